"""Effects that every base model has, such as friction, where a black box lacks them: when they go before another one.

An effect that does what several of them do looks better than each of them alone: friction that drifts with time within
a moment is viscous and Coulomb friction. It is named only if it explains more than all of them together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.fit.gap import bic_gain
from fmu_didim.model.loop_model import EffectAtJoint


def base_before(
    competition: Competition,
    ranking: Sequence[FittedCandidate],
    accepted: FittedCandidate,
    nearness: float,
    is_allowed: Callable[[FittedCandidate], bool],
) -> FittedCandidate:
    """The candidate to add: the accepted one, or an effect of every base model that its joint lacks.

    Args:
        ranking: all fitted candidates, the best first; nearness: BIC difference within which candidates are equal.
        is_allowed: whether a candidate may be added by itself.
    """
    missing = missing_base(competition, accepted.effect_at.joint)
    if not missing or accepted.effect_at in missing:
        return accepted
    for candidate in (c for c in ranking if c.effect_at in missing):
        together = _with_the_others(competition, candidate, missing)
        if together >= accepted.delta_bic - nearness and is_allowed(candidate):
            return candidate
    return accepted


def missing_base(competition: Competition, joint: int) -> list[EffectAtJoint]:
    """Effects of every base model that a joint of a black box lacks and can get."""
    builder = competition.builder
    own = (EffectAtJoint(name, joint) for name, effect in builder.effects.items() if effect.is_base)
    free = (a for a in own if builder.description is None and a not in competition.fit.model.added_effects)
    return [a for a in free if builder.at(a).can_be_added and not builder.at(a).is_present]


def _with_the_others(competition: Competition, candidate: FittedCandidate, missing: Sequence[EffectAtJoint]) -> float:
    """Gain in BIC of a candidate together with all others that are missing."""
    candidate = competition.finished(candidate)
    fit, cost = candidate.fit, candidate.cost
    for effect_at in missing:
        if effect_at == candidate.effect_at:
            continue
        larger = Competition(competition.builder, fit).refit(Proposal(effect_at, {}))
        if larger is not None:
            cost += len(larger.model.free_parameters) - len(fit.model.free_parameters)
            fit = larger
    return bic_gain(competition.fit, fit, cost, competition.fit.noise)
