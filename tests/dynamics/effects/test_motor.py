"""The motor of a joint: its harmonics, what is refused, and what knowing them costs."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
import yaml

from fmu_didim.base.errors import InputError
from fmu_didim.dynamics.effects import EFFECTS, Motor, Search
from fmu_didim.dynamics.robot import RobotDescription, read_robot, write_robot
from fmu_didim.workflow.robot_file import robot_lines

HARMONIC_DRIVE = {"gear_ratio": 100, "pole_pairs": 5, "slots": 12}


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        (HARMONIC_DRIVE, {
            100: ["1 in a turn of the motor: gear or bearings"], 200: ["2 in a turn of the motor: gear or bearings"],
            500: ["1 in an electrical turn: offset of a current sensor"],
            1000: ["2 in an electrical turn: gains of the current sensors"],
            3000: ["6 in an electrical turn: commutation"],
            6000: ["12 in an electrical turn: commutation", "lcm(12, 10) = 60 in a turn of the motor: cogging"],
        }),
        ({"gear_ratio": 50}, {50: ["1 in a turn"], 100: ["2 in a turn"]}),
        ({"gear_ratio": 80.5, "pole_pairs": 4}, {
            80.5: ["1 in a turn"], 161: ["2 in a turn"], 322: ["1 in an electrical"], 644: ["2 in an electrical"],
            1932: ["6 in an electrical"], 3864: ["12 in an electrical"],
        }),
        # One pair of poles: electrical turns are those of the motor.
        ({"gear_ratio": 1, "pole_pairs": 1, "slots": 9}, {
            1: ["1 in a turn", "1 in an electrical"], 2: ["2 in a turn", "2 in an electrical"],
            6: ["6 in an electrical"], 12: ["12 in an electrical"], 18: ["lcm(9, 2) = 18"],
        }),
        ({"gear_ratio": 1, "pole_pairs": 4, "slots": 9}, {
            1: ["1 in a turn"], 2: ["2 in a turn"], 4: ["1 in an el"], 8: ["2 in an el"], 24: ["6 in an el"],
            48: ["12 in an el"], 72: ["lcm(9, 8) = 72"],
        }),
    ],
)  # fmt: skip
def test_the_ripples_of_a_drive(stated: dict[str, Any], expected: dict[float, list[str]]) -> None:
    found = Motor(**stated).ripples()
    assert [h.frequency for h in found] == pytest.approx(sorted(expected))
    for harmonic, names in zip(found, (expected[f] for f in sorted(expected)), strict=True):
        assert harmonic.name.count(":") == len(names)
        assert all(name in harmonic.name for name in names)


def test_each_effect_that_repeats_knows_its_harmonics_and_no_other() -> None:
    motor = Motor(**HARMONIC_DRIVE)
    known = {name: effect.harmonics(motor) for name, effect in EFFECTS.items()}
    shapes = {
        name: {s: [h.frequency for h in own] for s, own in found.items()} for name, found in known.items() if found
    }
    assert shapes == {
        "torque_ripple": {"nr": [100, 200, 500, 1000, 3000, 6000]},
        "current_ripple": {"nr": [100, 200, 500, 1000, 3000, 6000]},
        "encoder_eccentricity": {"eccentricity_number": [100, 200]},
        "transmission_error": {"gear_number": [100, 200]},
    }
    for name, found in shapes.items():
        assert found.keys() <= EFFECTS[name].search("revolute").keys()


def robot(motor: Any, **joint: Any) -> dict[str, Any]:
    return {"schema": 1, "name": "arm", "joints": [{"type": "revolute", "motor": motor, **joint}]}


@pytest.mark.parametrize(
    ("motor", "what"),
    [
        ({"gear_ratio": 0}, "motor.gear_ratio"),
        ({"gear_ratio": -100}, "motor.gear_ratio"),
        ({"gear_ratio": 100, "pole_pairs": 0}, "motor.pole_pairs"),
        ({"gear_ratio": 100, "pole_pairs": 2.5}, "motor.pole_pairs"),
        ({"gear_ratio": 100, "pole_pairs": 5, "slots": -12}, "motor.slots"),
        ({"gear_ratio": 100, "pole_pairs": 5, "slots": 12.5}, "motor.slots"),
        ({"pole_pairs": 5, "slots": 12}, "motor.gear_ratio"),
        ({"gear_ratio": 100, "slots": 12}, "slots: 12 tell nothing without pole_pairs"),
        ({"gear_ratio": 100, "poles": 10}, "motor.poles"),
        (100, "motor"),
    ],
)
def test_what_no_motor_has_is_refused(motor: Any, what: str, tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot(motor)), encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_robot(tmp_path / "robot.yaml")
    assert what in str(error.value)


@pytest.mark.parametrize("frames", ["modified", "standard"])
def test_a_motor_is_written_as_it_was_read(frames: str, tmp_path: Path) -> None:
    read = RobotDescription.model_validate(robot(HARMONIC_DRIVE, a=0.3, alpha=0.4) | {"frames": frames})
    write_robot(read.with_values({"ZZ1": 2.0}), tmp_path / "robot.yaml")
    again = read_robot(tmp_path / "robot.yaml")
    assert again.joints[0].motor == Motor(**HARMONIC_DRIVE)
    assert yaml.safe_load((tmp_path / "robot.yaml").read_text())["joints"][0]["motor"] == HARMONIC_DRIVE


@pytest.mark.parametrize(
    ("effects", "coupled"), [((), ()), (("wrist_friction",), (1, 2)), (("coupled_inertia",), (1, 2)),
                             (("coupling_friction",), (1, 2)), (("stribeck",), ())],
)  # fmt: skip
def test_joints_that_share_motors(effects: tuple[str, ...], coupled: tuple[int, ...]) -> None:
    joints = [{"type": "revolute"}, {"type": "revolute", "effects": ["coulomb", *effects]}, {"type": "revolute"}]
    read = RobotDescription.model_validate({"schema": 1, "name": "arm", "joints": joints})
    assert read.coupled_joints() == frozenset(coupled)


FREE = Search(6, 120, 115, logarithmic=False, cost=3.0)
KNOWN = Search(6, 120, 115, logarithmic=False, cost=3.0, known=(40.0, 80.0, 160.0, 320.0))
CHOICE = 2 * math.log(4)


@pytest.mark.parametrize(
    ("search", "value", "deviation", "samples", "nats"),
    [
        (FREE, 40.0, 0.0, 1000, 3 * math.log(1000)),
        (KNOWN, 40.0, 0.0, 1000, CHOICE),
        (KNOWN, 40.0, 0.0, 100_000, CHOICE),  # however many samples there are
        (KNOWN, 320.0, 0.0, 1000, CHOICE),
        (KNOWN, 41.0, 0.0, 1000, 3 * math.log(1000)),  # tried at another frequency
        (KNOWN, 41.0, 0.5, 1000, CHOICE + 4.0),  # fitted two deviations away
        (KNOWN, 79.0, 1.0, 1000, CHOICE + 1.0),
        (KNOWN, 60.0, 0.5, 1000, 3 * math.log(1000)),  # never dearer than a frequency of which nothing is known
        (Search(1, 9, 9, cost=3.0, known=(5.0,)), 5.0, 0.0, 1000, 0.0),  # nothing to choose
    ],
)
def test_the_price_of_a_frequency(search: Search, value: float, deviation: float, samples: int, nats: float) -> None:
    price = search.price(value, samples, deviation=deviation) * math.log(samples)
    assert price == pytest.approx(nats, abs=1e-9)


def test_the_command_of_a_robot_lists_its_ripples() -> None:
    joints = [
        {"type": "revolute", "motor": {"gear_ratio": 1, "pole_pairs": 4}},
        {"type": "revolute", "a": 0.3, "effects": ["wrist_friction"], "motor": {"gear_ratio": 50}},
        {"type": "revolute", "a": 0.3},
    ]
    lines = robot_lines(RobotDescription.model_validate({"schema": 1, "name": "arm", "joints": joints}))
    text = " ".join(line.strip() for line in lines[lines.index("Motors") :])
    assert "joint 1, ripples at 1 (1 in a turn of the motor: gear or bearings), 2 (" in text
    assert "24 (6 in an electrical turn: commutation)" in text
    assert "joint 2 shares its motors with a neighbour: motor: is not used" in text and "joint 3" not in text
    plain = RobotDescription.model_validate({"schema": 1, "name": "arm", "joints": [{"type": "revolute"}]})
    assert "Motors" not in robot_lines(plain)
