"""The efficient finish: Gauss-Newton on the torque with the true sensitivity of the closed loop.

DIDIM's fixed point solves W'(y - tau_s) = 0 and is consistent; the minimum of |y - tau_s|^2 solves
S'(y - tau_s) = 0 and reaches the Cramer-Rao bound. From DIDIM's answer a few steps suffice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fmu_didim.errors import SimulationError
from fmu_didim.prediction.guard import mass_matrix_problem
from fmu_didim.prediction.iteration import Iteration
from fmu_didim.prediction.plant_sensitivity import sensitivity
from fmu_didim.prediction.problem import Prediction, Problem, predict
from fmu_didim.prediction.weighting import joint_deviation, whitened
from fmu_didim.signals import Array
from fmu_didim.statistics import covariance_efficient, least_squares, relative_error_percent

MAXIMUM_HALVINGS = 8
MAXIMUM_DELAY = 50.0
RENEW_STEP = 0.02
"""Farther than this part of a standard deviation from where it was taken, a sensitivity is not the one that ends the
steps: what it leaves of the error is this part times its relative change, of a standard deviation."""
CONTRACTION = 0.1
"""A step that is at most this part of the one before shows that the sensitivity still serves."""
ROUNDING = 1e-6
"""A step that would lower the error by a smaller part may fail by rounding alone."""
TORQUE_FLOOR = 1e-3
"""Part of the tolerance, in units of the torque, below which a move counts as none: a parameter that is zero, in data
without noise, has neither size nor standard deviation."""


@dataclass(frozen=True)
class Point:
    """The closed loop at one set of parameters.

    Attributes:
        theta: (p,) base parameters, then the delay in samples if it is estimated.
        prediction: of the simulation there.
        sensitivity: (N, n, p).
        deviation: (n,) noise of each joint that the residual shows.
    """

    theta: Array
    prediction: Prediction
    sensitivity: Array
    deviation: Array
    condition_number: float

    @property
    def covariance(self) -> Array:
        """(p, p) Cramer-Rao bound (S'S)^-1 with the noise of each joint."""
        return covariance_efficient(whitened(self.sensitivity, self.deviation))


def split(problem: Problem, theta: Array) -> tuple[Problem, Array]:
    """The problem with the delay that stands behind the parameters, if one does, and the parameters (p,) alone."""
    count = problem.parameters.count
    return (problem.with_delay(float(theta[count])), theta[:count]) if theta.size > count else (problem, theta)


def evaluate(problem: Problem, theta: Array, prediction: Prediction | None = None) -> Point:
    """Simulate at theta and differentiate; ``prediction`` saves the first simulation where it is known."""
    there, base = split(problem, theta)
    prediction = prediction or predict(there, base)
    s = sensitivity(there, base, prediction, with_delay=theta.size > base.size)
    deviation = joint_deviation(problem, problem.measured - prediction.torque, s)
    condition = least_squares(whitened(s, deviation), np.zeros(s.shape[0] * s.shape[1])).condition_number
    return Point(theta, prediction, s, deviation, condition)


@dataclass(frozen=True)
class Finished:
    """The minimum: the point, whether the steps settled, and their history."""

    point: Point
    settled: bool
    iterations: tuple[Iteration, ...]


def efficient_finish(
    problem: Problem,
    start: Point,
    *,
    tolerance: float,
    maximum_iterations: int = 15,
    stage: str = "finish",
    progress: Callable[[Iteration], None],
) -> Finished:
    """Minimise the weighted torque error from ``start``.

    Steps are halved while a simulation fails or the error grows. It has settled when no parameter moves
    by more than ``tolerance`` times the larger of its size and its standard deviation, or moves the torque by less than
    TORQUE_FLOOR times that part. It has not where no part of a step keeps what a sensitivity taken at that very point
    promises. ``stage`` names the iterations in the history.
    """
    point, differentiated = start, start.theta
    history: list[Iteration] = []
    jacobian_updates, last = False, 0.0
    for number in range(1, maximum_iterations + 1):
        if jacobian_updates:
            point, differentiated = evaluate(problem, point.theta, point.prediction), point.theta
        fresh = point.theta is differentiated
        step = _propose(problem, point)
        theta, prediction, note = _search(problem, point.theta, step)
        moved = theta - point.theta
        history.append(
            Iteration(
                stage,
                number,
                theta,
                relative_error_percent(problem.measured, prediction.torque)[0],
                float(np.max(np.abs(moved) / np.maximum(np.abs(theta), step.scale))),
                point.condition_number,
                note,
            )
        )
        progress(history[-1])
        point = Point(theta, prediction, point.sensitivity, step.deviation, point.condition_number)
        stuck = not moved.any() and step.promised > ROUNDING * step.cost
        small = tolerance * np.maximum(np.maximum(np.abs(theta), step.scale), TORQUE_FLOOR * step.size)
        stale = bool((np.abs(theta - differentiated) > RENEW_STEP * step.scale).any())
        if stuck and fresh:
            break
        if not stuck and (np.abs(moved) <= small).all() and (fresh or not stale):
            return Finished(point, True, tuple(history))
        here = float(np.max(np.abs(moved) / step.scale))
        # Far from where it was taken a sensitivity serves as long as each step is a small part of the one before.
        jacobian_updates = stuck or (stale and not RENEW_STEP < here <= CONTRACTION * last)
        last = here
    return Finished(point, False, tuple(history))


@dataclass(frozen=True)
class _Step:
    """A Gauss-Newton step.

    Attributes:
        change: (p,); scale: (p,) standard deviations; size: (p,) at which each makes up the whole torque.
        deviation: (n,) weights; cost: weighted square of the residual; promised: how much the step would lower it.
    """

    change: Array
    scale: Array
    size: Array
    deviation: Array
    cost: float
    promised: float


def _propose(problem: Problem, point: Point) -> _Step:
    residual = problem.measured - point.prediction.torque
    # Renewed at every step, so that the minimum does not depend on where the steps began.
    deviation = joint_deviation(problem, residual, point.sensitivity)
    columns, target = whitened(point.sensitivity, deviation), whitened(residual, deviation)
    change = least_squares(columns, target).solution
    return _Step(
        change=change,
        scale=np.sqrt(np.diag(covariance_efficient(columns))),
        size=np.linalg.norm(whitened(problem.measured, deviation)) / np.linalg.norm(columns, axis=0),
        deviation=deviation,
        cost=float(np.sum(target**2)),
        promised=float(np.sum((columns @ change) ** 2)),
    )


def _search(problem: Problem, theta: Array, step: _Step) -> tuple[Array, Prediction, str]:
    """The longest of the steps step / 2^k that simulates and does not raise the error."""
    note = ""
    for halving in range(MAXIMUM_HALVINGS):
        trial = theta + step.change / 2**halving
        count = problem.parameters.count
        trial[:count] = problem.parameters.limited(trial[:count])
        if theta.size > count:
            trial[-1] = min(max(trial[-1], 0.0), MAXIMUM_DELAY)
        there, base = split(problem, trial)
        if mass_matrix_problem(there, base):
            note = "step halved: inertia not positive definite"
            continue
        try:
            prediction = predict(there, base)
        except SimulationError as error:
            note = f"step halved: {error.what}"
            continue
        reached = float(np.sum(whitened(problem.measured - prediction.torque, step.deviation) ** 2))
        # At the minimum, rounding decides whether the error grows.
        if reached <= step.cost * (1 + 1e-9) or np.abs(step.change).max() < 1e-9 * np.abs(theta).max():
            return trial, prediction, note
        note = "step halved: the error grew"
    there, base = split(problem, theta)
    return theta, predict(there, base), "no smaller step lowers the error"
