"""Bounds, tested versions, workflows and the page of platforms say the same, and what they run is there."""

from __future__ import annotations

import importlib.util
import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml
from packaging.specifiers import SpecifierSet
from packaging.version import Version

from tests.conftest import ROOT
from tests.tools.versions import __main__ as of_versions
from tests.tools.versions import sizes, suite, wheels
from tests.tools.versions.__main__ import COMMAND, PYTHON, asking_for_more, main, write_constraints
from tests.tools.versions.environments import (
    MissingToolError,
    constraints,
    installed,
    lowest,
    normal,
    requirements,
    uv,
)

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
README = (ROOT / "README.md").read_text(encoding="utf-8")
GATE = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
REMOVES_TREE = ["git", "rm", "-r", "-q", "fmu_didim"]
"""So that the installed wheel is what runs."""
ALL_EXTRAS = ("hdf5", "mf4", "ros", "mjcf", "cluster", "modelica", "sensitivity", "docs", "test")


# ---- bounds and tested versions --------------------------------------------------------------------


def test_lower_bounds_become_exact_versions() -> None:
    pins = lowest({"casadi": ">=3.7,<4", "rumoca": "==0.9.13"})
    assert pins == ["casadi==3.7", "rumoca==0.9.13"]
    with pytest.raises(ValueError, match="no lowest version of numpy"):
        lowest({"numpy": "<3"})


def test_everything_that_is_needed_to_run_has_a_lowest_version() -> None:
    every = requirements("hdf5", "mf4", "ros", "mjcf", "cluster", "modelica", "sensitivity", "docs")
    assert len(lowest(every)) == len(every) > 20


def test_extras_that_name_others_have_what_these_have(tmp_path: Path) -> None:
    file = tmp_path / "pyproject.toml"
    file.write_text(
        '[project]\nname = "my_own"\ndependencies = ["A.b>=1; sys_platform == \'linux\'"]\n'
        '[project.optional-dependencies]\none = ["c[x]>=2"]\ntwo = ["my-own[one]", "d"]\n',
        encoding="utf-8",
    )
    assert requirements("two", file=file) == {"a-b": ">=1", "c": ">=2", "d": ""}


def test_an_extra_and_the_tests_ask_for_the_same_version() -> None:
    tests = requirements("test")
    for extra in ("hdf5", "mf4", "ros", "mjcf", "cluster", "modelica", "sensitivity"):
        assert requirements(extra).items() <= tests.items()


def test_tested_versions_keep_the_bounds() -> None:
    tested = constraints()
    for name, bound in requirements(*ALL_EXTRAS).items():
        if name != "uv":  # makes environments, and runs nothing
            assert Version(tested.get(name, "0")) in SpecifierSet(bound), f"{name}: run {COMMAND}"


def test_constraints_hold_versions_only_and_name_their_command() -> None:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    assert any(COMMAND in line for line in lines if line.startswith("#"))
    rest = [line for line in lines if not line.startswith("#")]
    assert [line for line in rest if not re.fullmatch(r"[a-z0-9-]+==[0-9][\w.+!]*", line)] == []
    names = [line.partition("==")[0] for line in rest]
    assert names == sorted(set(names)) and len(names) > 50


