"""The figures of a discovery, as Plotly JSON: the gap, the residual over time, and over what it depends on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go

from fmu_didim.discovery.findings import FindingsDocument, GapPair
from fmu_didim.report.discovery_words import experiment_name
from fmu_didim.report.figures import AXIS_TITLE, FONT, FRAME, RESIDUAL, SIMULATED, decimated, figure_json
from fmu_didim.report.numbers import pretty_unit
from fmu_didim.signals import Array, Trajectory

BEFORE, AFTER = RESIDUAL, SIMULATED
STAGES = (("base model", "base", BEFORE), ("final model", "final", AFTER))
"""Name in a legend, column of the simulated torque, colour."""
NOISE_BAND = "rgba(107, 114, 128, 0.18)"
BINS = 24
SMALLEST_BIN = 5
"""Samples; with fewer the standard error says little."""
PANEL_HEIGHT, PANEL_GAP, BINNED_HEIGHT, GAP_HEIGHT = 150, 46, 210, 190
MARGIN = {"l": 74, "r": 14, "t": 62, "b": 46}


@dataclass(frozen=True)
class Quantity:
    """What a residual can be drawn against: its column without the joint number, and how its axis is called."""

    column: str
    title: str
    linear: str
    angular: str

    def unit(self, torque_unit: str) -> str:
        """The unit for a joint with this unit of torque."""
        return pretty_unit(self.linear if torque_unit == "N" else self.angular)


QUANTITIES = {
    "velocity": Quantity("dq", "velocity", "m/s", "rad/s"),
    "position": Quantity("q", "position", "m", "rad"),
    "torque": Quantity("base", "simulated torque of the base model", "N", "N.m"),
}
"""By their names in the regions of a discovery; those whose column a table of signals has."""
PANELS = 2


def gap_figure(document: FindingsDocument) -> str:
    """Gap before and after, over all joints and of each one, a row an experiment; 1: error as large as the noise."""
    labels, joints = list(document.gap), len(document.torque_unit)
    heads = ["all", *(f"joint {j + 1}" for j in range(joints))] if joints > 1 else ["joint 1"]
    figure = go.Figure()
    domains, height = _rows(len(labels), GAP_HEIGHT)
    for row, label in enumerate(labels):
        pair = document.gap[label]
        axis = "" if row == 0 else str(row + 1)
        for name, column, colour in STAGES if document.findings else STAGES[:1]:
            values = _bars(pair, column, joints)
            figure.add_bar(
                x=heads, y=values, name=name, legendgroup=name, showlegend=row == 0, marker={"color": colour},
                xaxis=f"x{axis}", yaxis=f"y{axis}", hovertemplate=f"%{{x}}: %{{y:.3g}}<extra>{name}</extra>",
                text=["" if v is None else f"{v:.2f}" for v in values], textposition="auto", textangle=0,
            )  # fmt: skip
        figure.add_shape(
            type="line", xref=f"x{axis} domain", yref=f"y{axis}", x0=0, x1=1, y0=1, y1=1,
            line={"dash": "dot", "color": "#6b7280", "width": 1.5},
        )  # fmt: skip
        figure.update_layout(
            {
                f"xaxis{axis}": FRAME | {"anchor": f"y{axis}", "ticks": ""},
                f"yaxis{axis}": FRAME | {"anchor": f"x{axis}", "domain": domains[row], "rangemode": "tozero",
                                         "nticks": 6, "title": AXIS_TITLE | {"text": "gap / noise"}},
            }
        )  # fmt: skip
        title = experiment_name(document, label)
        _head(figure, title[:1].upper() + title[1:], domains[row][1])
    _finish(figure, height)
    figure.update_layout(barmode="group", bargap=0.35, uniformtext={"mode": "hide", "minsize": 9})
    return figure_json(figure)


def _bars(pair: GapPair, column: str, joints: int) -> list[float | None]:
    total, each = (pair.before, pair.before_per_joint) if column == "base" else (pair.after, pair.after_per_joint)
    padded = [each[j] if j < len(each) else None for j in range(joints)]
    return [total, *padded] if joints > 1 else padded


def drawn_joints(signals: Trajectory, joints: int) -> list[int]:
    """The joints, from 1, whose measured torque and at least one simulated one the table holds."""
    names = set(signals.names)
    return [
        j for j in range(1, joints + 1) if f"measured{j}" in names and any(f"{c}{j}" in names for _, c, _ in STAGES)
    ]


def _residuals(signals: Trajectory, joint: int) -> list[tuple[str, str, Array]]:
    """Name, colour and measured - simulated torque of each model that the table holds."""
    known = {c: signals.column(f"{c}{joint}") for _, c, _ in STAGES if f"{c}{joint}" in signals.names}
    if len(known) > 1 and np.array_equal(known["base"], known["final"]):
        del known["final"]  # nothing was added: one line says it all
    measured = signals.column(f"measured{joint}")
    return [(name, colour, measured - known[column]) for name, column, colour in STAGES if column in known]


def residual_figure(signals: Trajectory, units: Sequence[str], noise: Sequence[float], *, limit: int) -> str:
    """Residual before and after over time, a row a joint, with the band of two standard deviations of the noise.

    Args:
        signals: columns ``measured<j>``, ``base<j>``, ``final<j>``; units, noise: (n,); limit: points a trace.
    """
    joints = drawn_joints(signals, len(units))
    figure = go.Figure()
    domains, height = _rows(len(joints), PANEL_HEIGHT)
    for row, j in enumerate(joints):
        axis, unit = "" if row == 0 else str(row + 1), pretty_unit(units[j - 1])
        for name, colour, values in _residuals(signals, j):
            x, y = decimated(signals.time, values, limit)
            figure.add_scatter(
                x=x, y=y.astype(np.float32), name=name, legendgroup=name, showlegend=row == 0, mode="lines",
                line={"color": colour, "width": 1.1}, xaxis="x", yaxis=f"y{axis}",
                hovertemplate=f"%{{y:.4g}} {unit}<extra>{name} {j}</extra>",
            )  # fmt: skip
        _band(figure, noise[j - 1] if j <= len(noise) else None, "x domain", f"y{axis}")
        title = AXIS_TITLE | {"text": f"residual ({unit})"}
        figure.update_layout(
            {f"yaxis{axis}": FRAME | {"anchor": "x", "domain": domains[row], "nticks": 6, "title": title}}
        )
        _head(figure, f"Joint {j}", domains[row][1])
    last = "" if len(joints) == 1 else str(len(joints))
    figure.update_layout(
        xaxis=FRAME | {"anchor": f"y{last}", "mirror": "all", "zeroline": False,
                       "title": AXIS_TITLE | {"text": "time (s)"}},
        hovermode="x unified",
    )  # fmt: skip
    _finish(figure, height)
    return figure_json(figure)


def panel_quantities(document: FindingsDocument, signals: Trajectory, joint: int) -> list[str]:
    """The quantities that a joint is drawn against: of its strongest regions first, then velocity and position."""
    ranked = sorted((r for r in document.regions if r.joint == joint), key=lambda r: -r.share_of_gap)
    wanted = dict.fromkeys([*(r.quantity for r in ranked if r.quantity in QUANTITIES), "velocity", "position"])
    return [name for name in wanted if f"{QUANTITIES[name].column}{joint}" in signals.names][:PANELS]


def binned_figure(signals: Trajectory, joint: int, quantity: str, torque_unit: str) -> str:
    """Mean residual before and after in bins of a quantity, with twice its standard error.

    The bins hold equally many samples. The error is s / sqrt(N) of the residuals in the bin, as if they were
    independent; model error and coloured noise make the true one larger.
    """
    kind, unit = QUANTITIES[quantity], pretty_unit(torque_unit)
    at = signals.column(f"{kind.column}{joint}")
    figure = go.Figure()
    for name, colour, values in _residuals(signals, joint):
        centre, mean, error = binned(at, values)
        figure.add_scatter(
            x=centre, y=mean, name=name, mode="lines+markers", line={"color": colour, "width": 1.4},
            marker={"size": 5}, error_y={"type": "data", "array": 2 * error, "thickness": 1.2, "width": 2},
            hovertemplate=f"%{{y:.4g}} {unit} at %{{x:.4g}} {kind.unit(torque_unit)}<extra>{name}</extra>",
        )  # fmt: skip
    figure.update_layout(
        xaxis=FRAME | {"title": AXIS_TITLE | {"text": f"{kind.title} ({kind.unit(torque_unit)})"}, "nticks": 8},
        yaxis=FRAME | {"title": AXIS_TITLE | {"text": f"mean residual ({unit})"}, "nticks": 7},
    )
    _head(figure, f"Joint {joint}, against {kind.title.partition(' of ')[0]}", 1.0)
    _finish(figure, _rows(1, BINNED_HEIGHT)[1])
    return figure_json(figure)


def binned(at: Array, values: Array, *, bins: int = BINS) -> tuple[Array, Array, Array]:
    """Centre, mean and standard error of the mean of (N,) values in bins of (N,) ``at`` with equally many samples."""
    edges = np.unique(np.quantile(at, np.linspace(0, 1, min(bins, max(at.size // SMALLEST_BIN, 1)) + 1)))
    if edges.size < 2:
        return at[:1], np.array([values.mean()]), np.zeros(1)
    place = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, edges.size - 2)
    count = np.bincount(place, minlength=edges.size - 1)
    full = np.maximum(count, 1)
    mean = np.bincount(place, values, minlength=count.size) / full
    centre = np.bincount(place, at, minlength=count.size) / full
    square = np.bincount(place, (values - mean[place]) ** 2, minlength=count.size)
    error = np.sqrt(square / np.maximum(count - 1, 1) / full)
    kept = count >= min(SMALLEST_BIN, at.size)
    return centre[kept], mean[kept], error[kept]


def _rows(count: int, panel: int) -> tuple[list[tuple[float, float]], int]:
    """The stretch of each row from the top down, as shares of the plot, and the height of the figure in px."""
    inner = max(count * panel + (count - 1) * PANEL_GAP, panel)
    tops = [inner - k * (panel + PANEL_GAP) for k in range(count)]
    return [(max((top - panel) / inner, 0.0), top / inner) for top in tops], inner + MARGIN["t"] + MARGIN["b"]


def _band(figure: go.Figure, sigma: float | None, xref: str, yref: str) -> None:
    if sigma is not None:
        figure.add_shape(
            type="rect", xref=xref, yref=yref, x0=0, x1=1, y0=-2 * sigma, y1=2 * sigma, fillcolor=NOISE_BAND,
            line={"width": 0}, layer="below",
        )  # fmt: skip


def _head(figure: go.Figure, text: str, top: float) -> None:
    figure.add_annotation(
        text=f"<b>{text}</b>", x=0, y=top, xref="paper", yref="paper", xanchor="left", yanchor="bottom", showarrow=False
    )


def _finish(figure: go.Figure, height: int) -> None:
    figure.update_layout(
        height=height, margin=MARGIN, font=FONT, plot_bgcolor="white", paper_bgcolor="white", showlegend=True,
        legend={"orientation": "h", "x": 0, "xanchor": "left", "y": 1 - 8 / height, "yanchor": "top",
                "yref": "container", "itemsizing": "constant"},
    )  # fmt: skip
