"""A command keeps what it has freed for what it asks for next."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

from tests.helpers import ROOT

TABLES = """
import resource, sys
import numpy as np
from fmu_didim.cli.memory import keep_freed_memory

if "kept" in sys.argv:
    assert keep_freed_memory()
for _ in range(4):  # some tables at a time, of 40 MB
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    [np.ones(250_000) for _ in range(20)]
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the setting is one of glibc")
def test_pages_of_tables_are_not_asked_for_again() -> None:
    faults = []
    for choice in ("kept", "as it is"):
        run = [sys.executable, "-c", TABLES, choice]
        faults.append(int(subprocess.run(run, capture_output=True, text=True, check=True, cwd=ROOT).stdout))
    assert faults[0] < faults[1] / 10, faults
