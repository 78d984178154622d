"""The figures of the page, as Plotly JSON: torque against time, and the iterations."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
import plotly.graph_objects as go
from markupsafe import Markup
from plotly.subplots import make_subplots

from fmu_didim.identification.result import IterationResult
from fmu_didim.report.numbers import at, percentage, pretty_unit
from fmu_didim.signals import Array

MEASURED, MEASURED_DENSE, SIMULATED, RESIDUAL, FAILED = "#374151", "#a3acb9", "#0072b2", "#d55e00", "#b42318"
MARKERS_UP_TO = 1500
"""With more points, measured torque is drawn as a line."""
POINTS_PER_TRACE = 20_000
POINTS_PER_PAGE = 120_000
"""18 bytes of text a point: 2.2 MB beside the 4.8 MB of plotly.js."""
FONT = {"family": "system-ui, 'Segoe UI', Roboto, 'Liberation Sans', Arial, sans-serif", "size": 13, "color": "#1f2937"}
TORQUE_HEIGHT, RESIDUAL_HEIGHT = 200, 85
GAP_BELOW_TORQUE, GAP_BELOW_JOINT = 10, 62
FRAME = {"gridcolor": "#e5e7eb", "zeroline": True, "zerolinecolor": "#9ca3af", "zerolinewidth": 1, "showline": True,
         "linecolor": "#9ca3af", "mirror": True, "ticks": "outside", "tickcolor": "#9ca3af"}  # fmt: skip
"""What all axes of a figure have in common."""
AXIS_TITLE = {"font": {"size": 12}, "standoff": 10}
MARGIN = {"l": 84, "r": 16, "t": 66, "b": 48}
SENDS_DATA = ("sendChartToCloud", "sendDataToCloud")
"""Buttons of plotly.js that upload the data of a figure: on no page of ours, and in no figure shown elsewhere."""
WHITE = {"font": FONT, "plot_bgcolor": "white", "paper_bgcolor": "white", "modebar": {"remove": list(SENDS_DATA)}}


def decimated(time: Array, values: Array, limit: int) -> tuple[Array, Array]:
    """At most about ``limit`` points: the smallest and the largest value of each stretch, in their order.

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


