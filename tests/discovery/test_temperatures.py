"""Friction that follows the temperature, on logs by a simulator that shares no code with the package: whose does?"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.tools.temperatures import KINDS, WITHIN, friction_at, run, scored

SEED = 1


@pytest.mark.gate
@pytest.mark.parametrize(
    "number", [pytest.param(0, marks=pytest.mark.slow), 1, pytest.param(2, marks=pytest.mark.slow)]
)
def test_joints_whose_friction_follows_the_temperature_are_named(number: int, tmp_path: Path) -> None:
    """Of both joints, of one, of none, at 100 Hz."""
    line = run(number + len(KINDS), SEED, tmp_path)
    assert line["kind"] == KINDS[number]
    assert sorted(line["found"]) == [j for j, change in enumerate(line["FcK"], start=1) if change]
    for joint, found in line["found"].items():
        value, std = found[f"FcK{joint}"]
        assert abs(value - line["FcK"][joint - 1]) <= WITHIN * std
    assert not line["others"]


def test_friction_of_the_simulated_machine_falls_by_its_share_of_that_at_20_degrees() -> None:
    true = {"Fc1": 2.0, "Fv1": 1.0, "Fc2": 1.0, "Fv2": 0.5}
    found = friction_at(true, 30.0, [0.01, 0.0], [0.02, 0.0], bent=False)
    assert found == pytest.approx({"Fc1": 1.8, "Fv1": 0.8, "Fc2": 1.0, "Fv2": 0.5})
    assert friction_at(true, 30.0, [0.01, 0.0], [0.02, 0.0], bent=True)["Fv1"] == pytest.approx(0.8187, abs=1e-4)


def test_a_joint_too_many_and_another_name_are_counted() -> None:
    line = {"kind": "one", "FcK": [-0.1, 0.0], "verdict": "valid"}
    found = {"FcK1": (-0.1, 0.01), "FvK1": (0.0, 1.0)}
    right = line | {"found": {1: found}, "others": []}
    many = line | {"found": {1: found, 2: {"FcK2": (-0.1, 0.01)}}, "others": []}
    other = line | {"found": {}, "others": ["stribeck 1"]}
    off = line | {"found": {1: {"FcK1": (-0.2, 0.01)}}, "others": []}
    score = scored([right, many, other, off])
    assert score["kinds"][3] == "| one | 4 | 2 | 1 | 1 |"
    assert score["inside"] == "2 of 3"
