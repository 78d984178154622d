"""The virtual controller: a PD law with gains from the inertia matrix, and the torque that is fed forward.

    tau = u + w^2 M (q_ref - q) + 2 w M (dq_ref - dq),    M = diag of the inertia matrix at the mean posture
    u(t_k) = W(q_ref, dq_ref, ddq_ref) chi at t_k + h/2,  chi by least squares of the measured torque

M is that of chi, or of the nearest values that a machine can have where chi is of none: inertias of a wrist may be too
small beside its friction to come out positive. Where joints move each other so much that the sampled loop could not be
stable with M in some posture of the log, as two parallel axes of an arm of seven joints do, each joint has the least
inertia in the place of M that it feels with the others free, 1/(M(q)^-1)_jj.

u makes the loop follow closely whatever the bandwidth of the feedback, which the sampled loop limits; what u lacks the
feedback adds, and tau, both together, is what is compared. A torque that is held from t_k to t_k + h moves the
plant as that of t_k + h/2.

Source: Gautier, Janot, Vandanjon, A new closed-loop output error method, IEEE TCST 21(2), 2013: the simulated
controller may be another one as long as the simulated motion follows the measured one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.case.tracking.positions import Smooth
from fmu_didim.components import Component, ModelComponent
from fmu_didim.components.compiled_model import with_compiled_twin
from fmu_didim.controllers.pd import PD
from fmu_didim.data.signals import Array, Trajectory, Variable
from fmu_didim.dynamics.robot.observed_states import NO_STARTS
from fmu_didim.estimators.starts.reference_start import Motion, observed_on, values_of_machine
from fmu_didim.model.parameters import RobotParameters

FEEDBACK = 1 / 25
"""[1] Of the control rate, the highest natural frequency of the feedback: w h = 0.25 and Kd h / M = 0.5, where a
sampled joint is stable with a quarter of its inertia, too."""
LIGHTER = 4.0
"""[1] Largest eigenvalue of M(q)^-1 M in a posture q of the log: how much lighter a motion of several joints may be
than each of them, as the feedback is stable with a quarter of the inertia."""
POSTURES = 16
"""[postures] Of each run, evenly in time, in which that is asked."""
ROUNDS = 2
"""[fits] Least squares with joints weighted alike, then by what they leave."""
NO_LOADS: Mapping[str, str] = MappingProxyType({})
"""No run carries a load."""
FED_FORWARD = "tracking_torque"
"""Columns of the reference with the torque that is fed forward, one a joint."""


@dataclass(frozen=True)
class Measured:
    """Torque (N, n) of a run at instants (N,), s, and the motion that was measured.

    Attributes:
        cutoff_hz: of the filter that the torque is behind; None without one. starts: of measured states.
    """

    time: Array
    torque: Array
    motion: Smooth
    cutoff_hz: float | None = None
    starts: Mapping[str, float] = field(default_factory=dict)

    @property
    def rate_hz(self) -> float:
        """Of the log, Hz."""
        return float((self.time.size - 1) / (self.time[-1] - self.time[0]))

    def inside(self, first: float, last: float) -> Measured:
        """The same from ``first`` to ``last``, s."""
        kept = (self.time >= first) & (self.time <= last)
        return replace(self, time=self.time[kept], torque=self.torque[kept])


@dataclass(frozen=True)
class VirtualLaw:
    """Gains and feedforward of a virtual controller.

    Attributes:
        parameters: of the robot; values: (b,) base parameters by least squares; inertia: (n,) diagonal of the inertia
            matrix at the mean posture, kg.m2 or kg; frequency_hz: natural frequency of the feedback.
        loaded: label of a run with a load -> (b,) those of that run alone, which are fed forward there.
        step: control period, s.
        drive_gains: (n,) torque of each joint for a unit of what the law gives, which is that of the log; None: one, as
            values by least squares of a log are of its unit.
    """

    parameters: RobotParameters
    values: Array
    inertia: Array
    frequency_hz: float
    step: float
    loaded: Mapping[str, Array] = field(default_factory=dict)
    drive_gains: Array | None = None

    def component(self) -> Component:
        """The PD law."""
        w = 2 * np.pi * self.frequency_hz
        joints = tuple(joint.type for joint in self.parameters.model.description.joints)
        inertia = self.inertia / (1.0 if self.drive_gains is None else self.drive_gains)
        law = PD(
            law="pd", name="tracking", description="virtual controller that follows measured positions",
            joints=joints, rate_hz=1 / self.step, Kp=tuple(w * w * inertia), Kd=tuple(2 * w * inertia),
        )  # fmt: skip
        return with_compiled_twin(ModelComponent(law.block()))

    def reference(self, motion: Smooth, label: str = "", starts: Mapping[str, float] = NO_STARTS) -> Trajectory:
        """What the loop follows in a run: the motion at all ticks, and the torque that is fed forward; ``starts``: of
        measured states."""
        values = self.loaded.get(label, self.values)
        count = int((motion.last - motion.first) / self.step + 1e-6) + 1
        time = motion.first + np.arange(count, dtype=np.float64) * self.step
        middle = motion.at(time + self.step / 2)
        observed = self.parameters.observed_along(time, *middle, values, starts=starts)
        columns, known = self.parameters.regressor(*middle, observed=observed)
        torque = (columns @ values + known) / (1.0 if self.drive_gains is None else self.drive_gains)
        table = np.hstack([*motion.at(time), torque])
        joints = range(1, self.inertia.size + 1)
        names = [f"{kind}{j}" for kind in ("q", "dq", "ddq", FED_FORWARD) for j in joints]
        return Trajectory(time, table, tuple(Variable(name) for name in names))

    def injections(self) -> Mapping[str, str]:
        """Command -> column that is added to it."""
        return {f"command{j}": f"{FED_FORWARD}{j}" for j in range(1, self.inertia.size + 1)}


def virtual_law(
    parameters: RobotParameters, runs: Mapping[str, Measured], bandwidth_hz: float, step: float,
    loads: Mapping[str, str] = NO_LOADS,
) -> VirtualLaw:  # fmt: skip
    """The virtual controller of runs.

    Args:
        step: control period, s; loads: label of a run with a load -> label of the fitted run that describes it.

    Raises:
        InputError: torque and positions are of no machine.
    """
    fitted = [run for k, run in runs.items() if k not in loads] or list(runs.values())
    values = _values(parameters, fitted, step)
    own = {label: _values(parameters, [runs[of]], step) for label, of in loads.items() if of in runs}
    inertia = _felt(parameters, values, fitted, step)
    if (bad := np.flatnonzero(~(inertia > 0))).size:
        raise InputError(
            "Torque and positions give a joint no positive inertia, so that a controller has no gains.",
            where=f"controller: tracking, joint {bad[0] + 1}", got=f"{inertia[bad[0]]:.3g}", valid="above 0",
            next_step="Check signs, units, joints and clocks of torque and positions (fmu-didim data FILE); move the "
            "joint with more acceleration: friction may hide its inertia.",
        )  # fmt: skip
    return VirtualLaw(parameters, values, inertia, min(bandwidth_hz, FEEDBACK / step), step, own)


def planned_law(
    parameters: RobotParameters, values: Array, postures: Array, step: float, frequency_hz: float, *,
    loaded: Mapping[str, Array], drive_gains: Array | None = None,
) -> VirtualLaw:  # fmt: skip
    """The virtual controller of runs that are planned, of a robot with base parameters (b,).

    Args:
        postures: (K, n) in which it shall be stable, the first the mean one; loaded: label of a run with a load -> (b,)
            with it.
    """
    inertia = _of_matrices(_inertias(parameters, values, postures))
    frequency = min(frequency_hz, FEEDBACK / step)
    return VirtualLaw(parameters, values, inertia, frequency, step, dict(loaded), drive_gains)


def _values(parameters: RobotParameters, runs: Sequence[Measured], step: float) -> Array:
    """(b,) base parameters by least squares of the torque along measured motions."""
    columns, target = _all_rows(parameters, runs, step)
    deviation, values = target.std(axis=0) + np.finfo(float).tiny, np.zeros(columns.shape[2])
    for _ in range(ROUNDS):
        table = (columns / deviation[:, None]).reshape(-1, columns.shape[2])
        values = np.linalg.lstsq(table, (target / deviation).reshape(-1), rcond=None)[0]
        deviation = np.maximum((target - columns @ values).std(axis=0), 1e-9 * deviation)
    return values


def _felt(parameters: RobotParameters, values: Array, runs: Sequence[Measured], step: float) -> Array:
    """(n,) inertia of each joint for its gains."""
    mean = np.concatenate([run.motion.at(run.time)[0] for run in runs]).mean(axis=0)
    places = [np.linspace(0, run.time.size - 1, POSTURES).astype(int) for run in runs]
    postures = np.concatenate([run.motion.at(run.time[k])[0] for run, k in zip(runs, places, strict=True)])
    postures = np.vstack([mean, postures])
    matrices = _inertias(parameters, values, postures)
    if not np.linalg.eigvalsh(matrices).min() > 0:
        matrices = _inertias(parameters, _of_machine(parameters, values, runs, step), postures)
    return _of_matrices(matrices)


def _of_matrices(matrices: Array) -> Array:
    """(n,) inertia of each joint for its gains, from inertia matrices (K, n, n), the first at the mean posture."""
    inertia = np.diag(matrices[0]).copy()
    if not np.linalg.eigvalsh(matrices).min() > 0 or _lightest(matrices, inertia) <= LIGHTER:
        return inertia
    inertia = np.min(1 / np.diagonal(np.linalg.inv(matrices), axis1=1, axis2=2), axis=0)
    return np.asarray(inertia * min(1.0, LIGHTER / _lightest(matrices, inertia)))


def _lightest(matrices: Array, inertia: Array) -> float:
    """Largest eigenvalue of M(q)^-1 M for matrices (K, n, n) and M = diag(n,)."""
    root = np.sqrt(inertia)
    return float(np.linalg.eigvalsh(root[:, None] * np.linalg.inv(matrices) * root).max())


def _of_machine(parameters: RobotParameters, values: Array, runs: Sequence[Measured], step: float) -> Array:
    """(b,) base parameters of a machine, nearest to those by least squares."""
    columns, target = _all_rows(parameters, runs, step)
    deviation = (target - columns @ values).std(axis=0) + np.finfo(float).tiny
    return values_of_machine(parameters, values, (columns / deviation[:, None]).reshape(-1, columns.shape[2]))


def _all_rows(parameters: RobotParameters, runs: Sequence[Measured], step: float) -> tuple[Array, Array]:
    """Regressor and torque of all runs, one below the other."""
    pairs = [_rows(parameters, run, step) for run in runs]
    return np.concatenate([pair[0] for pair in pairs]), np.concatenate([pair[1] for pair in pairs])


def _rows(parameters: RobotParameters, run: Measured, step: float) -> tuple[Array, Array]:
    """Regressor (N, n, b) along the measured motion, and the torque (N, n) without the known one."""
    motion: Motion = run.motion.at(run.time + step / 2)

    def rows(observed: Array) -> tuple[Array, Array]:
        return parameters.regressor(*motion, observed=observed)

    columns, known = rows(observed_on(parameters, run.time, motion, run.torque, rows, starts=run.starts))
    return columns, run.torque - known


def _inertias(parameters: RobotParameters, values: Array, postures: Array) -> Array:
    """(K, n, n) inertia matrices at postures (K, n): torque for an acceleration of one joint, less that at rest."""
    count, n = postures.shape
    q, rest, unit = np.repeat(postures, n, axis=0), np.zeros((count * n, n)), np.tile(np.eye(n), (count, 1))

    def torque(ddq: Array) -> Array:
        observed = parameters.observed_along(np.zeros(count * n), q, rest, ddq, values)
        columns, known = parameters.regressor(q, rest, ddq, observed=observed)
        return np.asarray(columns @ values + known)

    found = (torque(unit) - torque(rest)).reshape(count, n, n)
    return np.asarray((found + found.transpose(0, 2, 1)) / 2)
