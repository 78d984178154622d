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

from fmu_didim.base.distributions import chi2_sf
from fmu_didim.estimators.finish import FINISH_ITERATIONS, NEXT_STEP, Minimum, finish_by_colour
from fmu_didim.fit.estimate import ChannelNoise, JointFit
from fmu_didim.fit.fit import point
from fmu_didim.fit.fit_uncertainty import influences, unfiltered_residual
from fmu_didim.fit.iteration import Iteration
from fmu_didim.fit.noise.shared import parts_of_outputs, shared_variance
from fmu_didim.fit.noise.weighting import NoiseOfResidual
from fmu_didim.fit.uncertainty import covariance_of, stretches_of_outputs
from fmu_didim.model.experiments import Experiments
from fmu_didim.model.loop_model import LoopModel

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
    stage: str = "joint",
) -> Minimum:
    """The minimum of the error of all outputs, from the values of a model; of the channels alone where the loop is
    open, since a torque that is given depends on no value.

    Args:
        maximum: iterations of each round; stage: names the iterations; the others as of :func:`joint_minimum`.

    Raises:
        IdentificationError, SimulationError: as of that.
    """
    start = point(model, NoiseOfResidual(model))
    found = finish_by_colour(
        start, tolerance=tolerance, progress=progress, stage=stage, maximum_iterations=maximum
    )  # fmt: skip
    return replace(found, joint=JointFit(_channels(found), None, np.zeros(0), np.zeros(0), 1.0))


def _compared(alone: Minimum, joint: Minimum) -> JointFit:
    """The joint answer beside that of the torque alone."""
    fit, model = joint.fit, joint.fit.model
    experiments = model.experiments
    difference, of_prior = influences(fit)
    of_torque, prior_alone = influences(alone.fit)
    block, whole = experiments.output_blocks[0], alone.fit.model.experiments.output_blocks[0]
    for log, own in zip(block.logs, whole.logs, strict=True):
        difference[log.rows, block.columns] -= of_torque[own.rows]
    deviation = alone.known.deviation
    covariance = covariance_of(difference, joint.known, stretches_of_outputs(experiments))
    shared = np.sqrt(shared_variance(difference, unfiltered_residual(fit), parts_of_outputs(experiments)))
    covariance = covariance * np.outer(shared, shared)
    if model.prior is not None:
        covariance += (of_prior - prior_alone).T @ (of_prior - prior_alone)
    covariance = covariance / np.outer(deviation, deviation) + UNFINISHED**2 * np.eye(deviation.size)
    moved = (fit.values - alone.fit.values) / deviation
    distance = float(moved @ np.linalg.solve(covariance, moved))
    return JointFit(
        channels=_channels(joint),
        alone=alone.fit.values,
        alone_deviation=deviation,
        apart=np.asarray(moved / np.sqrt(np.diag(covariance))),
        p_value=float(chi2_sf(distance, moved.size)),
    )


def _channels(joint: Minimum) -> tuple[ChannelNoise, ...]:
    """What each channel leaves."""
    model, residual, n = joint.fit.model, joint.fit.residual, joint.fit.model.joint_count
    units = {c.name: c.unit for e in model.experiments.values() for c in e.channels}
    stated, scales, found = model.stated_deviations, model.experiments.typical_scales, []
    for k, name in enumerate(model.experiments.channels, start=n):
        own = [colour for colour in joint.known.colours if colour.joint == k + 1]
        main = max(own, key=lambda colour: colour.samples)
        samples = float(model.output_counts[k])
        found.append(
            ChannelNoise(
                name=name,
                unit=units[name],
                samples=int(samples),
                deviation=float(joint.fit.noise.deviation[k] * scales[k]),
                is_stated=bool(np.isfinite(stated[k])),
                rms=float(np.sqrt(np.sum(residual[:, k] ** 2) / samples) * scales[k]),
                lag_one=main.lag_one,
                inflation=max(colour.inflation for colour in own),
            )
        )
    return tuple(found)
