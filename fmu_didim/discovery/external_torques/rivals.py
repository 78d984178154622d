"""Torques from outside against effects that look like them: a load taken up during the run, friction that sticks."""

from __future__ import annotations

from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.external_torques.fit import FittedExternalTorques
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.screening.catalogue import SignatureCatalogue
from fmu_didim.discovery.selection.candidates import ScreenedCandidate
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.fit.fit import Fit
from fmu_didim.model.loop_model import EffectAtJoint


def rivalled(
    fitted_torques: FittedExternalTorques,
    base: Fit,
    builder: LoopModelBuilder,
    *,
    forbid: frozenset[str] = frozenset(),
    progress: Progress,
) -> bool:
    """Whether one effect of the machine explains the data better than all the external torques.

    Args:
        base: the fit without the external torques; builder: builds on it; forbid: effects that are not proposed.
    """
    names = [name for name, effect in builder.effects.items() if effect.rivals_external_torque and name not in forbid]
    candidates = [EffectAtJoint(name, j) for name in names for j in builder.joints(name)]
    catalogue = SignatureCatalogue(builder, base, candidates=candidates)
    competition = Competition(builder, base)
    first: dict[str, ScreenedCandidate] = {}  # the best joint of each
    for candidate in competition.screen(catalogue):
        first.setdefault(candidate.effect_at.effect, candidate)
    best = competition.compare(list(first.values()), progress=progress).ranking
    return bool(best) and best[0].delta_bic > fitted_torques.delta_bic
