"""The page of a result, made by a copy of the process: the same page, the same errors, and nothing is left behind."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from fmu_didim import Result, identify
from fmu_didim.checks.validation import validated
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.report import write_report
from tests.workflow.three_experiments import three_experiments

IN_ONE_OF_ITS_OWN = """
import multiprocessing, os, sys, time
from pathlib import Path
import fmu_didim.report as report
import fmu_didim.workflow.identify as verb
from fmu_didim import load_result
from fmu_didim.base.errors import InputError
from fmu_didim.model.workers import VARIABLE, can_copy_process

linux, here = sys.platform == "linux", os.getpid()
assert can_copy_process() == linux
saved, folder = Path(sys.argv[1]), Path(sys.argv[2])
result, real = load_result(saved), report.result_page

def told_of(page):
    report.result_page = page
    try:
        return result.save(folder)
    except InputError as error:
        return error.what
    finally:
        report.result_page = real
        assert not multiprocessing.active_children()

def files():
    return {path.name: path.read_bytes() for path in folder.iterdir()}

def by_process(document, validations):
    return "here" if os.getpid() == here else "copy"

def killed(document, validations):
    if os.getpid() != here:
        os.kill(os.getpid(), 9)
    return "killed"

def refused(document, validations):
    raise InputError("No page.", next_step="Change it.")

def full(document, validations):
    raise OSError(28, "No space left on device")

def endless(document, validations):
    time.sleep(60)

assert told_of(real) == folder / "result.json"
page = (folder / "report.html").read_bytes()
assert page == (saved / "report.html").read_bytes() and set(files()) == {path.name for path in saved.iterdir()}
before = files()
for workers, maker in (("1", "here"), ("2", "copy" if linux else "here")):
    os.environ[VARIABLE] = workers
    for broken, what in ((refused, "No page."), (full, "The results cannot be written.")):
        assert told_of(broken) == what
        assert files() == before, workers  # of the earlier run, and nothing else
    told_of(by_process)
    assert (folder / "report.html").read_text(encoding="utf-8") == maker
    told_of(killed)
    assert (folder / "report.html").read_text(encoding="utf-8") == "killed"
    told_of(real)
    assert files() == before

report.result_page, begin = endless, time.perf_counter()
if linux:  # a user ends it while the table is shown
    try:
        with result.page_beside():
            raise KeyboardInterrupt
    except KeyboardInterrupt:
        pass
    assert time.perf_counter() - begin < 30 and not multiprocessing.active_children()
print("as it should be")
"""


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    folder = tmp_path_factory.mktemp("three")
    return identify(three_experiments(), folder), folder


def test_a_copy_makes_the_page(outcome: tuple[Result, Path], tmp_path: Path) -> None:
    call = [sys.executable, "-W", "error", "-c", IN_ONE_OF_ITS_OWN, str(outcome[1]), str(tmp_path)]
    done = subprocess.run(call, capture_output=True, text=True)
    assert (done.stdout, done.returncode) == ("as it should be\n", 0), done.stderr


def test_the_page_is_that_of_what_was_saved(outcome: tuple[Result, Path], tmp_path: Path) -> None:
    result, folder = outcome
    result.save(tmp_path)
    page = (folder / "report.html").read_bytes()
    assert (tmp_path / "report.html").read_bytes() == page
    assert write_report(tmp_path).read_bytes() == page  # from its files alone


def test_experiments_that_are_simulated_side_by_side_are_the_same(
    outcome: tuple[Result, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    estimate, found = outcome[0].estimate, []
    for workers in (1, 2):
        monkeypatch.setattr(LoopModel, "workers_from_start", workers)
        found.append(Result(outcome[0].document, tuple(validated(estimate))))
    assert found[0] == found[1] == outcome[0]
