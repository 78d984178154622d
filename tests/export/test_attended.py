"""Compilers end with the process that has started them, however that ends, and leave nothing outside the cache."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from fmu_didim.errors import BuildError
from fmu_didim.export import build

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks at processes in /proc")
SLOW = """import os, subprocess, sys, time
open(sys.argv[1], "a").write(f"{os.getpid()}\\n")
inner = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
open(sys.argv[1], "a").write(f"{inner.pid}\\n")
time.sleep(600)
"""
"""A compiler that starts another process and does not end."""
STARTS = "import sys; from fmu_didim.export import build; build.run_compiler(sys.argv[1:], what='It failed.')"


def is_running(pid: int) -> bool:
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    except OSError:
        return False


def pids(file: Path) -> list[int]:
    """The two processes, once they have begun."""
    end = time.monotonic() + 60
    while not file.exists() or len(file.read_text().split()) < 2:
        assert time.monotonic() < end
        time.sleep(0.02)
    return [int(text) for text in file.read_text().split()]


def assert_gone(found: list[int]) -> None:
    end = time.monotonic() + 20
    while any(is_running(pid) for pid in found):
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_compiler_ends_with_its_parent(tmp_path: Path, how: signal.Signals) -> None:
    (tmp_path / "slow.py").write_text(SLOW)
    command = [sys.executable, str(tmp_path / "slow.py"), str(tmp_path / "pids")]
    with subprocess.Popen([sys.executable, "-c", STARTS, *command], stderr=subprocess.DEVNULL) as parent:
        found = pids(tmp_path / "pids")
        assert all(is_running(pid) for pid in found)
        os.kill(parent.pid, how)
    assert_gone(found)


def test_a_compiler_that_does_not_end_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "TIMEOUT", 1.0)
    (tmp_path / "slow.py").write_text(SLOW)
    with pytest.raises(BuildError, match="no end after 1 s"):
        build.run_compiler([sys.executable, str(tmp_path / "slow.py"), str(tmp_path / "pids")], what="It failed.")
    assert_gone(pids(tmp_path / "pids"))


def test_what_a_compiler_prints_and_its_exit_status() -> None:
    assert build.run_compiler([sys.executable, "-c", "print('a version')"], what="") == "a version\n"
    with pytest.raises(BuildError, match=r"^It failed\.[\s\S]*no such thing"):
        build.run_compiler([sys.executable, "-c", "raise SystemExit('no such thing')"], what="It failed.")
    with pytest.raises(BuildError, match=r"^It failed\.[\s\S]*No such file"):
        build.run_compiler(["/nowhere/compiler"], what="It failed.")
    with pytest.raises(BuildError, match="exit status 137"):
        build.run_compiler([sys.executable, "-c", "import os; os.kill(os.getpid(), 9)"], what="")


def test_compiling_leaves_nothing_in_the_folder_for_temporary_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "main.c").write_text('__attribute__((visibility("default"))) int one(void) { return 1; }\n')
    build.compile_shared_library(tmp_path / "own", tmp_path / "own" / "library", main="main.c")
    assert sorted(path.name for path in (tmp_path / "own").iterdir()) == ["library", "main.c"]
    assert [path.name for path in tmp_path.iterdir()] == ["own"]
