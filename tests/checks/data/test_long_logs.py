"""A log of a million rows that says nothing is refused after one simulation, whatever its length."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim import identify
from fmu_didim.base.errors import InputError
from fmu_didim.case import load_case
from fmu_didim.model import loop_model
from tests.conftest import ROOT, package
from tests.patience import Calls

RATE = 200
"""Hz of control and log."""


def constant_case(folder: Path, rows: int) -> Path:
    """A SCARA that moves, and a log of it that is 0.3 N.m throughout, in files."""
    table, csv = package("pyarrow").table, package("pyarrow.csv")
    t = np.arange(rows) / RATE
    motion = {
        "t": t,
        "q1": np.sin(t) / 2,
        "dq1": np.cos(t) / 2,
        "q2": 0.4 * np.sin(1.3 * t),
        "dq2": 0.52 * np.cos(1.3 * t),
    }
    log = {"t": t, "tau1": np.full(rows, 0.3), "tau2": np.full(rows, 0.3)}
    for name, columns in (("reference", motion), ("log", log)):
        csv.write_csv(table(columns), str(folder / f"{name}.csv"))
    case: dict[str, Any] = {
        "schema": 1, "name": "long", "robot": str(ROOT / "fmus/scara/robot.yaml"), "plant": {"kind": "model"},
        "controller": {"kind": "model", "source": str(ROOT / "controllers/scara_pd.yaml")}, "loop": {"rate_hz": RATE},
        "train": {"reference": {"file": "reference.csv"}, "torque": {"file": "log.csv"}},
    }  # fmt: skip
    (folder / "case.yaml").write_text(yaml.safe_dump(case), encoding="utf-8")
    return folder / "case.yaml"


def refused(case: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, int, int]:
    """What identify says, and how often the loop was simulated and functions were called for it, the files read."""
    run, count = loop_model.simulate, 0

    def counted(*args: object, **options: object) -> object:
        nonlocal count
        count += 1
        return run(*args, **options)

    with monkeypatch.context() as patch:
        patch.setattr(loop_model, "simulate", counted)
        loaded = load_case(case)
        assert loaded.model.start.size  # its files are read
        with pytest.raises(InputError) as caught, Calls() as calls:
            identify(loaded)
    return str(caught.value), count, calls.count


@pytest.mark.gate
@pytest.mark.parametrize("many", [200_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_a_long_constant_log_is_refused_after_one_simulation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, many: int
) -> None:
    """Whole columns are worked on, in blocks: fewer functions are called than there are rows."""
    found = {}
    for rows in (10_000, many):
        (tmp_path / str(rows)).mkdir()
        found[rows] = refused(constant_case(tmp_path / str(rows), rows), monkeypatch)
    (short, *_), (told, simulations, calls) = found.values()
    assert simulations == 1
    assert "The log is 0.3 throughout, where the motion needs a torque that varies by" in told
    for part in ("log-constant", "joint 1", "joint 2", "next:  Check the columns of the log"):
        assert part in told and part in short
    assert calls < many
