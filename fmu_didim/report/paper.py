"""Charts as PNG and SVG files for a paper, by Matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fmu_didim.report.discovery import charts as discovery_charts
from fmu_didim.report.drawing.charts import Chart, Panel, Series
from fmu_didim.report.drawing.figures import COLOURS, DASHED
from fmu_didim.report.drawing.torque_charts import history_chart
from fmu_didim.report.identification import page
from fmu_didim.results.findings import FINDINGS_FILE, load_findings
from fmu_didim.results.result import read_result

PATTERN = "figure_*"
"""Names of the files."""
WIDTH, DOTS = 6.3, 300
"""Inches of a text column, and dots an inch."""
INCHES = 1 / 90
"""Of a pixel of a panel."""
STYLE: dict[Any, Any] = {
    "font.size": 8, "axes.titlesize": 8, "axes.titlelocation": "left", "axes.titleweight": "bold", "axes.grid": True,
    "grid.color": "#e5e7eb", "lines.linewidth": 1.0, "legend.frameon": False, "svg.fonttype": "none",
    "svg.hashsalt": "fmu_didim", "axes.spines.top": False, "axes.spines.right": False,
}  # fmt: skip


def write_figures(folder: Path) -> list[Path]:
    """Write every chart of the page of a saved result, or of a saved discovery, as PNG and SVG beside it.

    Raises:
        InputError: there is neither, or a table that it names is missing.
    """
    written = []
    with matplotlib.rc_context(STYLE):
        for chart in saved_charts(folder):
            figure = drawn(chart)
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
    result = read_result(folder)
    charts = [c for part in page.drawn_experiments(result, folder) for c in part.charts]
    return [*charts, history_chart(result.history)] if result.history else charts


def drawn(chart: Chart) -> Figure:
    """A chart as a Matplotlib figure."""
    heights = [panel.height for panel in chart.panels]
    figure = Figure((WIDTH, INCHES * sum(heights) + 0.25 * len(heights) + 0.6), layout="constrained")
    found = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)
    axes: Sequence[Axes] = list(found[:, 0])
    known: dict[str, Artist] = {}
    for axis, panel in zip(axes, chart.panels, strict=True):
        _panel(axis, panel, known)
    last = axes[-1]
    last.set_xlabel(chart.label)
    if chart.log:
        last.set_xscale("log")
    if chart.ticks:
        last.set_xticks([place for place, _ in chart.ticks], [text for _, text in chart.ticks], rotation=45, ha="right")
    if len(known) > 1:
        figure.legend(list(known.values()), list(known), loc="outside upper right", ncols=4)
    return figure


def _panel(axis: Axes, panel: Panel, known: dict[str, Artist]) -> None:
    if panel.log:
        axis.set_yscale("log")
    if panel.range is not None:
        axis.axhspan(*panel.range, color="#6b7280", alpha=0.15, linewidth=0)
    for level in panel.levels:
        axis.axhline(level, color="#9ca3af", linewidth=0.6)
    for series in sorted(panel.series, key=lambda s: s.kind == "points"):
        handle = _series(axis, series)
        if series.legend:
            known.setdefault(series.name, handle)
    axis.set_ylabel(panel.label)
    axis.set_title(panel.head)


def _series(axis: Axes, series: Series) -> Artist:
    colour = COLOURS[series.style]
    if series.band.size:
        axis.fill_between(
            series.x, series.y - series.band, series.y + series.band, color=colour, alpha=0.25, linewidth=0
        )
    if series.kind == "stems":
        return axis.vlines(series.x, np.zeros_like(series.y), series.y, color=colour, linewidth=1.6)
    if series.kind == "points":
        return axis.plot(series.x, series.y, ".", color=colour, markersize=3, markeredgewidth=0)[0]
    style = "--" if series.style in DASHED else "-"
    if series.error.size:
        shown = axis.errorbar(series.x, series.y, series.error, color=colour, linestyle=style, elinewidth=0.7)
        return shown.lines[0]
    return axis.plot(series.x, series.y, linestyle=style, color=colour)[0]
