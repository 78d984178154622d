"""Minima beyond a barrier: light joints whose loop resonates above half the rate of the log.

Such a resonance shows folded back in the samples, and several inertias explain it nearly alike: along the inertia of
the joint the torque error has a minimum at each, and the iterations end in the one they started in. With a resonance
at f and a log at the rate R, minima lie apart by

    d ln I = R / f,   because f goes with I^(-1/2) and folds back anew every R/2
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from fmu_didim.base.errors import IdentificationError, SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.estimators.finish import Minimum
from fmu_didim.estimators.starts.inverse_simulation import stiffness
from fmu_didim.estimators.starts.start import simulatable
from fmu_didim.fit.fit import Fit, point, prior_squares, sum_of_squares
from fmu_didim.fit.noise.weighting import NoiseOfResidual, whitened
from fmu_didim.fit.prior_fit import prior_fit
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.parameters import RobotParameters
from fmu_didim.model.workers import side_by_side

PASSED_BY = 0.001
"""[1] Probability of data and prior as far apart by chance, below which the minimum from the prior is looked for."""
SCANNED = 100
"""[samples] First samples of a log, in which other minima are searched for; the lowest are then compared on
all."""
OTHER_MINIMA = 3
"""[minima] Most that are left for lower ones."""
FARTHEST_FACTOR = 6.0
"""[1] Ratio of inertias up to which other minima of a folded resonance are searched for."""
DAMPED = 0.5
"""[1] Damping ratio by the controller from which a loop does not ring: it overshoots by 16 %, once, and no resonance
is folded back. Friction, which is not counted, damps it further."""
SCAN_STEP = 0.15
"""[1] Largest step of that search: half of the width of the valleys of a TX40's last joint at 100 Hz."""
SCAN_PART = 0.125
"""[1] Step of it over the distance of two minima: each has four points on its slopes."""
FAR = 2.0
"""[1] Ratio of the squares that another minimum and this one leave of the first samples, above which the other does not
count, whatever it makes of the later ones."""
HASTE = 1.5
"""[1] By which a residual may change faster than it is seen to change at the ends of a part of the grid."""
VALLEYS = 3
"""[minima] Compared on the whole log, the lowest ones."""
HARDLY_WORSE = 10.8
"""[chi-square] Another minimum that is worse by less, before its other values are fitted, is not excluded by the data:
0.1 % by chance, with one degree of freedom."""


@dataclass(frozen=True)
class Valley:
    """A local minimum of the torque error along an inertia, the other values held.

    Attributes:
        place: of the inertia among the values; factor: by which it is larger; cost: weighted square of the residual,
            with that of a prior.
    """

    place: int
    factor: float
    cost: float

    def values(self, values: Array) -> Array:
        """(p,) with that inertia changed."""
        result = values.copy()
        result[self.place] *= self.factor
        return result


def lowest(minimum: Minimum, finish: Callable[[Fit], Minimum]) -> Minimum:
    """The same minimum, or a lower one beyond it, with those that fit the data almost as well.

    Args:
        finish: minimises the torque error from a point.
    """
    for _ in range(OTHER_MINIMA):
        fit = minimum.fit
        found, cost = valleys(fit), fit.chi_square + prior_squares(fit.model.prior, fit.values)
        lower = min(found, key=lambda valley: valley.cost, default=None)
        if lower is None or lower.cost >= cost:
            rivals = tuple(
                (fit.model.names[valley.place], float(valley.values(fit.values)[valley.place]))
                for valley in found
                if valley.cost < cost + HARDLY_WORSE
            )
            return replace(minimum, rivals=rivals)
        other = finish(point(fit.model.with_values(lower.values(fit.values)), NoiseOfResidual(fit.model)))
        name, here, there = fit.model.names[lower.place], fit.values[lower.place], other.fit.values[lower.place]
        text = (
            f"The torque error has several minima along {name}: {here:.4g} was left for {there:.4g}, where it is "
            "smaller. A log at a higher rate would show one alone."
        )
        minimum = other.after(minimum, text)
    return minimum


def nearer_to_prior(minimum: Minimum, finish: Callable[[Fit], Minimum]) -> Minimum:
    """The same minimum; or, where it is farther from a prior than chance has it, that from the mean of the prior if it
    is lower: iterations that begin elsewhere may have passed it by.

    Args:
        finish: minimises the torque error from a point.
    """
    fit, model = minimum.fit, minimum.fit.model
    found = prior_fit(fit, minimum.known)
    if found is None or found.p_value >= PASSED_BY:
        return minimum
    values, _ = simulatable(model, np.where(np.isfinite(found.deviation), found.mean, fit.values))
    try:
        other = finish(point(model.with_values(values), NoiseOfResidual(model)))
    except (SimulationError, IdentificationError):
        return minimum
    here, there = (weighted_cost(one, fit.deviation) for one in (fit, other.fit))
    if there >= here:
        return minimum
    return other.after(minimum, "The minimum was found from the values of the prior.")


def weighted_cost(fit: Fit, deviation: Array) -> float:
    """Sum of squares of a fit with other weights, with that of a prior."""
    return sum_of_squares(fit.residual, deviation) + prior_squares(fit.model.prior, fit.values)


