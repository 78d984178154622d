"""Where a spring rests that was found with a constant."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmu_didim.discovery.rest import _rest, part_of
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.model.loop_model import EffectAtJoint

BUILDER: Any = SimpleNamespace(
    effect=lambda a: EFFECTS[a.effect],
    loop=SimpleNamespace(joint_type=lambda joint: "prismatic" if joint == 3 else "revolute"),
)
COVARIANCE = np.array([[0.04, 0.1, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 9.0]])


def fit(*named: EffectAtJoint, c: float = -6.0, k: float = 20.0) -> Any:
    """A fit with a constant, a spring and one base parameter."""
    free = [SimpleNamespace(effect=0), SimpleNamespace(effect=1), SimpleNamespace(effect=None)]
    return SimpleNamespace(
        model=SimpleNamespace(added_effects=named, free_parameters=free),
        values=np.array([c, k, 1.0]), covariance=COVARIANCE,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("constant", "spring", "told"),
    [
        (
            ("torque_offset", 1),
            ("spring", 1),
            "spring or cable stiffness on joint 1, which rests at 0.3 ± 0.022 rad then",
        ),
        (
            ("torque_offset", 3),
            ("spring", 3),
            "spring or cable stiffness on joint 3, which rests at 0.3 ± 0.022 m then",
        ),
        (("torque_offset", 1), ("spring", 2), ""),
        (("asymmetric_coulomb", 1), ("spring", 1), ""),
        (("torque_offset", 1), ("cubic_spring", 1), ""),
    ],
)
def test_where_it_rests_is_said(constant: tuple[str, int], spring: tuple[str, int], told: str) -> None:
    """With the constant, not with the spring."""
    places = EffectAtJoint(*constant), EffectAtJoint(*spring)
    assert part_of(fit(*places), places[0], places[::-1], BUILDER) == told
    assert part_of(fit(*places), places[1], places[::-1], BUILDER) == ""


def test_its_deviation_is_that_of_random_constants_and_stiffnesses() -> None:
    """Monte Carlo over the joint covariance of both."""
    places = EffectAtJoint("torque_offset", 1), EffectAtJoint("spring", 1)
    rest, deviation = _rest(fit(*places), places[1], places[0])
    draws = np.random.default_rng(4).multivariate_normal([-6.0, 20.0], COVARIANCE[:2, :2], size=100_000)
    found = -draws[:, 0] / draws[:, 1]
    assert rest == pytest.approx(0.3) and deviation == pytest.approx(found.std(), rel=0.03)
