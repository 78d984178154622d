"""The shipped plants as FMUs: valid, and equal to their reference output in FMPy's own simulation."""

from __future__ import annotations

from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from scipy.integrate import solve_ivp

from fmu_didim.controllers import read_controller
from fmu_didim.data.tables import read_trajectory
from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.export import build_fmu

PLANTS = sorted(path.parent.name for path in Path(__file__).parent.parent.glob("fmus/*/robot.yaml"))
CONTROLLERS = sorted(path.name for path in Path(__file__).parent.parent.glob("controllers/*.yaml"))


@pytest.mark.parametrize("name", PLANTS)
def test_plant_gives_its_reference_output(name: str) -> None:
    """Co-simulation, torque held over each communication step."""
    folder = Path("fmus") / name
    torque = read_trajectory(folder / "reference_input.csv")
    expected = read_trajectory(folder / "reference_output.csv")
    fmu = build_fmu(RobotModel(read_robot(folder / "robot.yaml")).block())
    signals = np.zeros(torque.time.size, dtype=[("time", float), *((n, float) for n in torque.names)])
    signals["time"] = torque.time
    for i, column in enumerate(torque.names):
        signals[column] = torque.values[:, i]
    joints = torque.values.shape[1]
    starts = {f"q_start{j}": expected.values[0, j - 1] for j in range(1, joints + 1)}
    result = fmpy.simulate_fmu(
        str(fmu), fmi_type="CoSimulation", stop_time=float(torque.time[-1]), step_size=0.005, output_interval=0.005,
        input=signals, start_values=starts, output=list(expected.names),
    )  # fmt: skip
    assert len(result) == torque.time.size
    for i, column in enumerate(expected.names[: 2 * joints]):
        worst = np.abs(result[column] - expected.values[:, i]).max()
        assert worst <= 1e-6 * np.abs(expected.values[:, i]).max(), column


@pytest.mark.gate
@pytest.mark.parametrize("name", PLANTS)
def test_plant_in_model_exchange_agrees_with_dop853(name: str) -> None:
    """Constant torque, FMPy's CVode against SciPy's DOP853."""
    model = RobotModel(read_robot(Path("fmus") / name / "robot.yaml"))
    n, chi, shapes = model.joint_count, model.parameter_values, model.shape_values
    torque = np.array([30.0, 0.5, 0.4, 0.3, 0.2, 0.1][:n])
    joints = range(1, n + 1)
    result = fmpy.simulate_fmu(
        str(build_fmu(model.block())), fmi_type="ModelExchange", solver="CVode", relative_tolerance=1e-10,
        stop_time=0.5, output_interval=0.005, output=[f"q{j}" for j in joints],
        start_values={f"tau{j}": torque[j - 1] for j in joints} | {f"dq_start{j}": 0.4 for j in joints},
    )  # fmt: skip
    expected = solve_ivp(
        lambda t, x: np.concatenate([x[n:], model.direct(x[:n], x[n:], torque, chi, shapes).full().ravel()]),
        (0, 0.5), np.concatenate([np.zeros(n), np.full(n, 0.4)]), method="DOP853", rtol=1e-11, atol=1e-13,
        t_eval=result["time"],
    )  # fmt: skip
    for j in joints:
        worst = np.abs(result[f"q{j}"] - expected.y[j - 1]).max()
        assert worst <= 1e-6 * np.abs(expected.y[j - 1]).max()


@pytest.mark.parametrize("name", PLANTS)
def test_plant_fmu_is_valid(name: str) -> None:
    fmu = build_fmu(RobotModel(read_robot(Path("fmus") / name / "robot.yaml")).block())
    assert validate_fmu(str(fmu)) == []


@pytest.mark.parametrize("name", CONTROLLERS)
def test_controller_fmu_is_valid(name: str) -> None:
    assert validate_fmu(str(build_fmu(read_controller(Path("controllers") / name)))) == []
