"""Covariance of the values of a fit, and the noise of its logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fmu_didim.data.signals import Array
from fmu_didim.fit.confounding import shown_directions
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.noise.shared import counted_once, variance_by_sharing
from fmu_didim.fit.noise.weighting import noise_floor, whitened
from fmu_didim.fit.statistics import deviation_of_sums, influence_efficient, influence_of_instruments
from fmu_didim.fit.uncertainty import Uncertainty, covariance_of, stretches_of_outputs, uncertainty


def unfiltered_residual(fit: Fit) -> Array:
    """(M, m) residual of a fit on the unfiltered logs."""
    if fit.model.experiments.low_pass is None:
        return fit.residual
    model = fit.model.with_low_pass(None)
    return model.measured_outputs - model.outputs(fit.values)


def fit_uncertainty(fit: Fit, instruments: Array | None = None) -> Uncertainty:
    """The covariance of the values where a fit stands, with the noise that its residual shows.

    Samples that were filtered count for what they are: the noise is that of the log, and the filter belongs to the
    influence. Beside a prior, the noise is what no values of the parameters explain of the residual, and the covariance
    is  Phi' Omega Phi + Psi' Psi  with the influences Phi of the data and Psi of the prior, which is a draw as well.

    Args:
        instruments: (N, n, b) W of the torque alone, where W'(y - tau_s) = 0 instead of S'(y - tau_s) = 0 (DIDIM); the
            first b values are then those that were fitted.

    Raises:
        SimulationError: the values cannot be simulated, which they could when they were fitted.
    """
    sensitivity = fit.jacobian if instruments is None else fit.jacobian[:, :, : instruments.shape[2]]
    influence, of_prior = _influences(fit, sensitivity, instruments)
    if fit.model.prior is None:
        return _by_residual(fit, unfiltered_residual(fit), sensitivity, influence)
    left, right = shown_directions(whitened(sensitivity, fit.deviation))
    step = right @ (left.T @ whitened(fit.residual, fit.deviation))
    residual = unfiltered_residual(fit) - sensitivity @ step
    free = (left @ right.T).reshape(sensitivity.shape) / fit.deviation[:, None]
    alone = _by_residual(fit, residual, sensitivity, free)
    by_data = data_covariance(fit, influence, alone, residual)
    return replace(alone, covariance=by_data + of_prior.T @ of_prior, by_data=by_data, alone=alone.covariance)


def influences(fit: Fit) -> tuple[Array, Array]:
    """(M, m, p) by which the values of a fit follow the noise of its outputs, and (r, p) by which they follow that of
    the rows of its prior."""
    influence, of_prior = _influences(fit, fit.jacobian, None)
    return influence if fit.model.experiments.low_pass is None else filtered_torque(fit, influence), of_prior


def moved_by(fit: Fit, error: Array) -> Array:
    """(p,) standard deviations by which an error (M, m) of the outputs moves the values of a fit, by one linear
    step."""
    deviation = np.maximum(fit_uncertainty(fit).deviation, TINY)
    return np.asarray(np.abs(moves_of(fit, [error])[:, 0]) / deviation)


def moves_of(fit: Fit, errors: Sequence[Array | NDArray[np.float32]]) -> Array:
    """(p, s) by which errors, (M, m) each, of the outputs move the values of a fit, by one linear step."""
    influence, _ = influences(fit)
    flat = influence.reshape(-1, influence.shape[2]).T
    return np.column_stack([flat @ error.reshape(-1) for error in errors])


def data_covariance(fit: Fit, influence: Array, noise: Uncertainty, residual: Array) -> Array:
    """(p, p) covariance of what follows the noise of the outputs with an influence (M, m, p).

    Args:
        noise: of the outputs; residual: (M, m) what noise leaves, by which outputs may share some.
    """
    experiments = fit.model.experiments
    if experiments.low_pass is not None:
        influence = filtered_torque(fit, influence)
    covariance = covariance_of(influence, noise, stretches_of_outputs(experiments))
    return counted_once(covariance, variance_by_sharing(influence, residual, experiments))


def _influences(fit: Fit, sensitivity: Array, instruments: Array | None) -> tuple[Array, Array]:
    """Influence of the outputs (M, m, p), not filtered, and of the prior (r, p)."""
    model, deviation = fit.model, fit.deviation
    s = whitened(sensitivity, deviation)
    if instruments is None:
        flat = influence_efficient(model.beside_prior(s))
    else:
        flat = influence_of_instruments(
            model.beside_prior(whitened(instruments, deviation)), model.beside_prior(s)
        )  # fmt: skip
    of_outputs = flat[: len(s)].reshape(sensitivity.shape)
    of_outputs /= deviation[:, None]
    return of_outputs, flat[len(s) :]


def _by_residual(fit: Fit, residual: Array, sensitivity: Array, influence: Array) -> Uncertainty:
    """The noise that a residual (M, m) shows, and the covariance of what follows it with an influence (M, m, p)."""
    model, experiments = fit.model, fit.model.experiments
    stated = ~np.isnan(model.stated_deviations)
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
        stated=stated, floor=floor, usual=usual if is_filtered else None, size=fit.outputs,
    )  # fmt: skip
    by_sharing = variance_by_sharing(influence, residual, experiments)
    return replace(found, covariance=counted_once(found.covariance, by_sharing))


def filtered_torque(fit: Fit, table: Array) -> Array:
    """A table (M, m, ...) over all outputs with its torque filtered as the logs are."""
    experiments, result = fit.model.experiments, table.copy()
    block = experiments.output_blocks[0]
    for label, log in zip(experiments.estimation_labels, block.logs, strict=True):
        result[log.rows, block.columns] = experiments.filtered(table[log.rows, block.columns], label)
    return result
