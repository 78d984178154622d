"""A simulated experiment as a table: at every control period, and its motion at the samples of the log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmu_didim.data.signals import Array, Trajectory, Variable
from fmu_didim.model.loop_model import Simulation


def simulated_table(run: Simulation, *, motion: Sequence[str] = ("q", "dq")) -> Trajectory:
    """Torque ``tau<j>`` (N.m or N) and motion of an experiment, a row a control period.

    Args:
        motion: of ``q``, ``dq``, ``ddq`` (rad or m, per s, per s2); those that the plant does not give are left out.

    Raises:
        SimulationError: the loop cannot be simulated.
    """
    recording, model = run.record(all_ticks=True), run.model
    joints = range(1, model.joint_count + 1)
    columns = [run.logged_torque(recording)]
    variables = [Variable(f"tau{j}") for j in joints]
    for name in motion:
        if set(model.loop.joint_signals(name)) <= set(recording.applied):
            columns.append(recording.table(model.loop.joint_signals(name)))
            variables += [Variable(f"{name}{j}") for j in joints]
    return Trajectory(recording.time, np.column_stack(columns), tuple(variables))


def motion_at_samples(run: Simulation, table: Trajectory) -> dict[str, Array]:
    """Positions ``q<j>`` and velocities ``dq<j>`` of a table at the tick before each sample of the log, (N,) each."""
    times = run.experiment.time - run.operator.lag * run.step_size
    place = np.clip(np.searchsorted(table.time, times + 1e-9, side="right") - 1, 0, table.time.size - 1)
    return {name: table.column(name)[place] for name in table.names if not name.startswith("tau")}
