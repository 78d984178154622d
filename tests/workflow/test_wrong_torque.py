"""A torque log that is wrong as they come from machines is told by name before any fit, from the file on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import check, identify, load_case
from fmu_didim.base.diagnostics import DiagnosedError
from fmu_didim.base.errors import FmuDidimError
from tests.helpers import ROOT

Array = np.ndarray
CASES = {"scara": ROOT / "examples/scara/identify_200hz.yaml", "arm": ROOT / "examples/arm2r/discover.yaml"}


def times(factor: float) -> Callable[[Array], Array]:
    """Stamps by a clock that runs at another rate."""
    return lambda rows: rows * np.array([factor, 1.0, 1.0])


def of_joint(j: int, change: Callable[[Array], Array]) -> Callable[[Array], Array]:
    return lambda rows: np.column_stack([rows[:, :j], change(rows[:, j]), rows[:, j + 1 :]])


def wrapped(torque: Array) -> Array:
    """Counts of 16 bits whose range the torque leaves."""
    counts = np.rint(torque / np.abs(torque).max() * 1.3 * 2**15)
    return np.asarray((counts + 2**15) % 2**16 - 2**15)


NOISE = np.random.default_rng(1).normal(size=10000)
KINDS: dict[str, tuple[Callable[[Array], Array], str]] = {
    "stamps at half the rate": (times(2.0), "reaches beyond its reference"),
    "stamps in ms": (times(1000.0), "time-unit"),
    "stamps at twice the rate": (times(0.5), "reference-foreign"),
    "a clock that gains a tenth": (times(1 / 1.1), "reference-foreign"),
    "a clock that gains a hundredth": (times(1 / 1.01), "clock-early"),
    "N.mm": (lambda rows: rows * np.array([1.0, 1e3, 1e3]), "torque-unit"),
    "kN.m": (lambda rows: rows * np.array([1.0, 1e-3, 1e-3]), "torque-unit"),
    "one joint in N.mm": (of_joint(2, lambda tau: 1e3 * tau), "torque-unit"),
    "one joint in kN.m": (of_joint(2, lambda tau: 1e-3 * tau), "torque-unit"),
    "a dead channel": (of_joint(1, np.zeros_like), "log-constant"),
    "another dead channel": (of_joint(2, np.zeros_like), "log-constant"),
    "a channel that stands": (of_joint(2, lambda tau: np.full_like(tau, 0.37)), "log-constant"),
    "all channels dead": (lambda rows: rows * np.array([1.0, 0.0, 0.0]), "log-constant"),
    "a channel of noise": (of_joint(2, lambda tau: tau.std() * NOISE[: tau.size]), "reference-foreign"),
    "a dead channel with noise": (of_joint(2, lambda tau: 1e-3 * tau.std() * NOISE[: tau.size]), "reference-foreign"),
    "wrapped integers": (of_joint(1, wrapped), "log-wrapped"),
    "one column twice": (lambda rows: rows[:, [0, 1, 1]], "log-copied"),
}


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("robot", CASES)
@pytest.mark.parametrize("kind", KINDS)
def test_it_is_told_by_name(kind: str, robot: str, tmp_path: Path) -> None:
    """Among the first two that are told; what is a problem ends ``identify`` before it simulates a fit."""
    change, code = KINDS[kind]
    content = wrong(CASES[robot], change, tmp_path)
    try:
        found = check(load_case(content))
    except FmuDidimError as error:
        assert code in str(error)
        return
    assert code in [d.code.name for d in found.diagnostics if d.code.name != "parameters-confounded"][:2]
    if any(d.code.name == code for d in found.diagnostics) and not found.ok and code != "torque-unit":
        with pytest.raises(DiagnosedError) as caught:
            identify(load_case(content))
        assert code in str(caught.value)


def wrong(path: Path, change: Callable[[Array], Array], folder: Path) -> dict[str, Any]:
    """A case with its logs changed, both of them."""
    content = dict(yaml.safe_load(path.read_text(encoding="utf-8")))
    content["robot"] = str((path.parent / content["robot"]).resolve())
    content["controller"] = {"kind": "model", "source": str((path.parent / content["controller"]["source"]).resolve())}
    content["plant"] = {"kind": "model"}
    for label in ("train", "validation"):
        rows = np.loadtxt(path.parent / content[label]["torque"]["file"], delimiter=",", skiprows=1)
        np.savetxt(folder / f"{label}.csv", change(rows), "%.9g", ",", header="t,tau1,tau2", comments="")
        content[label]["torque"] = {"file": str(folder / f"{label}.csv")}
    return content
