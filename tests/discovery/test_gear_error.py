"""The error of position of an elastic gear, named by discovery; where the gear does not give way it has no place."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmu_didim.results.findings import FindingsDocument
from fmu_didim.workflow import discover
from tests.discovery.helpers import arm_case

GEAR = {"K": 1500.0, "motor_share": 0.4}
TRUTH = {"gear_cosine": 3e-5, "gear_sine": -4e-5, "gear_number": 64.0}


def found_in(folder: Path, *, described: bool) -> FindingsDocument:
    """What is found of an arm with an uneven gear, of which the description has the elasticity or nothing."""
    if described:
        case = arm_case(folder, {"transmission_error": TRUTH}, gear=GEAR, sigma=0.05)
    else:
        case = arm_case(folder, {"joint_elasticity": GEAR, "transmission_error": TRUTH}, sigma=0.05)
    return discover(case).document


def within(document: FindingsDocument, effect: str, truth: dict[str, float]) -> None:
    """A finding has these values within 3 sigma, and they are known to a few per cent."""
    values = {p.name: p for f in document.findings if f.effect == effect for p in f.parameters}
    for name, value in truth.items():
        one = values[f"{name}_1"]
        assert one.std is not None
        assert abs(one.value - value) < 3 * one.std, name
        assert one.std < 0.1 * abs(value), name


@pytest.mark.gate
def test_the_error_of_a_gear_that_is_known_to_give_way(tmp_path: Path) -> None:
    document = found_in(tmp_path, described=True)
    assert [(f.effect, f.joint) for f in document.findings] == [("transmission_error", 1)]
    assert document.findings[0].ambiguous == []
    within(document, "transmission_error", TRUTH)


@pytest.mark.gate
def test_elasticity_and_error_of_a_gear_thought_rigid(tmp_path: Path) -> None:
    document = found_in(tmp_path, described=False)
    assert {(f.effect, f.joint) for f in document.findings} == {("joint_elasticity", 1), ("transmission_error", 1)}
    within(document, "transmission_error", TRUTH)
    within(document, "joint_elasticity", {"K": GEAR["K"]})