def valleys(fit: Fit) -> list[Valley]:
    """Minima of the torque error beyond barriers, along each inertia that has any: the lowest few of a grid."""
    model = fit.model.integrated_as(fit.values)
    folded = folded_inertias(model, fit.values)
    if not folded:
        return []
    begin, workers = _first_samples(model, SCANNED), model.allowed_workers(fit.values)
    found = []
    for place, distance in folded.items():
        step = min(SCAN_STEP, SCAN_PART * distance)
        count = math.ceil(math.log(FARTHEST_FACTOR) / step)
        trials = [Valley(place, math.exp(step * k), np.inf) for k in range(-count, count + 1)]
        sizes = partial(_sizes, begin, fit, trials, workers)
        speed = _speed(fit, place)
        scanned = scan(sizes, count, lambda k: speed * math.exp(step * max(k, 0)) * step)  # noqa: B023
        found += [
            Valley(place, trials[count + k].factor, _cost(model, trials[count + k].values(fit.values), fit.deviation))
            for k in scanned[:VALLEYS]
        ]
    return found


def scan(sizes: Callable[[Sequence[int]], Array], count: int, speed: Callable[[int], float]) -> list[int]:
    """Places k on a grid from -count to count at which the size of a residual has a minimum that counts, the lowest
    first; the one at 0, whence the scan begins, is left out.

    Between two places the residual r cannot become smaller than

        |r| >= (|r_a| + |r_b| - (b - a) v) / 2

    where v is the speed at which it changes. Only where that is small is looked at closely.

    Args:
        sizes: |r| at some places; speed: change of r from one place to the next, near a place.
    """
    begin = sorted({-count, 0, count})
    known = dict(zip(begin, sizes(begin), strict=True))
    limit, gaps = math.sqrt(FAR * known[0] ** 2 + HARDLY_WORSE), list(pairwise(begin))
    while gaps := [gap for gap in gaps if gap[1] - gap[0] > 1 and _may_hide(known, *gap, speed) <= limit]:
        middles = [(a + b) // 2 for a, b in gaps]
        known |= dict(zip(middles, sizes(middles), strict=True))
        gaps = [part for (a, b), k in zip(gaps, middles, strict=True) for part in ((a, k), (k, b))]
    places = sorted(known)
    lower = [
        k for before, k, after in zip(places, places[1:], places[2:], strict=False)
        if known[k] < known[before] and known[k] <= known[after] and known[k] <= limit and k != 0
    ]  # fmt: skip
    return sorted(lower, key=lambda k: known[k])


def _may_hide(known: Mapping[int, float], a: int, b: int, speed: Callable[[int], float]) -> float:
    """The smallest size that a residual may have between two places; nothing is known beside one that failed."""
    if not math.isfinite(known[a] + known[b]):
        return 0.0
    fastest = HASTE * max(speed(b), abs(known[b] - known[a]) / (b - a))
    return 0.5 * (known[a] + known[b] - (b - a) * fastest)


def _speed(fit: Fit, place: int) -> float:
    """Change of the weighted residual of the first samples, and of a prior's, with the logarithm of an inertia, at the
    values of a fit."""
    first = np.concatenate(
        [np.arange(rows.stop - rows.start) < SCANNED for rows in fit.model.experiments.rows.values()]
    )
    table = fit.model.beside_prior(whitened(fit.jacobian[first], fit.deviation))
    return float(np.linalg.norm(table[:, place]) * abs(fit.values[place]))


def _sizes(model: LoopModel, fit: Fit, trials: Sequence[Valley], workers: int, places: Sequence[int]) -> Array:
    """(K,) size of the weighted residual of the first samples, with that of a prior, at places on a grid around 0."""
    middle = len(trials) // 2
    costs = [partial(_cost, model, trials[middle + k].values(fit.values), fit.deviation) for k in places]
    return np.sqrt(side_by_side(costs, workers))


def folded_inertias(model: LoopModel, values: Array) -> dict[int, float]:
    """Places of the motor or link inertias of joints whose loop rings above half the rate of the log, with the distance
    d ln I of their minima; the highest resonance first. With the response C of the controller at half the rate w

        2 pi f = sqrt(|C| / M_jj),    damping ratio = Im C / (2 w M_jj 2 pi f)
    """
    parameters = model.parameters
    if not isinstance(parameters, RobotParameters):
        return {}
    run = model.simulation(values)
    rate = run.experiment.rate_hz
    if np.pi * rate * run.step_size > 1:
        return {}  # the control is not faster than the log
    try:
        response = stiffness(run, np.pi * rate)
    except SimulationError:
        return {}
    robot, base = parameters.model, parameters.base
    mass = robot.inertia_columns(np.zeros((1, model.joint_count)))[0] @ base.expand(run.theta)
    inertia = np.diag(mass)
    resonance = np.sqrt(np.abs(response) / inertia) / (2 * np.pi)
    found = {}
    for j in np.argsort(-resonance):
        own = [i for i, name in enumerate(base.standard) if name in (f"Ia{j + 1}", f"ZZ{j + 1}", f"M{j + 1}")]
        if resonance[j] <= rate / 2 or not own:
            continue
        damping = response[j].imag / (4 * np.pi**2 * rate * inertia[j] * resonance[j])
        if damping < DAMPED:
            found[own[-1]] = float(rate / resonance[j])
    return found


def _first_samples(model: LoopModel, count: int) -> LoopModel:
    """The model with the first samples of each fitted experiment alone."""
    for label in model.estimation_labels:
        one = model.experiments[label]
        if one.time.size > count:
            model = model.with_experiment(label, one.before(count))
    return model


def _cost(model: LoopModel, values: Array, deviation: Array) -> float:
    if mass_matrix_problem(model, values):
        return np.inf
    try:
        return sum_of_squares(model.residual(values), deviation) + prior_squares(model.prior, values)
    except SimulationError:
        return np.inf
