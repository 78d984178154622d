"""Compilers end with the process that has started them, however that ends, and leave nothing outside the cache."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import pytest

from fmu_didim.base.errors import BuildError
from fmu_didim.export import build, supervised
from tests.patience import is_running, patience, wait_until

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="looks at processes in /proc")
SLOW = """import os, subprocess, sys, time
open(sys.argv[1], "a").write(f"{os.getpid()}\\n")
inner = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
open(sys.argv[1], "a").write(f"{inner.pid}\\n")
time.sleep(600)
"""
"""A compiler that starts another process and does not end."""
STARTS = """import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from fmu_didim.export import build
build.run_compiler(sys.argv[1:], what="It failed.")
"""
"""A process that hears interrupts even where a shell began the tests in the background, deaf to them."""


def pids(file: Path) -> list[int]:
    """The two processes, once they have begun."""
    wait_until(lambda: file.exists() and len(file.read_text().split()) == 2)
    return [int(text) for text in file.read_text().split()]


def assert_gone(found: list[int]) -> None:
    wait_until(lambda: not any(is_running(pid) for pid in found))


@pytest.mark.gate
@LINUX
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_compiler_ends_with_its_parent(tmp_path: Path, how: signal.Signals) -> None:
    (tmp_path / "slow.py").write_text(SLOW)
    command = [sys.executable, str(tmp_path / "slow.py"), str(tmp_path / "pids")]
    with subprocess.Popen([sys.executable, "-c", STARTS, *command], stderr=subprocess.DEVNULL) as parent:
        found = pids(tmp_path / "pids")
        assert all(is_running(pid) for pid in found)
        os.kill(parent.pid, how)
    assert_gone(found)


@pytest.mark.gate
@LINUX
def test_a_compiler_that_does_not_end_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    limit = patience(1.0)
    monkeypatch.setattr(build, "TIMEOUT", limit)
    (tmp_path / "slow.py").write_text(SLOW)
    with pytest.raises(BuildError, match=f"no end after {limit:g} s"):
        build.run_compiler([sys.executable, str(tmp_path / "slow.py"), str(tmp_path / "pids")], what="It failed.")
    assert_gone(pids(tmp_path / "pids"))


@LINUX
def test_what_a_compiler_prints_and_its_exit_status() -> None:
    assert build.run_compiler([sys.executable, "-c", "print('a version')"], what="") == "a version\n"
    with pytest.raises(BuildError, match=r"^It failed\.[\s\S]*no such thing"):
        build.run_compiler([sys.executable, "-c", "raise SystemExit('no such thing')"], what="It failed.")
    with pytest.raises(BuildError, match=r"^It failed\.[\s\S]*No such file"):
        build.run_compiler(["/nowhere/compiler"], what="It failed.")
    with pytest.raises(BuildError, match="exit status 137"):
        build.run_compiler([sys.executable, "-c", "import os; os.kill(os.getpid(), 9)"], what="")


@pytest.mark.parametrize("has_taskkill", [True, False])
def test_on_windows_all_that_was_started_ends(has_taskkill: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """There are no groups of processes there: ending the launcher alone would leave the compiler that it started."""
    done: list[object] = []

    def run(command: list[str], **options: object) -> None:
        done.append(command)
        if not has_taskkill:
            raise FileNotFoundError(2, "no such program")

    process = SimpleNamespace(pid=4711, kill=lambda: done.append("killed"))
    monkeypatch.setattr(supervised, "os", SimpleNamespace())
    monkeypatch.setattr(supervised.subprocess, "run", run)
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO()))  # its end is reached
    supervised._end_with_input(process)  # type: ignore[arg-type]
    assert done == [["taskkill", "/T", "/F", "/PID", "4711"], "killed"]


def test_compiling_leaves_nothing_in_the_folder_for_temporary_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "main.c").write_text('__attribute__((visibility("default"))) int one(void) { return 1; }\n')
    build.compile_shared_library(tmp_path / "own", tmp_path / "own" / "library", main="main.c")
    assert sorted(path.name for path in (tmp_path / "own").iterdir()) == ["library", "main.c"]
    assert [path.name for path in tmp_path.iterdir()] == ["own"]
