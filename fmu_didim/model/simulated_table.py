"""A simulated experiment as a table: at every control period, and its motion at the samples of the log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmu_didim.data.signals import Array, Trajectory, Variable
from fmu_didim.model.loop_model import Simulation

ROUNDING = 1e-6
"""[1] Of a step by which an instant of a recording may lie beside that of its inputs."""


def simulated_table(
    run: Simulation, *, motion: Sequence[str] = ("q", "dq"), sampled: bool = False, alone: bool = False
) -> Trajectory:
    """Torque ``tau<j>`` (N.m or N) and motion of an experiment, a row a control period; of a model alone its outputs
    that were measured together, and its inputs.

    Args:
        motion: of ``q``, ``dq``, ``ddq`` (rad or m, per s, per s2); those that the plant does not give are left out.
        sampled: give it at the ticks, as a logger shows it, not where the torque of a delayed loop acts.
        alone: nobody asks for more of this run afterwards, so that nothing else of it is recorded, nor computed for
            that: accelerations take longer than a step of the plant.

    Raises:
        SimulationError: the loop cannot be simulated.
    """
    model = run.model
    offered = {f"{model.loop.plant_name}.{v.name}" for v in model.loop.plant.outputs}
    given = [name for name in motion if set(model.loop.joint_signals(name)) <= offered]
    asked = [*model.loop.logged, *(signal for name in given for signal in model.loop.joint_signals(name))]
    recording = run.record(all_ticks=True, signals=asked if alone and model.loop.shows_torque else None)
    if not model.loop.shows_torque:
        reference = run.experiment.reference
        rows = np.searchsorted(reference.time, recording.time - ROUNDING * run.step_size)
        inputs = reference.values[np.minimum(rows, reference.time.size - 1)]
        units = model.parameters.torque_units
        names = [Variable(name, unit) for name, unit in zip(model.loop.output_names, units, strict=True)]
        return Trajectory(
            recording.time, np.column_stack([run.logged_torque(recording), inputs]), (*names, *reference.variables)
        )  # fmt: skip
    joints = range(1, model.joint_count + 1)
    columns = [run.logged_torque(recording)]
    variables = [Variable(f"tau{j}") for j in joints]
    for name in given:
        columns.append(recording.table(model.loop.joint_signals(name), sampled=sampled))
        variables += [Variable(f"{name}{j}") for j in joints]
    return Trajectory(recording.time, np.column_stack(columns), tuple(variables))


def motion_at_samples(run: Simulation, table: Trajectory) -> dict[str, Array]:
    """Positions ``q<j>`` and velocities ``dq<j>``, or the inputs of a model, at the tick before each sample of the log,
    (N,) each."""
    times = run.experiment.time - run.operator.lag * run.step_size
    place = np.clip(np.searchsorted(table.time, times + 1e-9, side="right") - 1, 0, table.time.size - 1)
    n = run.model.joint_count
    return {name: table.column(name)[place] for name in table.names[n:]}
