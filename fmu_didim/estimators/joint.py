"""The joint fit of the torque and what else was measured, beside the torque alone.

    values = argmin sum_j |y_j - y_sj(values)|^2 / (s_j f_j)^2

over the torques of the joints and the further channels j, in the same simulation of the loop. s_j is the noise of an
output, f_j by how much its colour inflates the standard deviations that come from it, relative to the torque; so that
an encoder with little noise whose residual is slow model error counts by what it knows, not by how many samples it has.
The covariance is that of these weights with these colours, whatever they are.

Where the model is right both answers differ by noise. With the influence Phi of the noise on each, the difference has
the covariance D' Omega D, D = Phi_joint - Phi_alone: the torque that both share counts once. What feedback carries from
one output into another is counted in both (:mod:`fmu_didim.fit.noise.shared`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from fmu_didim.data.signals import Array
from fmu_didim.estimators.finish import FINISH_ITERATIONS, NEXT_STEP, Minimum, efficient_finish
from fmu_didim.fit.estimate import ChannelNoise, JointFit
from fmu_didim.fit.fit import Fit, point
from fmu_didim.fit.fit_uncertainty import filtered_torque, unfiltered_residual
from fmu_didim.fit.iteration import Iteration
from fmu_didim.fit.noise.shared import parts_of_outputs, shared_variance
from fmu_didim.fit.noise.weighting import NoiseOfResidual, whitened
from fmu_didim.fit.statistics import influence_efficient
from fmu_didim.fit.uncertainty import Uncertainty, covariance_of, stretches_of_outputs
from fmu_didim.model.experiments import Experiments
from fmu_didim.model.loop_model import LoopModel

ROUNDS = 3
"""[rounds] Of fit and colour: the inflation follows from the residual, and the residual from the weights."""
SAME_INFLATION = 0.1
"""[1] Relative change of an inflation below which the weights stay: it moves no standard deviation by 1 %."""
LEAST_INFLATION = 0.1
"""[1] Smallest inflation of a channel: weights must stay finite where it says nothing of any value."""
UNFINISHED = 2 * NEXT_STEP
"""[standard deviations] Two fits that have settled may be apart by that without any noise."""


def joint_minimum(
    alone: Minimum,
    *,
    experiments: Experiments,
    tolerance: float | None,
    progress: Callable[[Iteration], None],
) -> Minimum:
    """The minimum of the error of all outputs, from that of the torque alone, which it is where nothing else was
    measured.

    Args:
        experiments: with all channels; tolerance: as of :func:`~fmu_didim.estimators.finish.efficient_finish`.

    Raises:
        IdentificationError: as of that; SimulationError: the values cannot be simulated.
    """
    if not experiments.channels:
        return alone
    model = replace(alone.fit.model.with_values(alone.fit.values), experiments=experiments)
    found = motion_minimum(model, tolerance=tolerance, progress=progress)
    return replace(found.after(alone), rivals=alone.rivals, joint=_compared(alone, found))


def motion_minimum(
    model: LoopModel,
    *,
    tolerance: float | None,
    progress: Callable[[Iteration], None],
    maximum: int = FINISH_ITERATIONS,
) -> Minimum:
    """The minimum of the error of all outputs, from the values of a model; of the channels alone where the loop is
    open, since a torque that is given depends on no value.

    Args:
        maximum: iterations of each round; the others as of :func:`joint_minimum`.

    Raises:
        IdentificationError, SimulationError: as of that.
    """
    fit, inflation = point(model, NoiseOfResidual(model)), None
    iterations: list[Iteration] = []
    remarks: list[str] = []
    for _ in range(ROUNDS):
        found = efficient_finish(
            fit, tolerance=tolerance, progress=progress, stage="joint", inflation=inflation, maximum_iterations=maximum
        )
        iterations.extend(found.iterations)
        remarks.extend(remark for remark in found.remarks if remark not in remarks)
        fit, wanted = found.fit, _inflation(found.known, model.joint_count, model.output_counts.size)
        before = np.ones(wanted.size) if inflation is None else inflation
        if (np.abs(wanted / before - 1) <= SAME_INFLATION).all():
            break
        inflation = wanted
    nothing = JointFit(_channels(found), None, np.zeros(0), np.zeros(0), 1.0)
    return replace(found, iterations=tuple(iterations), remarks=tuple(remarks), joint=nothing)


def _inflation(known: Uncertainty, joints: int, count: int) -> Array:
    """(m,) by how much each output counts less than its white noise would say; one for the torques, whose weights stay
    those of the torque alone."""
    found = np.zeros(count)
    for colour in known.colours:
        found[colour.joint - 1] = max(found[colour.joint - 1], colour.inflation)
    found[joints:] = np.maximum(found[joints:], LEAST_INFLATION)
    of_torque = float(np.sqrt(np.mean(found[:joints] ** 2)))
    return np.concatenate([np.ones(joints), found[joints:] / (of_torque or 1.0)])  # none of a torque that is given


def _influence(fit: Fit) -> Array:
    """(M, m, p) by which the values of a fit follow the noise of its outputs."""
    flat = influence_efficient(whitened(fit.jacobian, fit.deviation))
    found = np.asarray(flat.reshape(fit.jacobian.shape) / fit.deviation[:, None])
    return found if fit.model.experiments.low_pass is None else filtered_torque(fit, found)


def _compared(alone: Minimum, joint: Minimum) -> JointFit:
    """The joint answer beside that of the torque alone."""
    fit, model = joint.fit, joint.fit.model
    experiments, difference = model.experiments, _influence(fit)
    of_torque = _influence(alone.fit)
    block, whole = experiments.output_blocks[0], alone.fit.model.experiments.output_blocks[0]
    for log, own in zip(block.logs, whole.logs, strict=True):
        difference[log.rows, block.columns] -= of_torque[own.rows]
    deviation = alone.known.deviation
    covariance = covariance_of(difference, joint.known.colours, stretches_of_outputs(experiments))
    shared = np.sqrt(shared_variance(difference, unfiltered_residual(fit), parts_of_outputs(experiments)))
    covariance = covariance * np.outer(shared, shared) / np.outer(deviation, deviation) + UNFINISHED**2 * np.eye(
        deviation.size
    )
    moved = (fit.values - alone.fit.values) / deviation
    distance = float(moved @ np.linalg.solve(covariance, moved))
    return JointFit(
        channels=_channels(joint),
        alone=alone.fit.values,
        alone_deviation=deviation,
        apart=np.asarray(moved / np.sqrt(np.diag(covariance))),
        p_value=float(chi2.sf(distance, moved.size)),
    )


def _channels(joint: Minimum) -> tuple[ChannelNoise, ...]:
    """What each channel leaves."""
    model, residual, n = joint.fit.model, joint.fit.residual, joint.fit.model.joint_count
    units = {c.name: c.unit for e in model.experiments.values() for c in e.channels}
    stated, found = model.stated_deviations, []
    for k, name in enumerate(model.experiments.channels, start=n):
        own = [colour for colour in joint.known.colours if colour.joint == k + 1]
        main = max(own, key=lambda colour: colour.samples)
        samples = float(model.output_counts[k])
        found.append(
            ChannelNoise(
                name=name,
                unit=units[name],
                samples=int(samples),
                deviation=float(joint.fit.noise.deviation[k]),
                is_stated=bool(np.isfinite(stated[k])),
                rms=float(np.sqrt(np.sum(residual[:, k] ** 2) / samples)),
                lag_one=main.lag_one,
                inflation=max(colour.inflation for colour in own),
            )
        )
    return tuple(found)
