"""The charts of an identification: torque and residual of each experiment whose torque was saved."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fmu_didim.data.signals import Trajectory
from fmu_didim.data.tables import read_trajectory
from fmu_didim.report import experiments
from fmu_didim.report.drawing.charts import Chart
from fmu_didim.report.drawing.residual import Residual
from fmu_didim.report.drawing.residual_charts import QUANTITIES
from fmu_didim.report.drawing.skeleton import Skeleton, skeleton
from fmu_didim.report.drawing.torque_charts import (
    DrawnChannel,
    DrawnInput,
    Simulated,
    channel_chart,
    samples_text,
    torque_chart,
)
from fmu_didim.report.experiment_charts import ExperimentCharts
from fmu_didim.report.identification.display import in_display_units, table_in_display_units
from fmu_didim.results.result import ResultDocument

MOST_INPUTS = 5
"""[inputs] Of a model over which each residual is drawn."""
DRAWN_OVER = ("velocity", "position")
"""Quantities over which the residual is drawn."""


def saved_charts(
    document: ResultDocument, directory: Path, tables: Mapping[str, Trajectory] | None = None
) -> list[ExperimentCharts]:
    """The charts of each experiment.

    Args:
        tables: that need not be read, by their files.

    Raises:
        InputError: a table of torques that the result names is missing.
    """
    known = tables or {}

    def table(file: str) -> Trajectory:
        return table_in_display_units(
            document, file, known[file] if file in known else read_trajectory(directory / file)
        )

    document = in_display_units(document)
    found = []
    for number, (label, file) in enumerate(document.signals.items(), start=1):
        signals = table(file)
        every = document.simulated.get(label)
        dense = table(every) if every is not None else None
        drawn = _experiment(document, label, number, signals, dense)
        found.append(replace(drawn, channels=_channels(document, label, number, table)))
    return found


def _channels(document: ResultDocument, label: str, number: int, table: Callable[[str], Trajectory]) -> Chart | None:
    """The signals that were measured beside the torque in an experiment; None where there are none."""
    fitted = document.joint.channels if document.joint is not None else {}
    drawn = []
    for name, error in document.experiments[label].channels.items():
        signal = table(error.file)
        noise = fitted[name].noise_std if name in fitted else error.std
        drawn.append(
            DrawnChannel(
                name, error.unit, signal.time, signal.column("measured"), signal.column("simulated"),
                error.relative_error_percent, noise,
            )
        )  # fmt: skip
    what = "Outputs at instants of their own" if document.outputs else "Measured beside the torque"
    title = f"{what}, {experiments.experiment_title(document, label)}"
    moves = "what it moves" if document.outputs else "its motion"
    return channel_chart(f"channels-{number}", title, drawn, moves) if drawn else None


def _drawn_over(document: ResultDocument, signals: Trajectory, joint: int) -> list[str]:
    """Over what the residual of a joint, or an output, is drawn."""
    if document.outputs:
        moving = [name for name in document.inputs if name in signals.names and np.ptp(signals.column(name)) > 0]
        return [document.table_columns[joint - 1][1], *moving[:MOST_INPUTS]]
    return [name for name in DRAWN_OVER if f"{QUANTITIES[name].column}{joint}" in signals.names]


def _experiment(
    document: ResultDocument, label: str, number: int, signals: Trajectory, dense: Trajectory | None
) -> ExperimentCharts:
    units, names, pairs = document.torque_unit, document.outputs, document.table_columns
    joints = range(1, len(units) + 1)
    measured, simulated = (signals.select([pair[k] for pair in pairs]) for k in (0, 1))
    model = Simulated(simulated, *((dense.time, dense.values) if dense is not None else (None, None)))
    error = document.relative_error_percent.get(label)
    title = experiments.experiment_title(document, label)
    drawn = [DrawnInput(name, unit, dense.time, dense.column(name))
             for name, unit in document.inputs.items() if dense is not None and name in dense.names]  # fmt: skip
    what = "Outputs" if names else "Torque"
    torque = torque_chart(
        f"{document.quantity}-{number}", f"{what}, {title}", signals.time, measured, {"simulated": model}, units,
        percent=error.per_joint if error is not None else (), noise=document.noise_std, names=names, inputs=drawn,
    )  # fmt: skip
    residual = Residual(
        str(number), title, signals, units,
        [{"residual": ("residual", (measured - simulated)[:, j - 1])} for j in joints],
        [_drawn_over(document, signals, j) for j in joints], names=names,
        further={**dict(zip((simulated for _, simulated in pairs), units, strict=True)), **document.inputs},
    )  # fmt: skip
    return ExperimentCharts(
        title,
        samples_text(signals.time),
        torque,
        residual,
        skeleton=_skeleton(document, str(number), title, signals, pairs),
    )


def _skeleton(
    document: ResultDocument, number: str, title: str, signals: Trajectory, pairs: Sequence[tuple[str, str]]
) -> Skeleton | None:
    """The robot along the motion of an experiment; None where its geometry or its positions are not known."""
    geometry, places = document.geometry, [f"q{j}" for j in range(1, len(pairs) + 1)]
    if geometry is None or len(geometry.links) != len(places) or not set(places) <= set(signals.names):
        return None
    measured, simulated = (signals.select([pair[k] for pair in pairs]) for k in (0, 1))
    deviation = (measured - simulated).std(axis=0)
    size = np.abs(measured - simulated) / np.where(deviation > 0, deviation, np.inf)
    return skeleton(
        f"skeleton-{number}", f"The robot, {title}", geometry.links, geometry.gravity, signals.time,
        signals.select(places), size.max(axis=1),
    )  # fmt: skip
