"""The motion that a measured torque implies: the controller inverted by the loop itself.

A tracking controller computes its torque from the tracking error, tau = C(e), so the measured torque implies the motion
q = q_ref - C^-1(tau). C is everything else in the loop: a law, an FMU, a lag in a drive. It is inverted by simulating
the controller with an almost massless plant, so that its torque matches the measured one:

    m (ddq - ddq_ref) + d (dq - dq_ref) = tau - tau_measured,        m = |C(i w)| / w^2

with the response C(i w) of the controller to a small oscillation of the joint at the bandwidth w, and d such that the
loop is well damped there. Below w, e = C^-1(tau_measured). No parameter of the robot takes part.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmu_didim.base.errors import DivergedError, SimulationError
from fmu_didim.components.control import ControlComponent, Matrices
from fmu_didim.cosim import Connection, InstancePool, Recording, System, simulate
from fmu_didim.cosim.system import REFERENCE
from fmu_didim.data.signals import Array, Trajectory, Variable
from fmu_didim.estimators.starts.reference_start import Motion, reference_motion
from fmu_didim.model.external_torque import held, with_external_torques
from fmu_didim.model.loop_model import Simulation

BANDWIDTH = 0.25
"""[rad] Phase in a period of the slowest component at which a light plant still follows the torque: sampled loops of
half that speed are stable."""
BANDWIDTHS = 6
"""[bandwidths] Tried, each half of the one before, for drives with lag or delay."""
DAMPING_RATIO = 0.7
"""[1] Of the loop with a light plant, at its bandwidth: no resonance."""
PERIODS = 12
"""[periods] Of the oscillation by which the response of a controller is measured."""
SHARE_OF_RANGE = 1e-4
"""[1] Size of that oscillation, of the range of a joint: no drive saturates by it."""
NOT_FOLLOWED = 0.3
"""[1] Part of the measured torque of a joint that the loop with a light plant may leave unexplained."""
SUBSTEPS = 2
"""[substeps] Of RK4 in a step of a light plant whose step changes: its rate is a third of that of the steps at most."""
SERIES = 1e-6
"""[1] Decay in a step below which it is computed by its series."""

DRIVE = "light_plant_drive"
"""Columns of the reference: the acceleration of the light plant by all but the torque of the controller."""


def implied_motion(run: Simulation) -> Motion:
    """q, dq, ddq (K, n) at all ticks of an experiment, as its measured torque implies them, whatever the plant is.

    Raises:
        SimulationError: the torque of the loop does not follow from the motion of the joints, or follows it too late.
    """
    loop = _Loop(run)
    reason = ""
    for halvings in range(BANDWIDTHS):
        try:
            found, left = loop.dragged(BANDWIDTH / loop.slowest / 2**halvings)
        except DivergedError as error:
            reason = error.what
            continue
        if left <= NOT_FOLLOWED:
            return found
        reason = f"{100 * left:.0f} % of the measured torque are left"
    raise SimulationError(
        "No motion was found in which the controller gives the measured torque.", got=reason,
        next_step="Start from the description or from a result instead: estimator: {start: ...}.",
    )  # fmt: skip


def stiffness(run: Simulation, frequency: float) -> Array:
    """(n,) complex response -d tau_j / d q_j of the controller at a frequency in rad/s; raises SimulationError."""
    return _Loop(run).response(frequency)


class _Loop:
    """The loop of one experiment with a light plant in place of the robot."""

    def __init__(self, run: Simulation) -> None:
        self._run, self._system, self._pool = run, run.system, InstancePool()
        self._wired: System | None = None
        loop = self._loop = run.model.loop
        self._step = self._system.step_size
        self.slowest = self._step * max(self._system.every.values(), default=1)
        reference = run.experiment.reference
        external = with_external_torques(reference, run.external_torques)
        changes, count = self._system.at_instants, loop.subdivision
        self._reference = held(external, count, at_instants=changes) if count > 1 else external
        self._joints = range(1, loop.joint_count + 1)
        offered = {name for kind in ("q", "dq", "ddq") for name in loop.joint_signals(kind)}
        for connection in self._system.connections:
            if connection.source.startswith(f"{loop.plant_name}.") and connection.source not in offered:
                raise SimulationError(
                    "The torque of the loop does not follow from the motion of the joints.", got=connection.source,
                    next_step="Start from the description or from a result instead: estimator: {start: ...}.",
                )  # fmt: skip
        # The reference is delayed like the inputs of the plant.
        late = self._system.delays.get(loop.plant_name, 0.0) * self._step
        motion = reference_motion(reference, loop.joint_count)
        time = self._reference.time
        self._q, self._dq, self._ddq = (
            np.column_stack([np.interp(time + late, reference.time, column) for column in table.T]) for table in motion
        )

    def dragged(self, bandwidth: float) -> tuple[Motion, float]:
        """The implied motion q, dq, ddq (K, n), and the part of the measured torque that it does not explain.

        Args:
            bandwidth: w, in rad/s.
        """
        response = self.response(bandwidth)
        if not (np.abs(response) > 0).all():
            raise SimulationError(
                "The torque of the loop does not follow from the motion of the joints.",
                next_step="Start from the description or from a result instead: estimator: {start: ...}.",
            )  # fmt: skip
        mass = np.abs(response) / bandwidth**2
        damping = np.maximum(2 * DAMPING_RATIO * np.abs(response) - response.imag, 0.0) / bandwidth
        drive = self._ddq + (damping * self._dq - self._target()) / mass
        found = self._moved(drive, 1 / mass, damping / mass)
        operator, every, measured = self._run.operator, self._loop.subdivision, self._run.experiment.torque
        left = measured - operator.apply(self._run.logged_torque(found)[::every][operator.ticks])
        q, dq, ddq = (found.table(self._loop.joint_signals(name))[::every] for name in ("q", "dq", "ddq"))
        size = np.linalg.norm(measured, axis=0)
        alive = size > 0
        parts = np.linalg.norm(left[:, alive], axis=0) / size[alive]  # a dead channel is told elsewhere
        return (q, dq, ddq), float(np.max(parts, initial=0.0))

    def _target(self) -> Array:
        """(K, n) the measured torque at all ticks: a cubic spline through the middles of its samples."""
        from scipy.interpolate import CubicSpline  # few cases need it

        operator = self._run.operator
        places = np.asarray(operator.matrix @ operator.ticks.astype(float))
        places, rows = np.unique(places, return_index=True)
        ticks = np.arange(self._reference.time.size) / self._loop.subdivision
        spline = CubicSpline(places, self._run.experiment.torque[rows])
        return np.asarray(spline(np.clip(ticks, places[0], places[-1])))

    def response(self, bandwidth: float) -> Array:
        """(n,) complex -d tau_j / d q_j at a frequency in rad/s, at the start of the reference."""
        n, changes, given = self._loop.joint_count, self._system.at_instants, self._reference.time
        time = given - given[0] if changes else self._step * np.arange(given.size)
        length = min(PERIODS * 2 * np.pi / bandwidth, time[-1])
        time = time[: int(np.searchsorted(time, length)) if changes else int(length / self._step) + 1]
        spacing = time if changes else self._step
        window = np.sin(np.pi * np.clip(time / length, 0, 1)) ** 2
        shape = np.gradient(np.gradient(window * np.sin(bandwidth * time), spacing), spacing)
        nothing = np.zeros(n)
        still = self._moved(self._ddq[: time.size], nothing, nothing)
        result = np.zeros(n, dtype=complex)
        for j in range(n):
            size = SHARE_OF_RANGE * (float(np.ptp(self._q[:, j])) or 1.0)
            drive = self._ddq[: time.size].copy()
            drive[:, j] += size * shape
            moved = self._moved(drive, nothing, nothing)
            kernel = window * np.exp(-1j * bandwidth * time)
            torque, position = (
                kernel @ (table(moved) - table(still))[:, j]
                for table in (self._run.logged_torque, lambda run: run.table(self._loop.joint_signals("q")))
            )
            result[j] = -torque / position
        return result

    def _moved(self, drive: Array, inverse_mass: Array, rate: Array) -> Recording:
        """The loop with  ddq = tau / m + drive - rate dq  over as many ticks as ``drive`` (K, n) has rows."""
        step = None if self._system.at_instants else self._step
        plant = light_plant(step, inverse_mass, rate, np.concatenate([self._q[0], self._dq[0]]))
        system = self._driven(plant)
        given, count = self._reference, drive.shape[0]
        variables = (*given.variables, *(Variable(f"{DRIVE}{j}") for j in self._joints))
        reference = Trajectory(given.time[:count], np.hstack([given.values[:count], drive]), variables)
        experiment = self._run.experiment
        bounds = self._loop.position_bounds(experiment.reference, experiment.initial_state.values)
        return simulate(system, reference, bounds=bounds, pool=self._pool)

    def _driven(self, plant: ControlComponent) -> System:
        """The loop with a light plant that the reference drives, wired when it is asked for first."""
        name = self._loop.plant_name
        if self._wired is None:
            wires = (Connection(f"{REFERENCE}.{DRIVE}{j}", f"{name}.{DRIVE}{j}") for j in self._joints)
            self._wired = replace(
                self._system, components={**self._system.components, name: plant},
                connections=(*self._system.connections, *wires),
            )  # fmt: skip
        return self._wired.replace(name, plant)


def light_plant(step: float | None, inverse_mass: Array, rate: Array, start: Array) -> ControlComponent:
    """Uncoupled joints,  ddq = tau / m + drive - rate dq, exact for held inputs.

    Args:
        step: in s; None where it changes, for a continuous plant that RK4 integrates.
        inverse_mass: (n,) 1/m; rate: (n,) 1/s; start: (2 n,) q and dq.
    """
    n = rate.size
    motion, torque = _continuous(rate) if step is None else _held(step, rate)
    unit, nothing = np.eye(n), np.zeros((n, n))
    b = torque @ np.hstack([np.diag(inverse_mass), unit])
    c = np.vstack([np.eye(2 * n), np.hstack([nothing, -np.diag(rate)])])
    d = np.vstack([np.zeros((2 * n, 2 * n)), np.hstack([np.diag(inverse_mass), unit])])
    names = {s: [f"{s}{j}" for j in range(1, n + 1)] for s in ("tau", DRIVE, "q", "dq", "ddq")}
    inputs, outputs = names["tau"] + names[DRIVE], names["q"] + names["dq"] + names["ddq"]
    return ControlComponent(
        system=Matrices(motion, b, c, d),
        inputs=tuple(Variable(v, "", "input") for v in inputs),
        outputs=tuple(Variable(v) for v in outputs),
        initial_state=tuple(float(v) for v in start),
        substeps=None if step else SUBSTEPS,
        origin="light plant",
        sample_time=step,
    )


def _continuous(rate: Array) -> tuple[Array, Array]:
    """(2 n, 2 n) and (2 n, n) of  d (q, dq) / dt = A (q, dq) + B ddq_0,  ddq = ddq_0 - rate dq."""
    unit, nothing = np.eye(rate.size), np.zeros((rate.size, rate.size))
    return np.block([[nothing, unit], [nothing, -np.diag(rate)]]), np.vstack([nothing, unit])


def _held(step: float, rate: Array) -> tuple[Array, Array]:
    """The same from instant to instant, with ddq_0 held over a step."""
    n = rate.size
    decay = np.exp(-rate * step)
    # Velocity and position after an acceleration held for a step; by the series for small rates.
    slow = rate * step < SERIES
    safe = np.where(slow, 1.0, rate)
    velocity = np.where(slow, step * (1 - rate * step / 2), (1 - decay) / safe)
    position = np.where(slow, step**2 / 2 * (1 - rate * step / 3), (step - velocity) / safe)
    unit, nothing = np.eye(n), np.zeros((n, n))
    motion = np.block([[unit, np.diag(velocity)], [nothing, np.diag(decay)]])
    return motion, np.vstack([np.diag(position), np.diag(velocity)])
