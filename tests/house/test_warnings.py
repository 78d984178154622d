"""Which warnings are errors in the tests: those of this project, not those of others."""

from __future__ import annotations

import re
import subprocess
import sys
import types
import warnings
from contextlib import nullcontext
from pathlib import Path

import pytest

from tests.conftest import ROOT

OTHER = """
import warnings
def warned(level):
    warnings.warn("in a later release", DeprecationWarning, stacklevel=level)
"""
LEFT_OPEN = """
import threading

def test_file(tmp_path):
    open(tmp_path / "file", "w")

class Broken:
    def __del__(self):
        raise ValueError("never seen")

def test_destructor():
    Broken()

def test_thread():
    thread = threading.Thread(target=lambda: 1 / 0)
    thread.start()
    thread.join()

def test_without_fault():
    import warnings
    warnings.warn_explicit("in a later release", DeprecationWarning, "statesp.py", 1, module="control.statesp")
"""


@pytest.mark.parametrize(
    ("module", "is_error"),
    [
        ("fmu_didim", True),
        ("fmu_didim.components.block_control", True),
        ("tests.conftest", True),
        ("<run_path>", True),
        ("__main__", True),
        ("control.statesp", False),
        ("numpy", False),
        ("distributed.tests.of_others", False),
        ("fmu_didimension", False),
        ("testsuite", False),
    ],
)
@pytest.mark.parametrize("category", [DeprecationWarning, RuntimeWarning, UserWarning])
def test_warnings_of_ours_are_errors(module: str, is_error: bool, category: type[Warning]) -> None:
    with warnings.catch_warnings(record=True) as told, pytest.raises(category) if is_error else nullcontext():
        warnings.warn_explicit("in a later release", category, "file.py", 1, module=module)
    assert len(told) == (not is_error)


def test_who_uses_what_is_going_to_leave_is_told() -> None:
    """Of what this file calls, and of what another calls for itself."""
    other = types.ModuleType("other")
    exec(OTHER, other.__dict__)
    with warnings.catch_warnings(record=True) as told, pytest.raises(DeprecationWarning):
        other.warned(1)
        other.warned(2)
    assert len(told) == 1


def test_what_is_left_open_or_raised_unseen_is_an_error(tmp_path: Path) -> None:
    """By the settings of this project, in a session of its own; warnings of others are shown at its end."""
    (tmp_path / "test_left_open.py").write_text(LEFT_OPEN, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-c", str(ROOT / "pyproject.toml"), "-o", "addopts=", "-p", "no:cacheprovider",
         "--rootdir", str(tmp_path), str(tmp_path)], capture_output=True, text=True, cwd=tmp_path,
    )  # fmt: skip
    assert set(re.findall(r"^FAILED .*::(\w+)", done.stdout, re.M)) == {"test_file", "test_destructor", "test_thread"}
    assert "3 failed, 1 passed, 1 warning" in done.stdout
    assert "in a later release" in done.stdout
