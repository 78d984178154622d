"""What of an answer comes from a prior, what from the data, and whether the two agree.

At the minimum of  |r|^2 + |t - R v|^2,  with the whitened sensitivity S and A = S'S + R'R, the values follow the noise
e of the data and the draw e0 of the prior by

    v - truth = Phi' e + Psi' e0,     Phi = S A^-1,     Psi = R A^-1,

so that their covariance has two parts. The first, as a fraction of the variance of a value, is what the data have of
it: for a single parameter the weight of the data in the value. Where both are right the rest t - R v of the prior is

    (R Psi' - 1) (-e0) - R Phi' e,

normal with a known covariance, and so is the distance of each value from the mean of the prior. All of it is taken to
first order, at the minimum without limits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmu_didim.base.distributions import chi2_sf
from fmu_didim.data.signals import Array
from fmu_didim.fit.confounding import shown_directions
from fmu_didim.fit.fit import Fit, prior_rows
from fmu_didim.fit.fit_uncertainty import influences
from fmu_didim.fit.noise.weighting import whitened
from fmu_didim.fit.uncertainty import Uncertainty

UNTESTED = 1e-4
"""[1] Variance that a rest of the prior can have, of one at most, below which the data say nothing of it."""
ALONE = 1e-3
"""[1] Part of a parameter along directions that the data do not show, from which they alone do not have it."""


@dataclass(frozen=True)
class PriorFit:
    """A prior beside the data.

    Attributes:
        source: where the prior comes from.
        mean, deviation: (p,) of the prior; NaN and infinite for parameters that have none.
        data_share: (p,) part of the variance of each value that comes from the noise of the data.
        alone, alone_deviation: (p,) values by the data alone, one step from the minimum; NaN where they have none.
        apart: (p,) value minus mean of the prior, in standard deviations of that difference; NaN where there is none.
        p_value: probability of data and prior as far apart by chance; tested: how many directions both know.
        open: as of :class:`~fmu_didim.dynamics.prior.Prior`.
    """

    source: str
    mean: Array
    deviation: Array
    data_share: Array
    alone: Array
    alone_deviation: Array
    apart: Array
    p_value: float
    tested: int
    open: dict[str, tuple[str, ...]]


def prior_fit(fit: Fit, known: Uncertainty) -> PriorFit | None:
    """What the prior of a model does at a minimum with this uncertainty; None where there is none."""
    prior, found = fit.model.prior, prior_rows(fit.model.prior, fit.values)
    if prior is None or found is None or known.by_data is None or known.alone is None:
        return None
    rows, left = found
    s, right = whitened(fit.jacobian, fit.deviation), whitened(fit.residual, fit.deviation)
    table = fit.model.beside_prior(s)
    moved = np.linalg.lstsq(table, np.concatenate([right, left]), rcond=None)[0]
    values, left = fit.values + moved, left - rows @ moved
    _, psi = influences(fit)
    own = np.eye(left.size) - psi @ rows.T
    spread = rows @ known.by_data @ rows.T + own @ own.T
    sizes, vectors = np.linalg.eigh(spread)
    tested = sizes > UNTESTED
    distance = float(np.sum((vectors[:, tested].T @ left) ** 2 / sizes[tested]))
    count = fit.values.size
    missing = count - prior.mean.size
    mean = np.pad(prior.mean, (0, missing), constant_values=np.nan)
    deviation = np.pad(prior.deviation, (0, missing), constant_values=np.inf)
    alone, alone_deviation = _without_prior(fit, known.alone)
    return PriorFit(
        source=prior.source,
        mean=mean,
        deviation=deviation,
        data_share=np.clip(np.diag(known.by_data) / np.diag(known.covariance), 0.0, 1.0),
        alone=alone,
        alone_deviation=alone_deviation,
        apart=_standardised_distance(values - mean, rows, psi, known.by_data, np.isfinite(deviation)),
        p_value=float(chi2_sf(distance, int(tested.sum()))) if tested.any() else 1.0,
        tested=int(tested.sum()),
        open=dict(prior.open),
    )


def _standardised_distance(distance: Array, rows: Array, psi: Array, by_data: Array, has_prior: Array) -> Array:
    """(p,) distances of values from the means of a prior in standard deviations of theirs."""
    of_mean = np.linalg.pinv(rows)  # (p, r): how the means follow the draw of the prior
    moved = psi.T - of_mean
    variance = np.diag(by_data) + np.einsum("pr,pr->p", moved, moved)
    least = UNTESTED * np.einsum("pr,pr->p", of_mean, of_mean)
    return np.where(has_prior & (variance > least), distance / np.sqrt(np.maximum(variance, least)), np.nan)


def _without_prior(fit: Fit, covariance: Array) -> tuple[Array, Array]:
    """Values (p,) by the data alone and their standard deviations (p,), NaN where the data do not have them."""
    s = whitened(fit.jacobian, fit.deviation)
    left, right = shown_directions(s)
    values = fit.values + right @ (left.T @ whitened(fit.residual, fit.deviation))
    length = np.linalg.norm(s, axis=0)
    shown = np.linalg.qr(right * length[:, None])[0] if right.size else np.zeros((length.size, 0))
    hidden = (length == 0) | (1 - np.einsum("pk,pk->p", shown, shown) > ALONE)
    return np.where(hidden, np.nan, values), np.where(hidden, np.nan, np.sqrt(np.maximum(np.diag(covariance), 0.0)))
