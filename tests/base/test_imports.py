"""Python that a case names: refused where it is not to be run, and told where it fails."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import Any

import pytest

from fmu_didim import discover, load_case
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.base.imports import NO_CODE, import_object
from fmu_didim.cli.main import main
from fmu_didim.dynamics.effects import EFFECTS, find_effect
from fmu_didim.dynamics.robot import RobotDescription, read_robot, write_robot
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
    assert "unexpected error" not in capsys.readouterr().err


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
        assert "names Python code, which must not be run" in capsys.readouterr().err
    assert NO_CODE not in os.environ
    monkeypatch.setenv(NO_CODE, "1")
    with pytest.raises(InputError, match="must not be run"):
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
    assert "must not be run" in capsys.readouterr().err
    case = "examples/scara/identify.yaml"
    assert main(["discover", case, "--effect", "os:path", "--no-code", "--out", str(tmp_path / "out")]) == 1
    assert "must not be run" in capsys.readouterr().err


@pytest.mark.gate
def test_a_case_without_code_runs_all_the_same(tmp_path: Path) -> None:
    assert main(["identify", "examples/scara/identify.yaml", "--out", str(tmp_path), "--quiet", "--no-code"]) == 0


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a module, on no import path; beside it ``there``, which has none."""
    here = tmp_path / "here ü"
    here.mkdir()
    (tmp_path / "there").mkdir()
    (here / "mine_here.py").write_text("law = 'of the working folder'\n", encoding="utf-8")
    monkeypatch.chdir(here)
    monkeypatch.setattr(sys, "path", [folder for folder in sys.path if folder])
    return here


def test_a_file_is_that_beside_what_names_it(here: Path) -> None:
    there = here.parent / "there"
    with pytest.raises(InputError, match=r"does not exist[\s\S]*there.mine_here\.py"):
        import_object("mine_here.py:law", folder=there)
    assert import_object("../here ü/mine_here.py:law", folder=there) == "of the working folder"
    assert import_object("mine_here.py:law", folder=here) == "of the working folder"
    assert import_object("mine_here.py:law") == "of the working folder"
    with pytest.raises(UnknownNameError, match="Did you mean 'law'"):
        import_object("mine_here.py:laws", folder=here)


def test_a_module_is_beside_what_names_it_or_installed_or_in_the_working_folder(here: Path) -> None:
    there = here.parent / "there"
    assert import_object("mine_here:law", folder=there) == "of the working folder"
    (there / "mine_here.py").write_text("law = 'of there'\n", encoding="utf-8")
    assert import_object("mine_here:law", folder=there) == "of there"
    (here / "colorsys.py").write_text("rgb_to_hsv = 'planted'\n", encoding="utf-8")
    assert import_object("colorsys:rgb_to_hsv", folder=there) != "planted"
    with pytest.raises(InputError, match=r"cannot be found[\s\S]*file absent_module\.py in .*there"):
        import_object("absent_module:law", folder=there)


def test_two_files_of_one_name_are_two_modules(here: Path) -> None:
    there = here.parent / "there"
    text = "from dataclasses import dataclass\n@dataclass\nclass Law:\n    gain: float = {}\n"
    for folder, gain in ((here, 1.0), (there, 2.0)):
        (folder / "law_of.py").write_text("from __future__ import annotations\n" + text.format(gain), encoding="utf-8")
    first, second = (import_object("law_of:Law", folder=folder) for folder in (here, there))
    assert (first().gain, second().gain) == (1.0, 2.0)


@pytest.mark.parametrize("named", ["", "law", "mine_here.py", "mine_here:", ":law", "mine_here:law()", "a b:law"])
def test_what_is_no_reference_is_refused(here: Path, named: str) -> None:
    with pytest.raises(InputError, match=r"does not name a Python object[\s\S]*path/to/file\.py:name"):
        import_object(named)


EFFECT = """
from fmu_didim.dynamics.effects import Parameter, TorqueEffect


class Root(TorqueEffect):
    name = "root"
    title = "Root"
    equation = "Fr*dq"
    signature = experiment = source = "test"
    own_parameters = (Parameter("Fr", ("N.m", "N"), "friction"),)

    def columns(self, at, shapes):
        return (at.dq,)
"""


def test_an_effect_is_found_beside_the_robot_that_names_it(here: Path) -> None:
    """And again where the description is written to another folder and read from a third one."""
    there = here.parent / "there"
    (there / "own.py").write_text(EFFECT, encoding="utf-8")
    joint = "{type: revolute, effects: [viscous, '%s'], parameters: {ZZ: 1, Fr: 2}}"
    for named in ("own:Root", "own.py:Root", "../there/own.py:Root"):
        (there / "robot.yaml").write_text(f"name: x\njoints: [{joint % named}]\n", encoding="utf-8")
        robot = read_robot("../there/robot.yaml")
        write_robot(robot, here.parent / "copy.yaml")
        again = read_robot(here.parent / "copy.yaml")
        assert again == robot and again.joints[0].all_effects()[1].title == "Root"
    with pytest.raises(InputError, match=r"does not exist[\s\S]*here ü.own\.py"):
        find_effect("own.py:Root")


def test_effects_in_memory_are_of_the_working_folder(here: Path) -> None:
    (here / "own.py").write_text(EFFECT, encoding="utf-8")
    content = {"name": "x", "joints": [{"type": "revolute", "effects": ["own:Root"], "parameters": {"Fr": 2}}]}
    robot = RobotDescription.model_validate(content)
    assert find_effect("own.py:Root") is find_effect("own:Root") is robot.joints[0].all_effects()[0]


def test_code_that_a_case_names_is_among_its_files(tmp_path: Path) -> None:
    """By whichever of the two forms; another text is another digest."""
    from fmu_didim.workflow.case_files import case_files

    for form in ("mine.py", "mine"):
        case = load_case(case_with(tmp_path, GAINS, source=f"{form}:law"))
        digest = case_files(case)[f"{form}:law"]
        other = load_case(case_with(tmp_path, GAINS + "# another\n", source=f"{form}:law"))
        assert case_files(other)[f"{form}:law"] != digest


@pytest.mark.parametrize("place", ["working folder", "case"])
@pytest.mark.parametrize("named", ["own:Root", "own.py:Root"])
def test_discover_takes_a_module_or_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str, named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of the working folder or beside the case; the same effect may be forbidden by its other name."""
    taken: dict[str, Any] = {}

    def search(model: object, request: Any) -> None:
        taken.update(effects=request.effects, options=request.options)
        raise InputError("seen", next_step="Change it.")

    here, there = tmp_path / "here ü", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    case = scara_case(there)
    monkeypatch.chdir(here)
    (here if place == "working folder" else case.parent).joinpath("own.py").write_text(EFFECT, encoding="utf-8")
    monkeypatch.setattr(sys.modules[discover.__module__], "discover_in", search)
    other = {"own:Root": "own.py:Root", "own.py:Root": "own:Root"}[named]
    arguments = ["discover", str(case), "--out", "out", "--effect", named, "--forbid", other]
    assert main([*arguments, "--quiet"]) == 1
    assert "seen" in capsys.readouterr().err
    (key,) = set(taken["effects"]) - set(EFFECTS)
    assert taken["effects"][key].title == "Root"
    assert taken["options"].forbid == {key}
    assert main([*arguments, "--no-code"]) == 1
    assert "must not be run" in capsys.readouterr().err
