"""Profiles of the misfit: one parameter held at a value, all others fitted anew.

    D(v) = [min over the others of chi2(v, others) - chi2(answer)] / r^2,    r = sigma / sigma_white

with the weights of the answer. sigma is the standard deviation of the answer, with the colour of the noise, sigma_white
that by white noise: where the model is linear, D is ((v - answer) / sigma)^2, and where D reaches the square of
Student's t lies the linear interval. So the noise is held at that of the answer, its colour too: the vertical scaling
of a likelihood of independent samples, R. E. Chandler, S. Bate, "Inference for clustered data using the independence
loglikelihood", Biometrika 94(1), 2007.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from fmu_didim.base.distributions import t_ppf
from fmu_didim.base.errors import FmuError, IdentificationError, SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.fit.fit import Fit, prior_squares, sum_of_squares
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.fit.region import Region
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.fit.statistics import CONFIDENCE
from fmu_didim.model.loop_model import LoopModel

AIMS = (0.35, 0.7, 1.05, 1.4)
"""[1] Heights sqrt(D) of the points of a side, over that of the interval: a curve to look at, and one point beyond."""
MOST_POINTS = 14
"""[points] Of a side, where the misfit rises slowly."""
FARTHEST = 20.0
"""[standard deviations] From the answer; what has not reached the height of the interval there is called open."""
FASTER = 3.0
"""[1] Most by which a step grows beside the one before: the neighbour is the start of the next fit."""
HALVINGS = 6
"""[halvings] Of a step to values that cannot be simulated or fitted, before the side ends there."""
LOWER = 0.5
"""[1] D below minus this is another minimum, and no rest of the iterations."""
ITERATIONS = 25
"""[steps] Of one fit of the others, from those of the neighbour."""
TOLERANCE = 1e-6
"""[1] Relative change of the values at which it stops at the latest,"""
NEXT_STEP = 0.02
"""[standard deviations] or when the next step would be smaller: D is then off by less than a thousandth."""

DIFFERENT = 1 / 3
"""[1] Difference of the ends of the interval from the linear ones, over its half-width, from which the profile's is the
one to be shown."""

How = Literal["reached", "limit", "open", "failed", "lower"]
"""How a side ends: the interval was reached; a limit of the parameter comes first; it is not reached far away; nothing
can be simulated beyond; another minimum lies there."""


@dataclass(frozen=True)
class Side:
    """One side of a profile, to be followed.

    Attributes:
        place: of the parameter; sign: of the direction, 1.0 or -1.0.
        values: (p,) of the answer; noise: its weights; chi_square: its misfit.
        sigma: standard deviation of the parameter; ratio: r above; height: t.
        direction: (p,) change of all values with that of the parameter, by linear theory.
    """

    place: int
    sign: float
    values: Array
    noise: Noise
    chi_square: float
    sigma: float
    ratio: float
    height: float
    direction: Array


@dataclass(frozen=True)
class HalfProfile:
    """One side of a profile.

    Attributes:
        values: (K, p) of all parameters at its points, away from the answer; difference: (K,) D.
        end: of the interval; NaN where it is open; how: it ends.
    """

    values: Array
    difference: Array
    end: float
    how: How


@dataclass(frozen=True)
class Profile:
    """The profile of a parameter.

    Attributes:
        place: of it among all; values: (K, p) in order of the parameter, the answer among them; difference: (K,) D.
        interval: low and high; NaN where it is open; how: it ends, low and high.
        linear: the interval of the answer; height: D at the ends of the interval.
    """

    place: int
    values: Array
    difference: Array
    interval: tuple[float, float]
    how: tuple[How, How]
    linear: tuple[float, float]
    height: float

    @property
    def lowest(self) -> Array:
        """(p,) values of the least misfit."""
        return np.asarray(self.values[int(np.argmin(self.difference))])

    @property
    def is_bent(self) -> bool:
        """Whether the interval differs from the linear one, as far as limits let that reach, by more than a third of
        its half-width, or has an open end."""
        answer = 0.5 * (self.linear[0] + self.linear[1])
        half = 0.5 * (self.linear[1] - self.linear[0])
        for end, linear, how in zip(self.interval, self.linear, self.how, strict=True):
            wanted = end if how == "limit" and abs(end - answer) < abs(linear - answer) else linear
            if not abs(end - wanted) <= DIFFERENT * half:
                return True
        return False


def sides_of(fit: Fit, deviation: Array, freedom: float, places: list[int]) -> list[Side]:
    """Both sides of the profiles of some parameters, low and high in turn.

    Args:
        fit: the answer, with all outputs; deviation: (p,) standard deviations; freedom: degrees of freedom of t.
    """
    white, covariance = fit.equations.deviations(), fit.covariance
    chi_square = _chi_square(fit.model, fit.values, fit.outputs, fit.noise)
    found = []
    for i in places:
        direction = covariance[:, i] / covariance[i, i] if covariance[i, i] > 0 else np.eye(deviation.size)[i]
        ratio = float(deviation[i] / white[i]) if 0 < white[i] < np.inf else 1.0
        height = float(t_ppf(0.5 + CONFIDENCE / 2, max(freedom, 1.0)))
        one = Side(i, -1.0, fit.values, fit.noise, chi_square, float(deviation[i]), ratio or 1.0, height, direction)
        found += [one, replace(one, sign=1.0)]
    return found


def joined(low: Side, below: HalfProfile, above: HalfProfile, linear: tuple[float, float]) -> Profile:
    """The profile of two sides."""
    values = np.concatenate([below.values[::-1], low.values[None], above.values])
    difference = np.concatenate([below.difference[::-1], [0.0], above.difference])
    ends = (below.end, above.end)
    return Profile(low.place, values, difference, ends, (below.how, above.how), linear, low.height**2)


def followed(model: LoopModel, side: Side) -> HalfProfile:
    """One side of a profile, each point fitted from its neighbour."""
    walk = _Walk(model, side)
    how = walk.to_the_end()
    end = walk.crossing() if how == "reached" else walk.limit if how == "limit" else np.nan
    points = walk.points[1:]
    values = np.array([v for v, _ in points]).reshape(-1, side.values.size)
    return HalfProfile(values, np.array([np.sign(z) * z**2 for _, z in points]), end, how)


class _Walk:
    """Points (values, z) along one side, z = sqrt(D)."""

    def __init__(self, model: LoopModel, side: Side) -> None:
        self._model, self._side = model, side
        self.points: list[tuple[Array, float]] = [(side.values, 0.0)]
        self._jacobian: Array | None = None
        region = Region.of(model)  # of machines, too: friction is not negative
        self.limit = float((region.high if side.sign > 0 else region.low)[side.place])

    def to_the_end(self) -> How:
        """Walk until the height of the interval is passed, or the side ends."""
        side, rate, halvings = self._side, self._side.sigma, 0
        begin = float(side.values[side.place])
        if side.sign * (self.limit - begin) <= 0:
            return "limit"
        for _ in range(MOST_POINTS):
            values, z = self.points[-1]
            aim = next((a * side.height for a in AIMS if a * side.height > z + AIMS[0] / 2 * side.height), None)
            if aim is None or z >= AIMS[2] * side.height:
                break
            wanted = float(values[side.place]) + side.sign * (aim - z) * rate / 2**halvings
            held = min(wanted, self.limit) if side.sign > 0 else max(wanted, self.limit)
            if not self._fitted(held):
                if halvings == HALVINGS:
                    return "failed"
                halvings += 1
                continue
            halvings, new = 0, self.points[-1][1]
            if new < -np.sqrt(LOWER):
                return "lower"
            if new < side.height and held == self.limit:
                return "limit"
            if new < side.height and abs(held - begin) >= FARTHEST * side.sigma:
                return "open"
            moved = abs(held - float(values[side.place]))
            rate = float(np.clip(moved / max(new - z, 1e-9), rate / FASTER, rate * FASTER))
        return "reached" if self.points[-1][1] >= side.height else "open"

    def crossing(self) -> float:
        """The value where the height of the interval is crossed, after one more point there."""
        if self._fitted(self._interpolated()):
            self.points.sort(key=lambda point: self._side.sign * float(point[0][self._side.place]))
        return self._interpolated()

    def _interpolated(self) -> float:
        place, height = self._side.place, self._side.height
        k = next(k for k, (_, z) in enumerate(self.points) if z >= height)
        (before, low), (after, high) = self.points[k - 1], self.points[k]
        part = (height - low) / (high - low)
        return float(before[place] + part * (after[place] - before[place]))

    def _fitted(self, held: float) -> bool:
        """Whether the others could be fitted with the parameter held there; the point is then added."""
        side = self._side
        near = min(self.points, key=lambda point: abs(float(point[0][side.place]) - held))[0]
        others = [values for values, _ in self.points if values is not near]
        step = side.direction
        if others:  # along the line through the two nearest
            next_one = min(others, key=lambda values: abs(float(values[side.place]) - held))
            apart = float(near[side.place] - next_one[side.place])
            step = (near - next_one) / apart if apart else step
        for start in (near + step * (held - near[side.place]), near):
            values = self._model.free_parameters.limited(start)
            values[side.place] = held
            try:
                found = self._minimum(values)
            except (SimulationError, IdentificationError, FmuError):
                continue
            if found.settled:
                difference = (self._chi_square_of(found) - side.chi_square) / side.ratio**2
                self._jacobian = found.jacobian
                self.points.append((found.values, float(np.sign(difference) * np.sqrt(abs(difference)))))
                return True
        return False

    def _minimum(self, values: Array) -> Fit:
        free = list(self._model.with_values(values).free_parameters)
        one = free[self._side.place]
        free[self._side.place] = one.held()
        stopping = Stopping(
            ITERATIONS, tolerance=TOLERANCE, next_step=NEXT_STEP, updates=None, check_all=False, exact=True, whole=True
        )
        return minimise(self._model.with_free(tuple(free)), self._side.noise, stopping=stopping)

    def _chi_square_of(self, fit: Fit) -> float:
        return _chi_square(fit.model, fit.values, fit.outputs, self._side.noise)


def _chi_square(model: LoopModel, values: Array, outputs: Array, noise: Noise) -> float:
    return sum_of_squares(model.measured_outputs - outputs, 1 / noise.weight) + prior_squares(model.prior, values)
