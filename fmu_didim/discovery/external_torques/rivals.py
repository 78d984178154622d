"""Torques from outside against what looks like them: a load taken up during the run, friction that sticks."""

from __future__ import annotations

from collections.abc import Callable

from fmu_didim.discovery.augmentation.builder import Workshop
from fmu_didim.discovery.external_torques.fit import Pushed
from fmu_didim.discovery.screening.catalogue import Library
from fmu_didim.discovery.selection.contenders import Screened, contend, screen
from fmu_didim.effects import EFFECTS
from fmu_didim.prediction.least_squares import Fit
from fmu_didim.prediction.loop_model import Addition
from fmu_didim.prediction.noise import Noise

RIVALS = (*EFFECTS["external_force"].confounded_with, "presliding")
"""Effects of the machine that are tried in the place of pushes; friction that sticks before it slides leaves steps of
the size of its breakaway."""


def rivalled(
    pushed: Pushed,
    base: Fit,
    noise: Noise,
    workshop: Workshop,
    *,
    forbid: frozenset[str] = frozenset(),
    say: Callable[[str], None] = lambda text: None,
) -> bool:
    """Whether one effect of the machine explains the data better than all the pushes.

    Args:
        base: the fit without the pushes; noise: of the data, with which the pushes were looked for; workshop: builds
            on the base; forbid: effects that are not proposed.
    """
    names = [name for name in RIVALS if name in workshop.effects and name not in forbid]
    candidates = [Addition(name, j) for name in names for j in workshop.joints(name)]
    library = Library(workshop, base, candidates=candidates)
    first: dict[str, Screened] = {}  # the best joint of each
    for candidate in screen(library, workshop, base, noise):
        first.setdefault(candidate.addition.effect, candidate)
    best = contend(list(first.values()), workshop, base, noise, progress=say)
    return bool(best) and best[0].delta_bic > pushed.delta_bic


__all__ = ["rivalled"]
