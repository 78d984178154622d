"""Machines with a controller that the case does not know: their log of torque and positions, and cases of it."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from fmu_didim import Case, Result, load_case, simulate, trajectory
from fmu_didim.data.signals import Array, Trajectory
from tests.helpers import ROOT

SCARA = ROOT / "examples/scara/identify.yaml"
TORQUE_STD = (0.17, 0.0065)
"""[N.m] 5 % of the torque."""
POSITION_STD = 2e-5
"""[rad] Of an encoder."""


@cache
def machine(controller: str = "scara_cascade", rate_hz: float = 200.0) -> Trajectory:
    """What the SCARA does at its control rate, with the values of the description and this controller."""
    law = {"kind": "model", "source": f"../../controllers/{controller}.yaml"}
    return simulate(load_case(SCARA).with_(plant={"kind": "model"}, controller=law))


@cache
def truth() -> dict[str, float]:
    model = load_case(SCARA).model
    return dict(zip(model.names, map(float, model.start), strict=True))


def content_of(
    *, reference: bool = False, positions: bool = True, torque_rate: float | None = None, **changes: Any
) -> dict[str, Any]:
    """A case of the log, in memory under the name ``log``."""
    content = dict(load_case(SCARA).content)
    content.pop("validation")
    train: dict[str, Any] = {"torque": {"file": "log"}}
    if torque_rate is not None:
        train["torque"]["rate_hz"] = torque_rate
    if positions:
        train["positions"] = {"file": "positions"}
    if reference:
        train["reference"] = content["train"]["reference"]
    content |= {"plant": {"kind": "model"}, "controller": {"kind": "tracking"}, "train": train}
    content |= {"estimator": {"kind": "didim"}, "loop": {"rate_hz": 200}}
    return content | changes


def case_of(
    seed: int = 0, *, position_std: float = POSITION_STD, thinned: int = 1, to_s: float = 10.0,
    hidden: str = "scara_cascade", torque_std: tuple[float, float] = TORQUE_STD, run: Trajectory | None = None,
    **changes: Any,
) -> Case:  # fmt: skip
    """A case with noisy torques at the control rate, and positions at a part of it; of another ``run``, if given."""
    rng, names, run = np.random.default_rng(seed), ("q1", "q2", "tau1", "tau2"), run or machine(hidden)
    table = run.select(names) + np.array((position_std, position_std, *torque_std)) * rng.normal(
        size=(run.time.size, 4)
    )
    kept = run.time <= to_s + 1e-9
    log = trajectory(run.time[kept], dict(zip(names[2:], table[kept, 2:].T, strict=True)))
    positions = trajectory(run.time[kept][::thinned], dict(zip(names[:2], table[kept, :2][::thinned].T, strict=True)))
    signals = {"log": log, "positions": positions}
    return load_case(content_of(**changes), folder=SCARA.parent, signals=signals)


def errors_of(found: Result) -> Array:
    """(b,) errors of the values, over their standard deviations."""
    return np.array([(p.value - truth()[name]) / p.std for name, p in found.parameters.items()])
