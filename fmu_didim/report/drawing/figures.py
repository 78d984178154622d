"""A chart as a Matplotlib figure, for notebooks and papers."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from typing import Any

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fmu_didim.report.drawing.charts import Chart, Panel, Series

COLOURS = {
    "measured": "#374151", "simulated": "#0072b2", "residual": "#d55e00", "base": "#d55e00", "final": "#0072b2",
    "failed": "#b42318", "faint": "#9aa3b0", "series0": "#0072b2", "series1": "#d55e00", "series2": "#009e73",
    "series3": "#cc79a7", "series4": "#e69f00", "series5": "#56b4e9", "series6": "#7a3db8", "series7": "#444444",
}  # fmt: skip
"""Okabe and Ito's palette, which colour-blind readers can tell apart."""
DASHED = ("base", "series1", "series5")
WIDTH = 6.3
"""[inch] Width of a text column."""
INCHES = 1 / 90
"""[inch] Height of a pixel of a panel."""
DOTS_IN_NOTEBOOK = 120
"""[dots/inch] A figure is then 756 pixels wide, which fits a notebook cell."""
STYLE: dict[Any, Any] = {
    "font.size": 8, "axes.titlesize": 8, "axes.titlelocation": "left", "axes.titleweight": "bold", "axes.grid": True,
    "grid.color": "#e5e7eb", "lines.linewidth": 1.0, "legend.frameon": False, "svg.fonttype": "none",
    "svg.hashsalt": "fmu_didim", "axes.spines.top": False, "axes.spines.right": False,
}  # fmt: skip


class NotebookFigure(Figure):
    """A figure that a notebook shows by itself, without ``pyplot`` and its list of open figures."""

    def _repr_png_(self) -> bytes:
        stream = BytesIO()
        self.savefig(stream, format="png", dpi=DOTS_IN_NOTEBOOK)
        return stream.getvalue()


def matplotlib_figure(chart: Chart) -> Figure:
    """The panels of a chart below each other over one axis, with each entry of the legend once."""
    with matplotlib.rc_context(STYLE):
        return _figure(chart)


def _figure(chart: Chart) -> Figure:
    heights = [panel.height for panel in chart.panels]
    size = (WIDTH, INCHES * sum(heights) + 0.25 * len(heights) + 0.6)
    figure = NotebookFigure(size, layout="constrained")
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
    if panel.log and any((series.y > 0).any() for series in panel.series):
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
        zero = np.zeros_like(series.y)
        return axis.vlines(series.x, zero, series.y, color=colour, linewidth=1.6, label=series.name)
    if series.kind == "points":
        marks: dict[str, Any] = {"markersize": 3, "markeredgewidth": 0}
        return axis.plot(series.x, series.y, ".", color=colour, label=series.name, **marks)[0]
    if series.error.size:
        axis.errorbar(series.x, series.y, series.error, color=colour, linestyle="none", elinewidth=0.7)
    style = "--" if series.style in DASHED else "-"
    return axis.plot(series.x, series.y, linestyle=style, color=colour, label=series.name)[0]
