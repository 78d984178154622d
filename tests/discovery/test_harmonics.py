"""Ripples at harmonics of a stated motor: found where they are small, told apart, and told where the motor has none."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from fmu_didim import discover
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.augmentation.ranges import Range
from fmu_didim.discovery.harmonics import Near, motor_notes, origin_of
from fmu_didim.dynamics.effects import Harmonic, Motor
from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.dynamics.robot.description import RobotDescription
from fmu_didim.export import build_fmu
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.helpers import arm_case, arm_model

MOTOR = {"gear_ratio": 12, "pole_pairs": 5}
"""Ripples at 12, 24, 60, 120, 360 and 720 in a turn of the joint."""
TRUTH = {"Rsin": 0.05, "Rcos": -0.035, "nr": 60.0}
"""0.6 times the noise at its peak: too small for a name at a frequency of which nothing is known."""


@pytest.mark.parametrize(
    ("value", "deviation", "drift", "same", "text"),
    [
        (60.3, 0.2, 0.5, True, "commutation (60)"),  # within two deviations
        (60.3, 0.1, 0.1, True, "commutation (60, off by 3 standard deviations)"),  # the range hardly tells
        (60.3, 0.1, 0.25, False, "commutation (60, off by 3 standard deviations)"),
        (60.0, 0.0, 0.0, True, "commutation (60)"),  # held there
        (61.0, 0.0, 0.3, False, "commutation (60, off by inf standard deviations)"),
    ],
)
def test_whether_a_ripple_is_a_harmonic(value: float, deviation: float, drift: float, same: bool, text: str) -> None:
    found = Near(Harmonic(60.0, "commutation"), value, deviation, drift)
    assert (found.is_same, found.text) == (same, text)


@pytest.mark.parametrize(
    ("distances", "told"),
    [
        ([(5.0, 0.1), (8.0, 0.4)], "a (0)"),
        ([(0.3, 0.1), (0.5, 0.2)], "a (0); or b (1)"),  # a short range does not tell neighbours apart
        ([(5.0, 0.3), (8.0, 0.4)], ""),
        ([], ""),
    ],
)
def test_all_harmonics_that_the_data_do_not_tell_apart(distances: list[tuple[float, float]], told: str) -> None:
    near = [
        Near(Harmonic(float(i), name), i + off, 1.0, drift)
        for i, (name, (off, drift)) in enumerate(zip("ab", distances, strict=False))
    ]
    assert origin_of(near).replace(", off by 5 standard deviations", "") == told


@pytest.mark.parametrize(("frequency", "shown"), [(6.0, True), (314.0, True), (315.0, False)])
def test_what_is_too_fast_for_the_control(frequency: float, shown: bool) -> None:
    within = Range(-1.0, 1.0, speed=4.0, way=0.01, begin=0.0, end=8.0)
    assert within.shows(frequency) == shown
    assert within.drift(60.0, 60.0 + 3.14159) == pytest.approx(1.0, abs=1e-5)


def with_motor(robot: RobotDescription, motor: Any, joint: int = 1) -> RobotDescription:
    joints = list(robot.joints)
    stated = None if motor is None else Motor.model_validate(motor)
    joints[joint - 1] = joints[joint - 1].model_copy(update={"motor": stated})
    return robot.model_copy(update={"joints": tuple(joints)})


def builder_of(folder: Path, motor: Any, *, joints: int = 1, effects: Any = None) -> LoopModelBuilder:
    model = arm_model(folder, joints=joints, effects=effects)
    return LoopModelBuilder(model, with_motor(read_robot(folder / "robot.yaml"), motor))


RIPPLE = EffectAtJoint("torque_ripple", 1)


def test_what_is_tried_and_what_it_costs(tmp_path: Path) -> None:
    placed, plain = builder_of(tmp_path, MOTOR).at(RIPPLE), builder_of(tmp_path, None).at(RIPPLE)
    assert plain.search["nr"].known == () and plain.cost_with({"nr": 60.0}) == plain.cost == 5.0
    assert placed.search["nr"].known == (12.0, 24.0, 60.0, 120.0, 360.0)  # 720 is too fast here
    assert placed.cost == 5.0 and placed.cost_with({"nr": 61.0}) == 5.0
    assert 2.0 < placed.cost_with({"nr": 60.0}) < 2.5
    slow = builder_of(tmp_path, {"gear_ratio": 2}).at(RIPPLE)
    assert slow.search["nr"].known == ()  # slower than what can be told from gravity
    one = placed.free_parameters(Proposal(RIPPLE, {"Rsin": 1.0, "Rcos": 1.0, "nr": 120.0}), 0)
    assert next(p for p in one if p.is_shape).highest >= 150.0


@pytest.mark.parametrize(
    ("motor", "told"),
    [
        (None, []),
        ({"gear_ratio": 12}, []),
        (
            MOTOR,
            ["at the RMS of the speed: 720 (12 in an electrical turn: commutation). A slow motion"],
        ),
        ({"gear_ratio": 2}, ["look like gravity: 2 (1 in a turn of the motor: gear or bearings), 4 ("]),
    ],
)
def test_what_was_not_looked_for_is_told(motor: Any, told: list[str], tmp_path: Path) -> None:
    notes = motor_notes(builder_of(tmp_path, motor))
    assert len(notes) == len(told)
    assert all(text in note for text, note in zip(told, notes, strict=True))


def test_motors_that_joints_share_are_not_used_and_that_is_told(tmp_path: Path) -> None:
    builder = builder_of(tmp_path, MOTOR, joints=2, effects={1: ("wrist_friction",)})
    assert builder.at(RIPPLE).harmonics == {} and builder.at(RIPPLE).search["nr"].known == ()
    (note,) = motor_notes(builder)
    assert note.startswith("Joint 1 shares its motors with a neighbour")


def found_in(folder: Path, motor: Any, **ripple: float) -> tuple[dict[str, Any], Path]:
    """``findings.json`` of the arm with a ripple, whose description states a motor or none, and its folder."""
    hidden = {} if "none" in ripple else {"torque_ripple": {**TRUTH, **ripple}}
    case, out = arm_case(folder, hidden), folder / "out"
    robot = yaml.safe_load((folder / "robot.yaml").read_text())
    if motor is not None:
        robot["joints"][0]["motor"] = motor
    (folder / "robot.yaml").write_text(yaml.safe_dump(robot))
    discover(case, out)
    return json.loads((out / "findings.json").read_text()), out


@pytest.mark.gate
@pytest.mark.parametrize(
    ("motor", "origins"),
    [(None, []), (MOTOR, ["1 in an electrical turn: offset of a current sensor (60"]), ({"gear_ratio": 13}, [])],
)
def test_a_small_ripple_is_named_where_the_motor_has_it(motor: Any, origins: list[str], tmp_path: Path) -> None:
    found, out = found_in(tmp_path, motor)
    assert [f["effect"] for f in found["findings"]] == ["torque_ripple"] * len(origins)
    for finding, text in zip(found["findings"], origins, strict=True):
        assert finding["origin"].startswith(text)
        robot = yaml.safe_load((out / "robot_augmented.yaml").read_text())
        assert robot["joints"][0]["motor"] == motor  # the augmented description keeps it
        assert text in (out / "discovery.html").read_text()


@pytest.mark.gate
@pytest.mark.parametrize(
    ("motor", "told"), [(None, False), (MOTOR, False), ({"gear_ratio": 13.2, "pole_pairs": 5}, True)]
)
def test_a_ripple_that_the_motor_does_not_have_is_a_doubt(motor: Any, told: bool, tmp_path: Path) -> None:
    """As where the gear ratio is stated wrongly."""
    found, _ = found_in(tmp_path, motor, Rsin=0.3)
    (finding,) = found["findings"]
    reasons = [r for r in found["reasons"] if r["code"] == "ripple-not-of-motor"]
    assert bool(reasons) == told
    assert bool(finding["origin"]) == (motor is MOTOR)
    if told:
        assert "the nearest is 66 (1 in an electrical turn: offset of a current sensor)" in reasons[0]["text"]
        assert found["verdict"] == "doubtful"


@pytest.mark.gate
def test_a_motor_without_a_ripple_gives_none(tmp_path: Path) -> None:
    found, _ = found_in(tmp_path, MOTOR, none=1.0)
    assert found["answer"] == "nothing" and not found["findings"]


@pytest.mark.gate
@pytest.mark.parametrize("motor", [None, MOTOR])
def test_a_motor_beside_a_plant_from_elsewhere_is_told_to_be_unused(motor: Any, tmp_path: Path) -> None:
    case = arm_case(tmp_path)
    plant = build_fmu(RobotModel(read_robot(tmp_path / "robot.yaml")).block(), directory=tmp_path)
    robot, document = (yaml.safe_load((tmp_path / name).read_text()) for name in ("robot.yaml", "case.yaml"))
    robot["joints"][0] |= {} if motor is None else {"motor": motor}
    document["plant"] = {"kind": "fmu", "source": str(plant)}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot))
    case.write_text(yaml.safe_dump(document))
    notes = discover(case, rounds=0).document.notes
    assert any("motor: of joint 1 was not used" in note for note in notes) == (motor is not None)


@pytest.mark.gate
@pytest.mark.parametrize(("motor", "answer"), [(None, "unknown"), (MOTOR, "named")])
def test_an_encoder_on_the_motor_is_named_where_the_gear_is_known(motor: Any, answer: str, tmp_path: Path) -> None:
    """Without a motor up to nine periods in a turn of the joint are looked for."""
    error = {"eccentricity_cosine": 2e-4, "eccentricity_sine": 1e-4, "eccentricity_number": 24.0}
    case = arm_case(tmp_path, {"encoder_eccentricity": error}, sigma=0.05)
    robot = yaml.safe_load((tmp_path / "robot.yaml").read_text())
    robot["joints"][0] |= {} if motor is None else {"motor": motor}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot))
    found = discover(case).document
    assert found.answer == answer
    told = [("encoder_eccentricity", "2 in a turn of the motor: encoder on the motor (24)")]
    assert [(f.effect, f.origin) for f in found.findings] == (told if motor else [])


@pytest.mark.gate
def test_the_error_of_a_gear_is_that_of_its_motor(tmp_path: Path) -> None:
    error, gear = {"gear_cosine": 4e-5, "gear_sine": -4e-5, "gear_number": 24.0}, {"K": 1500.0, "motor_share": 0.4}
    case = arm_case(tmp_path, {"transmission_error": error}, gear=gear, sigma=0.05)
    robot = yaml.safe_load((tmp_path / "robot.yaml").read_text())
    robot["joints"][0]["motor"] = MOTOR
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot))
    (finding,) = discover(case).document.findings
    assert (finding.effect, finding.origin) == ("transmission_error", "2 in a turn of the motor: gear (24)")
