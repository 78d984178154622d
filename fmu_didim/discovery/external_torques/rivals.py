"""Torques from outside against what looks like them: a load taken up during the run, friction that sticks."""

from __future__ import annotations

from collections.abc import Callable

from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.external_torques.fit import FittedExternalTorques
from fmu_didim.discovery.screening.catalogue import SignatureCatalogue
from fmu_didim.discovery.selection.contenders import Screened, contend, screen
from fmu_didim.effects import EFFECTS
from fmu_didim.prediction.least_squares import Fit
from fmu_didim.prediction.loop_model import EffectAtJoint
from fmu_didim.prediction.noise import Noise

RIVALS = (*EFFECTS["external_force"].confounded_with, "presliding")
"""Effects of the machine that are tried in the place of external torques; friction that sticks before it slides leaves
steps of the size of its breakaway."""


def rivalled(
    fitted_torques: FittedExternalTorques,
    base: Fit,
    noise: Noise,
    builder: LoopModelBuilder,
    *,
    forbid: frozenset[str] = frozenset(),
    say: Callable[[str], None] = lambda text: None,
) -> bool:
    """Whether one effect of the machine explains the data better than all the external torques.

    Args:
        base: the fit without the external torques; noise: of the data, with which the external torques were looked
        for; builder: builds
            on the base; forbid: effects that are not proposed.
    """
    names = [name for name in RIVALS if name in builder.effects and name not in forbid]
    candidates = [EffectAtJoint(name, j) for name in names for j in builder.joints(name)]
    catalogue = SignatureCatalogue(builder, base, candidates=candidates)
    first: dict[str, Screened] = {}  # the best joint of each
    for candidate in screen(catalogue, builder, base, noise):
        first.setdefault(candidate.effect_at.effect, candidate)
    best = contend(list(first.values()), builder, base, noise, progress=say)
    return bool(best) and best[0].delta_bic > fitted_torques.delta_bic


__all__ = ["rivalled"]
