"""Torques from outside against what looks like them, such as a load that is taken up during the run."""

from __future__ import annotations

from collections.abc import Callable

from fmu_didim.discovery.augment import Workshop
from fmu_didim.discovery.compete import contend, screen
from fmu_didim.discovery.fit import Fit
from fmu_didim.discovery.library import Library
from fmu_didim.discovery.loop_model import Addition
from fmu_didim.discovery.noise import Noise
from fmu_didim.discovery.pushes import Pushed
from fmu_didim.effects import EFFECTS

FEW = 3
"""More pushes than this come from outside: nothing else begins and ends so often."""


def rivalled(
    pushed: Pushed,
    base: Fit,
    noise: Noise,
    workshop: Workshop,
    *,
    forbid: frozenset[str] = frozenset(),
    say: Callable[[str], None] = lambda text: None,
) -> bool:
    """Whether an effect of the machine with which an external force is confounded explains the data better.

    Args:
        base: the fit without the pushes; noise: of the data, with which the pushes were looked for; workshop: builds
            on the base; forbid: effects that are not proposed.
    """
    if len(pushed.pushes) > FEW:
        return False
    rivals = EFFECTS["external_force"].confounded_with
    names = [name for name in rivals if name in workshop.effects and name not in forbid]
    candidates = [Addition(name, j) for name in names for j in workshop.joints(name)]
    library = Library(workshop, base, candidates=candidates)
    best = contend(screen(library, workshop, base, noise)[:2], workshop, base, noise, progress=say)
    return bool(best) and best[0].delta_bic > pushed.delta_bic


__all__ = ["rivalled"]
