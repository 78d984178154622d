"""The processes of FMUs run this package and what it needs, and no Python file that happens to lie where they start."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmu_didim
from fmu_didim.cli.main import main
from fmu_didim.components.fmu import load_fmu
from fmu_didim.components.fmu.isolation.process import Worker, hold, run_held
from tests.awkward.build import awkward_fmu, library
from tests.components.fmu.helpers import ONES, H, slave_outputs
from tests.helpers import drive
from tests.patience import patience

MARKER = "was_run"
SHADOWS = ("struct", "random", "numpy", "pickle", "fmu_didim", "fmpy", "sitecustomize", "usercustomize", "lxml")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with files that have the names of modules and leave a marker when they are run."""
    library("slave")  # compiled before, with the cache of all tests
    monkeypatch.setenv("FMU_DIDIM_CACHE", str(tmp_path / "cache"))
    here = tmp_path / "here"
    here.mkdir()
    for name in SHADOWS:
        (here / f"{name}.py").write_text(f"open({str(here / MARKER)!r}, 'a').write({name!r} + '\\n')\n")
    awkward_fmu(here)
    monkeypatch.chdir(here)
    monkeypatch.setattr(sys, "path", [*sys.path, "", str(here)])  # last, so that this process is as it was
    return here


def fmu_in(folder: Path) -> Path:
    (path,) = folder.glob("*.fmu")
    return path


@pytest.mark.gate
def test_an_isolated_fmu(folder: Path) -> None:
    got = drive(load_fmu(fmu_in(folder), isolated=True, rerun="re-instantiate"), ONES, H)
    np.testing.assert_allclose(got, slave_outputs(ONES))
    assert not (folder / MARKER).exists()


@pytest.mark.gate
def test_the_trial_of_a_foreign_fmu(folder: Path) -> None:
    assert load_fmu(fmu_in(folder)).find_rerun().strategy == "reset"
    assert not (folder / MARKER).exists()


@pytest.mark.gate
def test_the_command_fmu_check(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fmu", "check", str(fmu_in(folder))]) == 0
    assert "run it again by: reset" in capsys.readouterr().out
    assert not (folder / MARKER).exists()


@pytest.mark.gate
@pytest.mark.parametrize("options", [["-P"], pytest.param(["-P", "-s"], marks=pytest.mark.slow)])
def test_the_command_with_the_folder_in_nothing_but_the_current_one(folder: Path, options: list[str]) -> None:
    """The package is found by PYTHONPATH, which the process of the FMU does not read."""
    environment = os.environ | {"PYTHONPATH": str(Path(fmu_didim.__file__).parents[1])}
    command = [sys.executable, *options, "-m", "fmu_didim.cli.main", "fmu", "check", fmu_in(folder).name]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert "run it again by: reset" in done.stdout
    assert not (folder / MARKER).exists()


def in_another_process(expression: str) -> Any:
    with closing(Worker("test", patience(30.0))) as worker:
        worker.request("start", hold, eval, (expression,))
        return worker.request("the run", run_held)


@pytest.mark.gate
@pytest.mark.usefixtures("folder")
def test_the_package_is_the_one_of_the_parent() -> None:
    """Whatever is installed: here PYTHONPATH or an editable install say where it is."""
    what = "(__import__('fmu_didim').__file__, __import__('sys').flags.isolated, __import__('numpy').__file__)"
    package, isolated, numpy_file = in_another_process(what)
    assert Path(package).samefile(fmu_didim.__file__)
    assert isolated == 1
    assert Path(numpy_file).samefile(np.__file__)


@pytest.mark.gate
def test_folders_of_the_parent_come_last(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A module of a folder that PYTHONPATH names is found there, but takes no other one's place."""
    own = tmp_path / "own"
    own.mkdir()
    (own / "struct.py").write_text((folder / "struct.py").read_text())
    (own / "of_the_user.py").write_text("VALUE = 7\n")
    monkeypatch.setattr(sys, "path", [str(own), *sys.path])
    assert in_another_process("__import__('of_the_user').VALUE") == 7
    assert not (folder / MARKER).exists()
