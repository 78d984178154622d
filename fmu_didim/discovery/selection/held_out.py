"""Whether held-out data confirm an effect: the model without it and the one with it, on the same samples.

They do if the whole prediction gets better: the interval of the ratio of the RMS lies below 1. The other parameters
are fitted anew with an effect, and errors that have nothing to do with it move them a little; on other data that may be
more than the effect itself. Where the RMS does not rise but its interval reaches 1, the effect is therefore looked for
in what the other parameters cannot make,

    a = <P w r_0, P w e> / <P w e, P w e>,   e = r_0 - r_1,   P = I - Q Q'

with the residuals r_0 and r_1 without and with it, weights w and an orthonormal basis Q of the weighted sensitivities
of the model without it. This is the size of the effect on held-out data as a
multiple of the fitted one. |P w r_1| < |P w r_0| if and only if a > 1/2: the interval of a must lie above, and reach
1. An effect that is absent has a = 0: with a standard deviation of a below 1/2 it passes once in 600 times.

Held-out data too short for that interval are asked for the joint where the effect changes the fit most: if its error
falls in each of at least five blocks, they confirm the effect; by chance that happens once in 32 times (the sign test).
On 3 s of a measured TX40 a friction of joint 2 lowers the error of that joint by 4 to 25 % in each block, and what its
fit moves on the others by less than their noise hides it in the whole.

The hits of a gear with play come at moments that any little thing moves: along one of them the error of the right model
is larger than that of none, even with the true values. So an effect of many minima is also confirmed where the error of
a typical block falls: where the interval of the geometric mean of the blocks' RMS ratios, by the same bootstrap, lies
below 1, and the RMS of all falls. It is what the likelihood of blocks says whose sizes of the error are not known.

What shows in a block or two, as gears do where data begin, no bootstrap over blocks confirms: the draws without these
blocks reach 1. With the start of the data the interval of a is that of the residual at these samples, u:

    a +- 1.96 sqrt(max(sum(e^2 u^2), sum(e^2))) / sum(e^2),   u = P w r_0 - a P w e

with e, of the weighted residuals, in place of P w e (H. White, Econometrica 48, 1980).

Where an effect follows what was measured, such as a temperature, and the held-out runs have about the mean of the
fitted ones, it changes little there, and no prediction confirms it. Such data tell nothing if the interval of the ratio
holds both 1, which no effect makes, and what the effect would make, were it as large as it was fitted,

    sqrt(sum(w r_1)^2 / (sum(w r_1)^2 + sum(w (r_0 - r_1))^2))

The fitted data then decide, which is said.

Weights are 1 / noise, and less for samples that neither model explains, such as glitches of a logger: by Huber's rule
for the smaller one of the two residuals, so that no sample that one of them explains loses weight.

Source: P. J. Huber, Annals of Mathematical Statistics 35 (1964); block bootstrap as for the ratio.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.distributions import DEVIATION_OF_MEDIAN, normal_isf
from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.selection.competition import SURVIVING
from fmu_didim.fit.base_projection import BaseProjection
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import (
    BLOCK_S,
    Ratio,
    block_sums,
    drawn_sums,
    held_out_block,
    held_out_blocks,
    held_out_ratio,
    held_out_ratios,
    held_out_residual,
)
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.statistics import CONFIDENCE

HELD_OUT = 1.0
"""[1] The interval of the held-out RMS ratio must lie below; otherwise a model may be worse."""
WORSE_JOINT = 1.02
"""[1] Lower end of the interval of the held-out RMS ratio of a joint above which an effect makes that joint worse;
the base parameters, fitted anew, may move others by a little."""
NEARER = 0.5
"""[1] Of its fitted size: an effect that is larger on held-out data is nearer to them than none."""
OWN_SIZE = 1.0
"""[1] Of its fitted size: where the whole prediction does not confirm an effect, the interval of its size must reach
this. What only copies another effect along the fitted motion has another size on another one: the gain of a drive,
named in place of a coupling of two joints, has 0.57 to 0.79 of it."""
FEWEST_BLOCKS = 10
"""[blocks] Of held-out data, with fewer of which a bootstrap gives too short an interval."""
EACH_OF = 5
"""[blocks] Of held-out data, in each of which the error of a joint must fall where they are fewer than that: a chance
of 1/32."""
GLITCH = 3.0
"""[standard deviations] Of the residual from which a sample that neither model explains weighs less; noise alone
reaches it once in 370 samples."""

FEW_BLOCKS = float(np.log(2 / (1 - CONFIDENCE)))
"""[blocks] Of held-out data in which two models differ, 3.7, with fewer of which the interval of the bootstrap reaches
1 whatever the effect is: of k blocks among many a draw holds none with the probability exp(-k)."""

FAILS_HELD_OUT = "held-out RMS ratio"
"""Beginning of the objection that a candidate does not help on the held-out data."""


@dataclass(frozen=True)
class Amplitude:
    """Size of an effect on data as a multiple of the fitted one: value and its 95 % interval.

    Attributes:
        size: RMS of what a larger model has more and the other parameters cannot make, in units of the noise, of the
            output where that is largest.
    """

    value: float
    low: float
    high: float
    size: float

    def __str__(self) -> str:
        return f"{self.value:.2f} ({self.low:.2f} to {self.high:.2f}) times its fitted size"


@dataclass(frozen=True)
class Lenience:
    """What else than the whole prediction and the size may confirm an effect on held-out data.

    Attributes:
        hits: whether the error of a typical block may, of an effect of many minima.
        at_start: whether a few samples may, where the start of the data counts.
    """

    hits: bool = False
    at_start: bool = False


STRICT = Lenience()


def held_out_objection(before: Fit, after: Fit, *, seed: int = 0, lenience: Lenience = STRICT) -> str:
    """Why held-out data speak against a larger model, or an empty string; that without such data too."""
    if why := unconfirmed(before, after, seed=seed, lenience=lenience):
        return why
    worse = [(j, r) for j, r in held_out_ratios(before, after, seed=seed) if r.low > WORSE_JOINT]
    if worse:
        joint, one = worse[0]
        n, names = before.model.joint_count, before.model.experiments.channels
        output = f"joint {joint}" if joint <= n else names[joint - n - 1]
        return f"{FAILS_HELD_OUT} {one.value:.3f} of {output}, its interval starts at {one.low:.3f}"
    return ""


def unconfirmed(before: Fit, after: Fit, *, seed: int = 0, lenience: Lenience = STRICT) -> str:
    """Why held-out data, over all joints, do not confirm what a larger model has more, or an empty string."""
    ratio = held_out_ratio(before, after, seed=seed)
    if ratio is None or ratio.high < HELD_OUT:
        return ""
    if ratio.value < HELD_OUT and (confirming_joint(before, after) or _leniently(before, after, seed, lenience)):
        return ""
    text = f"{FAILS_HELD_OUT} {ratio.value:.3f}, its interval reaches {ratio.high:.3f}"
    found = held_out_amplitude(before, after, seed=seed) if ratio.value < HELD_OUT else None
    if found is None:
        return text
    return "" if found.low > NEARER and found.high >= OWN_SIZE else f"{text}; there it has {found}"


def tells_nothing(before: Fit, after: Fit, *, seed: int = 0) -> bool:
    """Whether held-out data neither confirm nor contradict an effect: they look as with all of it, and as without."""
    ratio = held_out_ratio(before, after, seed=seed)
    if ratio is None or ratio.low > WORSE_JOINT or ratio.high < HELD_OUT:
        return False
    first, second = (held_out_residual(fit) / before.noise.deviation for fit in (before, after))
    left, change = float(np.sum(second**2)), float(np.sum((first - second) ** 2))
    return bool(np.sqrt(left / (left + change + TINY)) >= ratio.low)


def _leniently(before: Fit, after: Fit, seed: int, lenience: Lenience) -> str:
    """What confirms a larger model whose interval reaches 1 by what is allowed beyond its size, for the user; empty
    where nothing does."""
    typical = typical_ratio(before, after, seed=seed) if lenience.hits else None
    if typical is not None and typical.high < HELD_OUT:
        return (
            f"that of a typical block of {BLOCK_S:g} s is: {typical.value:.3f} times what it was ({typical.low:.3f} to "
            f"{typical.high:.3f}); hits come at other moments in some"
        )
    few = amplitude_in_few_blocks(before, after) if lenience.at_start else None
    if few is not None and few.low > NEARER and few.high >= OWN_SIZE:
        return f"the few samples that show it, where the data begin, have it at {few}"
    return ""


def typical_ratio(before: Fit, after: Fit, *, seed: int = 0) -> Ratio | None:
    """RMS ratio of a typical block of held-out data: the geometric mean over all, with its interval; None where they
    are too few or a model cannot be run."""
    try:
        first, second = held_out_residual(before), held_out_residual(after)
    except SimulationError:
        return None
    block, noise = held_out_block(before), before.noise.deviation
    if first.shape[0] < FEWEST_BLOCKS * block:
        return None
    squares = np.column_stack([np.sum((r / noise) ** 2, axis=1) for r in (first, second)])
    sums = np.maximum(block_sums(squares, block=block), TINY)
    logarithms = np.log(sums[:, 1] / sums[:, 0]) / 2
    drawn = drawn_sums(logarithms[:, None], block=1, seed=seed)[:, 0] / logarithms.size
    outside = (1 - CONFIDENCE) / 2
    low, high = np.quantile(drawn, [outside, 1 - outside])
    return Ratio(float(np.exp(logarithms.mean())), float(np.exp(low)), float(np.exp(high)))


def amplitude_in_few_blocks(before: Fit, after: Fit) -> Amplitude | None:
    """Size on held-out data of what a larger model has more where that shows in a few blocks alone, with the interval
    of the samples that show it; None where it shows in more, or not at all, and where a model cannot be run."""
    if held_out_blocks(before, after) >= FEW_BLOCKS:
        return None
    try:
        first, second = held_out_residual(before), held_out_residual(after)
        columns = before.held_out_jacobian
    except SimulationError:
        return None
    beside = _beside_others(first, second, columns, before)
    if beside is None:
        return None
    own, change = beside
    square = float(np.sum(change**2))
    value = float(np.sum(own * change)) / square
    left = float(np.sum(change**2 * (own - value * change) ** 2))
    half = float(normal_isf((1 - CONFIDENCE) / 2)) * np.sqrt(max(left, square)) / square
    size = float(np.sqrt(np.mean(change**2, axis=0).max()))
    return Amplitude(value, float(value - half), float(value + half), size)


def confirming_joint(before: Fit, after: Fit) -> int:
    """The joint, from 1, where a larger model changes the fit most, if held-out data that are too short for the size of
    the effect confirm it there: its error falls in each block. Zero where they do not."""
    try:
        first, second = held_out_residual(before), held_out_residual(after)
    except SimulationError:
        return 0
    block = held_out_block(before)
    if first.shape[0] >= FEWEST_BLOCKS * block:
        return 0
    change = np.mean(((before.residual - after.residual) / before.noise.deviation) ** 2, axis=0)
    joint = int(np.argmax(change[: before.model.joint_count]))
    sums = block_sums(np.column_stack([first[:, joint] ** 2, second[:, joint] ** 2]), block=block)
    return joint + 1 if len(sums) >= EACH_OF and (sums[:, 1] < sums[:, 0]).all() else 0


def is_confirmed_by_size_alone(before: Fit, after: Fit, *, seed: int = 0) -> bool:
    """Whether held-out data confirm an effect though the whole prediction may not be better."""
    ratio = held_out_ratio(before, after, seed=seed)
    return ratio is not None and ratio.high >= HELD_OUT and not unconfirmed(before, after, seed=seed)


def held_out_remark(before: Fit, after: Fit, *, seed: int = 0, lenience: Lenience = STRICT) -> str:
    """By what an effect is confirmed that the whole prediction does not confirm, for the user; empty where it does or
    nothing does."""
    ratio = held_out_ratio(before, after, seed=seed)
    if ratio is None or ratio.high < HELD_OUT or unconfirmed(before, after, seed=seed, lenience=lenience):
        return ""
    whole = (
        f"as a whole the held-out error may not be smaller (RMS ratio {ratio.value:.3f}, {ratio.low:.3f} to "
        f"{ratio.high:.3f})"
    )
    if unconfirmed(before, after, seed=seed):
        return f"{whole}, but {_leniently(before, after, seed, lenience)}"
    size = held_out_amplitude(before, after, seed=seed)
    if joint := confirming_joint(before, after):
        return f"{whole}, but that of joint {joint} is in each block of {BLOCK_S:g} s; the held-out data are short"
    return (
        f"{whole}, but in what the other parameters cannot make, and with less weight on samples that "
        f"neither model explains, held-out data show the effect at {size}"
    )


def held_out_amplitude(before: Fit, after: Fit, *, seed: int = 0) -> Amplitude | None:
    """Size on held-out data of what a larger model has more; None where they are too few or do not show it at all, and
    where a model cannot be run on them."""
    try:
        first, second = held_out_residual(before), held_out_residual(after)
        columns = before.held_out_jacobian
    except SimulationError:
        return None
    return amplitude(first, second, columns, before, block=held_out_block(before), seed=seed)


def amplitude(
    first: Array, second: Array, columns: Array, before: Fit, *, block: int, seed: int = 0
) -> Amplitude | None:
    """Size on some data of what a larger model has more; None where they are too few or do not show it at all.

    Args:
        first, second: (M, m) residuals without and with it; columns: (M, m, p) sensitivity of the model without it.
        before: the fit without it; block: rows in a block of the bootstrap.
    """
    if first.shape[0] < FEWEST_BLOCKS * block:
        return None
    beside = _beside_others(first, second, columns, before)
    if beside is None:
        return None
    own, change = beside
    products = np.column_stack([np.sum(own * change, axis=1), np.sum(change**2, axis=1)])
    total = products.sum(axis=0)
    drawn = drawn_sums(products, block=block, seed=seed)
    shown = drawn[:, 1] > 0
    sizes = np.where(shown, drawn[:, 0] / np.where(shown, drawn[:, 1], 1.0), 0.0)
    outside = (1 - CONFIDENCE) / 2
    low, high = np.quantile(sizes, [outside, 1 - outside])
    size = float(np.sqrt(np.mean(change**2, axis=0).max()))
    return Amplitude(float(total[0] / total[1]), float(low), float(high), size)


def _beside_others(first: Array, second: Array, columns: Array, before: Fit) -> tuple[Array, Array] | None:
    """(M, m) weighted residual of the model without an effect, and what the effect changes, in what its other
    parameters cannot make; None where nothing of the effect is left of that."""
    there = (first != 0) | (second != 0) if before.model.experiments.channels else None
    weight = shared_weights(first, second, before.noise.deviation, there)
    base = BaseProjection.of(columns * weight[:, :, None]) if columns.size else None

    def rest(residual: Array) -> Array:
        weighted = (residual * weight).reshape(-1)
        return (weighted if base is None else base.rest_of(weighted)).reshape(first.shape)

    own, change = rest(first), rest(first - second)
    if np.linalg.norm(change) <= SURVIVING * np.linalg.norm((first - second) * weight):
        return None
    return own, change


def shared_weights(first: Array, second: Array, deviation: Array, there: NDArray[np.bool_] | None = None) -> Array:
    """(M, m) weights of the samples of two residuals (M, m), the same for both: 1 / deviation, where the smaller
    residual is beyond three of its deviations the less the larger that is.

    Args:
        there: (M, m) which cells hold a sample; all by default.
    """
    least = np.minimum(np.abs(first), np.abs(second))
    if there is None:
        median = np.median(least, axis=0)
    else:
        columns = zip(least.T, there.T, strict=True)
        median = np.array([np.median(column[own]) if own.any() else 0.0 for column, own in columns])
    bound = GLITCH * np.maximum(deviation, DEVIATION_OF_MEDIAN * median)
    return np.asarray(np.sqrt(bound / np.maximum(least, bound)) / deviation)
