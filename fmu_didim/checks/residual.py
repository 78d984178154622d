"""Whether the residual of a fit is noise: as large as the noise, and white once its colour is taken out.

Model error shows in both. At high rates neighbouring samples become alike, whatever the noise is; at low rates only a
known noise shows it, by a larger residual.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydantic import Field

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, REMARK, Diagnostic
from fmu_didim.base.documents import Number, Saved
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.noise import ABOVE_MOTION
from fmu_didim.fit.uncertainty import Colour, chi_square_bounds

SLOW_SHARE = 0.5
"""[1] Of the power of a residual in the band of the motion, from which it is doubted: noise with a memory of 50 ms has
12 to 25 % below 1.25 Hz."""
SLOW_CONTRAST = 30.0
"""[1] Density of its spectrum there over that above: noise with a memory of 50 ms at 200 Hz has up to 23, a missing
offset of five times the noise 900."""
LARGE_ERROR = 0.1
"""[1] Of the torque, from which a slow residual is doubted that nothing else tells: noise of torques and currents is
some per cent. A dead zone of a quarter of the peak passed for coloured noise: 23 % of the torque, nine tenths of it
below four times the frequency of the motion,"""
LARGE_CONTRAST = 5.0
"""[1] with 80 times the density of what lies above; white noise has one, whatever its size."""
MOTION_BAND = 0.5
"""[1] Of the frequencies of a log that the motion may fill, so that there are others to compare with."""
SPECTRUM_POINTS = 1000
"""[points] Of the spectrum of an autoregression in a band."""
STILL_NOT_WHITE = 1e-4
"""[1] p value of Ljung and Box below which a residual, with its colour taken out, is no white noise."""
LOUDER = 0.1
"""[1] Change of the standard deviations by noise that is louder in places, from which it is told: 3 sigma then are 2.7
or 3.3. With less nothing is to be done, and they account for it."""
COMPARED = 1 / 3
"""[1] Fraction of the samples of a repeating log that determine its noise: of one and a half periods, the fewest that
are compared, a third."""

NOISE_COLOURED = CATALOGUE(
    "noise-coloured", REMARK, rank=80,
    meaning="Neighbouring samples of the residual are alike. Standard deviations and intervals account for "
    "that; the residual alone cannot show whether it is noise or something that the model lacks.",
    next_step="If the noise of the torque is white, the model lacks something: fmu-didim discover CASE.yaml.",
)  # fmt: skip
RESIDUAL_ABOVE_NOISE = CATALOGUE(
    "residual-above-noise", DOUBT, rank=60,
    meaning="The residual of a joint is larger than the known noise, or repeats with the motion, which noise does not: "
    "the model does not explain the data. Standard deviations and intervals treat the rest as noise; they do not "
    "include a bias.",
    next_step="Find what the model lacks: fmu-didim discover CASE.yaml.",
)  # fmt: skip
STATED_NOISE_LARGE = CATALOGUE(
    "stated-noise-large", REMARK, rank=70,
    meaning="The residual of a joint is smaller than the noise that the case states. Standard deviations are those of "
    "the stated noise, as if it were white.",
    next_step="Check torque_std, or leave it out: the noise is then taken from the residual.",
)  # fmt: skip
COLOUR_NOT_MODELLED = CATALOGUE(
    "colour-not-modelled", REMARK, rank=75,
    meaning="What the autoregression of the residual leaves is still not white: a hum, or noise with a colour whose "
    "size changes with the motion. Standard deviations account for the autoregression only.",
    next_step="Look at the residual in the report; regard the standard deviations as less certain than they look.",
)  # fmt: skip
NOISE_LOUDER = CATALOGUE(
    "noise-louder", REMARK, rank=76,
    meaning="The residual is white, but larger where the output is large, or where the samples matter to a value: "
    "noise that grows with the torque or the speed. Standard deviations and intervals account for that, which changes "
    "them by a tenth or more; the residual alone cannot show whether it is noise or something that the model lacks.",
    next_step="If the noise of the sensor is as loud everywhere, the model lacks something: fmu-didim discover "
    "CASE.yaml.",
)  # fmt: skip
RESIDUAL_SLOW = CATALOGUE(
    "residual-slow", DOUBT, rank=61,
    meaning="Most of the residual torque is as slow as the motion, where noise has little power: it looks like "
    "something that the model lacks, an offset or a drift. No interval includes what the values absorb of it.",
    next_step="Run fmu-didim discover CASE.yaml; if the sensor drifts, state that noise: torque_std.",
)  # fmt: skip


class NoiseResult(Saved):
    """Noise of the residual of a joint, in all fitted logs of one rate.

    Attributes:
        rate_hz: of the logs.
    """

    joint: int = Field(description="counted from 1")
    rate_hz: float
    order: int = Field(description="of the autoregression e_t = a_1 e_(t-1) + ... + u_t; 0: white")
    coefficients: list[float] = Field(description="a_1 ... of it")
    lag1: float = Field(description="correlation of neighbouring samples")
    whiteness_p: float = Field(description="p value of Ljung and Box's test with the autoregression taken out")
    inflation: float = Field(description="of the standard deviations that come from the joint, over white noise")
    chi_square_per_sample: Number = Field(description="of the residual over the known noise; null if it is not known")
    chi_square_bound: Number = Field(description="above which the residual is larger than the noise")
    chi_square_least: Number = Field(description="below which it is smaller")
    noise_is_stated: bool = Field(description="by the case; otherwise periods that repeat give it")
    is_louder: bool = Field(default=False, description="in places, for which the standard deviations account")

    @property
    def exceeds_noise(self) -> bool:
        """Whether the residual is larger than the known noise."""
        ratio, bound = self.chi_square_per_sample, self.chi_square_bound
        return ratio is not None and bound is not None and ratio > bound

    @property
    def is_below_noise(self) -> bool:
        """Whether it is smaller."""
        ratio, bound = self.chi_square_per_sample, self.chi_square_least
        return ratio is not None and bound is not None and ratio < bound


def lack_of_fit(colours: Sequence[Colour], deviation: Array | None, *, stated: bool = True) -> tuple[NoiseResult, ...]:
    """The test of the residual of each joint.

    Args:
        colours: of an estimate; deviation: (n,) known standard deviation of the noise, None if it is not known.
        stated: whether the case states it; periods that repeat give it from a part of the samples only.
    """
    found = []
    for colour in colours:
        known_from = np.inf if stated else COMPARED * colour.samples
        least, most = chi_square_bounds(colour.samples, known_from)
        ratio = None if deviation is None else colour.residual_variance / deviation[colour.joint - 1] ** 2
        found.append(
            NoiseResult(
                joint=colour.joint, rate_hz=colour.rate_hz, order=colour.coefficients.size,
                coefficients=colour.coefficients.tolist(), lag1=colour.lag_one, whiteness_p=colour.whiteness,
                inflation=colour.inflation, chi_square_per_sample=ratio,
                chi_square_bound=None if ratio is None else most, chi_square_least=None if ratio is None else least,
                noise_is_stated=stated, is_louder=colour.is_louder,
            )
        )  # fmt: skip
    return tuple(found)


def residual_diagnostics(tests: Sequence[NoiseResult], labels: Sequence[str] = ()) -> list[Diagnostic]:
    """The diagnostics of these tests; ``labels``: of the columns, where they are no joints."""
    found, rates = [], {test.rate_hz for test in tests}
    for test in tests:
        place = _place(test, labels) + (f", logs at {test.rate_hz:g} Hz" if len(rates) > 1 else "")
        ratio, most, least = test.chi_square_per_sample, test.chi_square_bound, test.chi_square_least
        if test.exceeds_noise:
            text = (
                f"the residual is larger than the known noise (chi-square per sample {ratio:.3g}, by chance at most "
                f"{most:.3g}); the standard deviations contain this lack of fit."
            )
            found.append(Diagnostic(RESIDUAL_ABOVE_NOISE, text, place, ratio, most))
        if test.is_below_noise and test.noise_is_stated:
            text = (
                f"the residual is smaller than the stated noise (chi-square per sample {ratio:.3g}, by chance at least "
                f"{least:.3g}); the standard deviations are those of the stated noise."
            )
            found.append(Diagnostic(STATED_NOISE_LARGE, text, place, ratio, least))
        if test.order:
            text = (
                f"the residual is not white (neighbouring samples correlate by {test.lag1:.2f}): standard deviations "
                f"are some {test.inflation:.2g} times those with white noise."
            )
            found.append(Diagnostic(NOISE_COLOURED, text, place, test.inflation, 1.0, "1"))
        if test.is_louder and abs(test.inflation - 1.0) >= LOUDER:
            text = (
                "the residual is white, but louder in places: standard deviations are some "
                f"{test.inflation:.2g} times those with noise that is as loud everywhere."
            )
            bound = 1.0 + LOUDER if test.inflation > 1.0 else 1.0 - LOUDER
            found.append(Diagnostic(NOISE_LOUDER, text, place, test.inflation, bound, "1"))
        if test.whiteness_p < STILL_NOT_WHITE:
            text = (
                f"the residual is not white even with its colour (order {test.order}) taken out "
                f"(p = {test.whiteness_p:.1e})."
            )
            found.append(Diagnostic(COLOUR_NOT_MODELLED, text, place, test.whiteness_p, STILL_NOT_WHITE, "1"))
    return found


def _place(test: NoiseResult, labels: Sequence[str]) -> str:
    return labels[test.joint - 1] if labels else f"joint {test.joint}"


def slow_diagnostics(
    tests: Sequence[NoiseResult],
    motion_hz: float,
    cutoff_hz: float = np.inf,
    *,
    labels: Sequence[str] = (),
    what: str = "where the motion is",
) -> list[Diagnostic]:
    """The joints whose residual is as slow as the motion, by the spectrum of its autoregression.

        S(f) = 1 / |1 - sum_k a_k exp(-2 pi i f k / rate)|^2

    Args:
        motion_hz: highest frequency of the motion; cutoff_hz: of a low-pass of torque and model, above which nothing
            is compared.
        labels: of the columns, where they are no joints; what: what lies below that frequency.
    """
    found = []
    for test in tests:
        if test.exceeds_noise or not test.order:
            continue
        band = _band(test, motion_hz, cutoff_hz)
        if band is not None and band.share > SLOW_SHARE and band.contrast > SLOW_CONTRAST:
            found.append(_slow(test, band, labels, what))
    return _worst(found)


def large_diagnostics(
    tests: Sequence[NoiseResult],
    errors: Mapping[int, float],
    motion_hz: float,
    cutoff_hz: float = np.inf,
    *,
    labels: Sequence[str] = (),
    what: str = "where motion and friction are",
    of: str = "torque",
) -> list[Diagnostic]:
    """The joints whose residual is large and slow: one of several per cent of the torque need not be as slow as the
    motion itself to be no noise.

    A misfit that no function of the motion follows looks the more like coloured noise the larger it is; but noise that
    moves with the motion is no tenth of the torque.

    Args:
        errors: joint, from 1 -> residual over the torque, root mean squares.
        labels: of the columns, where they are no joints; what: lies up to four times that frequency; of: what the
            errors are parts of.
    """
    found = []
    for test in tests:
        band = _band(test, ABOVE_MOTION * motion_hz, cutoff_hz) if test.order else None
        if band is None or band.share <= SLOW_SHARE or band.contrast <= LARGE_CONTRAST:
            continue
        error = errors[test.joint] * np.sqrt(band.share)
        if error > LARGE_ERROR:
            one = _slow(test, band, labels, what)
            text = f"{one.text} That is {100 * error:.2g} % of the {of}, and too much for noise."
            found.append(replace(one, text=text, value=error, bound=LARGE_ERROR))
    return _worst(found)


def _worst(found: Sequence[Diagnostic]) -> list[Diagnostic]:
    """One of each joint, that of its largest value: logs of several rates have tests of their own."""
    largest: dict[str, Diagnostic] = {}
    for one in sorted(found, key=lambda one: -(one.value or 0.0)):
        largest.setdefault(one.place, one)
    return [one for one in found if largest[one.place] is one]


@dataclass(frozen=True)
class _Band:
    """A residual below a frequency, Hz: its share of the power, and the density there over that above."""

    below_hz: float
    share: float
    contrast: float


def _band(test: NoiseResult, below_hz: float, cutoff_hz: float) -> _Band | None:
    """The residual of a joint below a frequency; None where too little lies above it to compare with."""
    highest = min(test.rate_hz / 2, cutoff_hz)
    if below_hz > MOTION_BAND * highest:
        return None
    below, above = (_mean_density(test, *band) for band in ((0.0, below_hz), (below_hz, highest)))
    slow, fast = below * below_hz, above * (highest - below_hz)
    return _Band(below_hz, slow / (slow + fast), below / above)


def _slow(test: NoiseResult, band: _Band, labels: Sequence[str], what: str) -> Diagnostic:
    text = (
        f"{100 * band.share:.0f} % of the squared residual lies below {band.below_hz:.2g} Hz, {what}, with "
        f"{band.contrast:.2g} times the density of what lies above."
    )
    return Diagnostic(RESIDUAL_SLOW, text, _place(test, labels), band.share, SLOW_SHARE, "1")


def _mean_density(test: NoiseResult, lowest: float, highest: float) -> float:
    """Mean of the spectral density of a residual between two frequencies, with innovations of variance one."""
    frequency = np.linspace(lowest, highest, SPECTRUM_POINTS)
    turns = np.exp(-2j * np.pi * np.outer(frequency / test.rate_hz, np.arange(1, test.order + 1)))
    return float(np.mean(1 / np.abs(1 - turns @ test.coefficients) ** 2))
