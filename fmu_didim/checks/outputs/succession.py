"""Whether what a model leaves of short records is alike from sample to sample: then it is no white noise.

Records of less than 20 samples show no colour (:mod:`fmu_didim.fit.noise.residual_noise`), so that their noise counts
as white. That is asked by the ratio of Durbin and Watson over all of them,

    d = sum (r_t - r_(t-1))^2 / sum r_t^2 = r'A r / r'r,      r = (I - S S^+) e,

whose distribution is exact for white normal noise e and the sensitivities S, whatever the number of samples: with the
covariance V = I - Q Q' of the residual, Q a basis of S, d is below what was found with the probability that the sum of
squares of normal numbers weighted by the eigenvalues of V^(1/2) (A - d I) V^(1/2) is below zero. Longer records show a
colour, which may be that of noise or of a misfit; where it leaves few independent samples, neither is known. Sources:
Durbin, Watson, Biometrika 37 (1950) and 58 (1971); Imhof, Biometrika 48 (1961).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.base.distributions import quadratic_below_zero
from fmu_didim.checks.motion.colour import orthonormal
from fmu_didim.checks.motion.dependence import independent
from fmu_didim.checks.outputs.residuals import OutputResiduals
from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.noise.residual_noise import FEWEST_COLOURED
from fmu_didim.fit.uncertainty import Colour

ALIKE = 0.005
"""[1] Probability, for all outputs together, with which white noise may be said to be alike from sample to sample. With
8 samples and two values a misfit of three times the noise is below in 84 of 100 draws, with 11 in all (x' = a x + u by
Euler's method)."""
FEWEST_LEFT = 5.0
"""[samples] Beside what was fitted, below which nothing is asked: a misfit without any noise, as smooth as four samples
let it be, has a probability of 0.003 to 0.008."""
DIGITS = 6
"""[1] Of such a number of samples: more are rounding."""
MOST_SAMPLES = 1000
"""[samples] Of short records that are asked, the first ones: the eigenvalues of more take seconds."""

FEWEST_INDEPENDENT = 7.0
"""[samples] That a residual with a colour is worth, below which it is doubted: a deviation is known from them to 27 %,
and no noise is told from a misfit of a few waves. Misfits of three times the noise and more in 20 to 100 samples leave
2 to 7, white noise with a memory of ten samples in 200 leaves 11 and more."""

RESIDUAL_ALIKE = CATALOGUE(
    "residual-alike", DOUBT, rank=55,
    meaning="What a model leaves of an output is alike from sample to sample, which white noise is not: the model "
    "lacks something, or the noise has a memory that so short a record does not show. Standard deviations and "
    "intervals do not include the first, and the second is hardly known.",
    next_step="Look at the residual in the report. Check how the inputs go between their rows (interpolation:), where "
    "the model starts and what is not identified; measure for longer. If the sensor has such a memory, state its "
    "noise (std:).",
)  # fmt: skip
OUTPUT_UNTESTED = CATALOGUE(
    "outputs-untested", DOUBT, rank=62,
    meaning="There are too few samples to test whether the residual of an output is noise: what the model lacks would "
    "go unnoticed.",
    next_step="Measure for longer or at a higher rate.",
)  # fmt: skip


@dataclass(frozen=True)
class Succession:
    """How alike neighbouring samples of the residual of an output are.

    Attributes:
        output: its place; left: samples beside what was fitted; ratio: that of Durbin and Watson, two for white noise;
        p_value: of one as small by white noise.
    """

    output: int
    left: float
    ratio: float = 2.0
    p_value: float = 1.0


def succession_diagnostics(found: OutputResiduals) -> list[Diagnostic]:
    """The outputs whose short records leave something that is alike from sample to sample; and those that leave too
    few."""
    tested = list(successions(found))
    level, told = ALIKE / max(len(tested), 1), list[Diagnostic]()
    for one in tested:
        name = found.names[one.output]
        if one.left < FEWEST_LEFT:
            text = f"{one.left:.2g} samples beside what was fitted are too few."
            told.append(Diagnostic(OUTPUT_UNTESTED, text, name, one.left, FEWEST_LEFT, "samples"))
        elif one.p_value < level:
            text = (
                f"neighbouring samples of the residual are alike (ratio of Durbin and Watson {one.ratio:.2g} where "
                f"white noise has about 2, p = {max(one.p_value, TINY):.1e})."
            )
            told.append(Diagnostic(RESIDUAL_ALIKE, text, name, one.p_value, level, "1"))
    return told


def few_independent(colours: Sequence[Colour], names: Sequence[str], stated: Sequence[bool]) -> list[Diagnostic]:
    """The outputs whose residual has a colour that leaves few independent samples of it, and whose noise is not
    stated; ``colours``: of all outputs."""
    told = []
    for k, name in enumerate(names):
        own = [colour for colour in colours if colour.joint == k + 1]
        count = sum(colour.samples for colour in own)
        if stated[k] or not any(colour.coefficients.size for colour in own) or count >= FEWEST_INDEPENDENT:
            continue
        text = (
            f"the residual is worth {count:.2g} independent samples, so alike are neighbouring ones (they correlate by "
            f"{max(colour.lag_one for colour in own):.2f}): that may be a misfit as well as noise."
        )
        told.append(Diagnostic(RESIDUAL_ALIKE, text, name, count, FEWEST_INDEPENDENT, "samples"))
    return told


def successions(found: OutputResiduals) -> Iterator[Succession]:
    """How alike the residuals of each output are in its short records; nothing of an output without any, or that
    leaves no more than the simulation errs by."""
    basis = orthonormal(independent(found.whitened(found.jacobian)))
    places = np.full(found.measured_at.shape, -1)
    places[found.measured_at] = np.arange(basis.shape[0])
    for k in range(len(found.names)):
        logs = _short(found, k)
        if not logs or k not in found.judged:
            continue
        rows = np.concatenate(logs)
        residual = found.residual[rows, k] / found.deviation[k]
        own = basis[places[rows, k]]
        left = round(rows.size - float(np.sum(own**2)), DIGITS)
        yield Succession(k, left) if left < FEWEST_LEFT else _tested(k, left, residual, own, [log.size for log in logs])


def _short(found: OutputResiduals, k: int) -> list[Indices]:
    """Rows of the records of output ``k`` in which no colour shows, as of all of one rate together."""
    stretches, logs = found.tables(k).stretches, [found.indices(log.rows) for log in found.logs(k)]
    counts: dict[float, int] = {}
    for stretch, log in zip(stretches, logs, strict=True):
        counts[stretch.rate_hz] = counts.get(stretch.rate_hz, 0) + log.size
    short, total = list[Indices](), 0
    for stretch, log in zip(stretches, logs, strict=True):
        total += log.size if counts[stretch.rate_hz] < FEWEST_COLOURED else 0
        if counts[stretch.rate_hz] < FEWEST_COLOURED and total <= MOST_SAMPLES:
            short.append(log)
    return short


def _tested(output: int, left: float, residual: Array, basis: Array, sizes: list[int]) -> Succession:
    """The test of a residual (N,) beside rows (N, r) of a basis of all sensitivities, in records of these sizes."""
    count = residual.size
    joined = np.ones(count - 1, dtype=bool)
    joined[np.cumsum(sizes)[:-1] - 1] = False  # from the last sample of one record to the first of the next
    steps = np.diff(np.eye(count), axis=0)[joined]
    ratio = float(np.sum((steps @ residual) ** 2)) / max(float(residual @ residual), TINY)
    squares, vectors = np.linalg.eigh(np.eye(count) - basis @ basis.T)
    half = vectors * np.sqrt(np.maximum(squares, 0.0))
    weights = np.linalg.eigvalsh(half.T @ (steps.T @ steps - ratio * np.eye(count)) @ half)
    return Succession(output, left, ratio, quadratic_below_zero(weights))
