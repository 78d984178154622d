"""Tests with other seeds: which of them rest on the draw of noise that they happen to have.

    python -m tests.tools.seeds --shifts 3 tests/fit -m "not slow"     # arguments of pytest follow

Each run shifts all seeds that tests give to ``numpy.random.default_rng``; at the end the tests that failed are
listed, with how often. Seeds of fixed cases and robots stay, those of motions do not. A test that fails now and then
needs more draws and a share of them; one that compares with what was written with its own seed (data that are shipped,
figures on a page) always fails.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from tests.conftest import ROOT

VARIABLE = "TEST_SEED_SHIFT"
FIXED = ("tests.tools.blind", "tests.tools.verdict.robots", "tests.tools.seeds")
"""Modules whose seeds are names of cases."""
APART = 7919
"""[1] Begins the second part of shifted seeds, so that none of them is one that another test has."""

_default_rng = np.random.default_rng


def shifted(seed: Any = None) -> np.random.Generator:
    """The generator of a seed, moved by the shift of this run where a test asks for it."""
    asked_by = sys._getframe(1).f_globals.get("__name__", "")
    is_of_a_test = asked_by.startswith("tests.") and not asked_by.startswith(FIXED)
    if not is_of_a_test or not isinstance(seed, (int, np.integer, list, tuple)):
        return _default_rng(seed)
    parts = [int(part) for part in (seed if isinstance(seed, (list, tuple)) else [seed])]
    return _default_rng([*parts, APART + int(os.environ[VARIABLE])])


def pytest_configure() -> None:
    """As a plugin of pytest, in its workers too: shift the seeds."""
    if os.environ.get(VARIABLE):
        np.random.default_rng = shifted


def failed(shift: int, arguments: Sequence[str]) -> list[str]:
    """The tests that fail with a shift."""
    command = [sys.executable, "-m", "pytest", "-p", "tests.tools.seeds", "-q", "-rfE", *arguments]
    environment = {**os.environ, VARIABLE: str(shift)}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    print(f"shift {shift}: {done.stdout.strip().splitlines()[-1]}", flush=True)
    return re.findall(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.M)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point: 0 where no test failed with any shift."""
    parser = argparse.ArgumentParser(prog="python -m tests.tools.seeds", description=str(__doc__).split("\n")[0])
    parser.add_argument("--shifts", type=int, default=3, help="how many other draws (3)")
    options, further = parser.parse_known_args(arguments)
    counts: Counter[str] = Counter()
    for shift in range(1, options.shifts + 1):
        counts.update(failed(shift, further))
    for name, count in counts.most_common():
        print(f"{count} of {options.shifts}: {name}")
    return 1 if counts else 0


if __name__ == "__main__":
    sys.exit(main())
