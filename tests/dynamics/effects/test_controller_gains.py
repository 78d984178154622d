"""Which parameters of a controller the factors of its gains multiply."""

from __future__ import annotations

from pathlib import Path

import pytest

from fmu_didim.controllers import read_controller
from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.effects import EFFECTS, ControllerEffect
from fmu_didim.dynamics.robot import RobotDescription

ROOT = Path(__file__).parents[3]
EFFECT = next(effect for effect in EFFECTS.values() if isinstance(effect, ControllerEffect))

NAMES = ("position_gain", "velocity_gain", "integral_gain")


def gains(*parameters: tuple[str, str], joint: int = 1) -> dict[str, str]:
    return dict(EFFECT.gains([Variable(name, "", "parameter", 1.0, text) for name, text in parameters], joint))


@pytest.mark.parametrize(
    ("law", "wanted"),
    [
        ("scara_pd", {"position_gain": "Kp2", "velocity_gain": "Kd2"}),
        ("scara_pid", {"position_gain": "Kp2", "velocity_gain": "Kd2", "integral_gain": "Ki2"}),
        ("scara_cascade", {"position_gain": "Kv2", "velocity_gain": "Kp2", "integral_gain": "Ki2"}),
        ("scara_computed_torque", {"position_gain": "Kp2", "velocity_gain": "Kd2"}),
    ],
)
def test_of_the_laws_that_ship(law: str, wanted: dict[str, str]) -> None:
    """Neither feed-forward and filters, nor limits, nor what a controller believes of its robot."""
    assert EFFECT.gains(read_controller(ROOT / f"controllers/{law}.yaml").parameters, 2) == wanted


def test_of_the_velocity_loop_of_the_benchmark() -> None:
    parameters = read_controller(ROOT / "controllers/emps.yaml").parameters
    assert EFFECT.gains(parameters, 1) == {"position_gain": "kp1", "velocity_gain": "kv1"}


@pytest.mark.parametrize(
    ("parameters", "wanted"),
    [
        ([("Kp1", ""), ("KD1", ""), ("ki1", "")], dict(zip(NAMES, ("Kp1", "KD1", "ki1"), strict=True))),
        ([("k_p_1", ""), ("d1", "")], {"position_gain": "k_p_1", "velocity_gain": "d1"}),
        ([("x_1", "Proportional Gain"), ("b1", "velocity gain")], {"position_gain": "x_1", "velocity_gain": "b1"}),
        ([("Kp2", ""), ("Kp11", ""), ("Kp", "")], {}),  # of other joints, or of none
        ([("Kp1", "proportional band"), ("Kd1", "dead zone")], {}),  # whose description says something else
        ([("a1", "proportional gain"), ("b1", "gain of the position loop"), ("Kd1", "")], {"velocity_gain": "Kd1"}),
        ([("Ka1", "gain of the reference acceleration"), ("limit1", "symmetric limit of the command")], {}),
    ],
)  # fmt: skip
def test_by_description_or_else_by_name(parameters: list[tuple[str, str]], wanted: dict[str, str]) -> None:
    """Where two have the same meaning nobody knows which is meant."""
    assert gains(*parameters) == wanted


def test_a_robot_has_none() -> None:
    joint = {"type": "revolute", "effects": [EFFECT.name]}
    with pytest.raises(ValueError, match="belongs to the controller, not to the robot: use gains: of a run"):
        RobotDescription.model_validate({"name": "arm", "joints": [joint]})
