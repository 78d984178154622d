"""Whether the fitted values of an effect are significant and physically possible.

An effect is not significant if, by the covariance C of its amplitudes a, they may all be neutral, a_0:

    (a - a_0)' C^-1 (a - a_0)  below the quantile of a chi-square      (Wald's test)

Source: A. Wald, Transactions of the American Mathematical Society 54 (1943).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fmu_didim.base.distributions import chi2_sf
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.effects import Effect
from fmu_didim.fit.fit import Fit
from fmu_didim.model.free_parameter import plain_name

ZERO = 0.05
"""[1] Largest p value, by its covariance, of an effect that is named: that of a 95 % interval."""


def implausible(fit: Fit, index: int, effect: Effect, link: Mapping[str, float]) -> str:
    """Why the values of an effect are not significant or not possible, or an empty string.

    Args:
        index: of the effect among those of the model; link: known inertial parameters of its link.
    """
    places = [i for i, p in enumerate(fit.model.free_parameters) if p.effect == index and not p.is_shape]
    if not places:
        return ""
    joint = fit.model.added_effects[index].joint
    names = [plain_name(fit.model.free_parameters[i].name, joint) for i in places]
    values = fit.values[places]
    covariance = fit.covariance[np.ix_(places, places)]
    deviations = np.sqrt(np.diag(covariance))
    found = dict(zip(names, values.tolist(), strict=True))
    why = effect.impossible(found, dict(zip(names, deviations.tolist(), strict=True)), link)
    if why:
        return f"physically impossible: {why}"
    chance = chance_of_none(values, covariance, np.array([effect.neutral.get(name, 0.0) for name in names]))
    if chance > ZERO:
        text = ", ".join(f"{n} = {v:.3g} ± {s:.2g}" for n, v, s in zip(names, values, deviations, strict=True))
        return f"may be absent: {text} (p = {chance:.2g})"
    return ""


def chance_of_none(values: Array, covariance: Array, neutral: Array) -> float:
    """Probability of values (k,) as far from neutral ones by chance; where the neutral one is infinite, as of a
    stiffness, the inverse is compared with zero."""
    inverse = ~np.isfinite(neutral)
    scale = np.where(inverse, 1 / np.where(inverse, values, 1.0) ** 2, 1.0)
    covariance = covariance * np.outer(scale, scale)
    off = np.where(inverse, values * scale, values - np.where(inverse, 0.0, neutral))
    free = np.diag(covariance) > 0
    if not free.any():
        return 0.0
    part = covariance[np.ix_(free, free)]
    return float(chi2_sf(off[free] @ np.linalg.pinv(part, hermitian=True) @ off[free], int(free.sum())))
