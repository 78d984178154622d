"""Minima of the misfit beside each other: what a search for them has found.

    misfit = sum_j |y_j - y_sj|^2 / s_j^2   over outputs j with a stated noise s_j
           + sum_j N_j ln(|y_j - y_sj|^2 / N_j)   over the others

minus twice the logarithm of the likelihood, but for a constant, at the noise that the residual shows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.fit.fit import prior_squares
from fmu_didim.fit.noise.weighting import noise_floor
from fmu_didim.model.loop_model import LoopModel


@dataclass(frozen=True)
class FoundMinimum:
    """A place where local fits ended.

    Attributes:
        values, deviation: name of each parameter -> value, standard deviation.
        worse: misfit above that of the best, as a chi-square; error_percent: of the log.
        starts: how many ended there; settled: whether one of them converged.
    """

    values: Mapping[str, float]
    deviation: Mapping[str, float]
    worse: float
    error_percent: float
    starts: int
    settled: bool


@dataclass(frozen=True)
class SearchOutcome:
    """What a search has found.

    Attributes:
        method, seed: of the search; starts: local fits that were run; asked: that were asked for.
        searched: names of the parameters that were drawn; held: of those without bounds.
        minima: the best first, which is the answer; alike: how many of the others no data can exclude.
        failures: why local fits failed -> how many.
        evaluations: simulations of a global search; stopped: why it ended early, in words; empty where it did not.
    """

    method: str
    seed: int
    starts: int
    asked: int
    searched: tuple[str, ...]
    held: tuple[str, ...]
    minima: tuple[FoundMinimum, ...]
    alike: int = 0
    failures: Mapping[str, int] = field(default_factory=dict)
    evaluations: int = 0
    stopped: str = ""


def squares_of(model: LoopModel, values: Array) -> Array:
    """(m,) sums of the squares that values (p,) leave of each output; raises SimulationError."""
    return np.asarray((model.output_residual(values) ** 2).sum(axis=0))


def misfit(model: LoopModel, squares: Array, values: Array) -> float:
    """The misfit, see above, of sums of squares (m,) at values (p,)."""
    counts, stated, n = model.output_counts, model.stated_deviations, model.joint_count
    least = counts * noise_floor(model.measured_outputs, counts) ** 2
    squares, of_torque = np.maximum(squares, least), slice(0, n)
    if model.joint_weights == "equal":
        squares = squares.copy()
        squares[of_torque] = counts[of_torque] * squares[of_torque].sum() / counts[of_torque].sum()
    own = counts * np.log(squares / counts)
    with np.errstate(invalid="ignore"):
        known = squares / stated**2
    return float(np.where(np.isnan(stated), own, known).sum()) + prior_squares(model.prior, values)
