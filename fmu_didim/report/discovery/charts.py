"""The charts of a discovery: torque and residual of base and final model, over time and over the motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fmu_didim.data.signals import Trajectory
from fmu_didim.data.tables import read_trajectory
from fmu_didim.report.discovery import texts
from fmu_didim.report.drawing.charts import Chart, Panel, Series
from fmu_didim.report.drawing.residual import Residual
from fmu_didim.report.drawing.residual_charts import QUANTITIES
from fmu_didim.report.drawing.torque_charts import SHOWN, Simulated, samples_text, torque_chart
from fmu_didim.report.experiment_charts import ExperimentCharts
from fmu_didim.report.numbers import joint_unit, pretty_unit
from fmu_didim.results.findings import FindingsDocument

MODELS = {"base model": "base", "final model": "final"}
"""Name in a legend -> column of the simulated torque."""
PANELS = 2
FRICTION_HEIGHT = 240


def saved_charts(document: FindingsDocument, folder: Path) -> list[ExperimentCharts]:
    """The charts of each experiment whose torques were saved."""
    found: list[ExperimentCharts] = []
    for key, name in document.files.items():
        if key.startswith(texts.SIGNALS):
            label = key.removeprefix(texts.SIGNALS)
            every = document.files.get(f"{texts.SIMULATED}{label}")
            dense = read_trajectory(folder / every) if every is not None else None
            part = _experiment(document, label, len(found) + 1, read_trajectory(folder / name), dense)
            found += [part] if part is not None else []
    return found


def _experiment(
    document: FindingsDocument, label: str, number: int, signals: Trajectory, dense: Trajectory | None
) -> ExperimentCharts | None:
    units, joints = document.torque_unit, range(1, len(document.torque_unit) + 1)
    models = _models(signals, len(units))
    if not models:
        return None
    measured = signals.select([f"measured{j}" for j in joints])
    simulated = {}
    for model, column in models.items():
        names = [f"{column}{j}" for j in joints]
        every = (None, None) if dense is None else (dense.time, dense.select(names))
        simulated[model] = Simulated(signals.select(names), *every)
    title = texts.experiment_name(document, label)
    torque = torque_chart(
        f"{'outputs' if document.outputs else 'torque'}-{number}",
        f"{'Outputs' if document.outputs else 'Torque'}, {title}",
        signals.time,
        measured,
        simulated,
        units,
        noise=document.noise.std,
        names=document.outputs,
    )
    residual = Residual(
        str(number), title, signals, units,
        [
            {m: (SHOWN[m], measured[:, j - 1] - signals.column(f"{column}{j}")) for m, column in models.items()}
            for j in joints
        ],
        # Over the motion only for the data in which the regions were found.
        [panel_quantities(document, signals, j) if number == 1 and not document.outputs else [] for j in joints],
        names=document.outputs,
    )  # fmt: skip
    return ExperimentCharts(title, samples_text(signals.time), torque, residual)


def _models(signals: Trajectory, joints: int) -> dict[str, str]:
    """The models whose torque the table holds; of two equal ones the first."""
    names = set(signals.names)
    found = {
        m: c for m, c in MODELS.items() if {f"{s}{j}" for j in range(1, joints + 1) for s in (c, "measured")} <= names
    }
    if len(found) == 2 and all(
        np.array_equal(signals.column(f"base{j}"), signals.column(f"final{j}")) for j in range(1, joints + 1)
    ):
        del found["final model"]
    return found


def panel_quantities(document: FindingsDocument, signals: Trajectory, joint: int) -> list[str]:
    """The quantities of the charts of a joint: those of its strongest regions, then velocity and position."""
    ranked = sorted((r for r in document.regions if r.joint == joint), key=lambda r: -r.share_of_gap)
    wanted = dict.fromkeys([*(r.quantity for r in ranked if r.quantity in QUANTITIES), "velocity", "position"])
    return [name for name in wanted if f"{QUANTITIES[name].column}{joint}" in signals.names][:PANELS]


def friction_charts(document: FindingsDocument) -> list[Chart]:
    """The friction of base and final model over velocity, with the interval of the final one."""
    charts = []
    for found in document.friction:
        j, velocity = found.joint, np.array(found.velocity)
        series = [
            Series("base model", velocity, np.array(found.base), "base"),
            Series("final model, 95 %", velocity, np.array(found.final), "final", band=np.array(found.half_width)),
        ]
        unit = joint_unit(document.torque_unit, j - 1)
        panel = Panel(f"friction ({unit})", series, f"Joint {j}", FRICTION_HEIGHT)
        title = f"Friction of joint {j} over its velocity"
        charts.append(Chart(f"friction-{j}", title, [panel], f"velocity ({pretty_unit(found.unit)})"))
    return charts
