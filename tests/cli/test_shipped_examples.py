"""``fmu-didim example``: what is listed is there, and what is written runs by the commands that are printed."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest
import yaml

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.base.terminal import quoted
from fmu_didim.campaigns.campaign import campaign
from fmu_didim.cli import examples as shipped
from fmu_didim.cli.examples import Written, example_names, examples, write_example
from fmu_didim.cli.main import main
from fmu_didim.workflow.validate import mistakes
from tests.conftest import ROOT

EXAMPLES = examples()
NOT_WRITTEN = {"index.toml", "first_hour.ipynb"}
"""Files of examples/ that no example holds: a notebook needs more than the package."""
OF_THE_PROJECT = {"benchmark", "__pycache__"}
"""Folders that no example holds: the benchmark needs the simulator of the tests."""


def written_files(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Written]:
    """All examples, written."""
    folder = tmp_path_factory.mktemp("with space, ü")
    return {name: write_example(name, folder / name) for name in EXAMPLES}


def test_every_file_of_the_examples_is_in_one(folders: dict[str, Written]) -> None:
    files = [path for path in (ROOT / "examples").rglob("*") if path.is_file()]
    own = {path.name for path in files if not OF_THE_PROJECT & set(path.parts)}
    named = {path.name for written in folders.values() for path in written.files}
    assert own - named == NOT_WRITTEN


@pytest.mark.gate
@pytest.mark.parametrize("name", EXAMPLES)
def test_what_is_written_needs_nothing_else(name: str, folders: dict[str, Written]) -> None:
    """Commands name files of the folder; cases have no mistake, campaigns load their cases, no path leads out."""
    written = folders[name]
    assert written_files(written.folder) == {str(path) for path in written.files}
    for path in written.folder.rglob("*"):
        if path.suffix in (".yaml", ".py", ".mo"):
            text = path.read_text(encoding="utf-8")
            assert not re.findall(r"\b(?:examples|fmus)/\S*|\.\./\.\./\S*", text), path
    for run in written.example.runs:
        command = shlex.split(run.command)
        file = written.folder / command[-1]
        assert file.is_file()
        if command[1] == "campaign":
            content = yaml.safe_load(file.read_text(encoding="utf-8"))
            assert (file.parent / content["case"]).is_file()
            if not written.example.needs:
                assert campaign(file, written.folder / "results").plan.runs
        elif command[0] == "fmu-didim":
            assert [m for m in mistakes(file) if "nonlinearbenchmark.org" not in m.text] == []


@pytest.mark.parametrize("name", EXAMPLES)
def test_what_needs_something_says_so(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In the listing and on writing: data that are not shipped, a compiler of Modelica."""
    assert main(["example"]) == 0
    listed = capsys.readouterr().out
    assert main(["example", name, str(tmp_path / name)]) == 0
    told = " ".join(capsys.readouterr().out.split())
    names_data = any("data:" in path.read_text(encoding="utf-8") for path in (tmp_path / name).glob("*.yaml"))
    names_modelica = any(".mo," in path.read_text(encoding="utf-8") for path in (tmp_path / name).glob("*.yaml"))
    assert bool(EXAMPLES[name].needs) == names_data
    assert any(run.needs for run in EXAMPLES[name].runs) == names_modelica
    assert EXAMPLES[name].needs in " ".join(listed.split())
    for needed in (EXAMPLES[name].needs, *(run.needs for run in EXAMPLES[name].runs)):
        assert needed in told


def test_the_listing_has_a_sentence_each(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["example"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert [name for name, e in EXAMPLES.items() if f"{name} {e.sentence}." not in printed] == []
    assert len(EXAMPLES) >= 4


def test_the_commands_that_are_printed_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As they stand there, from the folder that they name; the first one here, all verbs in the gate."""
    folder = tmp_path / "with space, ü"
    assert main(["example", "scara", str(folder)]) == 0
    lines = capsys.readouterr().out.partition("Next:\n")[2].splitlines()
    change, first = (shlex.split(line) for line in lines[:2])
    assert change == ["cd", str(folder)]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(change[1])
        assert main(first[1:]) == 0
    (report,) = folder.glob("results/*/report.html")
    robot = report.with_name("robot_identified.yaml").relative_to(folder)
    assert f"fmu-didim export {quoted(robot)}" in capsys.readouterr().out


def test_in_the_folder_itself_nothing_is_said_of_changing_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["example", "arm2r", "."]) == 0
    assert "cd " not in capsys.readouterr().out
    assert (tmp_path / "discover.yaml").is_file()


def test_a_folder_that_holds_something_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "identify.yaml").write_text("mine", encoding="utf-8")
    assert main(["example", "scara", str(tmp_path)]) == 1
    told = capsys.readouterr().err
    assert "not empty" in told and str(tmp_path) in told and "fmu-didim example scara FOLDER" in told
    assert written_files(tmp_path) == {"identify.yaml"}
    assert (tmp_path / "identify.yaml").read_text(encoding="utf-8") == "mine"


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(InputError, match="cannot be written") as caught:
            write_example("scara", folder)
        assert str(folder) in str(caught.value) and "fmu-didim example scara FOLDER" in str(caught.value)


def test_a_name_that_there_is_not(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        main(["example", "scra"])
    told = capsys.readouterr().err
    assert all(name in told for name in EXAMPLES)
    with pytest.raises(UnknownNameError, match="Did you mean 'scara'"):
        write_example("scra", tmp_path)


@pytest.mark.parametrize(("place", "is_there"), [("package/shipped", True), (".", True), ("package/elsewhere", False)])
def test_they_are_found_in_the_package_or_beside_it(
    place: str, is_there: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Installed from a wheel; in a checkout, installed in place or not; nowhere."""
    (tmp_path / "package").mkdir()
    for tree in shipped.TREES:
        shutil.copytree(ROOT / tree, tmp_path / place / tree)
    monkeypatch.setattr(shipped, "__file__", str(tmp_path / "package" / "cli" / "examples.py"))
    assert example_names() == (tuple(EXAMPLES) if is_there else ())
    if is_there:
        assert (tmp_path / "out" / write_example("arm2r", tmp_path / "out").files[0]).is_file()
    else:
        with pytest.raises(InputError, match="holds no examples"):
            examples()


@pytest.mark.parametrize(("arguments", "code"), [([], 2), (["init"], 1)])
def test_who_has_nothing_is_sent_to_the_examples(
    arguments: list[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == code
    assert "fmu-didim example" in capsys.readouterr().err


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_completion_knows_their_names(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    printed = capsys.readouterr().out
    (line,) = (
        (line for line in printed.splitlines() if "scara" in line and "arm2r" in line) if shell != "tcsh" else [printed]
    )
    assert all(name in line for name in EXAMPLES)
