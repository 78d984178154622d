"""A log whose stamps jitter, or that was read at a pace of its own: it is said, the case puts it right, and what is
neither is not put right."""

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


def polled(folder: Path, time: Any = None, pace: float = 0.97, scatter: float = 0.3) -> dict[str, Any]:
    """The same machine, of which a program reads the newest sample every so many ticks, somewhat more often than there
    is one."""
    content = case(folder)
    rng, rows = np.random.default_rng(2), np.loadtxt(folder / "log.csv", delimiter=",", skiprows=1)
    count = int((rows.shape[0] - 3) / max(pace, 1.0))
    at = 1 + pace * np.arange(count) + rng.uniform(0, 1, count) * scatter
    read = rows[at.astype(int)]
    read[:, 0] = PERIOD * at
    np.savetxt(folder / "log.csv", read, delimiter=",", header=",".join(("t", *NOISE)), comments="")
    for kind in ("torque", "positions"):
        content["train"][kind] = {"file": str(folder / "log.csv"), **({} if time is None else {"time": time})}
    return content


@pytest.mark.gate
def test_rows_read_at_a_pace_of_their_own_are_put_right(tmp_path: Path) -> None:
    (told,) = (reason for reason in identify(polled(tmp_path)).reasons if reason.code == "stamps-jitter")
    assert "polled: [columns of positions]" in told.next_step
    found = identify(polled(tmp_path, {"name": "t", "rate_hz": 1 / PERIOD, "polled": ["q1", "q2"]}))
    assert any("show a tick again and were left out" in text for text in found.document.remarks)
    for name, true in TRUE.items():
        assert abs(found.parameters[name].value - true) < 4 * found.parameters[name].std
    as_jittered = {"name": "t", "jittered": True}
    with pytest.raises(InputError, match=r"the same as the ones before them in all columns[\s\S]*polled"):
        load_case(polled(tmp_path, as_jittered)).model  # noqa: B018


@pytest.mark.parametrize(
    ("pace", "scatter", "told"),
    [
        pytest.param(0.6, 0.0, True, id="faster, even"),
        pytest.param(0.6, 0.2, True, id="faster"),
        pytest.param(0.97, 0.0, True, id="nearly as fast, even"),
        pytest.param(1.0, 0.0, False, id="each once"),
        pytest.param(0.5, 0.0, False, id="each twice"),
    ],
)
def test_rows_that_were_read_again_are_told(pace: float, scatter: float, told: bool, tmp_path: Path) -> None:
    found = [d for d in load_case(polled(tmp_path, pace=pace, scatter=scatter)).model.experiments["estimation"].told
             if d.code.name == "rows-read-again"]  # fmt: skip
    assert bool(found) is told
    if told:
        assert "are the same as the one before in all columns" in found[0].text
        assert "polled: [q1, q2]" in found[0].code.next_step


@pytest.mark.parametrize(
    ("time", "says"),
    [
        ({"name": "t", "polled": ["q1"]}, "polled goes with rate_hz"),
        ({"name": "t", "rate_hz": 200, "polled": ["q1"], "jittered": True}, "polled goes with rate_hz"),
        ({"name": "t", "rate_hz": 200, "polled": ["angle1"]}, "angle1"),
        ({"name": "t", "rate_hz": 190, "polled": ["q1", "q2"]}, "whole ticks|another one"),
        ({"name": "t", "rate_hz": 200, "polled": ["tau1"]}, "whole ticks"),
    ],
)
def test_what_does_not_tell_ticks_is_refused(time: dict[str, Any], says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=says):
        load_case(polled(tmp_path, time)).model  # noqa: B018
