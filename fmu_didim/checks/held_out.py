"""Whether held-out experiments are predicted as well as the fitted ones, joint by joint.

The residual of a held-out experiment holds the noise and the effect of the uncertainty C of the values on its torque,

    expected variance of joint j    v_j = s_j^2 + mean_k (S_v C S_v')_kj,kj

with the residual variance s_j^2 of the fit and the sensitivity S_v of the held-out torque. The ratio of the two
variances is compared with Fisher's F, by the number of independent samples. A joint is predicted worse if its residual
is larger both as it is and relative to the torque: model error and some noise grow with the torque, other noise does
not. A log that is noisier is no fault of the values: a larger residual is a remark where it is white once the colour of
the noise of the fit is taken out, so that it is noise of the same kind, and where it follows neither the motion nor any
of the values, by as many samples as show that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Code, Diagnostic
from fmu_didim.base.distributions import f_sf
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.motion.colour import Colour as Whitening
from fmu_didim.checks.motion.colour import Columns, Logs
from fmu_didim.checks.motion.dependence import SAMPLES_A_FUNCTION, dependence
from fmu_didim.checks.motion.functions import functions_of_motion
from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array
from fmu_didim.data.spectrum import lagged_products
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.noise.autoregression import portmanteau, portmanteau_p
from fmu_didim.fit.noise.noise import TINY, effective_fraction
from fmu_didim.fit.uncertainty import Colour, stretches
from fmu_didim.model.loop_model import LoopModel

HELD_OUT_RATIO = 1.25
"""[1] Residual of a joint in a held-out experiment over that of the fit, from which it is predicted worse: half as much
as shows in a plot."""
HELD_OUT_CHANCE = 1e-3
"""[1] Probability, for all joints together, with which noise alone may make it so."""

WORSE_HELD_OUT = CATALOGUE(
    "worse-on-held-out", DOUBT, rank=55,
    meaning="A held-out experiment is predicted worse than the fitted ones, by more than noise and the uncertainty of "
    "the values explain: the model lacks something that shows there, or the two experiments differ.",
    next_step="Run fmu-didim discover CASE.yaml; compare payload, temperature and clock of the two experiments.",
)  # fmt: skip
LAGS = 10
"""[samples] Correlations of a held-out residual that are tested before it counts as white."""

NOISIER_HELD_OUT = CATALOGUE(
    "held-out-noisier", REMARK, rank=64,
    meaning="The residual of a held-out experiment is larger than that of the fitted ones, but as white, or of the "
    "same colour, and follows neither the motion nor any of the values: noise that is larger there. What looks like "
    "such noise, as a rattle does, passes for it.",
    next_step="Find out why that log is noisier; one of the same quality tests the values harder.",
)  # fmt: skip
NOT_SIMULATED = CATALOGUE(
    "held-out-not-simulated", DOUBT, rank=51,
    meaning="The loop with the identified values cannot be simulated on a held-out experiment.",
    next_step="Check the reference of that experiment, and where its plant starts.",
)  # fmt: skip
NO_HELD_OUT = CATALOGUE(
    "no-held-out", REMARK, rank=90,
    meaning="No experiment was held out, so it is not known whether the values predict another motion.",
    next_step="Record a second motion: experiments: {...: {role: validation}}.",
)  # fmt: skip


@dataclass(frozen=True)
class Residual:
    """A residual (N, n), and the RMS (n,) of what was measured, both in the unit of that.

    A torque is measured from zero; other signals, (N, 1), from their mean, since their zero is anywhere.
    """

    values: Array
    size: Array

    @staticmethod
    def of(measured: Array, simulated: Array) -> Residual:
        """The residual of torques (N, n)."""
        return Residual(measured - simulated, np.maximum(np.sqrt(np.mean(measured**2, axis=0)), TINY))

    @property
    def variance(self) -> Array:
        """(n,) mean square."""
        return np.asarray(np.maximum(np.mean(self.values**2, axis=0), TINY))


def held_out_diagnostics(
    model: LoopModel,
    covariance: Array,
    fitted: Residual,
    held: Mapping[str, Residual],
    failures: Mapping[str, str],
    colours: Sequence[Colour] = (),
) -> list[Diagnostic]:
    """Whether held-out experiments contradict the values of a model, known with a covariance (p, p).

    Args:
        fitted: residual of all fitted experiments; held: label -> that of each held-out one.
        failures: label -> why one could not be simulated.
        colours: of the noise of the fit; it counts as white where none is of the joint and the rate.
    """
    found = not_simulated(failures)
    for label, residual in held.items():
        count = covariance.shape[0]
        worse = worse_than_fitted(fitted, residual, count=count)
        if not worse.size:
            continue
        columns = _sensitivity(model.on(label))
        extra = np.einsum("kjp,pq,kjq->j", columns, covariance, columns) / max(columns.shape[0], 1)
        for j in worse_than_fitted(fitted, residual, count=count, extra=extra):
            noise = _is_noise(model, label, residual.values[:, j], columns[:, j], int(j), colours)
            found.append(_worse(fitted, residual, int(j), label, NOISIER_HELD_OUT if noise else WORSE_HELD_OUT))
    if not held and not failures:
        text = "No experiment was held out: the prediction of another motion is untested."
        found.append(Diagnostic(NO_HELD_OUT, text))
    return found


def not_simulated(failures: Mapping[str, str]) -> list[Diagnostic]:
    """The experiments that could not be simulated: label -> why."""
    return [Diagnostic(NOT_SIMULATED, f"The simulation failed: {why}", place=label) for label, why in failures.items()]


def worse_than_fitted(
    fitted: Residual, held: Residual, *, count: float, extra: Array | float = 0.0, among: int | None = None
) -> NDArray[np.intp]:
    """Columns (from 0) of which a held-out residual is larger than that of the fit, beyond chance and by a good part.

    Args:
        count: of parameters fitted to these columns; extra: (n,) mean variance by their uncertainty.
        among: columns that are looked at in all; by default those of this residual.
    """
    samples, n = fitted.values.shape
    left = max(samples - count / n, 1.0)
    before = fitted.variance * samples / left + extra
    size = np.maximum(held.size / fitted.size, 1.0)
    ratio = held.variance / (before * size**2)
    first = np.maximum(left * _independent_squares(fitted.values), 1.0)
    second = np.maximum(held.values.shape[0] * _independent_squares(held.values), 1.0)
    chance = f_sf(ratio, second, first)
    return np.flatnonzero((chance < HELD_OUT_CHANCE / (among or n)) & (ratio > HELD_OUT_RATIO**2))


def _independent_squares(residual: Array) -> Array:
    """(n,) part of the samples whose squares count as independent, (1 - rho^2)/(1 + rho^2) with the lag-one
    correlation rho of a first-order autoregression."""
    fraction = effective_fraction(residual)
    rho = (1 - fraction) / (1 + fraction)
    return np.asarray((1 - rho**2) / (1 + rho**2))


def _sensitivity(model: LoopModel) -> Array:
    """(N, n, p) of the torque; zeros where it cannot be simulated near the values."""
    model = model.torque_alone
    try:
        return sensitivity(model, model.start, model.torque(model.start))
    except SimulationError:
        return np.zeros((*model.measured.shape, model.start.size))


def _is_noise(
    model: LoopModel, label: str, residual: Array, columns: Array, joint: int, colours: Sequence[Colour]
) -> bool:
    """Whether a held-out residual (N,) of a joint, from 0, is white once the colour of the noise of the fit is taken
    out, and follows neither the motion nor the values, by their columns (N, p)."""
    experiment = model.experiments[label]
    try:
        functions = functions_of_motion(model.simulation(model.start, label))[joint]
    except SimulationError:
        return False
    table = np.column_stack([residual, columns, *functions.values()])
    kept, white = _whitened(table, experiment.time, joint, colours)
    on_grid = np.full(experiment.time.size, np.nan)
    on_grid[kept] = white[:, 0]
    on_grid = experiment.with_gaps(on_grid)
    there, known = np.isfinite(on_grid).astype(float), np.nan_to_num(on_grid)
    lags = np.arange(min(LAGS, residual.size - 1) + 1)
    pairs = np.maximum(np.rint(lagged_products(there, there, lags)), 1.0)
    products = lagged_products(known, known, lags)
    if portmanteau_p(portmanteau(products / pairs, pairs, int(lags[-1])), int(lags[-1])) < HELD_OUT_CHANCE:
        return False
    left, motion = white[:, 0], white[:, 1:]
    if left.size < SAMPLES_A_FUNCTION * motion.shape[1]:
        return False
    names = [*model.names, *functions]
    return dependence(left, np.zeros((left.size, 0)), motion, names, joint=joint + 1).p_value > HELD_OUT_CHANCE


def _whitened(table: Array, time: Array, joint: int, colours: Sequence[Colour]) -> tuple[Indices, Array]:
    """The rows of columns (N, m) at these instants that have a past in the autoregression of the noise of the fit, and
    what it leaves of them; all as they are where that noise counts as white, or where none is of this rate."""
    (log,) = stretches([time])
    own = [c.coefficients for c in colours if c.joint == joint + 1 and c.rate_hz == log.rate_hz and c.coefficients.size]
    if not own:
        return np.arange(time.size), table
    logs = Logs((log,), lags=(own[0].size,))
    return np.arange(time.size)[logs.pasts[0].rows[0]], Columns(logs, table).whitened(
        Whitening(0, (own[0],), (1.0,), np.inf)
    )


def _worse(fitted: Residual, held: Residual, joint: int, label: str, code: Code) -> Diagnostic:
    before, after = (100 * float(np.sqrt(r.variance[joint]) / r.size[joint]) for r in (fitted, held))
    ratio = float(np.sqrt(held.variance[joint] / fitted.variance[joint]))
    text = f"The torque error is {after:.3g} % against {before:.3g} % in the fit, and {ratio:.3g} times as large."
    if code is NOISIER_HELD_OUT:
        text += " It is as white as that of the fit, and follows neither the motion nor the values: noise."
    value = min(ratio, after / max(before, TINY))
    return Diagnostic(code, text, f"{label}: joint {joint + 1}", value, HELD_OUT_RATIO, "1")
