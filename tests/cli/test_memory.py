"""A command keeps what it has freed for what it asks for next, and does not look for garbage where there is none."""

from __future__ import annotations

import gc
import platform
import subprocess
import sys

import pytest

from fmu_didim.cli.memory import loading
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


END = """
import sys, weakref
from fmu_didim.cli.memory import end_at_once

class Kept:
    pass

class InCycle:
    def __del__(self):
        print("looked for")

kept = Kept()
weakref.finalize(kept, print, "closed")
if "at once" in sys.argv:
    end_at_once()
one = InCycle()
one.itself = one
del one
print("written", end=" ")
"""


@pytest.mark.parametrize(
    ("choice", "told"), [("at once", ["written", "closed"]), ("as it is", ["written", "closed", "looked", "for"])]
)
def test_what_must_be_closed_is_closed_at_the_end_and_nothing_else_is_looked_for(choice: str, told: list[str]) -> None:
    done = subprocess.run([sys.executable, "-c", END, choice], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.split() == told
    assert not done.stderr


def test_nothing_is_looked_through_while_modules_are_loaded_nor_soon_after() -> None:
    with pytest.raises(ImportError, match="none"), loading():
        made = [[k] for k in range(1000)]
        assert not gc.isenabled()
        raise ImportError("none")  # what fails leaves it as it was
    assert gc.isenabled()
    old = {id(one) for one in gc.get_objects(generation=2)}
    assert all(id(one) in old for one in made)
    assert not gc.get_freeze_count()
