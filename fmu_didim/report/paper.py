"""Charts as PNG and SVG files for a paper, by Matplotlib."""

from __future__ import annotations

from pathlib import Path

import matplotlib

from fmu_didim.report.discovery import charts as discovery_charts
from fmu_didim.report.drawing.charts import Chart
from fmu_didim.report.drawing.figures import STYLE, matplotlib_figure
from fmu_didim.report.drawing.torque_charts import history_chart
from fmu_didim.report.identification import page
from fmu_didim.results.findings import FINDINGS_FILE, load_findings
from fmu_didim.results.result import load_result

PATTERN = "figure_*"
"""Names of the files."""
DOTS = 300
"""[dots/inch] Resolution that journals ask for."""


def write_figures(folder: Path) -> list[Path]:
    """Write every chart of the page of a saved result, or of a saved discovery, as PNG and SVG beside it.

    Raises:
        InputError: there is neither, or a table that it names is missing.
    """
    written = []
    with matplotlib.rc_context(STYLE):
        for chart in saved_charts(folder):
            figure = matplotlib_figure(chart)
            for suffix, options in ((".png", {"dpi": DOTS}), (".svg", {"metadata": {"Date": None}})):
                path = folder / f"{PATTERN.removesuffix('*')}{chart.name}{suffix}"
                figure.savefig(path, **options)
                written.append(path)
    return written


def saved_charts(folder: Path) -> list[Chart]:
    """The charts of a folder of results."""
    if (folder / FINDINGS_FILE).is_file():
        found = load_findings(folder)
        parts = discovery_charts.drawn_experiments(found, folder)
        return [*(c for part in parts for c in part.charts), *discovery_charts.friction_charts(found)]
    result = load_result(folder)
    charts = [c for part in page.drawn_experiments(result, folder) for c in part.charts]
    return [*charts, history_chart(result.history)] if result.history else charts
