"""Results of a run: all of it or all of the one before, and told before the work if they could not be written."""

from __future__ import annotations

import errno
import os
import re
import shutil
import subprocess
import sys
from collections import namedtuple
from pathlib import Path

import pytest
import yaml

from fmu_didim import discover, identify, load_findings, load_result
from fmu_didim.base import cache
from fmu_didim.base.errors import FmuDidimError, InputError
from fmu_didim.cli.main import main
from fmu_didim.workflow.output.discovered_files import result_folder
from fmu_didim.workflow.output.result_folder import ResultFolder, check_writable
from tests.cases import SCARA, scara_case
from tests.discovery.helpers import arm_case

OLD = {"head.json": "old", "page.html": "old", "table_a.csv": "old", "table_b.csv": "old"}
NEW = {"head.json": "new", "page.html": "new", "table_a.csv": "new", "table_c.csv": "new"}
MINE = {"table_mine.csv": "measured", "notes.txt": "notes", "result.json": "of another verb"}


def results(folder: Path) -> ResultFolder:
    return ResultFolder(folder, "test", "head.json", ("page.html",), ("table_*.csv",), "tables")


def put(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).write_text(text)


def write(folder: Path, files: dict[str, str]) -> None:
    with results(folder).written() as new:
        put(new, files)


def content(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir() if not path.name.startswith(".fmu_didim")}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Files of the user and an earlier result."""
    where = tmp_path / "a" / "b"
    write(where, OLD)
    put(where, MINE)
    assert content(where) == OLD | MINE
    return where


def test_a_run_replaces_all_of_an_earlier_one_and_nothing_else(folder: Path) -> None:
    write(folder, NEW)
    assert content(folder) == NEW | MINE
    write(folder, {"head.json": "refused"})
    assert content(folder) == {"head.json": "refused"} | MINE


def test_results_written_before_there_was_a_list(folder: Path) -> None:
    """Their tables are named in the head; what is named there but lies elsewhere stays."""
    (folder / ".fmu_didim_test").unlink()
    (folder.parent / "outside.csv").write_text("outside")
    named = '{"tables": {"a": "table_a.csv", "b": "table_b.csv", "c": "../outside.csv", "d": "..", "e": ""}}'
    (folder / "head.json").write_text(named)
    write(folder, {"head.json": "new"})
    assert content(folder) == {"head.json": "new"} | MINE
    assert (folder.parent / "outside.csv").is_file()


def test_a_list_names_nothing_outside(folder: Path) -> None:
    (folder.parent / "outside.csv").write_text("outside")
    (folder / ".fmu_didim_test").write_text("../outside.csv\n\n.\n..\ntable_a.csv\ntable_b.csv")
    write(folder, {"head.json": "new"})
    assert content(folder) == {"head.json": "new"} | MINE
    assert (folder.parent / "outside.csv").is_file()


@pytest.mark.parametrize(
    "error", [OSError(errno.ENOSPC, "No space left on device"), ValueError("x"), KeyboardInterrupt()]
)
def test_a_failure_while_writing_leaves_the_earlier_result(folder: Path, error: BaseException) -> None:
    told = InputError if isinstance(error, OSError) else type(error)
    with pytest.raises(told) as caught, results(folder).written() as new:
        put(new, {"head.json": "new"})
        raise error
    assert content(folder) == OLD | MINE
    if told is InputError:
        assert re.search(r"No space left[\s\S]*next:.*--out", str(caught.value))


@pytest.mark.parametrize("error", [PermissionError("open in another program"), KeyboardInterrupt()])
@pytest.mark.parametrize("count", range(8))
def test_a_failure_while_moving_leaves_the_earlier_result(
    folder: Path, monkeypatch: pytest.MonkeyPatch, count: int, error: BaseException
) -> None:
    """Four files go, four come: whichever cannot be moved, all are as they were."""
    real, calls = Path.replace, []

    def replace(self: Path, target: Path) -> Path:
        if not Path(target).name.startswith(".fmu_didim"):  # the list of files
            calls.append(self)
            if len(calls) == count + 1:
                raise error
        return real(self, target)

    monkeypatch.setattr(Path, "replace", replace)
    with pytest.raises(InputError if isinstance(error, OSError) else type(error)):
        write(folder, NEW)
    assert content(folder) == OLD | MINE
    write(folder, NEW)
    assert content(folder) == NEW | MINE


@pytest.mark.gate
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_kill_while_moving_never_leaves_what_looks_like_a_result(folder: Path) -> None:
    code = """
import os, shutil, sys
from pathlib import Path
from tests.workflow.test_result_folder import NEW, write
real, folder = Path.replace, Path(sys.argv[1])
for count in range(1, 11):
    copy = folder.with_name(f"copy{count}")
    shutil.copytree(folder, copy)
    if os.fork() == 0:
        left = count
        def replace(self, target):
            global left
            left -= 1
            if left == 0:
                os._exit(9)
            return real(self, target)
        Path.replace = replace
        write(copy, NEW)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.wait()[1]) == 9
