"""Friction that bends over the speed, on both joints of an arm or on one of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

from fmu_didim import discover
from tests.discovery.helpers import arm_case

FIRST = {"power_viscous": {"Fp": 2.0, "alpha": 0.6}}


@pytest.mark.parametrize(
    "second",
    [
        pytest.param({"power_viscous": {"Fp": 0.6, "alpha": 0.6}}, marks=pytest.mark.gate),
        pytest.param({}, marks=pytest.mark.slow),
    ],
    ids=["both", "first"],
)
def test_it_is_named_on_the_joints_that_have_it(tmp_path: Path, second: Mapping[str, Mapping[str, float]]) -> None:
    """Below one, and with a positive coefficient: beside viscous friction a negative one above one is nearly alike."""
    found = discover(arm_case(tmp_path, FIRST, joints=2, second=second)).document
    hidden = {1: FIRST, **({2: second} if second else {})}
    assert (found.answer, found.verdict) == ("named", "valid")
    assert sorted((f.effect, f.joint) for f in found.findings) == [("power_viscous", joint) for joint in hidden]
    for finding in found.findings:
        true = hidden[finding.joint]["power_viscous"]
        for value in finding.parameters:
            name = value.name.removesuffix(str(finding.joint)).removesuffix("_")
            assert value.std is not None
            assert abs(value.value - true[name]) < 3 * value.std, value.name
