"""What becomes of an identified model: a robot description, an FMU, a python-control system."""

from __future__ import annotations

from pathlib import Path

import control
import numpy as np
import pytest
import yaml

from fmu_didim import build_fmu, identify, load_fmu, load_result, simulate, to_control
from fmu_didim.base.errors import UnknownNameError
from fmu_didim.cli.main import main
from fmu_didim.dynamics.robot import RobotModel, read_robot, write_robot
from tests.cases import scara_case


@pytest.mark.gate
def test_identified_robot_simulates_the_identified_torque(tmp_path: Path) -> None:
    outcome = identify("examples/scara/identify.yaml", out=tmp_path)
    robot = read_robot(tmp_path / "robot_identified.yaml")
    values = {v.name: v.start for v in robot.standard_parameters()}
    assert values["ZZ1"] == pytest.approx(outcome.estimate.value[0], rel=1e-15)
    assert values["M2"] == 0
    path = scara_case(tmp_path, robot=str(tmp_path / "robot_identified.yaml"))
    again = simulate(path)
    named = dict(zip(outcome.estimate.names, outcome.estimate.value, strict=True))
    expected = simulate("examples/scara/identify.yaml", parameters=named)
    np.testing.assert_allclose(again.values, expected.values, rtol=0, atol=1e-12)


def test_identified_fmu_has_the_values_as_start_values(tmp_path: Path) -> None:
    robot = read_robot("fmus/scara/robot.yaml").with_values({"ZZ1": 3.3, "v0_2": 0.05})
    offered = load_fmu(build_fmu(RobotModel(robot).block())).parameter_values()
    assert offered["ZZ1"] == 3.3
    assert offered["v0_2"] == 0.05


def test_description_survives_writing_and_reading(tmp_path: Path) -> None:
    for name in ("scara", "emps", "arm2r"):
        robot = read_robot(f"fmus/{name}/robot.yaml")
        write_robot(robot, tmp_path / "robot.yaml")
        assert read_robot(tmp_path / "robot.yaml") == robot
        assert yaml.safe_load((tmp_path / "robot.yaml").read_text(encoding="utf-8"))["schema"] == 1
    with pytest.raises(UnknownNameError, match="ZZ3"):
        robot.with_values({"ZZ3": 1.0})


def test_plant_comes_back_as_a_python_control_system() -> None:
    """linearize, lqr and a closed loop by interconnect, on the vertical arm at rest, without dry friction."""
    robot = read_robot("fmus/arm2r/robot.yaml").with_values({"Fc1": 0.0, "Fc2": 0.0})
    model = RobotModel(robot)
    plant = to_control(model.block())
    assert isinstance(plant, control.NonlinearIOSystem)
    hold = model.bias([0.3, 0.2], [0, 0], model.parameter_values, model.shape_values).full().ravel()
    linear = control.linearize(plant, [0.3, 0.2, 0, 0], hold)
    mass = model.mass_matrix([0.3, 0.2], model.parameter_values).full()
    np.testing.assert_allclose(linear.B[2:], np.linalg.inv(mass), rtol=1e-4)
    gain, _, poles = control.lqr(linear.A, linear.B, np.eye(4), 0.01 * np.eye(2))
    assert poles.real.max() < 0
    regulator = control.nlsys(
        None, lambda t, x, u, params: hold - gain @ (u - [0.3, 0.2, 0, 0]), name="regulator",
        inputs=["q1", "q2", "dq1", "dq2"], outputs=["tau1", "tau2"],
    )  # fmt: skip
    loop = control.interconnect([plant, regulator], inputs=[], outputs=["q1", "q2"], check_unused=False)
    response = control.input_output_response(loop, np.linspace(0, 3, 61), initial_state=[0.35, 0.1, 0, 0])
    np.testing.assert_allclose(response.outputs[:, -1], [0.3, 0.2], atol=5e-3)


@pytest.mark.gate
def test_the_robot_of_a_run_with_a_payload_is_written_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its user is told which file is which, and what no robot description holds."""
    out = tmp_path / "out"
    assert main(["identify", "examples/scara/two_payloads.yaml", "--out", str(out), "--quiet"]) == 0
    shown = capsys.readouterr().out
    assert f"with those of payload: {out / 'robot_identified_payload.yaml'}" in shown
    assert "not in it, because not of the robot: Kp2\n" in shown
    found = load_result(out).parameters
    shared, own = (
        {v.name: v.start for v in read_robot(out / name).standard_parameters()}
        for name in ("robot_identified.yaml", "robot_identified_payload.yaml")
    )
    assert shared["ZZ2"] == found["ZZ2"].value != found["ZZ2[payload]"].value == own["ZZ2"]
    assert shared["Fv2"] == own["Fv2"] == found["Fv2"].value
    assert not (out / "robot_identified_empty.yaml").exists()


@pytest.mark.gate
def test_without_parameters_of_its_own_no_run_has_a_robot_of_its_own(tmp_path: Path) -> None:
    outcome = identify("examples/scara/identify.yaml", out=tmp_path)
    assert outcome.robots == {} and outcome.outside_robot == ()
    assert [path.name for path in tmp_path.glob("robot*")] == ["robot_identified.yaml"]
