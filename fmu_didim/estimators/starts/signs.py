"""Signs of a log that shows the size of a torque alone, as current sensors of hobby servos and some arms do.

With y = |tau| + noise and a regressor W along the reference, signs and base parameters are found in turn,

    s = sign(W theta + known),      theta = argmin |W theta + known - s y|^2,

from the values of the description and from some drawn about them, of which the least misfit counts: each turn lowers
it. A fit of the closed loop then asks again, with the torque that it simulates, until no sign changes. Source: the
alternating projections of R. W. Gerchberg, W. O. Saxton, Optik 35 (1972), with signs in the place of phases.

Near zero, sizes are too large on average, by normal noise of deviation sigma (F. C. Leone et al., Technometrics 3,
1961, the folded normal distribution):

    E|tau + noise| - |tau| = b(tau) = sigma sqrt(2/pi) exp(-tau^2 / 2 sigma^2) - |tau| erfc(|tau| / sigma sqrt(2)).

The values then solve S'(s (y - b) - tau) = 0 with the whitened sensitivity S. Where the torque is zero a size says
nothing of it; with the slopes a and the variances v of its terms,

    a = erf(|tau| / sigma sqrt(2)),      v = 1 + tau^2/sigma^2 - (|tau| + b)^2/sigma^2,

their covariance is (S'aS)^-1 S'vS (S'aS)^-1 (P. J. Huber, Proc. 5th Berkeley Symp., 1967) and not (S'S)^-1.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import erf, erfc

from fmu_didim.base.errors import FmuDidimError, InputError
from fmu_didim.data.signals import Array
from fmu_didim.estimators.starts.reference_start import rows_on, whole_reference
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.noise.weighting import whitened
from fmu_didim.model.loop_model import LoopModel

TURNS = 100
"""[1] Of signs and values, which take 3 to 20."""
DRAWS = 20
"""[starts] Beside the description."""
SPREAD = 1.0
"""[1] Deviation of the logarithm of a factor by which a base parameter is drawn off the description."""
SEED = 0


def with_signs(model: LoopModel) -> LoopModel:
    """The model whose logs without a sign have those of the reference motion, as far as it tells.

    Raises:
        InputError: neither regressor nor simulation gives a torque along the reference.
    """
    labels = [label for label, experiment in model.experiments.items() if experiment.is_unsigned]
    if not labels:
        return model
    names = next(iter(model.experiments.values())).reference.names
    if not model.parameters.has_regressor or not all(f"q{j}" in names for j in range(1, model.joint_count + 1)):
        try:
            return signed_by(model, model.start)
        except FmuDidimError as error:
            raise InputError(
                "The signs of the torque log cannot be found.", where="torque: unsigned", got=str(error),
                next_step="Give start values with which the loop can be simulated, or a log with signs.",
            ) from error  # fmt: skip
    fitted = [label for label in labels if label in model.estimation_labels] or labels
    rows = {label: rows_on(model.simulation(model.start, label), whole_reference(model.simulation(model.start, label)))
            for label in labels}  # fmt: skip
    theta = best_values(
        np.concatenate([rows[label][0] for label in fitted]), np.concatenate([rows[label][1] for label in fitted]),
        np.concatenate([np.abs(model.experiments[label].torque) for label in fitted]), model.theta(model.start),
    )[0]  # fmt: skip
    for label in labels:
        columns, known = rows[label]
        model = _signed(model, label, columns @ theta + known, np.abs(model.experiments[label].torque))
    return model


def signed_by(model: LoopModel, values: Array) -> LoopModel:
    """The model whose logs without a sign have those of the torque that is simulated with values (p,)."""
    for label, experiment in model.experiments.items():
        if experiment.is_unsigned:
            model = _signed(model, label, model.torque(values, label), np.abs(experiment.torque))
    return model


def unfolded(model: LoopModel, values: Array, noise: Array, logs: LoopModel) -> LoopModel:
    """The model whose logs without a sign are those sizes of ``logs``, less what noise adds to them on average, with
    the signs of the torque that is simulated with values (p,).

    Args:
        noise: (n,) its deviation, N.m; logs: a model with the sizes as they were measured.
    """
    for label, experiment in logs.experiments.items():
        if experiment.is_unsigned:
            torque = model.torque(values, label)
            model = _signed(model, label, torque, np.abs(experiment.torque) - folded_excess(torque, noise))
    return model


def folded_excess(torque: Array, noise: Array) -> Array:
    """(N, n) by how much the size of a torque (N, n) with normal noise of these deviations (n,) is larger on average
    than that of the torque, N.m."""
    deviation = np.maximum(noise, TINY)
    ratio = np.abs(torque) / deviation
    return np.asarray(deviation * (np.sqrt(2 / np.pi) * np.exp(-(ratio**2) / 2) - ratio * erfc(ratio / np.sqrt(2))))


def unknown_signs(fit: Fit) -> Array:
    """(p, p) by how much the covariance of the values is larger than if the signs had been measured."""
    slope, variance = np.ones_like(fit.outputs), np.ones_like(fit.outputs)
    experiments, block = fit.model.experiments, fit.model.experiments.output_blocks[0]
    for log in block.logs:
        if experiments[log.label].is_unsigned:
            deviation = fit.deviation[block.columns]
            torque = np.abs(fit.outputs[log.rows, block.columns])
            mean = torque + folded_excess(torque, deviation)
            slope[log.rows, block.columns] = erf(torque / (deviation * np.sqrt(2)))
            variance[log.rows, block.columns] = 1 + (torque**2 - mean**2) / deviation**2
    table = fit.model.beside_prior(whitened(fit.jacobian, fit.deviation))
    scale = np.linalg.norm(table, axis=0)
    table, rest = table / scale, len(table) - slope.size
    weights = (np.pad(one.ravel(), (0, rest), constant_values=1.0)[:, None] for one in (slope, variance))
    sloped, varied = (table.T @ (weight * table) for weight in weights)
    inverse = np.linalg.inv(sloped)
    return np.asarray((inverse @ varied @ inverse - np.linalg.inv(table.T @ table)) / np.outer(scale, scale))


def best_values(columns: Array, known: Array, sizes: Array, first: Array) -> tuple[Array, float]:
    """Values (b,) whose torque columns (N, n, b) theta + known (N, n) has the least mean squared difference in size
    from sizes (N, n), and that difference, each joint divided by its root mean square.

    Args:
        first: (b,) where they begin, and about which others are drawn.
    """
    scale = np.maximum(np.sqrt(np.mean(sizes**2, axis=0)), TINY)
    table = (columns / scale[:, None]).reshape(-1, columns.shape[2])
    length = np.maximum(np.linalg.norm(table, axis=0), TINY)
    inverse = np.linalg.pinv(table / length)
    flat, offset = (sizes / scale).ravel(), (known / scale).ravel()
    rng, best = np.random.default_rng(SEED), (first, np.inf)
    starts = [first, *(first * np.exp(SPREAD * rng.standard_normal(first.size)) for _ in range(DRAWS))]
    for theta in starts:
        signs = np.sign(table @ theta + offset)
        for _ in range(TURNS):
            theta = inverse @ (signs * flat - offset) / length
            torque = table @ theta + offset
            if (np.sign(torque) == signs).all():
                break
            signs = np.sign(torque)
        misfit = float(np.mean((np.abs(torque) - flat) ** 2))
        if misfit < best[1]:
            best = theta, misfit
    return best


def _signed(model: LoopModel, label: str, torque: Array, sizes: Array) -> LoopModel:
    """The model whose log of an experiment has these sizes and the signs of a torque, (N, n) each."""
    signs = np.where(torque < 0, -1.0, 1.0)
    return model.with_experiment(label, replace(model.experiments[label], torque=signs * sizes))
