"""From the last point of the iterations to an estimate: refinement of the integration, statistics."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.identification.estimate import Estimate, Stage, Status
from fmu_didim.prediction.finish import Point, efficient_finish, evaluate, split
from fmu_didim.prediction.iteration import Iteration
from fmu_didim.prediction.problem import Problem, predict_torque
from fmu_didim.signals import Array

INTEGRATION_TOLERANCE = 1e-6
INTEGRATION_SHARE = 0.01
"""The integration error may reach this part of the relative torque error."""
MAXIMUM_REFINEMENTS = 4


@dataclass(frozen=True)
class Minimum:
    """The minimum of the torque error.

    Attributes:
        point: the closed loop there; settled: whether the steps became small.
        iterations: those of the finish.
        integration_error: relative change of the torque when the plant's substeps are doubled.
        remarks: what was changed on the way.
    """

    point: Point
    settled: bool
    iterations: tuple[Iteration, ...]
    integration_error: float
    remarks: tuple[str, ...]


def minimise(
    problem: Problem,
    point: Point,
    *,
    tolerance: float,
    progress: Callable[[Iteration], None],
    stage: str = "finish",
    maximum_iterations: int = 15,
) -> Minimum:
    """The efficient finish, repeated with finer substeps while they change the torque too much."""
    iterations: list[Iteration] = []
    remarks: list[str] = []
    for _ in range(MAXIMUM_REFINEMENTS):
        finished = efficient_finish(
            problem, point, tolerance=tolerance, progress=progress, stage=stage, maximum_iterations=maximum_iterations
        )
        iterations.extend(finished.iterations)
        point = finished.point
        difference, allowed = integration_error(problem, point)
        if not difference > allowed:
            break
        problem = replace(problem, substep_factor=2 * problem.substep_factor)
        remarks.append(f"Substeps of the plant doubled: halving them changed the torque by {100 * difference:.2g} %.")
        point = evaluate(problem, point.theta)
    return Minimum(point, finished.settled, tuple(iterations), difference, tuple(remarks))


def integration_error(problem: Problem, point: Point) -> tuple[float, float]:
    """Relative change of the torque when the plant's substeps are doubled, and what is allowed; NaN if unknown."""
    there, theta = split(problem, point.theta)
    if not there.can_refine:
        return np.nan, np.inf
    finer = replace(there, substep_factor=2 * there.substep_factor)
    torque = predict_torque(finer, theta)[0]
    size = np.linalg.norm(torque)
    error = float(np.linalg.norm(torque - point.prediction.torque) / size)
    misfit = float(np.linalg.norm(problem.measured - torque) / size)
    return error, max(INTEGRATION_TOLERANCE, INTEGRATION_SHARE * misfit)


def degrees_of_freedom(problem: Problem, count: int) -> float:
    """Degrees of freedom of the intervals of ``count`` parameters: those of one joint where each joint's noise is
    estimated by itself, the safe end of what Welch and Satterthwaite's rule can give."""
    total = problem.measured.size - count
    if problem.torque_deviation is not None or problem.joint_weights == "equal":
        return float(total)
    return total / problem.joint_count


def torque_estimate(
    problem: Problem,
    point: Point,
    covariance: Array,
    *,
    estimator: str,
    settled: bool,
    iterations: Sequence[Iteration],
    stages: Mapping[str, Stage],
    difference: float,
    remarks: Sequence[str] = (),
) -> Estimate:
    """The estimate at a point of the closed loop; parameters beyond those of the plant are the delay."""
    parameters = problem.parameters
    extra = point.theta.size - parameters.count
    return Estimate(
        estimator=estimator,
        names=(*parameters.names, *("delay",) * extra),
        units=(*parameters.units, *("1",) * extra),
        value=point.theta,
        standard_deviation=np.sqrt(np.diag(covariance)),
        covariance=covariance,
        freedom=degrees_of_freedom(problem, point.theta.size),
        time=problem.experiment.time,
        measured=problem.measured,
        simulated=point.prediction.torque,
        noise=point.deviation,
        condition_number=point.condition_number,
        status=Status.CONVERGED if settled else Status.MAXIMUM_ITERATIONS,
        iterations=tuple(iterations),
        stages=stages,
        base_count=parameters.count,
        integration_error=difference,
        remarks=tuple(remarks),
    )
