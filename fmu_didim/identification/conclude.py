"""From the last point of the iterations to an estimate: the efficient finish, refinement of the integration,
statistics.

DIDIM's fixed point solves W'(y - tau_s) = 0 and is consistent; the minimum of |y - tau_s|^2 solves
S'(y - tau_s) = 0 and reaches the Cramer-Rao bound. From DIDIM's answer a few steps suffice.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.diagnosis.agreement import agreement
from fmu_didim.diagnosis.confounding import refuse_confounded
from fmu_didim.identification import thresholds as limits
from fmu_didim.identification.estimate import Estimate, Stage, Status
from fmu_didim.prediction.fit import Fit, point
from fmu_didim.prediction.iteration import Iteration
from fmu_didim.prediction.least_squares import Stopping, minimise
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.prediction.sensitivity import parameter_sizes
from fmu_didim.prediction.weighting import NoiseOfResidual, whitened
from fmu_didim.signals import Array


@dataclass(frozen=True)
class Minimum:
    """The minimum of the torque error.

    Attributes:
        fit: the closed loop there; iterations: those of the finish.
        integration_error: relative change of the torque when the plant's substeps are doubled.
        remarks: what was changed on the way.
    """

    fit: Fit
    integration_error: float
    iterations: tuple[Iteration, ...] = ()
    remarks: tuple[str, ...] = ()


def efficient_finish(
    start: Fit,
    *,
    tolerance: float,
    progress: Callable[[Iteration], None],
    stage: str = "finish",
    maximum_iterations: int = limits.FINISH_ITERATIONS,
) -> Minimum:
    """Minimise the weighted torque error from a point, again with finer substeps while they change the torque too much.

    Args:
        tolerance: see :class:`~fmu_didim.prediction.least_squares.Stopping`; stage: names the iterations.
    """
    iterations: list[Iteration] = []
    remarks: list[str] = []
    stopping = Stopping(maximum_iterations, tolerance=tolerance, updates=None, check_all=False, exact=True, whole=True)
    fit, model = start, start.model
    refuse_confounded(
        whitened(fit.jacobian, fit.deviation), fit.values, model.names,
        torque=float(np.linalg.norm(model.measured / fit.deviation)),
    )  # fmt: skip
    for _ in range(limits.MAXIMUM_REFINEMENTS):
        sizes = None if fit.prediction is None else parameter_sizes(fit.model, fit.values, fit.prediction)
        fit = minimise(
            fit.model, NoiseOfResidual(fit.model), stopping=stopping, jacobian=fit.jacobian, torque=fit.torque,
            sizes=sizes, stage=stage, progress=progress,
        )  # fmt: skip
        iterations.extend(fit.iterations)
        difference, allowed = integration_error(fit)
        if not difference > allowed:
            break
        remarks.append(f"Substeps of the plant doubled: halving them changed the torque by {100 * difference:.2g} %.")
        finer = replace(fit.model, substep_factor=2 * fit.model.substep_factor)
        fit = replace(point(finer, NoiseOfResidual(finer)), settled=fit.settled)
    return Minimum(fit, difference, tuple(iterations), tuple(remarks))


def integration_error(fit: Fit) -> tuple[float, float]:
    """Relative change of the torque when the plant's substeps are doubled, and what is allowed; NaN if unknown."""
    model = fit.model
    if not model.can_refine:
        return np.nan, np.inf
    torque = replace(model, substep_factor=2 * model.substep_factor).torque(fit.values)
    size = np.linalg.norm(torque)
    error = float(np.linalg.norm(torque - fit.torque) / size)
    misfit = float(np.linalg.norm(model.measured - torque) / size)
    return error, max(limits.INTEGRATION_TOLERANCE, limits.INTEGRATION_SHARE * misfit)


def degrees_of_freedom(model: LoopModel, count: int) -> float:
    """Degrees of freedom of the intervals of ``count`` parameters: those of one joint where each joint's noise is
    estimated by itself, the safe end of what Welch and Satterthwaite's rule can give."""
    total = model.measured.size - count
    if model.torque_deviation is not None or model.joint_weights == "equal":
        return float(total)
    return total / model.joint_count


def torque_estimate(
    minimum: Minimum,
    covariance: Array,
    *,
    estimator: str,
    settled: bool,
    iterations: Sequence[Iteration],
    stages: Mapping[str, Stage],
) -> Estimate:
    """The estimate at a minimum, or at another point of the closed loop, with covariance (p, p)."""
    fit, model = minimum.fit, minimum.fit.model
    return Estimate(
        estimator=estimator,
        names=model.names,
        units=model.units,
        value=fit.values,
        covariance=covariance,
        freedom=degrees_of_freedom(model, fit.values.size),
        time=np.concatenate([model.experiments[label].time for label in model.estimation_labels]),
        measured=model.measured,
        simulated=fit.torque,
        noise=fit.deviation,
        condition_number=fit.condition_number,
        status=Status.CONVERGED if settled else Status.MAXIMUM_ITERATIONS,
        iterations=tuple(iterations),
        stages=stages,
        base_count=model.parameters.count,
        integration_error=minimum.integration_error,
        agreements=agreement(model, fit.torque, fit.jacobian, fit.deviation),
        remarks=minimum.remarks,
    )
