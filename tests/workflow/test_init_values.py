"""Positions whose names do not say whether they were measured: their values say it, or nothing is said."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from fmu_didim.cli.main import main
from fmu_didim.data.signals import Array
from fmu_didim.workflow.init.values import measured_by_values
from fmu_didim.workflow.init.write import start_case

TIME = np.arange(0.0, 10.0, 0.005)
MOTION = 0.8 * np.sin(2 * np.pi * 0.4 * TIME) + 0.2 * np.cos(2 * np.pi * 1.1 * TIME)
ENCODER = 2 * np.pi / 2**16
Make = Callable[[np.random.Generator], Array]


def on(grid: float, values: Array) -> Array:
    return np.asarray(grid * np.rint(values / grid))


def waypoints() -> Array:
    """Lines between places at uneven instants."""
    at = np.array([0, 1.3, 2.1, 4.4, 5.2, 8.8, 10])
    return np.interp(TIME, at, [0, 0.5, 0.1, 0.9, -0.3, 0.4, 0])


MEASURED: dict[str, Make] = {
    "noisy": lambda rng: MOTION + 2e-5 * rng.normal(size=TIME.size),
    "noisy, six digits": lambda rng: np.round(MOTION + 2e-5 * rng.normal(size=TIME.size), 6),
    "encoder": lambda rng: on(ENCODER, MOTION),
    "encoder, twelve digits": lambda rng: np.round(on(ENCODER, MOTION), 12),
}
PLANNED: dict[str, Make] = {
    "exact": lambda rng: MOTION,
    "single precision": lambda rng: MOTION.astype(np.float32).astype(float),
    "four digits": lambda rng: np.round(MOTION, 4),
    "held": lambda rng: np.repeat(MOTION[::10], 10),
    "lines between rows": lambda rng: np.interp(TIME, TIME[::10], MOTION[::10]),
    "waypoints": lambda rng: waypoints(),
    "steps": lambda rng: np.sign(waypoints()),
    "at rest": lambda rng: np.zeros(TIME.size),
    "20 Hz": lambda rng: MOTION[::10],
    "8 Hz, noisy": lambda rng: MOTION[::25] + 2e-5 * rng.normal(size=TIME.size // 25),
}


@pytest.mark.parametrize("name", MEASURED)
def test_noise_says_that_positions_were_measured(name: str) -> None:
    assert all(measured_by_values(MEASURED[name](np.random.default_rng(seed))) for seed in range(10))


@pytest.mark.parametrize("name", PLANNED)
def test_what_may_be_planned_is_not_called_measured(name: str) -> None:
    assert not any(measured_by_values(PLANNED[name](np.random.default_rng(seed))) for seed in range(10))


def log(path: Path, names: str, noise: float) -> Path:
    rng = np.random.default_rng(4)
    q = MOTION + noise * rng.normal(size=TIME.size)
    columns = [q, 0.5 * MOTION + noise * rng.normal(size=TIME.size), 3 * MOTION, MOTION]
    rows = "\n".join(",".join(f"{value:.9g}" for value in row) for row in zip(TIME, *columns, strict=True))
    path.write_text(f"t,{names}\n{rows}\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("names", "noise", "follows"),
    [("q1,q2,tau1,tau2", 2e-5, True), ("q1,q2,tau1,tau2", 0.0, False), ("q_set1,q_set2,tau1,tau2", 2e-5, False)],
)
def test_a_log_of_measured_positions_is_followed(
    names: str, noise: float, follows: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Measured positions are no set points, whatever their names leave open; what a name says stands."""
    assert main(["init", str(log(tmp_path / "log.csv", names, noise)), "--out", str(tmp_path / "case")]) == 0
    told, text = capsys.readouterr().out, (tmp_path / "case/case.yaml").read_text(encoding="utf-8")
    case = yaml.safe_load(text)
    assert (case["controller"].get("kind") == "tracking") == follows
    if follows:
        assert case["train"]["positions"]["columns"] == {"q1": "q1", "q2": "q2"} and "reference" not in case["train"]
        assert "its noise of 2" in told and "set points would go to reference:" in text
    else:
        assert case["train"]["reference"]["columns"]["q1"] == names.split(",")[0]
        assert (tmp_path / "case/controller.yaml").exists()


def test_beside_a_known_controller_the_set_points_are_asked_for(tmp_path: Path) -> None:
    start_case([log(tmp_path / "log.csv", "q1,q2,tau1,tau2", 2e-5)], tmp_path / "case", law="pd")
    case = yaml.safe_load((tmp_path / "case/case.yaml").read_text(encoding="utf-8"))
    assert case["controller"]["kind"] == "model" and case["train"]["reference"]["columns"]["q1"] == "EDIT"
