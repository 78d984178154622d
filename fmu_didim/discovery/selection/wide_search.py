"""An effect of many local minima, such as play in a gear, looked for in the whole range of its parameters.

A gear with play hits its flanks at other instants with each other gap, stiffness and inertia of its motor, so that the
sum of squares has a minimum wherever the hits of model and machine coincide by chance. A fit from the best of a few
starts ends in one of them: at half of the gap, sure of it, or at no gap at all. So all parameters are searched for
together, by differential evolution of the sum of squares with the base refitted to first order, and the fit starts from
the best.

Source: R. Storn and K. Price, Differential evolution, Journal of Global Optimization 11 (1997).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition, fitted_proposal
from fmu_didim.dynamics.effects import Search
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import joint_gaps
from fmu_didim.model.loop_model import EffectAtJoint
from fmu_didim.model.workers import side_by_side

PEOPLE = 8
"""[1] Of the population, for each parameter. With these and so many generations the play of three logs at 20 Hz was
found from any seed, of which fits from the best of a grid found none."""
GENERATIONS = 12
"""[1] After the first one."""
MOST_STEPS = 5e8
"""[steps] Of the integration, times the square of the joints, for all simulations of a search: three quarters of a
minute. Six joints at 5 kHz would take ten minutes. What needs more than its share of them counts as what cannot be
simulated: a gear beside a link that the base leaves with hardly any inertia rings at any rate."""
UNSTABLE = 1e30
"""[1] Sum of squares of what cannot be simulated."""
_FROM_FEW = (
    "from a few starts alone: its whole range would take more than three quarters of a minute of simulations on each "
    "joint. {0} A shorter log, or a lower rate_hz of the loop, lets it be searched."
)
UNSEEN = "{0} was looked for on {1} " + _FROM_FEW.format("So it may be there and not be found.")
OTHER_MINIMUM = "{0} on {1} was fitted " + _FROM_FEW.format("So other values of it may explain more.")
"""Notes on an effect and its joints, where it has no name in the answer, and where it has."""


@dataclass(frozen=True)
class _Range:
    """The range of a parameter: its grid, logarithmic or not, as a number from 0 to 1."""

    search: Search

    def value(self, part: float) -> float:
        low, high = self.search.lowest, self.search.highest
        return float(low * (high / low) ** part if self.search.logarithmic else low + part * (high - low))

    def part(self, value: float) -> float:
        low, high = self.search.lowest, self.search.highest
        if self.search.logarithmic:
            return float(np.clip(np.log(max(value, low) / low) / np.log(high / low), 0, 1))
        return float(np.clip((value - low) / (high - low), 0, 1))


def searched_widely(
    competition: Competition, effect_at: EffectAtJoint, *, seed: int, progress: Progress, begin: Fit | None = None
) -> FittedCandidate | None:
    """An effect fitted from the best values in the whole range of its parameters; None where that takes too long, where
    the time is up or where none can be simulated.

    Args:
        begin: a fit with the effect, whose values are in the first generation; seed: of the search.
    """
    builder, fit = competition.builder, competition.fit
    ranges = _ranges(builder, effect_at)
    if progress.is_time_up or not ranges or takes_too_long(builder, fit, effect_at):
        return None
    builder.prepare([(*fit.model.added_effects, effect_at)], progress=progress, workers=fit.model.workers)
    progress.say(f"{effect_at.effect} on joint {effect_at.joint} in the whole range of its parameters")

    most = MOST_STEPS / (_simulations(ranges) * fit.model.joint_count**2)

    def misfit(parts: Array) -> float:
        if progress.is_time_up:
            return UNSTABLE
        return min(competition.misfit(Proposal(effect_at, _values(ranges, parts)), most_steps=most), UNSTABLE)

    known = {} if begin is None else fitted_proposal(begin, effect_at).values
    # A share of the motor is no parameter where the motor has an inertia of its own.
    own = [r.part(known[name]) if name in known else 0.5 for name, r in ranges.items()]
    first = None if begin is None else np.array(own)
    parts = _evolved(misfit, len(ranges), seed=seed, first=first, workers=fit.model.allowed_workers(fit.values))
    if progress.is_time_up or misfit(parts) >= UNSTABLE:
        return None
    found = competition.refit(Proposal(effect_at, _values(ranges, parts)))
    return None if found is None else competition.finished(competition.assess(effect_at, found))


def takes_too_long(builder: LoopModelBuilder, fit: Fit, effect_at: EffectAtJoint) -> bool:
    """Whether an effect is not looked for in the whole range of its parameters, as that would take too long."""
    steps = fit.model.integration_steps(fit.values)
    return _simulations(_ranges(builder, effect_at)) * steps * fit.model.joint_count**2 > MOST_STEPS


def _simulations(ranges: Mapping[str, _Range]) -> int:
    """Of a search in these ranges."""
    return PEOPLE * len(ranges) * (GENERATIONS + 1)


def worth_searching(
    builder: LoopModelBuilder, fit: Fit, candidates: Iterable[EffectAtJoint], smallest_size: float
) -> list[EffectAtJoint]:
    """Those of the candidates that have many minima, of no class that is named on their joint, where that has a gap of
    this size left."""
    named = {(builder.effect(a).class_name, a.joint) for a in fit.model.added_effects}
    of_many = [a for a in candidates if builder.effect(a).has_minima]
    asked = [a for a in of_many if builder.at(a).can_be_added and (builder.effect(a).class_name, a.joint) not in named]
    if not asked:
        return []
    gaps = joint_gaps(fit.torque_alone.residual, fit.torque_alone.noise)
    return [a for a in asked if gaps[a.joint - 1] > smallest_size]


def wide_search_notes(builder: LoopModelBuilder, fit: Fit, unnamed: Iterable[EffectAtJoint]) -> list[str]:
    """Notes on effects of many minima that were not looked for in their whole range, as that takes too long.

    Args:
        unnamed: effects that are not in the model of the fit, and would have been looked for there.
    """
    named = (a for a in fit.model.added_effects if builder.effect(a).has_minima)
    notes = []
    for text, asked in ((OTHER_MINIMUM, named), (UNSEEN, unnamed)):
        joints: dict[str, list[int]] = {}
        for a in asked:
            if takes_too_long(builder, fit, a):
                joints.setdefault(builder.effect(a).title, []).append(a.joint)
        for title, on in joints.items():
            notes.append(text.format(title, f"joint{'s' * (len(on) > 1)} {', '.join(map(str, on))}"))
    return notes


def _ranges(builder: LoopModelBuilder, effect_at: EffectAtJoint) -> dict[str, _Range]:
    return {name: _Range(search) for name, search in builder.at(effect_at).search.items()}


def _values(ranges: Mapping[str, _Range], parts: Array) -> dict[str, float]:
    return {name: r.value(float(part)) for (name, r), part in zip(ranges.items(), parts, strict=True)}


def _evolved(misfit: Callable[[Array], float], count: int, *, seed: int, first: Array | None, workers: int) -> Array:
    """(count,) numbers from 0 to 1 with the least misfit; the same with any number of workers."""
    from scipy.optimize import differential_evolution  # few discoveries need it

    def misfits(of: Callable[[Array], float], those: Iterable[Array]) -> list[float]:
        return side_by_side([partial(of, one) for one in those], workers)

    found = differential_evolution(
        misfit, [(0.0, 1.0)] * count, maxiter=GENERATIONS, popsize=PEOPLE, tol=0.0, seed=seed, polish=False,
        updating="deferred", workers=misfits, x0=first,
    )  # fmt: skip
    return np.asarray(found.x)