def test_versions_that_ask_for_a_later_patch_of_python_are_not_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The gate could not make its environment with the Python of Debian 12, 3.11.2."""
    asked = {"old": ">=3.9", "free": None, "late": f">={PYTHON}.5", "first": f">={PYTHON}"}
    found: Any = [SimpleNamespace(name=n, version="4.1", metadata={"Requires-Python": p}) for n, p in asked.items()]
    assert asking_for_more(found) == [f"late 4.1 (>={PYTHON}.5)"]
    monkeypatch.setattr(of_versions, "distributions", lambda: found)
    monkeypatch.setattr(of_versions, "write_constraints", lambda: pytest.fail("it was written"))
    with pytest.raises(SystemExit, match="1"):
        main(["constraints"])
    assert f"these need more than Python {PYTHON}.0: late 4.1" in capsys.readouterr().err


def test_constraints_are_those_of_this_environment(tmp_path: Path) -> None:
    assert write_constraints(tmp_path / "c.txt") == 0
    written = constraints(tmp_path / "c.txt")
    assert written["numpy"] == version("numpy") == installed(sys.executable, ["numpy"])["numpy"]
    assert not {"pip", "fmu-didim"} & set(written)


# ---- runs and their table --------------------------------------------------------------------------


def row(**entries: Any) -> suite.Row:
    usual = {
        "platform": "A, x", "compiler": "", "user": "root", "python": "3.11.1", "packages": {"numpy": "2"},
        "date": "2026-01-01", "which": "lowest", "what": "python -m pytest", "passed": 1, "failed": 0, "skipped": 0,
        "exit": 0, "seconds": 1,
    }  # fmt: skip
    return usual | entries


def test_a_later_run_takes_the_place_of_the_same_one(tmp_path: Path) -> None:
    file = tmp_path / "platforms.json"
    for one in (row(failed=2), row(python="3.12.1"), row(failed=0)):
        suite.record(one, file)
    content = json.loads(file.read_text(encoding="utf-8"))
    assert content["data"] == [row(), row(python="3.12.1")]
    assert len(content["figures"]["runs"]) == 4
    assert "A, x, no C compiler" in content["figures"]["runs"][2]


def test_what_came_out_is_counted(tmp_path: Path) -> None:
    test = tmp_path / "test_it.py"
    test.write_text(
        "import pytest\ndef test_a(): pass\ndef test_b(): assert 0\n@pytest.mark.skip\ndef test_c(): pass\n"
        "@pytest.fixture\ndef broken(): raise ValueError\ndef test_d(broken): pass\n",
        encoding="utf-8",
    )
    made = suite.run(sys.executable, [str(test)], which="newest")
    assert (made["passed"], made["failed"], made["skipped"], made["exit"]) == (1, 2, 1, 1)
    assert made["python"] == ".".join(map(str, sys.version_info[:3]))
    assert made["packages"]["numpy"] == version("numpy")


@pytest.mark.gate
def test_runs_without_a_test_have_failed(tmp_path: Path) -> None:
    assert main(["here", str(tmp_path / "test_nowhere.py")]) != 0


def test_without_uv_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.tools.versions.environments.shutil.which", lambda *_, **__: None)
    with pytest.raises(MissingToolError, match="pip install uv"):
        uv("venv")


@pytest.mark.parametrize(
    ("code", "stderr", "found"),
    [(0, "", True), (1, "No solution found: no usable wheels", False), (2, "timeout", None)],
)
def test_an_index_that_does_not_answer_is_no_absence(
    monkeypatch: pytest.MonkeyPatch, code: int, stderr: str, found: bool | None
) -> None:
    done = subprocess.CompletedProcess([], code, "", stderr)
    monkeypatch.setattr(wheels, "uv", lambda *_, **__: done)
    if found is None:
        with pytest.raises(subprocess.CalledProcessError):
            wheels.missing("Linux x64", "3.11", {"numpy": "2"})
    else:
        assert wheels.missing("Linux x64", "3.11", {"numpy": "2"}) == ([] if found else ["numpy"])


def test_the_page_shows_what_was_recorded() -> None:
    page = (ROOT / "docs" / "platforms.md").read_text(encoding="utf-8")
    for name in ("platforms", "wheels"):
        content = json.loads((ROOT / "docs" / "figures" / f"{name}.json").read_text(encoding="utf-8"))
        for lines in content["figures"].values():
            assert "\n".join(lines) in page, f"{name}.json has changed: put it into docs/platforms.md"
    assert "Windows arm64" in page and wheels.SYSTEMS.keys() <= {w.split(" |")[0][2:] for w in page.splitlines()}


# ---- workflows -------------------------------------------------------------------------------------


def steps(path: Path) -> Iterator[dict[str, Any]]:
    for job in yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"].values():
        yield from job["steps"]


def commands() -> list[list[str]]:
    return [shlex.split(line) for path in WORKFLOWS for s in steps(path) for line in s.get("run", "").splitlines()]


def is_known(command: list[str]) -> bool:
    """Whether a command line is one that there is: its module or script, its extra, its files."""
    program, *rest = command
    if program != "python":
        return program in ("ruff", "mypy", "lint-imports", "twine") or command == REMOVES_TREE
    assert rest[0] == "-m"
    module, rest = rest[1], rest[2:]
    if module == "pip":
        assert rest[0] == "install"
        extras = [name for word in rest for name in re.findall(r"\[(.*?)\]", word)]
        files = [word for flag, word in pairwise(rest) if flag == "-c"]
        return all(requirements(*extra.split(",")) for extra in extras) and all((ROOT / f).is_file() for f in files)
    if module == "tests.tools.versions":
        return rest[0] in ("lowest", "newest", "here")
    return module == "build" or importlib.util.find_spec(module) is not None


def test_workflows_are_read_and_name_actions_by_their_major_version() -> None:
    assert {path.stem for path in WORKFLOWS} == {"tests", "package", "docs"}
    for path in WORKFLOWS:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        assert content["permissions"] == {"contents": "read"}
        assert {"push", "pull_request"} == set(content[True])  # YAML 1.1 reads  on  as true
        for job in content["jobs"].values():
            assert job["timeout-minutes"] <= 120
        for step in steps(path):
            assert re.fullmatch(r"actions/[a-z-]+@v\d+", step.get("uses", "actions/checkout@v4"))


def test_workflows_run_the_tests_on_each_system_with_each_python() -> None:
    matrix = yaml.safe_load((ROOT / ".github/workflows/tests.yml").read_text(encoding="utf-8"))["jobs"]["tests"][
        "strategy"
    ]["matrix"]
    assert matrix["os"] == ["ubuntu-latest", "windows-latest", "macos-latest"]
    assert tuple(matrix["python"]) == PYTHONS == wheels.PYTHONS


def test_commands_of_workflows_are_there() -> None:
    assert len(commands()) > 15
    assert [command for command in commands() if not is_known(command)] == []


def test_workflows_run_what_readme_and_gate_run() -> None:
    said = {" ".join(command) for command in commands()}
    assert "-m pytest" in README and "python -m pytest" in said
    assert '-e ".[test]"' in README and "python -m pip install -e .[test]" in said
    assert "python -m sphinx" in README and "python -m sphinx -W docs docs/_build" in said
    for tool in ("ruff check .", "ruff format --check .", "mypy", "lint-imports"):
        in_gate = tool.replace(" ", r'"?\s+', 1).replace(".", r"\.")  # the gate names the folder of the tool, quoted
        assert re.search(rf"\b{in_gate}", GATE) and tool in said


def test_names_of_packages_compare_in_all_spellings() -> None:
    assert normal("Types_PyYAML") == normal("types.pyyaml") == "types-pyyaml"


@pytest.mark.gate
def test_large_packages_are_listed_with_what_they_are_for(tmp_path: Path) -> None:
    sizes.record(tmp_path / "sizes.json")
    figures = json.loads((tmp_path / "sizes.json").read_text(encoding="utf-8"))["figures"]
    rows = [line.split(" | ")[0].removeprefix("| ") for line in figures["table"]]
    assert {"casadi", "ziglang", "scipy"} <= set(rows)
    assert "pytest" not in sizes.needed()