def points_per_trace(traces: int) -> int:
    """How many points a trace may have when a page holds that many traces."""
    return max(min(POINTS_PER_TRACE, POINTS_PER_PAGE // max(traces, 1)), 200)


def signals_note(time: Array, limit: int) -> str:
    """What to say of signals at (N,) instants of which a trace has that many points at most."""
    note = f"{time.size} samples over {time[-1] - time[0]:.6g} s"
    return note + (f"; drawn by the extremes of {(limit - 2) // 2} stretches" if time.size > limit else "")


def torque_figure(
    time: Array,
    measured: Array,
    simulated: Mapping[str, Array],
    units: Sequence[str],
    *,
    percent: Sequence[float | None] = (),
    limit: int = POINTS_PER_TRACE,
) -> go.Figure:
    """Measured and simulated torque with the residual below, joint by joint over one time axis.

    Args:
        time: (N,) s; measured: (N, n); simulated: name of each model -> (N, n), at most two.
        units: (n,) FMI units of the joints; percent: (n,) relative errors; limit: points a trace.
    """
    rows = []
    for j, unit in enumerate(units, start=1):
        torque, residual = _traces(measured[:, j - 1], {k: v[:, j - 1] for k, v in simulated.items()})
        error = at(percent, j - 1)
        head = f"<b>Joint {j}</b>" + (f"   relative error {percentage(error)}" if error is not None else "")
        quantity = "force" if unit == "N" else "torque"
        rows.append(Row(j, quantity, pretty_unit(unit), torque, TORQUE_HEIGHT, GAP_BELOW_TORQUE, 7, head))
        rows.append(Row(j, "residual", pretty_unit(unit), residual, RESIDUAL_HEIGHT, GAP_BELOW_JOINT, 5))
    return over_time(time, rows, MARGIN, limit)


Trace = tuple[str, str, Array, dict[str, Any]]
"""Name, group in the legend, values (N,) and style of a line."""


def _traces(measured: Array, simulated: Mapping[str, Array]) -> tuple[list[Trace], list[Trace]]:
    """Torques and residuals of one joint; of two models each has one colour and one entry in the legend."""
    mode = "markers" if measured.size <= MARKERS_UP_TO else "lines"
    dots = {"mode": mode, "marker": {"color": MEASURED, "size": 5}, "line": {"color": MEASURED_DENSE, "width": 1}}
    torques: list[Trace] = [("measured", "measured", measured, dots)]
    residuals: list[Trace] = []
    one = len(simulated) == 1
    colours = ((SIMULATED, RESIDUAL),) if one else ((RESIDUAL, RESIDUAL), (SIMULATED, SIMULATED))
    for (name, torque), (wide, thin) in zip(simulated.items(), colours, strict=False):
        residual, group = ("residual", "residual") if one else (f"residual of the {name}", name)
        torques.append((name, name, torque, line(wide, 1.6)))
        residuals.append((residual, group, measured - torque, line(thin, 1)))
    return torques, residuals


def line(colour: str, width: float) -> dict[str, Any]:
    """The style of a line."""
    return {"mode": "lines", "line": {"color": colour, "width": width}}


@dataclass(frozen=True)
class Row:
    """One quantity of a joint, counted from 1, in a figure over time.

    Attributes:
        title, unit: of its axis; height, gap: px of it and below it; ticks: about so many; head: what stands above it.
    """

    joint: int
    title: str
    unit: str
    traces: Sequence[Trace]
    height: int
    gap: int
    ticks: int
    head: str = ""


def over_time(time: Array, rows: Sequence[Row], margin: Mapping[str, int], limit: int) -> go.Figure:
    """Rows below each other over one axis of (N,) instants in s, with at most about ``limit`` points a trace."""
    figure = go.Figure()
    domains, height = stacked([row.height for row in rows], [row.gap for row in rows[:-1]])
    known: set[str] = set()
    for k, row in enumerate(rows):
        axis = axis_of_row(k)
        for name, group, values, style in row.traces:
            x, y = decimated(time, values, limit)
            figure.add_scatter(
                x=x, y=y.astype(np.float32), name=name, legendgroup=group, xaxis="x", yaxis=f"y{axis}", **style,
                showlegend=name == group and name not in known,
                hovertemplate=f"%{{y:.4g}} {row.unit}<extra>{name} {row.joint}</extra>",
            )  # fmt: skip
            known.add(name)
        title = AXIS_TITLE | {"text": f"{row.title} ({row.unit})"}
        own = FRAME | {"anchor": "x", "domain": domains[k], "nticks": row.ticks, "title": title}
        figure.update_layout({f"yaxis{axis}": own})
        if row.head:
            add_head(figure, row.head, domains[k][1])
    last = {"anchor": f"y{axis_of_row(len(rows) - 1)}", "mirror": "all", "title": AXIS_TITLE | {"text": "time (s)"}}
    figure.update_layout(xaxis=FRAME | last, hovermode="x unified")
    finish(figure, height, margin)
    return figure


def axis_of_row(row: int) -> str:
    """What follows ``x`` or ``y`` in the name of an axis of this row, from 0."""
    return "" if row == 0 else str(row + 1)


def stacked(heights: Sequence[int], gaps: Sequence[int]) -> tuple[list[tuple[float, float]], int]:
    """The stretch of each row from the top down, as shares of the plot, and the height of the plot in px.

    Args:
        heights: px of each row; gaps: px below each but the last one.
    """
    total = sum(heights) + sum(gaps)
    tops = [total - above for above in accumulate((h + g for h, g in zip(heights, gaps, strict=False)), initial=0)]
    return [((top - height) / total, top / total) for top, height in zip(tops, heights, strict=True)], total


def add_head(figure: go.Figure, text: str, top: float) -> None:
    """A text above a row whose upper end is there."""
    figure.add_annotation(
        text=text, x=0, y=top, xref="paper", yref="paper", xanchor="left", yanchor="bottom", showarrow=False
    )


def finish(figure: go.Figure, plot_height: int, margin: Mapping[str, int]) -> None:
    """Size and legend of a figure whose plot has this height."""
    height = plot_height + margin["t"] + margin["b"]
    figure.update_layout(
        height=height, margin=margin, showlegend=True, **WHITE,
        legend={"orientation": "h", "x": 0, "xanchor": "left", "y": 1 - 8 / height, "yanchor": "top",
                "yref": "container", "itemsizing": "constant"},
    )  # fmt: skip


def history_figure(history: Sequence[IterationResult]) -> go.Figure:
    """Relative torque error and change of the parameters by iteration, logarithmic; failures are crosses."""
    ticks = [html.escape(f"{it.stage} {it.number}") for it in history]
    positions = list(range(1, len(history) + 1))
    figure = make_subplots(rows=1, cols=2, horizontal_spacing=0.12)
    columns = (
        ("relative torque error (%)", [it.relative_error_percent for it in history]),
        ("relative change of the step", [it.change for it in history]),
    )
    for column, (title, values) in enumerate(columns, start=1):
        y = [v if v is not None and v > 0 else None for v in values]
        figure.add_scatter(
            x=positions, y=y, mode="lines+markers", row=1, col=column, showlegend=False, connectgaps=False,
            line={"color": SIMULATED}, marker={"size": 8}, text=ticks, hovertemplate="%{text}: %{y:.4g}<extra></extra>",
        )  # fmt: skip
        figure.update_yaxes(title=AXIS_TITLE | {"text": title}, row=1, col=column, **_scale(y))
        figure.update_xaxes(
            tickvals=positions, ticktext=ticks, row=1, col=column, range=[0.5, len(history) + 0.5], tickangle=-45
        )
    failed = [(k, it) for k, it in zip(positions, history, strict=True) if it.note]
    if failed:
        known = [v for v in columns[0][1] if v]
        figure.add_scatter(
            x=[k for k, _ in failed], y=[it.relative_error_percent or max(known, default=100.0) for _, it in failed],
            mode="markers", marker={"symbol": "x", "size": 11, "color": FAILED}, row=1, col=1, showlegend=False,
            text=[html.escape(it.note) for _, it in failed], hovertemplate="%{text}<extra></extra>",
        )  # fmt: skip
    figure.update_xaxes(FRAME | {"zeroline": False, "gridcolor": "#f3f4f6"})
    figure.update_yaxes(FRAME | {"zeroline": False})
    figure.update_layout(height=330, margin={"l": 70, "r": 16, "t": 40, "b": 80}, **WHITE)
    return figure


def _scale(values: Sequence[float | None]) -> dict[str, object]:
    """A logarithmic axis with a tick a decade, or a linear one where there is less than a decade."""
    known = [v for v in values if v]
    decades = float(np.log10(max(known) / min(known))) if known else 0.0
    if decades < 1:
        return {"type": "linear"}
    return {"type": "log", "exponentformat": "e", "dtick": int(max(1, decades // 5))}


def figure_json(figure: go.Figure) -> Markup:
    """JSON that is safe inside a script element."""
    figure.update_layout(template="none")
    text = str(figure.to_json())
    return Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))


@dataclass(frozen=True)
class Plots:
    """One experiment on a page: its title, what to say of it, its figure over time, and others."""

    title: str
    note: str
    over_time: Markup
    others: Sequence[Markup] = ()
