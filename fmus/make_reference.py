"""Make the reference input and output of each plant: torque held over 5 ms, motion by SciPy's DOP853.

    python fmus/make_reference.py

The FMU of the plant, run by any tool at a communication step of 5 ms, must give the same motion.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from fmu_didim.dynamics.robot import RobotModel, read_robot

HERE = Path(__file__).parent
STEP_S, COUNT = 0.005, 401
# Amplitude (N.m or N) and frequency (Hz) of the torque of each joint; start positions.
INPUTS = {
    "scara": ((4.0, 0.7), (0.3, 1.3), (0.2, -0.4)),
    "emps": ((60.0, 0.8), (0.0,)),
    "arm2r": ((20.0, 0.9), (4.0, 1.7), (-1.2, 0.5)),
    "tx40": (
        (25.0, 0.7),
        (40.0, 0.9),
        (20.0, 1.1),
        (7.0, 1.3),
        (8.0, 1.5),
        (5.0, 1.7),
        (0.3, -0.4, 0.8, 0.2, -0.5, 0.6),
    ),
}


def main() -> None:
    """Write ``reference_input.csv`` and ``reference_output.csv`` of each plant."""
    for name, (*waves, start) in INPUTS.items():
        model = RobotModel(read_robot(HERE / name / "robot.yaml"))
        n = model.joint_count
        time = STEP_S * np.arange(COUNT)
        torque = np.column_stack([a * np.sin(2 * np.pi * f * time) for a, f in waves])
        # What is written is what is applied.
        torque = np.array([[float(f"{v:.9g}") for v in row] for row in torque])
        chi, shapes = model.parameter_values, model.shape_values

        def acceleration(x: np.ndarray, tau: np.ndarray) -> np.ndarray:
            return model.direct(x[:n], x[n:], tau, chi, shapes).full().ravel()  # noqa: B023

        x = np.concatenate([start, np.zeros(n)])
        rows = []
        for k in range(COUNT):
            rows.append(np.concatenate([x, acceleration(x, torque[k])]))
            x = solve_ivp(
                lambda t, x, k=k: np.concatenate([x[n:], acceleration(x, torque[k])]),  # noqa: B023
                (0, STEP_S), x, method="DOP853", rtol=1e-11, atol=1e-13,
            ).y[:, -1]  # fmt: skip
        joints = range(1, n + 1)
        outputs = [f"{signal}{j}" for signal in ("q", "dq", "ddq") for j in joints]
        for file, names, values in (
            ("reference_input.csv", [f"tau{j}" for j in joints], torque),
            ("reference_output.csv", outputs, np.array(rows)),
        ):
            table = np.column_stack([time, values])
            np.savetxt(HERE / name / file, table, "%.9g", ",", header=",".join(["t", *names]), comments="")


if __name__ == "__main__":
    main()
