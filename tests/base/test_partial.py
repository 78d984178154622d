"""What killed processes leave half written is removed at once, what others are writing stays."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from fmu_didim.base import files
from fmu_didim.base.files import is_running, partial_folder, remove_stale, whole_file

KILLED = """
import os, pathlib, sys
from fmu_didim.base.files import partial_folder, whole_file
folder = pathlib.Path(sys.argv[1])
partial_folder(folder)
with whole_file(folder / "a.txt"):
    os._exit(9)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs a system that tells whether a process runs")
def test_what_a_killed_process_left_goes_at_once(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], check=False)
    assert len(list(tmp_path.iterdir())) == 2
    own = partial_folder(tmp_path)
    remove_stale(tmp_path)
    assert list(tmp_path.iterdir()) == [own], "what this process writes stays"


def test_what_another_machine_is_writing_stays_until_it_is_old(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "_machine", lambda: "abcdef")
    monkeypatch.setattr(files, "is_running", lambda process: False)
    mine = partial_folder(tmp_path)
    monkeypatch.setattr(files, "_machine", lambda: "123456")
    remove_stale(tmp_path)
    assert mine.exists()
    os.utime(mine, (0, 0))
    remove_stale(tmp_path)
    assert not mine.exists()


def test_this_process_runs_and_a_file_is_whole(tmp_path: Path) -> None:
    assert is_running(os.getpid())
    with whole_file(tmp_path / "a.txt") as temporary:
        temporary.write_text("1", encoding="utf-8")
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
