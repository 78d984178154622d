"""Charts over time: measured and simulated torque with the residual below, joint by joint; and the iterations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.report.drawing.charts import POINTS_PER_TRACE, SERIES, Chart, Panel, Series
from fmu_didim.report.numbers import item_or_none, percentage, pretty_unit, with_unit
from fmu_didim.results.result import IterationResult

TORQUE_HEIGHT, RESIDUAL_HEIGHT, HISTORY_HEIGHT = 190, 92, 150
INPUT_HEIGHT = 120
MOST_INPUTS = 12
"""[inputs] Of a model that are drawn."""
NAMED = 2
"""[inputs] That an axis names; all are in the legend."""
SHOWN = {"base model": "base", "final model": "final"}
"""Name of each of two models -> its style; a single model is ``simulated``."""


@dataclass(frozen=True)
class Simulated:
    """The torque of a model at the samples of the log, and if known at every tick.

    Attributes:
        at_samples: (N, n); time, torque: (K,) s and (K, n) at the control rate, or None.
    """

    at_samples: Array
    time: Array | None = None
    torque: Array | None = None

    def drawn(self, samples: Array, joint: int) -> tuple[Array, Array]:
        """Instants and torques of a joint, counted from 0, at every tick if known, else at the samples (N,)."""
        if self.time is None or self.torque is None:
            return samples, self.at_samples[:, joint]
        inside = (self.time >= samples[0]) & (self.time <= samples[-1])
        return self.time[inside], self.torque[inside, joint]


def torque_chart(
    name: str,
    title: str,
    time: Array,
    measured: Array,
    models: Mapping[str, Simulated],
    units: Sequence[str],
    *,
    percent: Sequence[float | None] = (),
    noise: Sequence[float | None] = (),
    names: Sequence[str] = (),
    inputs: Sequence[DrawnInput] = (),
) -> Chart:
    """Measured torque as points, simulated torque as a line, the residual below, with two sigma of the noise.

    Args:
        time: (N,) s; measured: (N, n); models: one or two, by name; units: (n,) FMI units of the joints.
        percent, noise: relative error and standard deviation of each joint, if known.
        names: (n,) of the outputs of a model, where those stand in the place of joints; inputs: of it, drawn above.
    """
    panels = input_panels(inputs)
    for j, unit in enumerate(units):
        error, band = item_or_none(percent, j), item_or_none(noise, j)
        head = (names[j] if names else f"Joint {j + 1}") + (
            f", relative error {percentage(error)}" if error is not None else ""
        )
        torques = [Series("measured", time, measured[:, j], "measured", "points")]
        residuals = []
        for model, found in models.items():
            is_one = len(models) == 1
            torques.append(Series(model, *found.drawn(time, j), "simulated" if is_one else SHOWN.get(model, "final")))
            left = "residual" if is_one else model
            style = "residual" if is_one else SHOWN.get(model, "final")
            residuals.append(Series(left, time, measured[:, j] - found.at_samples[:, j], style, legend=is_one))
        quantity = names[j] if names else "force" if unit == "N" else "torque"
        panels += _panels(quantity, pretty_unit(unit), head, torques, residuals, band)
    return Chart(name, title, panels, "time (s)")


@dataclass(frozen=True)
class DrawnInput:
    """An input of a model over time: (N,) s and values in its unit."""

    name: str
    unit: str
    time: Array
    values: Array


def input_panels(inputs: Sequence[DrawnInput]) -> list[Panel]:
    """The inputs of a model, those of one unit in one panel; some tell most, and there may be hundreds."""
    panels, by_unit = list[Panel](), dict[str, list[DrawnInput]]()
    for one in inputs[:MOST_INPUTS]:
        by_unit.setdefault(pretty_unit(one.unit), []).append(one)
    colours = iter(range(MOST_INPUTS))
    for unit, group in by_unit.items():
        drawn = [Series(one.name, one.time, one.values, f"series{2 + next(colours) % (SERIES - 2)}") for one in group]
        left = len(inputs) - MOST_INPUTS
        head = "Inputs" + (f", the first {MOST_INPUTS} of {len(inputs)}" if left > 0 else "") if not panels else ""
        panels.append(Panel(with_unit(", ".join(one.name for one in group[:NAMED]), unit), drawn, head, INPUT_HEIGHT))
    return panels


@dataclass(frozen=True)
class DrawnChannel:
    """A signal beside the torque over time: (N,) s, measured and simulated, its error in per cent of what it moves,
    and the standard deviation of its noise, if known."""

    name: str
    unit: str
    time: Array
    measured: Array
    simulated: Array
    percent: float | None
    noise: float | None


def channel_chart(name: str, title: str, channels: Sequence[DrawnChannel], what: str = "its motion") -> Chart:
    """Signals measured beside the torque as points, simulated as a line, the residual below; ``what``: that errors are
    related to."""
    panels = []
    for c in channels:
        head = c.name + (f", error {percentage(c.percent)} of {what}" if c.percent is not None else "")
        drawn = [
            Series("measured", c.time, c.measured, "measured", "points"),
            Series("simulated", c.time, c.simulated, "simulated"),
        ]
        left = [Series("residual", c.time, c.measured - c.simulated, "residual", legend=True)]
        panels += _panels(c.name, pretty_unit(c.unit), head, drawn, left, c.noise)
    return Chart(name, title, panels, "time (s)")


def _panels(
    quantity: str, unit: str, head: str, drawn: list[Series], residuals: list[Series], deviation: float | None
) -> list[Panel]:
    """A signal over its residual, with two standard deviations of the noise."""
    noisy = None if deviation is None else (-2 * deviation, 2 * deviation)
    return [
        Panel(with_unit(quantity, unit), drawn, head, TORQUE_HEIGHT),
        Panel(with_unit("residual", unit), residuals, height=RESIDUAL_HEIGHT, range=noisy, levels=(0.0,)),
    ]


def history_chart(history: Sequence[IterationResult], quantity: str = "torque") -> Chart:
    """Relative error and change of the values by iteration; iterations with a note are crosses at the top."""
    ticks = [(float(k), f"{it.stage} {it.number}") for k, it in enumerate(history, start=1)]
    place = np.array([k for k, _ in ticks])
    panels: list[Panel] = []
    for label, values in (
        (f"{quantity} error (%)", [it.relative_error_percent for it in history]),
        ("change of the values", [it.change for it in history]),
    ):
        y = np.array([np.nan if v is None or v <= 0 else v for v in values])
        known = y[np.isfinite(y)]
        is_log = bool(known.size and known.max() > 10 * known.min())
        series = [Series(label.partition(" (")[0], place, y, "simulated")]
        failed = np.array([bool(it.note) for it in history])
        if failed.any() and not panels:
            top = np.where(np.isfinite(y[failed]), y[failed], known.max() if known.size else 100.0)
            series.append(Series("with a note", place[failed], top, "failed", "points"))
        panels.append(Panel(label, series, height=HISTORY_HEIGHT, log=is_log))
    title = f"{quantity.capitalize()} error and change of the values by iteration"
    return Chart("iterations", title, panels, "iteration", ticks=ticks)


def samples_text(time: Array) -> str:
    """Number and duration of (N,) samples, and how so many are drawn that no screen shows them."""
    thinned = (
        "; lines go through the smallest and the largest value of each piece" if time.size > POINTS_PER_TRACE else ""
    )
    return f"{time.size} samples over {time[-1] - time[0]:.6g} s{thinned}"
