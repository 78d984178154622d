"""Base parameters from the reference trajectory alone, as if the robot had followed it exactly."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import IdentificationError
from fmu_didim.data.filters import LowPass
from fmu_didim.data.signals import Array, Trajectory, Variable, derivative, white_noise
from fmu_didim.fit.feasibility import nearest_physical
from fmu_didim.fit.linear_problem import SAME_DIRECTION, LinearProblem
from fmu_didim.fit.noise.noise import motion_frequency
from fmu_didim.fit.statistics import covariance_white, least_squares
from fmu_didim.model.loop_model import LoopModel, Simulation
from fmu_didim.model.parameters import Parameters, RobotParameters
from fmu_didim.model.prediction import sampled_regressor

SMOOTHED = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005)
"""[1] Cut-offs of the low-pass of a reference from which accelerations are computed, of its rate, tried in this
order; half of it means no filter. The last one is 5 Hz at 1 kHz, about where the motion of an arm ends."""
SMOOTHED_ORDER = 4
"""[1] Of that filter, a Butterworth one run forward and backward."""
NOISE_OF_ACCELERATION = 0.1
"""[1] Fraction of the deviation of an acceleration that its noise may have: 1 % of its power."""
STANDS = 0.01
"""[1] Deviation of the velocity of a joint that stands still, of the largest one of its robot: of a log in which one
joint moved after the other, the others show 1e-3 of it and less."""

Rows = Callable[[Array], tuple[Array, Array]]
"""Regressor (N, n, b) and known torque (N, n) at the samples, for what is observed beyond the motion (K, no)."""


Motion = tuple[Array, Array, Array]
"""q, dq, ddq at all ticks of a reference, (K, n) each."""


def from_reference(model: LoopModel) -> Array:
    """Values (p,): the base parameters by least squares of the measured torque on the regressor of the reference
    motion, all others where they start.

    Needs no initial values of the base parameters at all: a controller that tracks well makes q = q_ref nearly true.
    """
    values, count = model.start, model.linear_count
    columns, target = rows_of(model, whole_reference)
    names = model.names[:count]
    values[:count] = least_squares(columns.reshape(-1, count), target.reshape(-1), names=names).solution
    return values


def whole_reference(run: Simulation) -> Motion:
    """The reference motion of an experiment, smoothed where its accelerations would be noise because they are
    differences of a rounded or measured reference."""
    reference, joints = run.experiment.reference, range(1, run.model.joint_count + 1)
    q, dq, ddq = reference_motion(reference, run.model.joint_count)
    if all(f"ddq{j}" in reference.names for j in joints):
        return q, dq, ddq
    has_velocity = all(f"dq{j}" in reference.names for j in joints)
    return _smoothed(reference.time, (q, dq, ddq), has_velocity)


def _smoothed(time: Array, motion: Motion, has_velocity: bool) -> Motion:
    """The motion with accelerations of no more than a small fraction of noise.

    Args:
        motion: q, dq, ddq, (K, n) each; has_velocity: whether dq was given and ddq alone comes from it.
    """
    q, dq, ddq = motion
    given, order = (dq, 1) if has_velocity else (q, 2)
    noise = np.array([white_noise(column) for column in given.T])
    rate = (time.size - 1) / (time[-1] - time[0])
    for part in SMOOTHED:
        cutoff = part * rate
        if cutoff < rate / 2:
            smooth = LowPass(cutoff, SMOOTHED_ORDER).apply(given, rate)
            q, dq = (q, smooth) if has_velocity else (smooth, derivative(time, smooth))
            ddq = derivative(time, dq)
        size = derived_noise(noise, cutoff, rate, order)
        if (size <= NOISE_OF_ACCELERATION * ddq.std(axis=0)).all():
            break
    return q, dq, ddq


def derived_noise(noise: Array, cutoff_hz: float, rate_hz: float, order: int) -> Array:
    """(n,) deviation of what white noise (n,) of signals becomes in their derivatives of an order.

    White noise of deviation s in a position sampled at the rate f becomes, below the cut-off c of a low-pass,

        s_ddq = s (2 pi)^2 c^2 sqrt(2 c / (5 f)),   and from a velocity   s_ddq = s 2 pi c sqrt(2 c / (3 f))
    """
    part = cutoff_hz / rate_hz
    return np.asarray(noise * (2 * np.pi * cutoff_hz) ** order * np.sqrt(2 * part / (2 * order + 1)))


def moving_joints(velocity: Array) -> NDArray[np.bool_]:
    """(n,) which joints move, by velocities (K, n): of the others noise is seen, and what the moving ones shake. All,
    where none does."""
    size = velocity.std(axis=0)
    found = np.asarray(size > STANDS * size.max(initial=0.0))
    return found if found.any() else np.ones(size.size, dtype=bool)


def motion_hz(time: Array, velocities: Array) -> float:
    """Highest frequency of the motion of joints with velocities (K, n) at even instants (K,), Hz."""
    count = velocities.shape[1]
    names = tuple(Variable(f"dq{j}") for j in range(1, count + 1))
    return motion_frequency(Trajectory(time, velocities, names), count)


def rows_of(model: LoopModel, motion: Callable[[Simulation], Motion]) -> tuple[Array, Array]:
    """Regressor (N, n, b) and the measured torque without the known one (N, n), on motions that were not
    simulated, at the samples after those in which an unknown start acts.

    Args:
        motion: of an experiment, at all ticks of its reference.
    """
    runs = [model.simulation(model.start, label) for label in model.estimation_labels]
    pairs = [rows_on(run, motion(run)) for run in runs]
    if len(pairs) == 1:  # of a long log as large as many
        columns, known = pairs[0]
    else:
        columns, known = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    settled = _settled(model)
    rest = measured_of(model) - known[settled]
    return columns if settled.all() else columns[settled], rest


def measured_of(model: LoopModel) -> Array:
    """(N, n) measured torque at the samples of :func:`rows_of`."""
    return model.measured[_settled(model)]


def _settled(model: LoopModel) -> NDArray[np.bool_]:
    """Which samples of the fitted experiments come after those in which an unknown start acts."""
    return np.concatenate([model.experiments[label].has_settled for label in model.estimation_labels])


def rows_on(run: Simulation, whole: Motion) -> tuple[Array, Array]:
    """W (N, n, b) and the torque of all that is known (N, n) at the samples of an experiment, on a motion that was not
    simulated.

    Args:
        whole: q, dq, ddq at all ticks of its reference.
    """
    ticks, model = run.operator.ticks, run.model
    q, dq, ddq = (table[ticks] for table in whole)

    def rows(observed: Array) -> tuple[Array, Array]:
        return sampled_regressor(run, (q, dq, ddq), observed[ticks])

    experiment, measured = run.experiment, model.experiments.measured_in(run.label)
    starts = experiment.measured_starts
    return rows(observed_on(model.parameters, experiment.reference.time, whole, measured, rows, starts=starts))


def observed_on(
    parameters: Parameters, time: Array, motion: tuple[Array, Array, Array], torque: Array, rows: Rows, *,
    starts: Mapping[str, float],
) -> Array:  # fmt: skip
    """Observed values (K, no) for the regressor on a motion that was not simulated.

    Loads follow from a least squares fit without the effects that depend on them.

    Args:
        time: (K,) in s; motion: q, dq, ddq, (K, n) each.
        torque: (N, n) measured; rows: regressor and known torque at its samples; starts: of measured states.
    """
    observed = parameters.observed_along(time, *motion, starts=starts)
    if not parameters.observes_load:
        return observed
    columns, known = rows(observed)
    flat = columns.reshape(-1, columns.shape[2])[:, : parameters.count]
    # Without loads the columns of those effects are zero.
    kept = np.flatnonzero(np.abs(flat).max(axis=0))
    theta = np.zeros(parameters.count)
    names = tuple(parameters.names[i] for i in kept)
    theta[kept] = least_squares(flat[:, kept], (torque - known).reshape(-1), names=names).solution
    return parameters.observed_along(time, *motion, theta, starts=starts)


def values_of_machine(parameters: RobotParameters, values: Array, whitened: Array) -> Array:
    """The base parameters that a machine can have and that are nearest to least-squares ones (b,), by the covariance of
    their regressor (r, b), each row of which is divided by the deviation of its torque.

    Those themselves where the motion leaves a direction of them open, or no machine has what the description knows.
    """
    problem = LinearProblem.of(whitened[:, None, :], np.zeros((whitened.shape[0], 1)))
    if not (problem.scale > 0).all() or problem.condition > 1 / SAME_DIRECTION:
        return values
    try:
        return nearest_physical(parameters.model, parameters.base, values, covariance_white(whitened)).values
    except IdentificationError:
        return values


def reference_motion(reference: Trajectory, joint_count: int) -> Motion:
    """q, dq, ddq of a reference; derivatives by cubic spline where not given."""
    joints = range(1, joint_count + 1)
    tables = [reference.select([f"q{j}" for j in joints])]
    for kind in ("dq", "ddq"):
        wanted = [f"{kind}{j}" for j in joints]
        given = set(wanted) <= set(reference.names)
        tables.append(reference.select(wanted) if given else derivative(reference.time, tables[-1]))
    return tables[0], tables[1], tables[2]
