"""Covariance of the values of a fit, and the noise of its logs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.shared import parts_of_outputs, shared_variance
from fmu_didim.fit.noise.weighting import noise_floor, whitened
from fmu_didim.fit.statistics import deviation_of_sums, influence_efficient, influence_of_instruments
from fmu_didim.fit.uncertainty import Uncertainty, stretches_of_outputs, uncertainty


def unfiltered_residual(fit: Fit) -> Array:
    """(M, m) residual of a fit on the unfiltered logs."""
    if fit.model.experiments.low_pass is None:
        return fit.residual
    model = fit.model.with_low_pass(None)
    return model.measured_outputs - model.outputs(fit.values)


def fit_uncertainty(fit: Fit, instruments: Array | None = None) -> Uncertainty:
    """The covariance of the values where a fit stands, with the noise that its residual shows.

    Samples that were filtered count for what they are: the noise is that of the log, and the filter belongs to the
    influence.

    Args:
        instruments: (N, n, b) W of the torque alone, where W'(y - tau_s) = 0 instead of S'(y - tau_s) = 0 (DIDIM); the
            first b values are then those that were fitted.

    Raises:
        SimulationError: the values cannot be simulated, which they could when they were fitted.
    """
    model, experiments = fit.model, fit.model.experiments
    deviation, residual = fit.deviation, unfiltered_residual(fit)
    stated = ~np.isnan(model.stated_deviations)
    sensitivity = fit.jacobian if instruments is None else fit.jacobian[:, :, : instruments.shape[2]]
    s = whitened(sensitivity, deviation)
    flat = (
        influence_efficient(s) if instruments is None else influence_of_instruments(whitened(instruments, deviation), s)
    )
    influence = flat.reshape(sensitivity.shape) / deviation[:, None]
    deviation = fit.noise.deviation
    usual = np.einsum("mjp,mjp->jp", influence, influence) * deviation[:, None] ** 2
    is_filtered = experiments.low_pass is not None
    if is_filtered:
        influence = filtered_torque(fit, influence)
    counts = model.output_counts
    floor = noise_floor(model.measured_outputs, counts)
    if not stated[: model.joint_count].all() and (is_filtered or model.joint_weights == "equal"):
        freedom = counts - np.einsum("mjp,mjp->j", sensitivity, influence)
        of_residual = deviation_of_sums((residual**2).sum(axis=0), freedom, floor=floor)
        deviation = np.where(stated, deviation, of_residual)
    found = uncertainty(
        residual, sensitivity, influence, deviation, stretches_of_outputs(experiments),
        stated=stated, floor=floor, usual=usual if is_filtered else None,
    )  # fmt: skip
    if not experiments.channels:
        return found
    # What outputs share by chance makes no value better known.
    factor = np.sqrt(np.maximum(shared_variance(influence, residual, parts_of_outputs(experiments)), 1.0))
    return replace(found, covariance=found.covariance * np.outer(factor, factor))


def filtered_torque(fit: Fit, table: Array) -> Array:
    """A table (M, m, ...) over all outputs with its torque filtered as the logs are."""
    experiments, result = fit.model.experiments, table.copy()
    block = experiments.output_blocks[0]
    for label, log in zip(experiments.estimation_labels, block.logs, strict=True):
        result[log.rows, block.columns] = experiments.filtered(table[log.rows, block.columns], label)
    return result
