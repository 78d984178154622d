"""Checks of the data beside the estimation: the same answers and the same refusals as if they had been made before."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from fmu_didim.case import load_case
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.workflow import data
from tests.helpers import ROOT
from tests.workflow.test_outliers import spiked_case

BEGIN = """
import json, sys, time
from pathlib import Path
import fmu_didim.workflow.data as data
import fmu_didim.workflow.identify as verb
from fmu_didim import identify
from fmu_didim.base.diagnostics import DiagnosedError, Diagnostic
from fmu_didim.base.errors import IdentificationError, InputError, SimulationError
from fmu_didim.case import load_case
from fmu_didim.checks.data.log import LOG_CONSTANT, FEW_OUTLIERS
from fmu_didim.model.workers import can_copy_process

assert can_copy_process()
told, ended = [], []
PROBLEM, DOUBT = Diagnostic(LOG_CONSTANT, "It is constant."), Diagnostic(FEW_OUTLIERS, "One is.", "estimation: joint 1")
case = load_case(sys.argv[1])
out = Path(sys.argv[2])

def run(found, workers, *, estimated=None):
    told.clear()
    ended.clear()
    data._workers = lambda case: workers
    def checks(case, model=None, *, causes=True):
        time.sleep(0.05)
        if isinstance(found, Exception):
            raise found
        return list(found)
    data.case_diagnostics = checks
    verb.estimated = estimated or real
    def progress(iteration):
        told.append((iteration.stage, iteration.number, iteration.relative_error_percent))
    try:
        return identify(case, out=out, progress=progress)
    except Exception as error:
        return error

def real(*arguments, **options):
    try:
        return estimated(*arguments, **options)
    finally:
        ended.append(True)

estimated = verb.estimated
"""
"""One process, in which no other thread keeps it from being copied."""

RIGHT = """
first = run([DOUBT], 1)
before = list(told)
second = run([DOUBT], 2)
assert told == before and len(told) > 3, (told, before)
assert first.document.parameters == second.document.parameters
assert first.document.reasons == second.document.reasons and first.document.remarks == second.document.remarks
"""
WRONG = """
for workers in (1, 2):
    error = run([DOUBT, PROBLEM], workers)
    assert isinstance(error, DiagnosedError) and error.found == [PROBLEM], error
    assert not told, told
    assert json.loads((out / "result.json").read_text())["verdict"] == "refused"
"""
ENDED = """
def forever(case, model, names, progress, *, essential):
    from fmu_didim.fit.iteration import Iteration
    import numpy as np
    for number in range(1, 10_000):
        progress(Iteration("didim", number, np.zeros(1), 1.0))
        time.sleep(0.01)
    raise AssertionError("it was not ended")

error = run([PROBLEM], 2, estimated=forever)
assert isinstance(error, DiagnosedError) and not told, error
"""
BOTH = """
def failing(error):
    def estimated(*arguments, **options):
        raise error
    return estimated

for caught in (IdentificationError("unknown", next_step="Go on."), SimulationError("broken", next_step="Go on."),
               InputError("missing", next_step="Go on."), ValueError("a fault")):
    for workers in (1, 2):
        error = run([PROBLEM], workers, estimated=failing(caught))
        assert isinstance(error, DiagnosedError) and error.found == [PROBLEM], (caught, error)
        error = run([DOUBT], workers, estimated=failing(caught))
        assert caught in (error, error.__cause__), (caught, error)
        if isinstance(caught, (IdentificationError, SimulationError)):
            assert "One is." in (out / "result.json").read_text(), caught
fault = ValueError("of the checks")
for workers in (1, 2):
    error = run(fault, workers)
    assert isinstance(error, ValueError) and str(error) == "of the checks" and not told, error
"""


@pytest.mark.skipif(sys.platform != "linux", reason="no copies of the process")
@pytest.mark.parametrize("code", [RIGHT, WRONG, ENDED, BOTH], ids=["right", "wrong", "ended", "both"])
def test_it_is_as_if_the_data_had_been_checked_before(code: str, tmp_path: Path) -> None:
    case = ROOT / "examples/scara/identify.yaml"
    call = [sys.executable, "-c", BEGIN + code, str(case), str(tmp_path / "out")]
    done = subprocess.run(call, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]


def test_what_the_estimation_needs_to_know_is_found_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Which outliers are left out; and a search makes processes of its own."""
    monkeypatch.setattr(LoopModel, "allowed_workers", lambda model, values: 2)
    case = load_case(ROOT / "examples/scara/identify.yaml")
    assert data._workers(case) == 2
    assert data._workers(spiked_case(tmp_path, "keep")) == 2
    assert data._workers(spiked_case(tmp_path, "leave_out")) == 1
    assert data._workers(case.with_(search={"starts": 2})) == 1
