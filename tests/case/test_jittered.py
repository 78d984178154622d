"""A log whose stamps jitter: it is said, the case puts it right, and what is no jitter is not put right."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim import InputError, Trajectory, identify, load_case, simulate
from fmu_didim.data.signals import Array
from tests.conftest import ROOT
from tests.workflow.naming.machine import NOISE

TRUE = {"ZZ1R": 3.43, "Fc1": 0.82, "ZZ2": 0.063, "MX2": 0.241, "Fc2": 0.137}
PERIOD = 0.005
EXAMPLE = ROOT / "examples/scara/identify_200hz.yaml"


@cache
def run() -> Trajectory:
    """The SCARA with the PD controller of its example."""
    parts = {"plant": {"kind": "model"}, "controller": {"kind": "model"}, "validation": None}
    return simulate(load_case(EXAMPLE).with_(**parts))  # type: ignore[typeddict-item]


def case(folder: Path, kept: Array | slice = slice(None), time: Any = None) -> dict[str, Any]:
    """A case of ``idim_ls`` with jittered stamps, rows ``kept``."""
    rng, true = np.random.default_rng(1), run()
    stamps = true.time + rng.uniform(0, 0.8 * PERIOD, true.time.size)
    columns = [stamps, *(true.column(name) + std * rng.normal(size=stamps.size) for name, std in NOISE.items())]
    header = ",".join(("t", *NOISE))
    np.savetxt(folder / "log.csv", np.column_stack(columns)[kept], delimiter=",", header=header, comments="")
    file = {"file": str(folder / "log.csv"), **({} if time is None else {"time": time})}
    return {
        "schema": 1, "name": "jittered", "robot": str(ROOT / "fmus/scara/robot.yaml"),
        "controller": {"kind": "model", "source": str(ROOT / "controllers/scara_pd.yaml")},
        "train": {"reference": load_case(EXAMPLE).content["train"]["reference"], "torque": file, "positions": file},
        "estimator": {"kind": "idim_ls", "cutoff_hz": 20},
    }  # fmt: skip


@pytest.mark.gate
def test_idim_ls_names_the_jitter_and_the_next_step(tmp_path: Path) -> None:
    found = identify(case(tmp_path))
    assert found.verdict != "valid"
    (told,) = (reason for reason in found.reasons if reason.code == "stamps-jitter")
    assert "even clock of 200" in told.text and "no row is missing" in told.text
    assert "jittered: true" in told.next_step
    assert found.parameters["ZZ2"].value < 0.95 * TRUE["ZZ2"]  # what it does to the answer


@pytest.mark.gate
def test_the_case_puts_it_right(tmp_path: Path) -> None:
    found = identify(case(tmp_path, time={"name": "t", "jittered": True}))
    assert found.verdict == "valid"
    assert any("even clock of 200" in text for text in found.document.remarks)
    for name, true in TRUE.items():
        assert abs(found.parameters[name].value - true) < 4 * found.parameters[name].std


@pytest.mark.parametrize("lacking", [[700], list(range(700, 760))], ids=["a row", "a gap"])
def test_rows_that_lack_are_not_put_right(lacking: list[int], tmp_path: Path) -> None:
    kept = np.delete(np.arange(run().time.size), lacking)
    with pytest.raises(InputError, match="lacking near row"):
        load_case(case(tmp_path, kept, {"name": "t", "jittered": True})).model  # noqa: B018


@pytest.mark.gate
def test_rows_that_lack_are_said_where_the_stamps_jitter(tmp_path: Path) -> None:
    found = identify(case(tmp_path, np.delete(np.arange(run().time.size), [700])))
    (told,) = (reason for reason in found.reasons if reason.code == "stamps-jitter")
    assert "not those of an even clock with all its rows" in told.text and "lacking near row" in told.text
    assert "jittered: true" not in told.next_step
