"""The fit of one law at one joint to the torque that it gave, the positions being measured with noise.

    r(theta) = tau - C(theta; reference, q measured),   R(w) its Fourier transform
    J(theta) = sum over w of |R|^2 / S,   S = a + b |C_q(theta)|^2

a is the density of the torque's noise, b that of the noise of the positions, which the law makes larger by C_q, its
response to a position. With white noise of known densities J is the likelihood of the errors in variables, the true
motion being eliminated frequency by frequency, so that noise that enters by a derivative does not draw the gains to
zero. The reference has no noise. Where the controller has seen the noise of the log, b = 0, and J is least squares.

Sources: Pintelon, Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., ch. 8 (errors in variables,
sample maximum likelihood); Whittle, Estimation and information in stationary time series, Ark. Mat. 2, 1953.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import comb
from typing import Any

import numpy as np
from scipy.fft import rfft
from scipy.optimize import least_squares

from fmu_didim.data.signals import Array
from fmu_didim.workflow.naming.catalogue import TIMES, Candidate, Complex, JointSignals

MOTION_OVER_NOISE = 1.5
"""[1] Power of the torque over that of the noise, from which a frequency belongs to the motion: noise of the torque,
and of the positions as the law makes it larger, once a law is known. Where that is more than the motion, a frequency
tells nothing of the law, but products of noise with itself scatter J, more than a sum of squares does."""
SMOOTHED = 15
"""[frequencies] Over which that power is averaged."""
LOWEST_SPLIT, HIGHEST_SPLIT = 0.05, 0.5
"""[1] Of half the rate, between which the highest frequency of the motion is: above it enough is left to tell noise."""
SURE = 6.0
"""[1] By how much -2 log likelihood must be less for noise to be of the other kind: odds of 20 to 1."""
MOST_EVALUATIONS = 40
"""[1] Of a fit, after which it counts as it is."""
LONGEST = 40.0
"""[control periods] The longest time constant and delay that are looked for."""
LEAST_SCALE = 1e-3
"""[1] Of the largest value, the step in which one that begins at zero is looked for."""
LEAST_NOISE = 1e-6
"""[1] Of the deviation of the torque, what its noise counts as at least: rounding of a log."""
INSIDE = 0.95
"""[1] Of a limit, below which a torque is none of its samples."""
AT_BORDER = (-1, 0, 1)
"""[samples] From the first one of a run, where differences and filters reach over its border."""
KEPT = 60
"""[1] Tables of columns that are kept."""
ROUGHLY = 1.4
"""[1] By which factor the variance of noise as a log shows it by itself may be wrong."""
PARTS, PART = 24, 60
"""[parts, samples] Most parts of a torque log, and the fewest samples of one, in which its noise is looked at."""
FOURTH = 2.63
"""[1] Sum of squares of the autocorrelation of fourth differences of white noise: samples to a free one."""
HANN = 1.94
"""[1] The same of frequencies in a Hann window."""
SMALL = 0.02
"""[1] Of a level, by which it is moved to see what the values do."""
CLEARLY, FEWEST_LIMITED = 3.0, 5
"""[standard deviations, samples] By how much, and how often, a law must ask for more than its limit."""
TINY = 1e-300
"""[1] No variance."""


@dataclass(frozen=True)
class NoiseLevels:
    """Variances of white noise of torque and positions of a joint, N.m2 (N2) and rad2 (m2), each with its relative
    standard deviation; zero positions: the controller saw what the log shows, or nothing is to be seen of it."""

    torque: float
    position: float
    of_torque: float = 0.0
    of_position: float = 0.0


@dataclass(frozen=True)
class Point:
    """What a law leaves of a run at frequencies (W,).

    Attributes:
        transform: R, scaled so that the mean of |R|^2 is the variance; response: C_q; density: S.
        jacobian: (W, p) of R / sqrt(S), where it was asked for.
    """

    transform: Complex
    response: Complex
    density: Array
    jacobian: Complex | None = None


@dataclass(frozen=True)
class Table:
    """Columns (N, m) of a law at the samples of a run, their spectra and their responses to positions (W, m)."""

    columns: Array
    spectra: Complex
    responses: Complex


@dataclass(frozen=True)
class JointFit:
    """A law that was fitted at a joint.

    Attributes:
        values: of its parameters; transients: further free values, see ``_compared``.
        cost: J; samples: real numbers that it is of.
        beyond, beyond_samples: the same above the frequencies of the motion, where no law is fitted.
    """

    candidate: Candidate
    values: Mapping[str, float]
    transients: int
    cost: float
    samples: int
    beyond: float
    beyond_samples: int

    @property
    def count(self) -> int:
        """Free values."""
        return len(self.values) + self.transients

    @property
    def x(self) -> Array:
        """(p,) all free values."""
        return np.array(list(self.values.values()))


@dataclass(frozen=True)
class JointProblem:
    """The runs of one joint, with the levels of its noise; densities: of each run, what a law that is near makes of
    both, (W,), once there is one."""

    runs: tuple[JointSignals, ...]
    noise: NoiseLevels
    densities: tuple[Array, ...] = ()

    @classmethod
    def of(cls, runs: Sequence[JointSignals], torque_std: float | None = None) -> JointProblem:
        """With noise as the logs themselves show it."""
        torque, of_torque = typical([noise_in_torque(run.torque) for run in runs])
        if torque_std is not None:
            torque, of_torque = torque_std**2, 0.0
        position, of_position = typical([noise_in_positions(run.q) for run in runs])
        least = (LEAST_NOISE * max(float(np.std(run.torque)) for run in runs)) ** 2
        return cls(tuple(runs), NoiseLevels(max(torque, least), position, of_torque, of_position))

    @cached_property
    def omegas(self) -> tuple[Array, ...]:
        """Of each run, rad/s, without zero."""
        return tuple(np.asarray(2 * np.pi * np.fft.rfftfreq(run.rows.size, run.sample_s)[1:]) for run in self.runs)

    @property
    def _densities(self) -> Sequence[Array | float]:
        return self.densities or [self.noise.torque] * len(self.runs)

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """Of each run, how many frequencies from the lowest on the motion has."""
        found = []
        for torque, density in zip(self.torques, self._densities, strict=True):
            power = np.convolve(np.abs(torque) ** 2, np.ones(SMOOTHED) / SMOOTHED, mode="same")
            seen = np.flatnonzero(power > MOTION_OVER_NOISE * density)
            last, count = int(seen[-1]) + 1 if seen.size else 1, torque.size
            found.append(int(np.clip(last, LOWEST_SPLIT * count, HIGHEST_SPLIT * count)))
        return tuple(found)

    def point(self, candidate: Candidate, x: Array, *, slopes: bool = False) -> list[Point]:
        """Of each run, what a law leaves."""
        values, found = dict(zip(candidate.names, map(float, x), strict=True)), []
        factors = candidate.coefficients(values)
        of_factors = _slopes(candidate, values) if slopes else None
        for run, torque, table in zip(self.runs, self.torques, self._tables(candidate, values), strict=True):
            spectra, of_limit = table.spectra, None
            if "limit" in candidate.extras:
                transform, spectra, of_limit = _limited(run, table.columns, factors, values["limit"])
            else:
                transform = torque - spectra @ factors
            response = table.responses @ factors
            density = self.noise.torque + self.noise.position * np.abs(response) ** 2
            jacobian = None
            if of_factors is not None:
                slope = -spectra @ of_factors
                if of_limit is not None:
                    slope[:, candidate.names.index("limit")] = -of_limit
                of_density = 2 * self.noise.position * np.real(
                    np.conj(response)[:, None] * (table.responses @ of_factors)
                )  # fmt: skip
                jacobian = (slope - 0.5 * (transform / density)[:, None] * of_density) / np.sqrt(density)[:, None]
            found.append(Point(transform, response, density, jacobian))
        return found

    @cached_property
    def torques(self) -> tuple[Complex, ...]:
        """Of each run, the spectrum of the torque."""
        return tuple(_spectrum(run.torque) for run in self.runs)

    @cached_property
    def kept(self) -> dict[Any, list[Table]]:
        """The last tables, by what they depend on."""
        return {}

    def _tables(self, candidate: Candidate, values: Mapping[str, float]) -> list[Table]:
        """Of each run the columns of a law, which depend on times alone."""
        law = (candidate.law.is_cascade, candidate.law.integrates, candidate.rate, candidate.extras)
        key = (*law, *(values[name] for name in candidate.times))
        if key not in self.kept:
            if len(self.kept) >= KEPT:
                del self.kept[next(iter(self.kept))]
            self.kept[key] = found = []
            for run, omega in zip(self.runs, self.omegas, strict=True):
                columns = candidate.columns(run, values)[run.rows]
                found.append(Table(columns, _spectrum(columns), candidate.responses(omega, run.step, values)))
        return self.kept[key]

    def residual(self, candidate: Candidate, x: Array) -> Array:
        """Real parts, then imaginary ones, over the roots of their densities, at the frequencies of the motion: J is
        their sum of squares. Without transients, see ``_compared``."""
        points = self.point(candidate, x)
        found = [self._compared(candidate, i, p, p.transform / np.sqrt(p.density)) for i, p in enumerate(points)]
        return np.concatenate(found)

    def jacobian(self, candidate: Candidate, x: Array) -> Array:
        """(N, p) of the residual: exact to gains, differences to times."""
        points = self.point(candidate, x, slopes=True)
        found = [self._compared(candidate, i, p, p.jacobian) for i, p in enumerate(points) if p.jacobian is not None]
        result = np.concatenate(found)
        if candidate.times:
            before = self.residual(candidate, x)
            for name in candidate.times:
                at, moved = candidate.names.index(name), x.copy()
                step = 1e-4 * max(self.runs[0].step, abs(float(x[at])))
                moved[at] += step
                result[:, at] = (self.residual(candidate, moved) - before) / step
        return result

    def _compared(self, candidate: Candidate, run: int, point: Point, whitened: Complex) -> Array:
        """A whitened table (W, ...) of a run at the frequencies of the motion, as real numbers.

        The Fourier transform takes a run for a period. Noise of the positions, which a law differences or filters, does
        not go on over its border like that: impulses there. Once integrated it is a random walk, whose end is not its
        beginning: a ramp. Sizes of these are free values, which are eliminated (the transient term of Pintelon and
        Schoukens, ch. 6).
        """
        count = self.moving[run]
        table = _real([whitened[:count]])
        free = self.borders[run][:count, : _transients(candidate)] / np.sqrt(point.density[:count, None])
        basis = np.linalg.qr(_real([free]))[0]
        return np.asarray(table - basis @ (basis.T @ table))

    @cached_property
    def borders(self) -> tuple[Complex, ...]:
        """Of each run, the spectra (W, m) of impulses at its border and of a ramp."""
        found = []
        for run in self.runs:
            table = np.zeros((run.rows.size, len(AT_BORDER) + 1))
            table[list(AT_BORDER), range(len(AT_BORDER))] = 1.0
            table[:, -1] = np.linspace(-1.0, 1.0, run.rows.size)
            found.append(_spectrum(table))
        return tuple(found)

    def fit(self, candidate: Candidate, starts: Sequence[Mapping[str, float]]) -> JointFit:
        """The best fit of a law from several starts."""
        lowest = np.array([0.0 if name in (*TIMES, "limit") else -np.inf for name in candidate.names])
        highest = np.full(lowest.size, np.inf)
        for name in candidate.times:
            highest[candidate.names.index(name)] = LONGEST * self.runs[0].step
        best = None
        for start in starts:
            x0 = np.array([start[name] for name in candidate.names])
            scale = np.abs(x0) + LEAST_SCALE * np.abs(x0).max()
            x0 = np.clip(x0, lowest + 1e-9 * scale, np.where(np.isfinite(highest), 0.999 * highest, highest))
            found = least_squares(
                partial(self.residual, candidate), x0, partial(self.jacobian, candidate), x_scale=scale,
                bounds=(lowest, highest), max_nfev=MOST_EVALUATIONS, xtol=1e-6, ftol=2e-6, gtol=1e-9,
            )  # fmt: skip
            if best is None or found.cost < best.cost:
                best = found
        assert best is not None
        return self.fitted(candidate, best.x)

    def fitted(self, candidate: Candidate, x: Array) -> JointFit:
        """A law with certain values."""
        values = dict(zip(candidate.names, map(float, x), strict=True))
        within, points = self.residual(candidate, x), zip(self.point(candidate, x), self.moving, strict=True)
        beyond = np.concatenate([2 * np.abs(p.transform[n:]) ** 2 / p.density[n:] for p, n in points])
        transients = len(self.runs) * _transients(candidate)
        return JointFit(
            candidate, values, transients, float(within @ within), within.size, float(beyond.sum()), 2 * beyond.size
        )  # fmt: skip

    def is_limited(self, fit: JointFit) -> bool:
        """Whether a law with a limit asks for clearly more than that for some samples."""
        found, factors = 0, fit.candidate.coefficients(fit.values)
        points = self.point(fit.candidate, fit.x)
        for run, table, point in zip(self.runs, self._tables(fit.candidate, fit.values), points, strict=True):
            command = table.columns @ factors
            command += float(np.median(run.torque - command))
            clear = CLEARLY * np.sqrt(float(np.mean(point.density)))
            found += int(np.sum(np.abs(command) > abs(fit.values["limit"]) + clear))
        return found >= FEWEST_LIMITED

    def with_noise_of(self, fit: JointFit) -> JointProblem:
        """The same with noise of the kind that a fit leaves above the frequencies of the motion: that of the logs, as
        they show it themselves, or of the torque alone, the controller having seen what the log of the positions
        shows."""
        points = list(zip(self.point(fit.candidate, fit.x), self.moving, strict=True))
        power = np.concatenate([np.abs(point.transform[count:]) ** 2 for point, count in points])
        density = np.concatenate([point.density[count:] for point, count in points])
        alone = float(np.mean(power))
        near = float(np.clip(np.mean(power / density), 1 / ROUGHLY, ROUGHLY))
        of_both = float(np.sum(np.log(near * density) + power / (near * density)))
        of_torque = power.size * (np.log(max(alone, TINY)) + 1)
        if 2 * (of_both - of_torque) >= SURE:
            return replace(self, noise=NoiseLevels(alone, 0.0, 1 / np.sqrt(power.size)), densities=())
        found = replace(self, noise=_combined(self.noise, power, (density - self.noise.torque) / self._position))
        of_fit = tuple(point.density for point in found.point(fit.candidate, fit.x))
        return replace(found, densities=of_fit)

    @property
    def _position(self) -> float:
        return self.noise.position or 1.0

    def deviations(self, fit: JointFit) -> Array:
        """(p,) standard deviations of all free values, inf where one is not determined at all.

        The larger of two: by the second derivative of J and the slopes of the residual, whose variance is one; and by
        the gradients frequency by frequency, which holds for coloured noise, too, but not where few frequencies tell
        most. In both, what the levels of the noise are not known by.
        """
        x, candidate = fit.x, fit.candidate
        step = 1e-4 * np.abs(x) + 1e-8 * np.max(np.abs(x))
        for name in candidate.times:
            step[candidate.names.index(name)] = 0.01 * self.runs[0].step

        def gradients(at: Array) -> Array:
            return 2 * self.residual(candidate, at)[:, None] * self.jacobian(candidate, at)

        hessian = np.array([
            (gradients(x + d).sum(axis=0) - gradients(x - d).sum(axis=0)) / (2 * d.sum()) for d in np.diag(step)
        ])  # fmt: skip
        scale = np.sqrt(np.abs(np.diag(hessian)))
        scale[~(scale > 0)] = 1.0
        inverse = np.linalg.pinv((hessian + hessian.T) / 2 / np.outer(scale, scale), rcond=1e-12, hermitian=True)
        inverse = inverse / np.outer(scale, scale)
        here, slopes = gradients(x), 2 * self.jacobian(candidate, x)
        ratio = max(fit.cost / max(fit.samples - fit.count, 1), 1.0)
        variance = np.maximum(*(np.diag(inverse @ (g.T @ g) @ inverse) for g in (here, np.sqrt(ratio) * slopes)))
        for key, deviation in (("torque", self.noise.of_torque), ("position", self.noise.of_position)):
            level = getattr(self.noise, key)
            more, less = (
                replace(self, noise=replace(self.noise, **{key: level * (1 + sign * SMALL)})) for sign in (1, -1)
            )
            slope = (more.gradient(candidate, x) - less.gradient(candidate, x)) / (2 * SMALL)
            variance = variance + (inverse @ slope * deviation) ** 2
        return np.where(variance > 0, np.sqrt(np.maximum(variance, 0.0)), np.inf)

    def gradient(self, candidate: Candidate, x: Array) -> Array:
        """(p,) slope of J."""
        return np.asarray(2 * self.residual(candidate, x) @ self.jacobian(candidate, x))


def noise_in_torque(values: Array) -> tuple[float, float]:
    """Variance of the white noise in a column (N,), and its relative standard deviation: the median over parts of the
    mean square of fourth differences, as steps of friction are in a few parts only."""
    fourth = np.diff(values, 4) / np.sqrt(float(comb(8, 4)))
    parts = np.array_split(fourth, max(min(fourth.size // PART, PARTS), 1))
    free = parts[0].size / FOURTH
    unbiased = (1 - 2 / (9 * free)) ** 3
    deviation = np.sqrt(2 / free / len(parts)) * (np.sqrt(np.pi / 2) if len(parts) > 2 else 1.0)
    return float(np.median([np.mean(part**2) for part in parts])) / unbiased, float(deviation)


def noise_in_positions(values: Array) -> tuple[float, float]:
    """Variance of the white noise in a column (N,), and its relative standard deviation: from the upper half of the
    spectrum of its second differences, where no motion is."""
    window = np.hanning(values.size - 2)
    spectrum = rfft(np.diff(values, 2) * window)
    half = spectrum.size // 2
    omega = np.pi * np.arange(spectrum.size) / (spectrum.size - 1)
    power = np.abs(spectrum[half:]) ** 2 / np.sum(window**2) / (2 * np.sin(omega[half:] / 2)) ** 4
    return float(np.mean(power)), float(np.sqrt(HANN / power.size))


def typical(found: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Mean of variances of several runs, and its relative standard deviation."""
    levels, deviations = zip(*found, strict=True)
    return float(np.mean(levels)), float(np.sqrt(np.mean(np.square(deviations)) / len(found)))


