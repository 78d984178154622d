"""A case in memory: two motions of the SCARA for the estimation, the second with a payload, and a third to judge."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fmu_didim import Trajectory, load_case, simulate, trajectory
from fmu_didim.case import Case

FOLDER = Path(__file__).parents[2] / "examples/scara"
OWN = ("ZZ1R", "ZZ2", "MX2")
PAYLOAD = {"ZZ1R": 3.45, "ZZ2": 0.088, "MX2": 0.291}
RATES_HZ = {"light": 10, "payload": 20, "check": 10}
NOISE = 0.05


def content() -> dict[str, Any]:
    """The case of the example with a start that needs no thought."""
    found = yaml.safe_load((FOLDER / "identify.yaml").read_text(encoding="utf-8"))
    return {**found, "estimator": {"kind": "didim"}}


@cache
def logs() -> dict[str, Trajectory]:
    """Torque at the rate of each experiment, with noise; by the name of its file."""
    rng, found = np.random.default_rng(5), {}
    for label, motion in motions().items():
        case = {**content(), "train": {"reference": motion}, "validation": None}
        values = PAYLOAD if label == "payload" else {}
        table = simulate(load_case(case, folder=FOLDER, require_torque=False), parameters=values)
        every = 200 // RATES_HZ[label]
        torque = table.select(["tau1", "tau2"])[::every]
        torque = torque + NOISE * torque.std(axis=0) * rng.normal(size=torque.shape)
        found[f"{label}.csv"] = trajectory(table.time[::every], {"tau1": torque[:, 0], "tau2": torque[:, 1]})
    return found


def motions() -> dict[str, dict[str, Any]]:
    """The reference of each experiment."""
    first, second = content()["train"]["reference"], content()["validation"]["reference"]
    third = {**second, "joints": [first["joints"][1], second["joints"][0]]}
    return {"light": first, "payload": second, "check": third}


def three_experiments(*, own: tuple[str, ...] = OWN, **changes: Any) -> Case:
    """The case; without ``own`` the payload is one that the model does not know of."""
    document = {key: value for key, value in content().items() if key not in ("train", "validation")}
    document["experiments"] = {
        label: {"reference": motion, "torque": {"file": f"{label}.csv"}} for label, motion in motions().items()
    }
    document["experiments"]["check"]["role"] = "validation"
    if own:
        document["experiments"]["payload"]["own"] = list(own)
    return load_case({**document, **changes}, folder=FOLDER, signals=logs())
