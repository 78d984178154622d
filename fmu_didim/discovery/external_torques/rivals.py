"""Torques from outside against effects that look like them: a load taken up during the run, friction that sticks, the
hits of a gear with play."""

from __future__ import annotations

from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.external_torques.fit import FittedExternalTorques
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.screening.catalogue import SignatureCatalogue
from fmu_didim.discovery.selection.candidates import ScreenedCandidate
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import SMALLEST_SIZE
from fmu_didim.discovery.selection.wide_search import searched_widely, worth_searching
from fmu_didim.fit.fit import Fit
from fmu_didim.model.loop_model import EffectAtJoint


def rivalled(
    fitted_torques: FittedExternalTorques,
    base: Fit,
    builder: LoopModelBuilder,
    *,
    forbid: frozenset[str] = frozenset(),
    progress: Progress,
    seed: int = 0,
) -> bool:
    """Whether one effect of the machine explains the data better than all the external torques.

    Args:
        base: the fit without the external torques; builder: builds on it; forbid: effects that are not proposed.
        seed: of the search for effects of many minima in their whole range, on joints with a gap.
    """
    rivals = {n: e for n, e in builder.effects.items() if e.rivals_external_torque and n not in forbid}
    names = [name for name, effect in rivals.items() if not effect.has_minima]
    candidates = [EffectAtJoint(name, j) for name in names for j in builder.joints(name)]
    catalogue = SignatureCatalogue(builder, base, candidates=candidates)
    competition = Competition(builder, base)
    first: dict[str, ScreenedCandidate] = {}  # the best joint of each
    for candidate in competition.screen(catalogue):
        first.setdefault(candidate.effect_at.effect, candidate)
    best = competition.compare(list(first.values()), progress=progress).ranking
    if best and best[0].delta_bic > fitted_torques.delta_bic:
        return True
    of_minima = [EffectAtJoint(n, j) for n, effect in rivals.items() if effect.has_minima for j in builder.joints(n)]
    asked = worth_searching(builder, base, of_minima, SMALLEST_SIZE)
    tried = (searched_widely(competition, a, seed=seed, progress=progress) for a in asked)
    return any(c is not None and c.delta_bic > fitted_torques.delta_bic for c in tried)