def _combined(noise: NoiseLevels, power: Array, gain: Array) -> NoiseLevels:
    """The levels, that of the positions also by |R|^2 (W,) that a law leaves where no motion is, and its |C_q|^2."""
    if noise.position == 0 or not np.mean(gain) > 0:
        return noise
    left = float(np.mean(power)) - noise.torque
    seen = left / float(np.mean(gain))
    total = float(np.mean(power))
    deviation = np.hypot(total / np.sqrt(power.size), noise.torque * noise.of_torque) / max(left, TINY)
    if seen <= 0 or deviation > 0.5:
        return noise
    weights = np.array([noise.of_position**-2, float(deviation) ** -2])
    position = float(weights @ [noise.position, seen] / weights.sum())
    return replace(noise, position=position, of_position=float(weights.sum() ** -0.5))


def _transients(candidate: Candidate) -> int:
    """Free values of a run beside those of the law."""
    return len(AT_BORDER) + candidate.law.integrates


def _spectrum(table: Array) -> Complex:
    """(W, ...) of columns, without the frequency 0, scaled so that the mean of its squares is the variance."""
    return np.asarray(rfft(table, axis=0)[1:] / np.sqrt(table.shape[0]))


def _limited(run: JointSignals, columns: Array, factors: Array, limit: float) -> tuple[Complex, Complex, Complex]:
    """Spectra of what a limited law leaves, of its columns where it is not limited, and of the slope to the limit."""
    bound, command = abs(limit), columns @ factors
    free = np.abs(run.torque) < INSIDE * bound
    command += float(np.mean((run.torque - command)[free])) if free.any() else 0.0
    beyond = np.abs(command) > bound
    left = run.torque - np.clip(command, -bound, bound)
    columns = np.where(beyond[:, None], 0.0, columns)
    return _spectrum(left), _spectrum(columns), _spectrum(np.where(beyond, np.sign(command), 0.0))


def _real(parts: Sequence[Complex]) -> Array:
    found = [np.sqrt(2.0) * each for part in parts for each in (part.real, part.imag)]
    return np.concatenate(found)


def _slopes(candidate: Candidate, values: Mapping[str, float]) -> Array:
    """(m, p) of the factors of the columns to the free values: they are products of two at most, so that a difference
    is exact."""
    result = np.zeros((candidate.coefficients(values).size, len(candidate.names)))
    for i, name in enumerate(candidate.names):
        if name not in (*TIMES, "limit"):
            scale = abs(values[name]) or 1.0
            more, less = ({**values, name: values[name] + sign * scale} for sign in (1, -1))
            result[:, i] = (candidate.coefficients(more) - candidate.coefficients(less)) / (2 * scale)
    return result
