"""The figures of a discovery, as Plotly JSON: the gap, the residual over time, and over what it depends on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from markupsafe import Markup

from fmu_didim.discovery.findings import FindingsDocument, GapPair
from fmu_didim.report.discovery_words import experiment_name
from fmu_didim.report.figures import (
    AXIS_TITLE,
    FRAME,
    RESIDUAL,
    SIMULATED,
    Row,
    add_head,
    axis_of_row,
    figure_json,
    finish,
    line,
    over_time,
    stacked,
)
from fmu_didim.report.numbers import at, capitalised, pretty_unit
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


def gap_figure(document: FindingsDocument) -> Markup:
    """Gap before and after, over all joints and of each one, a row an experiment; 1: error as large as the noise."""
    labels, joints = list(document.gap), len(document.torque_unit)
    heads = ["all", *(f"joint {j + 1}" for j in range(joints))] if joints > 1 else ["joint 1"]
    figure = go.Figure()
    domains, height = stacked([GAP_HEIGHT] * len(labels), [PANEL_GAP] * (len(labels) - 1))
    for row, label in enumerate(labels):
        pair, axis = document.gap[label], axis_of_row(row)
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
        add_head(figure, f"<b>{capitalised(experiment_name(document, label))}</b>", domains[row][1])
    finish(figure, height, MARGIN)
    figure.update_layout(barmode="group", bargap=0.35, uniformtext={"mode": "hide", "minsize": 9})
    return figure_json(figure)


def _bars(pair: GapPair, column: str, joints: int) -> list[float | None]:
    total, each = (pair.before, pair.before_per_joint) if column == "base" else (pair.after, pair.after_per_joint)
    padded = [at(each, j) for j in range(joints)]
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


def residual_figure(signals: Trajectory, units: Sequence[str], noise: Sequence[float], *, limit: int) -> Markup:
    """Residual before and after over time, a row a joint, with the band of two standard deviations of the noise.

    Args:
        signals: columns ``measured<j>``, ``base<j>``, ``final<j>``; units, noise: (n,); limit: points a trace.
    """
    rows = []
    for j in drawn_joints(signals, len(units)):
        traces = [(name, name, values, line(colour, 1.1)) for name, colour, values in _residuals(signals, j)]
        unit = pretty_unit(units[j - 1])
        rows.append(Row(j, "residual", unit, traces, PANEL_HEIGHT, PANEL_GAP, 6, f"<b>Joint {j}</b>"))
    figure = over_time(signals.time, rows, MARGIN, limit)
    figure.update_layout(xaxis={"zeroline": False})
    for k, row in enumerate(rows):
        if row.joint <= len(noise):
            band = 2 * noise[row.joint - 1]
            figure.add_shape(
                type="rect", xref="x domain", yref=f"y{axis_of_row(k)}", x0=0, x1=1, y0=-band, y1=band,
                fillcolor=NOISE_BAND, line={"width": 0}, layer="below",
            )  # fmt: skip
    return figure_json(figure)


def panel_quantities(document: FindingsDocument, signals: Trajectory, joint: int) -> list[str]:
    """The quantities that a joint is drawn against: of its strongest regions first, then velocity and position."""
    ranked = sorted((r for r in document.regions if r.joint == joint), key=lambda r: -r.share_of_gap)
    wanted = dict.fromkeys([*(r.quantity for r in ranked if r.quantity in QUANTITIES), "velocity", "position"])
    return [name for name in wanted if f"{QUANTITIES[name].column}{joint}" in signals.names][:PANELS]


def binned_figure(signals: Trajectory, joint: int, quantity: str, torque_unit: str) -> Markup:
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
    add_head(figure, f"<b>Joint {joint}, against {kind.title.partition(' of ')[0]}</b>", 1.0)
    finish(figure, BINNED_HEIGHT, MARGIN)
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
