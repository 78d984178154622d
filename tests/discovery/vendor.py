"""A robot of which only an FMU is known, and the case of somebody who has it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fmu_didim import simulate
from fmu_didim.data.signals import trajectory, write_csv
from fmu_didim.dynamics.robot import RobotModel, read_robot, write_robot
from fmu_didim.export import build_fmu

NOISE = (0.03, 0.003)
"""Standard deviation of the torque log of the joints, N.m."""
IDENTIFY = {
    "J1": "ZZ1", "d1": "Fv1", "c1": "Fc1", "J2": "ZZ2", "mx2": "MX2", "my2": "MY2", "d2": "Fv2", "c2": "Fc2",
}  # fmt: skip


def sines(seed: int, seconds: float = 12.0, period_s: float = 4.0, rate_hz: float = 200.0) -> Any:
    """A periodic motion of both joints, slow and fast."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate_hz) + 1) / rate_hz
    columns = {}
    for j, size in ((1, 0.5), (2, 0.6)):
        phase, q, dq, ddq = rng.uniform(0, 2 * np.pi, 4), 0.0, 0.0, 0.0
        for i, k in enumerate((1, 2, 3, 5)):
            w, a = 2 * np.pi * k / period_s, size / k
            q = q + a * np.sin(w * time + phase[i])
            dq = dq + a * w * np.cos(w * time + phase[i])
            ddq = ddq - a * w**2 * np.sin(w * time + phase[i])
        columns |= {f"q{j}": q, f"dq{j}": dq, f"ddq{j}": ddq}
    return trajectory(time, columns)


def vendor_case(folder: Path, hidden: str = "", joint: int = 1, *, late: int = 0, **values: float) -> Path:
    """A case whose plant is an FMU without the hidden effect, its data made by a robot with it, noise added.

    Args:
        late: control periods by which the torque log is stamped late.
    """
    robot = read_robot("fmus/scara/robot.yaml")
    plant = build_fmu(RobotModel(robot).block(), directory=folder)
    joints = list(robot.joints)
    if hidden:
        own = joints[joint - 1]
        joints[joint - 1] = own.model_copy(
            update={"effects": (*own.effects, hidden), "parameters": {**own.parameters, **values}}
        )
    truth = robot.model_copy(update={"joints": tuple(joints)})
    write_robot(truth, folder / "truth.yaml")
    document: dict[str, Any] = {
        "schema": 1, "name": "vendor", "plant": {"kind": "fmu", "source": str(plant)},
        "controller": {"kind": "fmu", "source": str(Path("controllers/scara_pd.yaml").resolve())},
        "identify": {
            name: {"parameter": own, **({"minimum": 1e-3} if name.startswith("J") else {})}
            for name, own in IDENTIFY.items()
        },
        "estimator": {"kind": "clie"},
    }  # fmt: skip
    rng = np.random.default_rng(5)
    for label, seed in (("train", 1), ("validation", 2)):
        write_csv(sines(seed), folder / f"{label}_reference.csv")
        reference = {"file": f"{label}_reference.csv"}
        making = {
            **{k: v for k, v in document.items() if k not in ("identify", "estimator")},
            "robot": "truth.yaml", "plant": {"kind": "fmu"},
            "train": {"reference": reference, "torque": {"file": "none.csv", "rate_hz": 100}},
        }  # fmt: skip
        (folder / "making.yaml").write_text(yaml.safe_dump(making), encoding="utf-8")
        table = simulate(folder / "making.yaml")
        torque = table.select(["tau1", "tau2"])[np.maximum(np.arange(0, table.time.size - 1, 2) - late, 0)]
        torque = torque + np.array(NOISE) * rng.normal(size=torque.shape)
        write_csv(trajectory(table.time[:-1:2], {"tau1": torque[:, 0], "tau2": torque[:, 1]}), folder / f"{label}.csv")
        document[label] = {"reference": reference, "torque": {"file": f"{label}.csv"}}
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return path
