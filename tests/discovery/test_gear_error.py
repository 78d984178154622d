"""The error of position of an elastic gear, named by discovery, and what is said where another model has it."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmu_didim import discover
from fmu_didim.results.findings import FindingsDocument
from tests.discovery.helpers import arm_case

GEAR = {"K": 1500.0, "motor_share": 0.4}
TRUTH = {"gear_cosine": 9e-5, "gear_sine": -1.2e-4, "gear_number": 64.0}


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
    """The error drives the gear so much that a fit of the elasticity alone gains nothing: both are found together."""
    document = found_in(tmp_path, described=False)
    assert [(f.effect, f.joint) for f in document.findings] == [("joint_elasticity", 1), ("transmission_error", 1)]
    within(document, "transmission_error", TRUTH)
    within(document, "joint_elasticity", {"K": GEAR["K"], "motor_share": GEAR["motor_share"]})
    assert any("it shows only beside Error of position of a gear" in note for note in document.notes)


@pytest.mark.gate
def test_a_ripple_of_an_elastic_gear_is_no_error_of_it(tmp_path: Path) -> None:
    """Both repeat along the joint; the motor's ripple does not drive the link by way of the gear."""
    ripple = {"Rsin": 0.4, "Rcos": -0.3, "nr": 64.0}
    document = discover(arm_case(tmp_path, {"torque_ripple": ripple}, gear=GEAR, sigma=0.05)).document
    assert [(f.effect, f.joint) for f in document.findings] == [("torque_ripple", 1)]
    within(document, "torque_ripple", {"nr": 64.0})


@pytest.mark.slow
def test_an_uneven_gear_that_hardly_gives_way_is_never_valid_with_a_wrong_value(tmp_path: Path) -> None:
    """Its stiffness lies beyond the grid: whatever it is called, a wrong value is doubted."""
    stiff = {"K": 1e6, "D": 20.0, "motor_share": 0.4}
    document = discover(
        arm_case(tmp_path, {"joint_elasticity": stiff, "transmission_error": TRUTH}, sigma=0.05)
    ).document
    assert document.findings and document.verdict == "doubtful"
    numbers = [p for f in document.findings for p in f.parameters if p.name == "gear_number_1"]
    assert all(abs(p.value - TRUTH["gear_number"]) < 0.1 for p in numbers)
