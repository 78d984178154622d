"""Covariance of the values of a fit, and the noise of its torque logs."""

from __future__ import annotations

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.weighting import noise_floor, whitened
from fmu_didim.fit.statistics import influence_efficient, influence_of_instruments, noise_deviation
from fmu_didim.fit.uncertainty import Uncertainty, stretches, uncertainty


def unfiltered_residual(fit: Fit) -> Array:
    """(N, n) residual of a fit on the unfiltered torque logs."""
    if fit.model.experiments.low_pass is None:
        return fit.residual
    return fit.model.with_low_pass(None).residual(fit.values)


def fit_uncertainty(fit: Fit, instruments: Array | None = None) -> Uncertainty:
    """The covariance of the values where a fit stands, with the noise that its residual shows.

    Samples that were filtered count for what they are: the noise is that of the log, and the filter belongs to the
    influence.

    Args:
        instruments: (N, n, b) W where W'(y - tau_s) = 0 instead of S'(y - tau_s) = 0 (DIDIM); the first b values are
            then those that were fitted.

    Raises:
        SimulationError: the values cannot be simulated, which they could when they were fitted.
    """
    model, experiments = fit.model, fit.model.experiments
    deviation, residual = fit.deviation, unfiltered_residual(fit)
    stated = model.torque_deviation is not None
    sensitivity = fit.jacobian if instruments is None else fit.jacobian[:, :, : instruments.shape[2]]
    s = whitened(sensitivity, deviation)
    flat = (
        influence_efficient(s) if instruments is None else influence_of_instruments(whitened(instruments, deviation), s)
    )
    influence = flat.reshape(sensitivity.shape) / deviation[:, None]
    usual = np.einsum("mjp,mjp->jp", influence, influence) * deviation[:, None] ** 2
    is_filtered = experiments.low_pass is not None
    if is_filtered:
        parts = [experiments.filtered(influence[rows], label) for label, rows in experiments.rows.items()]
        influence = np.concatenate(parts)
    floor = noise_floor(model.measured)
    if not stated and (is_filtered or model.joint_weights == "equal"):
        leverage = np.einsum("mjp,mjp->mj", sensitivity, influence)
        deviation = noise_deviation(residual, leverage, floor=floor)
    return uncertainty(
        residual, sensitivity, influence, deviation, stretches([experiments[label].time for label in experiments.rows]),
        stated=stated, floor=floor, usual=usual if is_filtered else None,
    )  # fmt: skip