"""
    subprocess.run([sys.executable, "-c", code, str(folder)], check=True)
    for count in range(1, 11):
        copy = folder.with_name(f"copy{count}")
        left = {name: text for name, text in content_of_files(copy).items() if name not in MINE}
        if "head.json" in left:
            assert left in (OLD, NEW)
        write(copy, NEW)
        for partial in copy.glob(".partial-*"):
            os.utime(partial, (0, 0))
        write(copy, NEW)
        assert content(copy) == NEW | MINE


def content_of_files(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir() if path.is_file() and path.name[0] != "."}


def test_only_what_is_old_is_removed_as_given_up(tmp_path: Path) -> None:
    for name in (".partial-old", ".partial-new", "other"):
        (tmp_path / name / "inner").mkdir(parents=True)
    (tmp_path / ".partial-file").write_text("")
    for name in (".partial-old", ".partial-file", "other"):
        os.utime(tmp_path / name, (0, 0))
    cache.remove_stale(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [".partial-new", "other"]


# ---- before the work -------------------------------------------------------------------------------


def test_folders_that_cannot_be_written_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"is a file[\s\S]*--out"):
        check_writable(tmp_path / "file")
    with pytest.raises(InputError, match=r"part of this path is a file[\s\S]*got:.*file"):
        check_writable(tmp_path / "file" / "out")
    check_writable(tmp_path / "new" / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(10**9, 10**9 - 5, 5))
    with pytest.raises(InputError, match=r"disk is full[\s\S]*16 MB"):
        check_writable(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(0, 0, 0))  # a file system that does not say
    check_writable(tmp_path)


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a place where nobody can write")
def test_read_only_places() -> None:
    with pytest.raises(InputError, match=r"cannot be written[\s\S]*where: /proc/results"):
        check_writable(Path("/proc/results"))


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_read_only_folders(tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    with pytest.raises(InputError, match="Permission denied"):
        check_writable(tmp_path / "out")
    tmp_path.chmod(0o755)


def test_what_the_run_reads_is_not_replaced(folder: Path) -> None:
    results(folder).check(reads=[folder / "notes.txt", folder.parent / "table_a.csv", Path()])
    for name in ("table_mine.csv", "page.html", "head.json"):
        with pytest.raises(InputError, match=rf"would replace[\s\S]*{name}[\s\S]*--out"):
            results(folder).check(reads=[folder / "notes.txt", folder / name])


@pytest.mark.parametrize("verb", ["identify", "discover"])
def test_the_verbs_look_before_they_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, verb: str
) -> None:
    """Even before the case is read."""
    (tmp_path / "file").write_text("")
    assert main([verb, "nowhere.yaml", "--out", str(tmp_path / "file")]) == 1
    assert "is a file" in capsys.readouterr().err
    function = {"identify": identify, "discover": discover}[verb]
    with pytest.raises(InputError, match="is a file"):
        function("nowhere.yaml", tmp_path / "file")
    case = scara_case(tmp_path)
    table = tmp_path / {"identify": "torque_train.csv", "discover": "signals_train.csv"}[verb]
    document = yaml.safe_load(case.read_text())
    shutil.copy(document["train"]["torque"]["file"], table)
    document["train"]["torque"]["file"] = table.name
    case.write_text(yaml.safe_dump(document))
    before = table.read_bytes()
    with pytest.raises(InputError, match=rf"would replace[\s\S]*{table.name}"):
        function(case, tmp_path)
    assert table.read_bytes() == before


# ---- the verbs -------------------------------------------------------------------------------------


@pytest.mark.gate
def test_a_refused_run_removes_what_an_earlier_one_left(tmp_path: Path) -> None:
    out = tmp_path / "out"
    shown: list[set[str]] = []
    identify(SCARA, out, show=lambda outcome: shown.append(set(os.listdir(out) if out.exists() else ())))  # noqa: PTH208
    assert shown == [set()]  # before anything was written
    whole = {"result.json", "report.html", "robot_identified.yaml", "torque_estimation.csv", "torque_validation.csv"}
    whole |= {"simulated_estimation.csv", "simulated_validation.csv"}
    assert set(content_of_files(out)) == whole
    (out / "notes.txt").write_text("mine")
    limited = scara_case(tmp_path, identify={"Kp2": {"of": "controller", "start": 50, "maximum": 51}})
    with pytest.raises(FmuDidimError, match="at a limit given in the case: Kp2"):
        identify(limited, out)
    assert load_result(out).verdict == "refused"
    assert set(content_of_files(out)) == {"result.json", "report.html", "notes.txt"}


LIMITED = """
import resource, sys
from fmu_didim.cli.main import main
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), resource.RLIM_INFINITY))
sys.exit(main(sys.argv[2:]))
"""


@pytest.mark.gate
@pytest.mark.skipif(sys.platform == "win32", reason="needs resource limits")
@pytest.mark.parametrize("size", [4096, pytest.param(100_000, marks=pytest.mark.slow)])
def test_a_full_disk_leaves_the_earlier_result_and_the_table_is_printed(tmp_path: Path, size: int) -> None:
    """Files end at 4 096 bytes, within result.json, or within the page."""
    out = tmp_path / "out"
    identify(SCARA, out)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    command = [sys.executable, "-c", LIMITED, str(size), "identify", str(SCARA), "--out", str(out), "--quiet"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "ZZ1R       3.406" in done.stdout
    assert "VALID" in done.stdout
    assert "Report:" not in done.stdout
    assert "The results cannot be written." in done.stderr
    assert "Traceback" not in done.stderr
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_discovery_is_shown_and_the_answer_so_far_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case, out = arm_case(tmp_path, held_out=False), tmp_path / "out"
    with result_folder(out).written() as new:
        put(new, {"findings.json": "old", "discovery.html": "old", "robot_augmented.yaml": "old", "old.fmu": "old"})

    def full(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("fmu_didim.report.discovery.sections.write_discovery_report", full)
    shown: list[str] = []
    with pytest.raises(InputError, match="No space left"):
        discover(case, out, time_limit=1e-3, show=lambda found: shown.append(found.summary()))
    assert len(shown) == 1
    assert shown[0].startswith("NOT FINISHED")
    assert set(content_of_files(out)) == {"findings.json"}
    assert load_findings(out).answer == "unfinished"


def test_simulate_looks_before_it_works(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert main(["simulate", str(SCARA), "--out", str(tmp_path / "file" / "loop.csv")]) == 1
    assert "is a file" in capsys.readouterr().err
