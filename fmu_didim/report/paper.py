"""Charts as PNG and SVG files for a paper, by Matplotlib."""

from __future__ import annotations

from pathlib import Path

import matplotlib

from fmu_didim.report.discovery.charts import saved_charts as charts_of_discovery
from fmu_didim.report.discovery.sections import discovery_report
from fmu_didim.report.drawing.figures import STYLE, matplotlib_figure
from fmu_didim.report.identification.charts import saved_charts as charts_of_result
from fmu_didim.report.identification.sections import result_report
from fmu_didim.results.findings import FINDINGS_FILE, load_findings
from fmu_didim.results.result import read_result

PATTERN = "figure_*"
"""Names of the files."""
DOTS = 300
"""[dots/inch] Resolution that journals ask for."""


def write_figures(folder: Path) -> list[Path]:
    """Write every chart of the page of a saved result, or of a saved discovery, as PNG and SVG beside it.

    Raises:
        InputError: there is neither, or a table that it names is missing.
    """
    if (folder / FINDINGS_FILE).is_file():
        found = load_findings(folder)
        report = discovery_report(found, charts_of_discovery(found, folder))
    else:
        result = read_result(folder)
        report = result_report(result, charts_of_result(result, folder))
    written = []
    with matplotlib.rc_context(STYLE):
        for chart in report.charts:
            figure = matplotlib_figure(chart)
            for suffix, options in ((".png", {"dpi": DOTS}), (".svg", {"metadata": {"Date": None}})):
                path = folder / f"{PATTERN.removesuffix('*')}{chart.name}{suffix}"
                figure.savefig(path, **options)
                written.append(path)
    return written
