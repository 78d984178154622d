"""Plain BIC: forward selection over the regressors that our discovery screens, and no fit in the loop after it.

What is missing against ours: colour of the noise, fits of the candidates in the loop, the test on held-out data, the
least sizes, and the backward steps. The shapes stay on the grid of the screening and are not counted as parameters.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from examples.benchmark.answer import Answer, Name, named
from examples.benchmark.base import Base, forward
from fmu_didim.data.signals import Array
from fmu_didim.discovery.screening.catalogue import SignatureCatalogue
from fmu_didim.model.loop_model import EffectAtJoint


def answer(case: Path) -> Answer:
    """The effects that BIC takes, one after the other."""
    base = Base.of(case)
    offered = signatures(base)
    taken = forward(base, offered)
    names = [Name(*_place(name), tuple(_place(other)[0] for other in near)) for name, _, near in taken]
    columns = np.column_stack([np.empty((len(base.target), 0)), *(table for _, table, _ in taken)])
    return named(names, base.parameters(columns))


def signatures(base: Base) -> dict[str, list[Array]]:
    """``effect@joint`` -> its columns (N n, m) at each of its shapes: all that our discovery proposes."""
    builder = base.builder
    candidates = [
        EffectAtJoint(name, j) for name, e in builder.effects.items() if e.is_proposed for j in builder.joints(name)
    ]
    candidates = [a for a in candidates if not builder.at(a).is_present]
    offered: dict[str, list[Array]] = {}
    for one in SignatureCatalogue(builder, base.fit, candidates=candidates):
        offered.setdefault(f"{one.effect_at.effect}@{one.effect_at.joint}", []).append(base.stacked(one.columns))
    return offered


def _place(name: str) -> tuple[str, int]:
    effect, _, joint = name.partition("@")
    return effect, int(joint)
