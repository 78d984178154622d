"""Robots that carry a load in one of two runs: their logs with known truth, and cases of them."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from fmu_didim import Case, load_case, simulate, trajectory
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.dynamics.robot import read_robot
from tests.helpers import ROOT

SCARA = ROOT / "examples/scara/identify.yaml"
LOAD = {"M": 2.0, "MX": 2.0 * 0.12, "MY": 2.0 * -0.03, "ZZ": 2.0 * (0.12**2 + 0.03**2) + 0.004}
"""A weight of 2 kg at (0.12, -0.03) m in the frame of the last link, with 0.004 kg.m2 about its centre."""
TORQUE_STD = (0.17, 0.02)
"""[N.m] Of white noise."""
POSITION_STD = 1e-5
"""[rad] Of an encoder."""


@cache
def run(
    label: str, load: tuple[tuple[str, float], ...] = tuple(LOAD.items()), friction: float = 0.0,
    gains: tuple[float, float] = (1.0, 1.0),
) -> Trajectory:  # fmt: skip
    """What the SCARA does at its control rate, without or with this load, with so much more Coulomb friction on joint
    1, and with drives that give so many times the torque that the log shows."""
    law = {"kind": "model", "source": "../../controllers/scara_cascade.yaml"}
    case = load_case(SCARA).with_(plant={"kind": "model"}, controller=law)
    if gains != (1.0, 1.0):
        free = {f"gain{j}": {"of": "drive", "joint": j, "start": g} for j, g in enumerate(gains, start=1)}
        case = case.with_(identify=free)
    if label == "loaded":
        robot, last = read_robot(ROOT / "fmus/scara/robot.yaml"), {f"{k}2": v for k, v in load}
        own = {v.name: v.start for v in robot.standard_parameters()}
        changed = {name: own.get(name, 0.0) + value for name, value in last.items()} | {"Fc1": own["Fc1"] + friction}
        case = case.with_(robot=robot.with_values(changed))
    return simulate(case)


def case_of(
    seed: int = 0, *, gains: tuple[float, float] = (1.0, 1.0), load: dict[str, Any] | None = None,
    carried: dict[str, float] = LOAD, tracking: bool = True, friction: float = 0.0, **changes: Any,
) -> Case:  # fmt: skip
    """A case of two runs, with noise; torques are over these gains, behind the loop or, its controller known, in it.

    Args:
        load: what the case says of it, ``{}`` by default.
    """
    signals, experiments, n = dict[str, Trajectory](), dict[str, Any](), 2
    for place, label in enumerate(("empty", "loaded")):
        of_loop = (1.0, 1.0) if tracking else gains
        rng, told = np.random.default_rng((seed, place)), run(label, tuple(carried.items()), friction, of_loop)
        torque = told.select([f"tau{j}" for j in (1, 2)]) + np.array(TORQUE_STD) * rng.normal(size=(told.time.size, n))
        q = told.select([f"q{j}" for j in (1, 2)]) + POSITION_STD * rng.normal(size=(told.time.size, n))
        torque = torque / np.array(gains if tracking else (1.0, 1.0))
        signals[f"log {label}"] = trajectory(told.time, {f"tau{j + 1}": torque[:, j] for j in range(n)})
        signals[f"positions {label}"] = trajectory(told.time, {f"q{j + 1}": q[:, j] for j in range(n)})
        experiments[label] = {"torque": {"file": f"log {label}"}}
        if tracking:
            experiments[label]["positions"] = {"file": f"positions {label}"}
    content = dict(load_case(SCARA).content)
    reference = content.pop("train")["reference"]
    content.pop("validation")
    if not tracking:
        for one in experiments.values():
            one["reference"] = reference
    experiments["loaded"]["load"] = load or {}
    controller = (
        {"kind": "tracking"} if tracking else {"kind": "model", "source": "../../controllers/scara_cascade.yaml"}
    )
    content |= {
        "plant": {"kind": "model"}, "controller": controller, "experiments": experiments,
        "estimator": {"kind": "didim"},
    }  # fmt: skip
    if tracking:
        content["loop"] = {"rate_hz": 200}
    return load_case(content | changes, folder=SCARA.parent, signals=signals)


def planned(
    *, tracking: bool = False, gains: tuple[float, float] | None = (1.3, 0.8), load: dict[str, Any] | None = None
) -> Case:
    """The case of two runs whose logs, in amperes, do not exist yet; ``gains`` are not free where there are none."""
    content = dict(load_case(SCARA).content)
    reference = content.pop("train")["reference"]
    content.pop("validation")
    experiments: dict[str, Any] = {}
    for label in ("empty", "loaded"):
        own = {"positions": {"file": f"{label}.csv"}} if tracking else {"reference": reference}
        experiments[label] = {"torque": {"file": f"{label}.csv", "rate_hz": 200 if tracking else 50}, **own}
    experiments["loaded"]["load"] = {"mass": 2.0, "mass_std": 0.01} if load is None else load
    law = {"kind": "tracking"} if tracking else {"kind": "model", "source": "../../controllers/scara_cascade.yaml"}
    content |= {"plant": {"kind": "model"}, "controller": law, "experiments": experiments}
    content |= {"estimator": {"kind": "didim"}} | ({"loop": {"rate_hz": 200}} if tracking else {})
    if gains is not None:
        content["identify"] = {
            f"gain{j}": {"of": "drive", "joint": j, "start": gain} for j, gain in enumerate(gains, start=1)
        }
    return load_case(content, folder=SCARA.parent, require_torque=False, require_positions=False)


def free_gains(joints: int = 2) -> dict[str, Any]:
    """The gains of all drives, free."""
    return {f"gain{j}": {"of": "drive", "joint": j, "start": 1.0} for j in range(1, joints + 1)}


def truth() -> dict[str, float]:
    """The parameters of robot and load."""
    model = load_case(SCARA).model
    return dict(zip(model.names, map(float, model.start), strict=True)) | {
        f"load_{name}[loaded]": value for name, value in LOAD.items()
    }


def errors(values: Array, deviations: Array, names: tuple[str, ...]) -> dict[str, float]:
    """Errors over their standard deviations."""
    true = truth()
    return {n: float((v - true[n]) / s) for n, v, s in zip(names, values, deviations, strict=True) if n in true and s}
