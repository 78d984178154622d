"""A SCARA with a controller that nobody tells, and what is logged of it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fmu_didim import Case, load_case, simulate, trajectory, write_csv
from fmu_didim.controllers import LAWS
from tests.conftest import ROOT

RATE_HZ = 200
NOISE = {"q1": 2e-5, "q2": 2e-5, "tau1": 0.17, "tau2": 0.0065}
"""Standard deviation of the noise of each column, rad and N.m."""
HIDDEN: Mapping[str, Mapping[str, Any]] = {
    "cascade": {
        "law": "cascade_ppi", "velocity": "measured", "Kv": [16, 16], "Kp": [230, 4], "Ki": [900, 15],
        "feedforward": 0.8,
    },
    "pid": {
        "law": "pid", "velocity": "backward_difference", "Kp": [3700, 62], "Ki": [9000, 150], "Kd": [230, 4],
        "filter_s": [0.008, 0.008],
    },
    "pd": {
        "law": "pd", "velocity": "measured", "Kp": [2960, 49.6], "Kd": [184, 3.2], "lag_s": [0.004, 0.004],
    },
    "whole": {
        "law": "cascade_ppi", "velocity": "measured", "Kv": [16, 16], "Kp": [230, 4], "Ki": [900, 15],
        "feedforward": 1.0,
    },
}  # fmt: skip
"""P-PI with feed-forward; PID with filter; PD with gains of 0.8 times those published, and a lag; P-PI as a PID."""


@cache
def scara() -> Case:
    """The SCARA of the examples."""
    return load_case(ROOT / "examples/scara/identify_200hz.yaml").with_(
        plant={"kind": "model"}, controller={"kind": "model"}, validation=None
    )  # fmt: skip


def law_of(options: Mapping[str, Any]) -> Any:
    """The law of these options for the SCARA."""
    whole = {"name": "hidden", "joints": ["revolute", "revolute"], "rate_hz": RATE_HZ, **options}
    return LAWS[str(options["law"])].model_validate(whole)


def logged(
    folder: Path, options: Mapping[str, Any] | str, seed: int, *, every: int = 1, noise: float = 1.0,
    late: int = 0, **changes: Any,
) -> dict[str, Any]:  # fmt: skip
    """The case of a log of the SCARA with a controller, which it does not name.

    Args:
        options: of the law, or the path of a description; every: ticks from row to row; noise: times ``NOISE``; late:
            ticks by which the torque is logged late; changes: of the case.
    """
    block = None if isinstance(options, str) else law_of(options).block()
    controller: Any = {"source": str(ROOT / str(options))} if block is None else block
    case = scara().with_(controller=controller)
    run, rng = simulate(case), np.random.default_rng(seed)
    table = {name: run.column(name) + noise * std * rng.normal(size=run.time.size) for name, std in NOISE.items()}
    for name in ("tau1", "tau2"):
        table[name] = np.roll(table[name], late)
    kept = slice(max(late, 0), None, every)
    path = folder / "machine.csv"
    write_csv(trajectory(run.time[kept], {name: column[kept] for name, column in table.items()}), path)
    found = {
        "schema": 1, "name": "machine", "robot": str(ROOT / "fmus/scara/robot.yaml"),
        "controller": {"kind": "tracking"}, "loop": {"rate_hz": RATE_HZ},
        "train": {"reference": case.content["train"]["reference"], "torque": {"file": str(path)},
                  "positions": {"file": str(path)}},
    }  # fmt: skip
    found |= changes
    return found


def written(folder: Path, content: Mapping[str, Any]) -> Path:
    """The case in a file."""
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(dict(content), sort_keys=False), encoding="utf-8")
    return path
