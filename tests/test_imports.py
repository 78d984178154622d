"""Python that a case names: refused where it is not to be run, and told where it fails."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest

from fmu_didim import load_case
from fmu_didim.cli import main
from fmu_didim.errors import InputError, UnknownNameError
from fmu_didim.imports import NO_CODE, import_object
from tests.cases import scara_case

GAINS = (
    "import control\nlaw = control.ss([], [], [], [[5.0, 0.0], [0.0, 1.0]], inputs=['a', 'b'], outputs=['c', 'd'])\n"
)
MAPPED = {"inputs": {"q_ref1 - q1": "a", "q_ref2 - q2": "b"}, "outputs": {"command1": "c", "command2": "d"}}
BROKEN = {
    "raises when it is imported": ("x = 1\nraise OSError('no licence')\n", r"OSError: no licence, .*mine\.py, line 2"),
    "raises when it is called": ("def law():\n    return 1 / 0\n", r"ZeroDivisionError: .*mine\.py, line 2"),
    "exits when it is imported": ("import sys\nsys.exit(0)\n", r"it exits: 0, .*mine\.py, line 2"),
    "exits when it is called": ("def law():\n    raise SystemExit('bye')\n", r"it exits: bye, .*mine\.py, line 2"),
    "does not parse": ("def law(:\n", r"SyntaxError: .*mine\.py, line 1"),
    "imports what is not there": ("import no_such_module_of_ours\n", r"ModuleNotFoundError: .*no_such_module_of_ours"),
    "is no text": ("\0", r"ValueError|SyntaxError"),
    "has another name": ("other = 1\n", r"no object named 'law'"),
    "is no system": ("law = 5\n", r"not a python-control system"),
    "returns no system": ("def law():\n    return None\n", r"not a python-control system"),
}


def case_with(folder: Path, text: str, **controller: object) -> Path:
    (folder / "mine.py").write_text(text, encoding="utf-8")
    return scara_case(folder, controller={"kind": "control", "source": "mine.py:law"} | MAPPED | controller,
                      loop={"rate_hz": 200})  # fmt: skip


@pytest.mark.parametrize("what", BROKEN)
def test_code_that_fails_is_told_with_its_line(tmp_path: Path, what: str, capsys: pytest.CaptureFixture[str]) -> None:
    text, told = BROKEN[what]
    with pytest.raises(InputError, match=told):
        load_case(case_with(tmp_path, text))
    assert main(["check", str(tmp_path / "case.yaml")]) == 1
    assert "nobody has foreseen" not in capsys.readouterr().err


UPDATES = {
    "raises in a run": ("raise RuntimeError('worn out')", r"worn out, .*mine\.py, line 6"),
    "exits in a run": (
        "raise SystemExit(3)",
        r"it exits: 3, .*mine\.py, line 6",
    ),
    "returns another size": ("return [1.0, 2.0, 3.0]", r"ValueError"),
    "returns no number": ("return ['a', 'b']", r"ValueError"),
}


@pytest.mark.parametrize("what", UPDATES)
def test_code_that_fails_in_a_run_is_named(tmp_path: Path, what: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Its first calls go well."""
    line, told = UPDATES[what]
    text = (
        "import control\ncalls = []\ndef out(t, x, u, params):\n    calls.append(t)\n"
        f"    if t > 0.1:\n        {line}\n    return [5.0 * u[0], u[1]]\n"
        "law = control.nlsys(lambda t, x, u, params: x, out,"
        " inputs=['a', 'b'], outputs=['c', 'd'], states=1, dt=0.005)\n"
    )
    path = case_with(tmp_path, text)
    assert main(["simulate", str(path), "--out", str(tmp_path / "a.csv")]) == 1
    err = capsys.readouterr().err
    assert re.search(rf"fmu-didim: The controller failed at t = 0\.1\d* s: its output function.*{told}", err), err


def test_no_code_runs_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    path = case_with(tmp_path, f"__import__('pathlib').Path({str(tmp_path / 'ran')!r}).touch()\n" + GAINS)
    for verb in (["check"], ["identify", "--out", str(tmp_path / "out")], ["simulate"], ["discover"]):
        assert main([verb[0], str(path), *verb[1:], "--no-code"]) == 1
        assert "names Python code, which is not to be run" in capsys.readouterr().err
    assert NO_CODE not in os.environ
    monkeypatch.setenv(NO_CODE, "1")
    with pytest.raises(InputError, match="not to be run"):
        load_case(path)
    assert not (tmp_path / "ran").exists()
    monkeypatch.delenv(NO_CODE)
    load_case(path)
    assert (tmp_path / "ran").exists()


def test_no_code_refuses_effects_as_well(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot = Path("fmus/emps/robot.yaml").read_text(encoding="utf-8").replace("effects:", "effects: ['os:path'] #", 1)
    assert "os:path" in robot
    (tmp_path / "robot.yaml").write_text(robot, encoding="utf-8")
    assert main(["export", str(tmp_path / "robot.yaml"), "--out", str(tmp_path), "--no-code"]) == 1
    assert "not to be run" in capsys.readouterr().err
    case = "examples/scara/identify.yaml"
    assert main(["discover", case, "--effect", "os:path", "--no-code", "--out", str(tmp_path / "out")]) == 1
    assert "not to be run" in capsys.readouterr().err


def test_a_case_without_code_runs_all_the_same(tmp_path: Path) -> None:
    assert main(["identify", "examples/scara/identify.yaml", "--out", str(tmp_path), "--quiet", "--no-code"]) == 0


def test_files_are_looked_for_beside_the_case_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    (here / "mine.py").write_text("law = 'of the current folder'\n", encoding="utf-8")
    monkeypatch.chdir(here)
    monkeypatch.setattr(sys, "path", [folder for folder in sys.path if folder])
    with pytest.raises(InputError, match="does not exist"):
        import_object("mine.py:law", folder=there)
    with pytest.raises(InputError, match="would be looked for in the current folder"):
        import_object("mine.py:law")
    with pytest.raises(InputError, match="cannot be imported"):
        import_object("mine:law", folder=here)
    assert import_object("mine.py:law", folder=here) == "of the current folder"
    with pytest.raises(UnknownNameError, match="Did you mean 'law'"):
        import_object("mine.py:laws", folder=here)
