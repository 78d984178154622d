"""A simulated motion with the torques that go with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from fmu_didim.base.tall import ROWS
from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array, Trajectory, periods
from fmu_didim.dynamics.effects import LINK_PARAMETERS, PAYLOAD
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.dynamics.robot.observed_states import NO_STARTS, following_links
from fmu_didim.model.loop_model import Simulation


@dataclass(frozen=True)
class Motion:
    """A simulated motion at ticks, and the torques that go with it.

    Attributes:
        time: (K,) s; q, dq, ddq: (K, n); torque: (K, n) logged torque; load: (K, n) transmitted torque of each joint,
            that of the links alone; step: s between ticks, which are equally spaced.
        links: joint (from 0) -> (K, n, 4) torque for one unit of each of PAYLOAD of its link.
        starts: of measured states, as of :class:`~fmu_didim.model.experiment.Experiment`.
    """

    time: Array
    q: Array
    dq: Array
    ddq: Array
    torque: Array
    load: Array
    step: float
    links: Mapping[int, Array]
    starts: Mapping[str, float] = field(default_factory=dict)

    @property
    def joint_count(self) -> int:
        """Number of joints n."""
        return int(self.q.shape[1])

    def at(self, ticks: Indices) -> Motion:
        """The same at some of its ticks."""
        signals = {name: getattr(self, name)[ticks] for name in ("time", "q", "dq", "ddq", "torque", "load")}
        step, links = float(np.median(periods(signals["time"]))), {j: table[ticks] for j, table in self.links.items()}
        return replace(self, **signals, step=step, links=links)


def motion_of(
    model: RobotModel, chi: Array, time: Array, q: Array, dq: Array, ddq: Array, torque: Array, *,
    starts: Mapping[str, float] = NO_STARTS,
) -> Motion:  # fmt: skip
    """The motion with its loads.

    Args:
        model: the robot; chi: (ns,) standard parameters; starts: of measured states.
    """
    names = [v.name for v in model.parameters]
    inertial = {v.name for v in LINK_PARAMETERS}
    own = np.array([name.rstrip("0123456789") in inertial for name in names])
    places = {j: [names.index(f"{name}{j + 1}") for name in PAYLOAD] for j in range(q.shape[1])}
    links, load = {j: np.empty((*q.shape, len(PAYLOAD))) for j in places}, np.empty(q.shape)
    observed = following_links(model, q, dq, ddq)
    for first in range(0, len(q), ROWS):
        at = slice(first, first + ROWS)
        rows = model.regressor_rows(q[at], dq[at], ddq[at], observed=observed[at])
        load[at] = rows[:, :, own] @ chi[own]
        for j, table in links.items():
            table[at] = rows[:, :, places[j]]
    return Motion(time, q, dq, ddq, torque, load, float(np.median(periods(time))), links, starts)


def simulated_motion(run: Simulation, robot: RobotModel | None, ticks: Indices | None = None) -> Motion | None:
    """The simulated motion of an experiment at all ticks; None if the plant does not give it.

    Args:
        robot: whose equations give the loads; None for a plant that is a black box.
        ticks: some of them, where only these are asked for.
    """
    if robot is None:
        found = _from_outputs(run)
        return found if found is None or ticks is None else found.at(ticks)
    model, wanted = run.model, slice(None) if ticks is None else ticks
    recording = run.record(all_ticks=True)
    q, dq = (recording.table(model.loop.joint_signals(name)) for name in ("q", "dq"))
    if {f"ddq{j + 1}" for j in range(model.joint_count)} <= {v.name for v in model.loop.plant.outputs}:
        ddq = recording.table(model.loop.joint_signals("ddq"))
    else:
        ddq = np.gradient(dq, _spacing(recording.time), axis=0)
    torque = np.column_stack([recording.inputs[name] for name in model.loop.logged])[wanted]
    known = model.parameters.values(run.theta)
    chi = np.array([known.get(v.name, v.start) for v in robot.parameters])  # standard parameters of the base robot
    signals = (recording.time[wanted], q[wanted], dq[wanted], ddq[wanted], torque)
    return motion_of(robot, chi, *signals, starts=run.experiment.measured_starts)


def joint_reference(reference: Trajectory, joint: int) -> tuple[Array, Array]:
    """Position and velocity (N,) of a joint, counted from 1, along a reference; one that is missing follows from the
    other, the position starting at zero; both are zero where both are missing."""
    q, dq = f"q{joint}", f"dq{joint}"
    if q in reference.names:
        position = reference.column(q)
        return position, np.gradient(position, _spacing(reference.time))
    velocity = reference.column(dq) if dq in reference.names else np.zeros(reference.time.size)
    return _summed(velocity, periods(reference.time)), velocity


def _spacing(time: Array) -> float | Array:
    """Of rows at these instants (N,), for ``numpy.gradient``: their one step, or the instants."""
    step = periods(time)
    return step if isinstance(step, float) else time


def _summed(velocity: Array, step: float | Array) -> Array:
    """Positions (N, ...) from velocities that hold over a step each; ``step``: one, or that behind each row."""
    position = np.zeros_like(velocity)
    np.cumsum(velocity[:-1] * (step if isinstance(step, float) else step[:-1]), axis=0, out=position[1:])
    return position


def _from_outputs(run: Simulation) -> Motion | None:
    """The simulated motion at all ticks from the outputs of the plant; None if they lack dq.

    A position that is no output is the integral of its velocity, starting at that of the reference. Loads and payloads
    are unknown and given as zero.
    """
    model = run.model
    joints = range(1, model.joint_count + 1)
    given = {v.name for v in model.loop.plant.outputs}
    if not {f"dq{j}" for j in joints} <= given:
        return None
    recording = run.record(all_ticks=True)
    dq = recording.table(model.loop.joint_signals("dq"))
    step = periods(recording.time)
    reference = run.experiment.reference
    q = np.column_stack(
        [
            recording.applied[f"{model.loop.plant_name}.q{j}"]
            if f"q{j}" in given
            else joint_reference(reference, j)[0][0] + _summed(dq[:, j - 1], step)
            for j in joints
        ]
    )
    links = {j: np.zeros((q.shape[0], q.shape[1], len(PAYLOAD))) for j in range(q.shape[1])}
    return Motion(
        time=recording.time, q=q, dq=dq, ddq=np.gradient(dq, _spacing(recording.time), axis=0),
        torque=run.logged_torque(recording), load=np.zeros_like(q), step=float(np.median(step)), links=links,
        starts=run.experiment.measured_starts,
    )  # fmt: skip
