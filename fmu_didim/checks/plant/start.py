"""Check of a plant before a long computation: whether it starts where its reference starts.

    away = |y(t_0) - y_ref(t_0)|,   y a position or a velocity of a joint

A column of the reference need not be what its name says: it may be the voltage of a drive, and a drive whose speed is
controlled may start at rest though its reference does not. The command at t_0 follows from the reference and the start
alone, whatever the parameters are, so that a log that begins there shows whether the machine started as the plant does.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.cosim.system import REFERENCE
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.data.units import parse_unit
from fmu_didim.fit.log_noise import STANDSTILL
from fmu_didim.model.loop_model import LoopModel

START_TOLERANCE = 1e-3
"""[1] Distance of the plant from the start of the reference, as a fraction of its range, that is reported."""
SAME_TORQUE = 0.02
"""[1] Difference of the first torque of the log from that of the loop, as a fraction of the range of the log, up to
which they agree: noise of 1 % of the torque is less by three standard deviations. Twice of that must tell another
start."""
SAME_INSTANT = 0.01
"""[ticks] Distance of the first sample of the log from the first tick up to which it shows the command there."""
FOLLOWS = 0.5
"""[1] Error of a signal in the second half of a run, as a fraction of the deviation of a reference of unknown unit, up
to which it follows that reference."""

PLANT_START = CATALOGUE(
    "plant-start", DOUBT, rank=32,
    meaning="The plant does not start where the reference starts, so the simulation starts with a jump.",
    next_step="Name the start values of the plant: plant: {parameter_names: {q_start1: name in the plant}}, or start "
    "the reference where the plant stands.",
)  # fmt: skip


def start_diagnostics(model: LoopModel) -> list[Diagnostic]:
    """Joints whose plant starts elsewhere than the reference, where nobody says that they do (``initial_state:``), nor
    the log, and where the reference is one of that signal.

    Outputs after the step (``outputs_after_step``) are those at the end of the first step of the plant: its positions
    are compared with the reference there; its velocities, which a step at wrong values changes, are not.
    """
    reference, given = model.experiments[model.first].reference, model.experiments[model.first].initial_state.values
    plant, system = model.loop.plant_name, model.loop.systems[model.first]
    first_row = system.every.get(plant, 1) if plant in system.after_step else 0
    try:
        first = model.simulation(model.start).record(ticks=np.zeros(1, dtype=np.int64))
    except SimulationError:
        return []
    found = []
    compared = [("q", "q_start")] if first_row else [("q", "q_start"), ("dq", "dq_start")]
    for name, what in compared:
        for j, signal in enumerate(model.loop.joint_signals(name), start=1):
            if signal not in first.applied or f"{name}{j}" not in reference.names or f"{name}{j}" in given:
                continue
            column = reference.column(f"{name}{j}")
            at_start, wanted = float(first.applied[signal][0]), float(column[min(first_row, len(column) - 1)])
            bound, away = START_TOLERANCE * max(float(np.ptp(column)), STANDSTILL), abs(at_start - wanted)
            if away <= bound or not _is_of(model, f"{name}{j}") or _is_confirmed(model, j, f"{name}{j}", at_start):
                continue
            text = f"The plant starts at {name}{j} = {at_start:.4g} while the reference starts at {wanted:.4g}."
            step = (
                f"Name its start value: plant: {{parameter_names: {{{what}{j}: name in the plant}}}}, or start "
                "the reference where the plant stands."
            )
            found.append(Diagnostic(PLANT_START, text, f"plant: joint {j}", away, bound, next_step=step))
    return found


def _is_of(model: LoopModel, name: str) -> bool:
    """Whether a column of the reference is what the output of the plant of that name follows: by the unit in which the
    loop takes it, or by what the loop does where that is not known."""
    system = model.loop.systems[model.first]
    takers = [c.target.partition(".") for c in system.connections if c.source == f"{REFERENCE}.{name}"]
    units = {v.unit for owner, _, own in takers for v in system.components[owner].inputs if v.name == own}
    (unit,) = (v.unit for v in model.loop.plant.outputs if v.name == name)
    known, own = [parsed for u in units if u and (parsed := parse_unit(u))], parse_unit(unit) if unit else None
    if own is not None and known:
        return any(own.exponents == taken.exponents for taken in known)
    column = model.experiments[model.first].reference.column(name)
    try:
        run = model.simulation(model.start).record(all_ticks=True)
    except SimulationError:
        return True
    half = column.size // 2
    error = run.applied[f"{model.loop.plant_name}.{name}"][half : column.size] - column[half : run.time.size]
    return bool(np.sqrt(np.mean(error**2)) <= FOLLOWS * max(float(column.std()), STANDSTILL))


def _is_confirmed(model: LoopModel, joint: int, name: str, at_start: float) -> bool:
    """Whether the log begins with the command of a loop that starts where the plant does, and not with that of one that
    starts on its reference."""
    experiment, system = model.experiments[model.first], model.loop.systems[model.first]
    if abs(experiment.time[0] - experiment.reference.time[0]) > SAME_INSTANT * system.step_size:
        return False
    logged = experiment.torque[:, joint - 1]
    allowed = SAME_TORQUE * float(np.ptp(logged))
    here, there = (
        _first_command(model, reference, joint)
        for reference in (experiment.reference, _starting_at(experiment.reference, name, at_start))
    )
    return abs(float(logged[0]) - here) <= allowed and abs(there - here) > 2 * allowed


def _first_command(model: LoopModel, reference: Trajectory, joint: int) -> float:
    """The logged torque of a joint at the first tick along a reference."""
    label = model.first
    along = model.with_experiment(label, replace(model.experiments[label], reference=reference))
    run = along.simulation(along.start, label)
    return float(run.logged_torque(run.record(ticks=np.zeros(1, dtype=np.int64)))[0, joint - 1])


def _starting_at(reference: Trajectory, name: str, value: float) -> Trajectory:
    """A reference with another value of a column in its first row."""
    values: Array = reference.values.copy()
    values[0, reference.names.index(name)] = value
    return replace(reference, values=values)
