"""Figures as data: ``chart.js`` draws them on a page, Matplotlib in a paper or a notebook.

A chart is a column of panels over one horizontal axis, so that the torques of all joints move together when one is
zoomed. A series states its meaning; each renderer chooses the colour.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from markupsafe import Markup

from fmu_didim.data.signals import Array

Kind = Literal["line", "points", "stems"]
STYLES = ("measured", "simulated", "residual", "base", "final", "failed", "faint")
"""Meanings of series; ``series0`` to ``series7`` have none but differ in colour."""
SERIES = 8
POINTS_PER_TRACE = 30_000
POINTS_PER_PAGE = 200_000
"""[points] At four bytes of text a point 0.8 MB of the 2 MB that a page may have."""
LEVELS = 65_534
"""[steps] Resolution of a value over its range: a fiftieth of a pixel."""


@dataclass(frozen=True)
class Series:
    """A line, points or stems of a panel.

    Attributes:
        x, y: (N,); NaN leaves a gap; x increases along a line.
        style: one of STYLES; error: (N,) half-width of an interval around y, or empty; band: the same as an area.
        legend: whether it has an entry; series of one name share it.
    """

    name: str
    x: Array
    y: Array
    style: str
    kind: Kind = "line"
    error: Array = field(default_factory=lambda: np.zeros(0))
    band: Array = field(default_factory=lambda: np.zeros(0))
    legend: bool = True


@dataclass(frozen=True)
class Panel:
    """One diagram of a chart.

    Attributes:
        head: above it, or empty; label: of its vertical axis, with the unit; height: px.
        range: (low, high) of a grey area in the background, such as two standard deviations of the noise; or None.
        levels: heights of dotted lines; log: whether its axis is logarithmic.
    """

    label: str
    series: Sequence[Series]
    head: str = ""
    height: int = 150
    range: tuple[float, float] | None = None
    levels: Sequence[float] = ()
    log: bool = False


@dataclass(frozen=True)
class Chart:
    """Panels below each other over one axis.

    Attributes:
        name: letters, digits and hyphens; part of its id on the page and of its file name; title: what it shows.
        label: of the horizontal axis; log: whether that is logarithmic; ticks: (place, text) for an axis of names.
    """

    name: str
    title: str
    panels: Sequence[Panel]
    label: str
    log: bool = False
    ticks: Sequence[tuple[float, str]] = ()


def decimated(time: Array, values: Array, limit: int) -> tuple[Array, Array]:
    """At most about ``limit`` points: the smallest and the largest value of each segment, in their order.

    Time and values are (N,); first and last point are kept.
    """
    count = time.size
    if count <= limit:
        return time, values
    edges = np.unique(np.linspace(0, count, max((limit - 2) // 2, 1) + 1).astype(np.int64))
    kept = {0, count - 1}
    for start, stop in pairwise(edges):
        piece = values[start:stop]
        kept |= {int(start + piece.argmin()), int(start + piece.argmax())}
    index = np.array(sorted(kept))
    return time[index], values[index]


def limited(chart: Chart, limit: int) -> Chart:
    """The chart with at most about ``limit`` points along each plain line."""

    def thinned(series: Series) -> Series:
        if series.x.size <= limit or series.kind != "line" or series.band.size or series.error.size:
            return series
        x, y = decimated(series.x, series.y, limit)
        return replace(series, x=x, y=y)

    panels = [replace(panel, series=[thinned(s) for s in panel.series]) for panel in chart.panels]
    return replace(chart, panels=panels)


def points_per_trace(charts: Sequence[Chart]) -> int:
    """Most points of a line so that the page of these charts stays small."""
    lines = sum(len(panel.series) for chart in charts for panel in chart.panels)
    return max(min(POINTS_PER_TRACE, POINTS_PER_PAGE // max(lines, 1)), 200)


def chart_json(chart: Chart) -> Markup:
    """The chart as JSON that is safe inside a script element; equal horizontal axes are written once."""
    axes: list[Array] = []
    panels = [_panel(panel, axes) for panel in chart.panels]
    content = {
        "title": chart.title, "label": chart.label, "log": chart.log, "ticks": list(chart.ticks), "panels": panels,
        "axes": [_axis(axis) for axis in axes],
    }  # fmt: skip
    return in_script(content)


def in_script(content: Any) -> Markup:
    """Content as JSON that is safe inside a script element."""
    text = json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))


def _panel(panel: Panel, axes: list[Array]) -> dict[str, Any]:
    return {
        "label": panel.label, "head": panel.head, "height": panel.height, "log": panel.log, "range": panel.range,
        "levels": list(panel.levels), "series": [_series(series, axes) for series in panel.series],
    }  # fmt: skip


def _series(series: Series, axes: list[Array]) -> dict[str, Any]:
    x = np.asarray(series.x, dtype=float)
    place = next((k for k, axis in enumerate(axes) if np.array_equal(axis, x)), len(axes))
    if place == len(axes):
        axes.append(x)
    found = {"name": series.name, "style": series.style, "kind": series.kind, "legend": series.legend, "x": place}
    found["y"] = _rounded(series.y)
    if series.error.size:
        found["error"] = _rounded(series.error)
    if series.band.size:
        found["band"] = _rounded(series.band)
    return found


def _axis(x: Array) -> dict[str, Any]:
    """Instants that are equally spaced to a hundredth of their step as three numbers, others as they are."""
    steps = np.diff(x)
    if x.size > 2 and np.isfinite(x).all() and np.abs(steps - steps.mean()).max() < 0.01 * abs(float(steps.mean())):
        return {"first": float(x[0]), "step": float(x[-1] - x[0]) / (x.size - 1), "count": int(x.size)}
    return {"floats": base64.b64encode(x.astype("<f4").tobytes()).decode()}


def _rounded(y: Array) -> dict[str, Any]:
    """Values (N,) in 16 bits each, over their range; values that are not finite, or too large to draw, become gaps.

    Values over many decades are written as floats, so that the smallest keep their digits on a logarithmic axis.
    """
    y = np.asarray(y, dtype=float)
    y = np.where(np.abs(y) <= np.finfo(np.float32).max, y, np.nan)
    finite = np.abs(y[np.isfinite(y)])
    if not finite.size or (finite > 0).sum() < 2 or finite[finite > 0].min() < finite.max() / 1e3 or y.size < 64:
        return {"floats": base64.b64encode(y.astype("<f4").tobytes()).decode()}
    low, high = float(np.nanmin(y)), float(np.nanmax(y))
    scale = (high - low) / LEVELS or 1.0
    steps = np.where(np.isfinite(y), np.round((y - low) / scale), LEVELS + 1).astype("<u2")
    return {"low": low, "scale": scale, "steps": base64.b64encode(steps.tobytes()).decode()}
