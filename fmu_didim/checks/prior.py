"""Whether the data agree with what was said to be known before, and which values the data hardly decide."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.prior_fit import PriorFit

DISAGREEMENT = 0.001
"""[1] Probability of data and prior as far apart by chance, over all that both know, below which they disagree."""
FAR = 3.0
"""[standard deviations] Of the difference, from which a parameter is named; else that which is farthest apart."""
TIMES = 6.0
"""[standard deviations] Of the logarithm of value over prior, from which the value is too small for the prior: values
that are known to 30 % are within a factor of 6, while a normal distribution has all smaller ones within 3.3 deviations,
such as those of a description in grams."""
SURELY = 2.0
"""[standard deviations] Of a value, that it may be larger than it is."""
DECIDED = 0.5
"""[1] Part of the variance of a value that comes from the data, below which it is the prior that decides."""

PRIOR_DISAGREES = CATALOGUE(
    "prior-disagrees", DOUBT, rank=44,
    meaning="The data are farther from the values that were said to be known than the stated standard deviations "
    "explain: the prior is wrong or too sure of itself, or the model is, and the values are a compromise.",
    next_step="Check masses, frames and units of the description that prior: names, and state a larger relative_std:; "
    "or identify without prior:.",
)  # fmt: skip
PRIOR_DECIDES = CATALOGUE(
    "prior-decides", REMARK, rank=66,
    meaning="Most of what is known of some values comes from the prior, not from the data: they are hardly measured.",
    next_step="Excite them more, or record longer, if they are to be measured.",
)  # fmt: skip
PRIOR_OPEN = CATALOGUE(
    "prior-open", REMARK, rank=67,
    meaning="A base parameter has no prior, because something that is a part of it has none.",
    next_step="State it, with a value that is not zero: relative_std: of that joint, or motor_inertia:.",
)  # fmt: skip


PRIOR_DOUBTFUL = CATALOGUE(
    "prior-doubtful", DOUBT, rank=42,
    meaning="The earlier result that a prior comes from is doubtful: its values and standard deviations are taken for "
    "true, and what is wrong with them is now in the load or in other values.",
    next_step="Settle the doubts of that result first.",
)  # fmt: skip


def prior_diagnostics(estimate: Estimate) -> list[Diagnostic]:
    """What is to be said of a prior; nothing without one."""
    prior = estimate.prior
    if prior is None:
        return []
    source = estimate.model.prior
    told = [] if source is None or not source.doubted else [Diagnostic(PRIOR_DOUBTFUL, source.doubted, "prior")]
    return [*told, *_disagreement(prior, estimate), *_decided(prior, estimate), *_open(prior)]


def _disagreement(prior: PriorFit, estimate: Estimate) -> list[Diagnostic]:
    smaller = _far_smaller(prior, estimate)
    if prior.p_value >= DISAGREEMENT and not smaller.any():
        return []
    apart = np.where(np.isfinite(prior.apart), np.abs(prior.apart), 0.0)
    if prior.p_value >= DISAGREEMENT:
        apart = np.where(smaller, apart, 0.0)
    farthest = int(np.argmax(apart))
    named = [i for i in np.argsort(-apart) if apart[i] >= FAR] or [farthest]
    values = ", ".join(
        f"{estimate.names[i]} = {estimate.value[i]:.4g} where the prior has {prior.mean[i]:.4g} ± "
        f"{prior.deviation[i]:.2g} {estimate.units[i]} ({apart[i]:.1f} sigma of the difference)" for i in named
    )  # fmt: skip
    times = [prior.mean[i] / estimate.value[i] for i in np.flatnonzero(smaller) if estimate.value[i]]
    factor = f", which is up to {max(map(abs, times)):.3g} times as large" if times else ""
    text = f"The data do not agree with {prior.source}{factor} (p = {prior.p_value:.1e}): {values}."
    return [Diagnostic(PRIOR_DISAGREES, text, estimate.names[farthest], prior.p_value, DISAGREEMENT, "1")]


def _far_smaller(prior: PriorFit, estimate: Estimate) -> NDArray[np.bool_]:
    """(p,) which values are smaller than those of the prior by a factor that its deviation does not explain."""
    is_sure = np.isfinite(prior.deviation) & (np.abs(prior.mean) > prior.deviation)
    mean, deviation = (np.where(is_sure, v, 1.0) for v in (prior.mean, prior.deviation))
    largest = estimate.value / mean + SURELY * estimate.standard_deviation / np.abs(mean)
    return np.asarray(is_sure & (np.log(np.maximum(largest, TINY)) < -TIMES * deviation / np.abs(mean)))


def _decided(prior: PriorFit, estimate: Estimate) -> list[Diagnostic]:
    """Values that the prior decides, among them such as have none of their own and hang on those that have."""
    places = [i for i in np.argsort(prior.data_share) if prior.data_share[i] < DECIDED]
    if not places:
        return []
    told = ", ".join(f"{estimate.names[i]} ({100 * prior.data_share[i]:.0f} %)" for i in places)
    text = f"The data have less than half of what is known of these values, the rest is from {prior.source}: {told}."
    least = float(prior.data_share[places[0]])
    return [Diagnostic(PRIOR_DECIDES, text, estimate.names[places[0]], least, DECIDED, "1")]


def _open(prior: PriorFit) -> list[Diagnostic]:
    return [
        Diagnostic(PRIOR_OPEN, f"The prior says nothing of {name}: {', '.join(parts)} has none.", name)
        for name, parts in prior.open.items()
    ]
