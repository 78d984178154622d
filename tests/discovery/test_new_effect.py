"""New effects, one class each: friction with a state of its own, found on an elastic joint, and one of a drive."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from fmu_didim import discover
from fmu_didim.components import load_fmu
from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.effects import (
    EFFECTS,
    UNITS,
    InsertedEffect,
    JointType,
    OperatingRange,
    Parameter,
    Search,
    Surroundings,
    TorqueEffect,
)
from fmu_didim.dynamics.effects.first_order import FirstOrder
from fmu_didim.dynamics.effects.steps import direction, smoothing_velocity
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot
from fmu_didim.model.motion import motion_of
from fmu_didim.results.findings import FindingsDocument
from tests.discovery.helpers import arm_case, arm_document, sines


class FilmFriction(TorqueEffect):
    """tau_e = Ff s(dq) exp(-w/vf), dw/dt = (|dq| - w)/Tf: friction of a film that needs time to build up.

    w in rad/s (m/s) is the speed as the film knows it, Tf in s later than the joint; it starts at 0. Ff in N.m (N).
    """

    name = "film_friction"
    title = "Friction of a lubricant film"
    equation = "Ff*tanh(dq/v0)*exp(-w/vf), dw/dt = (|dq| - w)/Tf"
    class_name = "film"
    confounded_with = ("stribeck",)
    signature = "Residual that falls with speed, and falls later than the speed rises."
    experiment = "The same path at two accelerations."
    source = "Hess and Soom: Friction at a lubricated line contact at oscillating sliding velocities, J. Tribology 1990"

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("Ff", UNITS[joint_type].torque, "parameter", 0.0, "friction without a film"),)

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        speed = UNITS[joint_type].velocity
        return (
            smoothing_velocity(joint_type),
            Variable("vf", speed, "parameter", 0.5, "speed at which the film carries"),
            Variable("Tf", "s", "parameter", 0.1, "time in which the film builds up"),
        )

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        return {"vf": Search(0.1, 2.0, 5), "Tf": Search(0.02, 1.0, 5)}

    def states(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (Variable("w", UNITS[joint_type].velocity, "local", 0.0, "speed as the film knows it"),)

    def columns(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return (direction(at, shapes) * ca.exp(-at.state[0] / shapes["vf"]),)

    def rates(self, at: Surroundings, shapes: Mapping[str, ca.SX]) -> tuple[ca.SX, ...]:
        return ((ca.fabs(at.dq) - at.state[0]) / shapes["Tf"],)

    def damping(self, parameters: Mapping[str, ca.SX], shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return ca.fabs(parameters["Ff"]) / shapes["v0"]

    def own_rate(self, shapes: Mapping[str, ca.SX], within: OperatingRange) -> ca.SX:
        return 1 / shapes["Tf"]


class FadingDrive(InsertedEffect):
    """tau = u - fading u |u|, with fading in 1/(N.m) (1/N): less torque for a large current, as iron saturates."""

    name = "fading_drive"
    title = "Drive that fades"
    equation = "tau = command - fading*command*|command|"
    place = "drive"
    class_name = "fading"
    confounded_with = ("drive_gain", "dead_zone")
    signature = "Residual that grows with the square of the torque."
    experiment = "A known payload."
    source = "made up for a test"
    rank = 15
    first_order = FirstOrder("torque", lambda at: at.logged * np.abs(at.logged))
    own_parameters = (
        Parameter(
            "fading", ("1/(N.m)", "1/N"), "loss of torque constant by torque",
            neutral=0.0, limits=(0.0, 0.1), search=Search(1e-4, 3e-2, 5),
        ),
    )  # fmt: skip

    def output(self, u: ca.SX, x: ca.SX, values: Mapping[str, ca.SX], step: float) -> ca.SX:
        return u - values["fading"] * u * ca.fabs(u)


NAME = "tests.discovery.test_new_effect:FilmFriction"
HIDDEN = {"Ff": 2.0, "vf": 0.6, "Tf": 0.15}
GEAR = {"K": 6000.0, "D": 10.0, "motor_share": 0.6}


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, FindingsDocument]:
    """Two joints, the first one elastic as the model knows; its friction is what the model lacks."""
    folder = tmp_path_factory.mktemp("film")
    case = arm_case(folder, {NAME: HIDDEN}, joints=2, gear=GEAR)
    return folder, discover(case, folder / "out", effects=[NAME])


@pytest.mark.gate
def test_it_is_no_effect_of_the_tree() -> None:
    assert FilmFriction.name not in EFFECTS


@pytest.mark.gate
def test_it_is_found_on_its_joint_with_its_size(found: tuple[Path, FindingsDocument]) -> None:
    document = found[1]
    assert document.answer == "named"
    assert [(f.effect, f.joint) for f in document.findings] == [(NAME, 1)]
    values = {v.name: v for v in document.findings[0].parameters}
    for name, key in (("Ff", "Ff1"), ("vf", "vf_1"), ("Tf", "Tf_1")):
        assert values[key].value == pytest.approx(HIDDEN[name], rel=0.2)
        assert abs(values[key].value - HIDDEN[name]) < 4 * values[key].std  # type: ignore[operator]
    for gap in document.gap.values():
        assert gap.before is not None and gap.after is not None
        assert gap.after < 0.4 < 1.0 < gap.before


@pytest.mark.gate
def test_the_augmented_model_holds_it_beside_the_gear(found: tuple[Path, FindingsDocument]) -> None:
    folder, document = found
    robot = read_robot(folder / "out" / document.files["robot"])
    assert {"joint_elasticity", NAME} <= set(robot.joints[0].effects)
    assert NAME not in robot.joints[1].effects
    (note,) = [n for n in document.notes if "augmented case" in n]
    assert float(note.split(" of its peak")[0].split()[-1]) < 1e-3


@pytest.mark.gate
def test_loads_of_an_elastic_joint_are_those_of_a_rigid_one_along_the_same_motion() -> None:
    """What friction that follows the load is screened by."""
    elastic = RobotModel(RobotDescription.model_validate(arm_document(2, gear=GEAR)))
    rigid = RobotModel(RobotDescription.model_validate(arm_document(2)))
    reference = sines(4.0, joints=2)
    q, dq, ddq = (reference.select([f"{name}{j}" for j in (1, 2)]) for name in ("q", "dq", "ddq"))
    first, second = (
        motion_of(model, model.parameter_values, reference.time, q, dq, ddq, np.zeros_like(q))
        for model in (elastic, rigid)
    )
    assert np.ptp(second.load, axis=0).min() > 5.0
    np.testing.assert_allclose(first.load, second.load, rtol=0, atol=1e-9)
    for j in range(2):
        np.testing.assert_allclose(first.links[j], second.links[j], rtol=0, atol=1e-9)


@pytest.mark.slow
def test_a_new_effect_of_a_drive_is_found_and_written_as_a_part_of_its_own(tmp_path: Path) -> None:
    name = "tests.discovery.test_new_effect:FadingDrive"
    document = discover(arm_case(tmp_path, {name: {"fading": 0.006}}, sigma=0.05), tmp_path / "out", effects=[name])
    assert (document.findings[0].effect, document.findings[0].joint) == (name, 1)
    (value,) = document.findings[0].parameters
    assert value.value == pytest.approx(0.006, rel=0.2)
    part = load_fmu(tmp_path / "out" / document.files["part_fading_drive1"])
    assert {v.name: v.start for v in part.parameters}["fading"] == pytest.approx(value.value)
    (note,) = [n for n in document.notes if "augmented case" in n]
    assert float(note.split(" of its peak")[0].split()[-1]) < 2e-3
