"""How often a comparison of two simulated logs is wrong: nothing has changed, one of eight causes, or two of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from fmu_didim import compare
from tests.discovery.change.pairs import identified, log_of

PAIRS = 200
FALSE_ALARMS = 0.01
RIGHT = 0.90
IN_SET = 0.97
FRICTION = {"Fv1": 0.03, "Fc1": 0.82, "Fv2": 0.013, "Fc2": 0.137}
"""Of the description, N.m.s/rad and N.m."""
Drawn = tuple[dict[str, Any], set[str]]
"""What is different after, and the titles of the causes."""


def _friction(rng: np.random.Generator, *joints: int) -> dict[str, Any]:
    values = {}
    for j in joints:
        values[f"Fc{j}"] = FRICTION[f"Fc{j}"] * rng.uniform(1.2, 1.5)
        values[f"Fv{j}"] = FRICTION[f"Fv{j}"] * (rng.uniform(6.0, 14.0) if j == 1 else rng.uniform(1.3, 2.0))
    return {"values": values}


def _warm(rng: np.random.Generator) -> dict[str, Any]:
    coulomb, viscous = rng.uniform(1.25, 1.5), rng.uniform(1.5, 3.0)
    return {"values": {name: v * (coulomb if name.startswith("Fc") else viscous) for name, v in FRICTION.items()}}


def _mass(rng: np.random.Generator) -> dict[str, Any]:
    return {"mass": (rng.uniform(0.1, 0.5), rng.uniform(0.1, 0.3), rng.uniform(-0.1, 0.1))}


def _gain(rng: np.random.Generator, *joints: int) -> dict[str, Any]:
    size = 1 + rng.uniform(0.06, 0.15) * rng.choice([-1, 1])
    return {"gain": tuple(size if j in joints else 1.0 for j in (1, 2))}


PAYLOAD, EACH = "payload on the last link", "friction of joints 1, 2, each by itself"
KINDS: Mapping[str, Callable[[np.random.Generator], Drawn]] = {
    "friction 1": lambda rng: (_friction(rng, 1), {"friction of joint 1"}),
    "friction 2": lambda rng: (_friction(rng, 2), {"friction of joint 2"}),
    "warm": lambda rng: (_warm(rng), {"friction of all joints"}),
    "payload": lambda rng: (_mass(rng), {PAYLOAD}),
    "gain 1": lambda rng: (_gain(rng, 1), {"torque scale of joint 1"}),
    "gain 2": lambda rng: (_gain(rng, 2), {"torque scale of joint 2"}),
    "gain of all": lambda rng: (_gain(rng, 1, 2), {"torque scale of all joints"}),
    "mass at the axis": lambda rng: ({"values": {"ZZ1": 3.43 * rng.uniform(1.05, 1.15)}}, {PAYLOAD}),
    "both frictions": lambda rng: (_friction(rng, 1, 2), {EACH}),
    "payload, friction 1": lambda rng: (_mass(rng) | _friction(rng, 1), {PAYLOAD, "friction of joint 1"}),
    "friction 2, gain 1": lambda rng: (
        _friction(rng, 2) | _gain(rng, 1), {"friction of joint 2", "torque scale of joint 1"},
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [20.0, 100.0])
def test_false_alarms_and_right_causes(rate_hz: float) -> None:
    kinds, counts = list(KINDS), Counter[str]()
    for k in range(PAIRS):
        rng = np.random.default_rng(7000 + k)
        drawn, truth = KINDS[kinds[k // 2 % len(kinds)]](rng) if k % 2 else ({}, set())
        found = compare(identified(log_of(rate_hz, 10 * k + 1)), identified(log_of(rate_hz, 10 * k + 2, **drawn)))
        named = [{part.title for part in cause.parts} for cause in found.document.causes]
        if not truth:
            counts["still"] += 1
            counts["alarm"] += found.changed
            continue
        counts["changed"] += 1
        counts["right"] += bool(named) and named[0] == truth
        counts["in set"] += truth in named
    assert counts["alarm"] <= FALSE_ALARMS * counts["still"]
    assert counts["right"] >= RIGHT * counts["changed"]
    assert counts["in set"] >= IN_SET * counts["changed"]
