"""The TX40 with its published PD control at 5 kHz: reference, case file and C program."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from fmu_didim.controllers import read_controller
from fmu_didim.data.excitation import Fourier, FourierJoint
from fmu_didim.data.signals import Trajectory
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot
from tests.helpers import ROOT
from tests.tools.benchmarks.c_program import ClosedLoop

ROBOT = ROOT / "fmus/tx40/robot.yaml"
CONTROLLER = ROOT / "controllers/tx40_pd.yaml"
CONTROLLERS = {5000: CONTROLLER, 1000: ROOT / "examples/tx40/pd_1khz.yaml"}
"""By their rate in Hz."""
RATE_HZ = 5000
SUBSTEPS = 4
# TUM-ICS/BIRDy, TX40.m (MIT): drive gains in N.m per unit of the command, and limits of the joints.
DRIVE_GAINS = (35.24, 32.04, 23.94, 9.05, 15.5, 6.56)
HIGHEST_DEG = np.array([180, 125, 138, 270, 133.5, 270])
LOWEST_DEG = np.array([-180, -125, -138, -270, -120, -270])
SPEED_DEG_S = np.array([287, 287, 430, 410, 320, 700])
ACCELERATION = 50.0
"""rad/s2."""


def excitation(*, seed: int = 1, duration_s: float = 10.0, harmonics: int = 5) -> Fourier:
    """A periodic motion with random coefficients that keeps 10 % away from the limits of the robot."""
    rng = np.random.default_rng(seed)
    base = 1.0 / duration_s
    # Lower harmonics as strong in speed as higher ones.
    weights = 1.0 / np.arange(1, harmonics + 1)
    middle, half = np.radians(HIGHEST_DEG + LOWEST_DEG) / 2, np.radians(HIGHEST_DEG - LOWEST_DEG) / 2
    raw = rng.normal(size=(2, 6, harmonics)) * weights
    joints = tuple(FourierJoint(cosine=tuple(raw[0, j]), sine=tuple(raw[1, j])) for j in range(6))
    shape = Fourier(fundamental_hz=base, duration_s=duration_s, joints=joints)
    motion = shape.motion(np.linspace(0, duration_s, 20001))
    limits = (half, np.radians(SPEED_DEG_S), np.full(6, ACCELERATION))
    share = np.max([np.abs(x).max(axis=0) / limit for x, limit in zip(motion, limits, strict=True)], axis=0)
    scaled = np.round(0.9 * raw / share[None, :, None], 5)
    return Fourier(
        fundamental_hz=base,
        duration_s=duration_s,
        joints=tuple(
            FourierJoint(offset=round(float(middle[j]), 5), cosine=tuple(scaled[0, j]), sine=tuple(scaled[1, j]))
            for j in range(6)
        ),
    )


def write_log(path: Path, time: np.ndarray, torque: np.ndarray) -> None:
    """Times (N,) and torques (N, n) as a table of numbers with all their digits."""
    names = ["t", *(f"tau{j + 1}" for j in range(torque.shape[1]))]
    np.savetxt(path, np.column_stack([time, torque]), "%.17g", ",", header=",".join(names), comments="")


def write_case(
    folder: Path,
    motion: Fourier,
    time: np.ndarray,
    torque: np.ndarray,
    *,
    substeps: int | None = None,
    noise: float | None = None,
    controller: Path = CONTROLLER,
    **estimator: object,
) -> Path:
    """A case file with its torque log (N, 6) in ``folder``; plant and controller as FMUs.

    Args:
        noise: standard deviation of the torque that the estimator is told; controller: its description.
        estimator: its other options.
    """
    write_log(folder / "torque.csv", time, torque)
    content = {
        "schema": 1,
        "name": "TX40",
        "robot": str(ROBOT),
        "plant": {"kind": "fmu", **({"substeps": substeps} if substeps is not None else {})},
        "controller": {"kind": "fmu", "source": str(controller)},
        "loop": {"drive_gains": list(DRIVE_GAINS)},
        "train": {"reference": motion.model_dump(mode="json"), "torque": {"file": "torque.csv"}},
        "estimator": {"kind": "didim", **estimator},
        **({"torque_std": [noise] * 6} if noise is not None else {}),
    }
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


def start_values(reference: Trajectory) -> dict[str, float]:
    """Start of the plant on the reference."""
    first = dict(zip(reference.names, reference.values[0], strict=True))
    return {f"{s}_start{j}": float(first[f"{s}{j}"]) for s in ("q", "dq") for j in range(1, 7)}


def description() -> RobotDescription:
    """The robot."""
    return read_robot(ROBOT)


def program(motion: Fourier, *, controller: Path = CONTROLLER, substeps: int = SUBSTEPS) -> ClosedLoop:
    """The closed loop as one C program, with the true parameters, at the rate of its controller."""
    control = read_controller(controller)
    assert control.sample_time is not None
    reference = motion.trajectory(round(1 / control.sample_time))
    plant = RobotModel(description()).block(start_values(reference))
    return ClosedLoop(plant, control, reference, DRIVE_GAINS, control.sample_time, substeps)
