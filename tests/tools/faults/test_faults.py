"""A few of the faults of ``python -m tests.tools.faults``, and all of them as slow tests."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.tools.faults import checks
from tests.tools.faults.runs import ROOT, Report

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks at processes in /proc")


@pytest.mark.slow
def test_a_run_that_is_killed_and_a_cache_that_is_damaged(tmp_path: Path) -> None:
    place, report = checks.Place(tmp_path), Report()
    checks.kills(place, report, 2, seed=1)
    checks.damages(place, report, ("libraries cut to half", "folders emptied"))
    assert not report.wrong, report.wrong
    assert report.tried == 14


@pytest.mark.slow
def test_all_faults() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.tools.faults", "--kills", "12"], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
