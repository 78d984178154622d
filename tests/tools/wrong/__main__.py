"""Count what becomes of wrong inputs: ``python -m tests.tools.wrong --count 240 --seed 1``, some six minutes.

Must hold for each: it is told with a next step, or it changes nothing. What is silent, unforeseen or lacks a next step
is printed.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from tests.tools.wrong.draw import draw
from tests.tools.wrong.physical import PHYSICAL
from tests.tools.wrong.place import HARMLESS, TOLD, expected_of, files, outcome, run

SUSPECTED = 0.9
"""[1] Share of the mistakes at a machine whose cause must be suspected first."""


def count(number: int, seed: int, folder: Path, say: bool = False) -> tuple[Counter[str], list[str]]:
    """How often each outcome came, and what was wrong."""
    expected = expected_of(run(files(), folder / "right"))
    tally, wrong = Counter[str](), list[str]()
    for k in range(number):
        made = files()
        what = draw(random.Random(f"{seed} {k}"), made)
        said = run(made, folder / str(k))
        found = outcome(said, expected)
        tally[found] += 1
        if found not in (TOLD, HARMLESS):
            wrong.append(f"{k}: {found}: {what}\n{said.text[-1500:]}")
        if say:
            first = next(iter(said.suspects), "")
            print(f"{k:4} {found:10} exit {said.code} {said.verdict:10} {first:24} {what[:150]}", flush=True)
    return tally, wrong


def physical(draws: int, seed: int, folder: Path, say: bool = False) -> tuple[int, int, list[str]]:
    """How many mistakes were made at a machine, how often the right thing was suspected first, and where it was not;
    what is silent, unforeseen or without a next step begins with ``WRONG``."""
    expected = expected_of(run(files(), folder / "right"))
    first, missed = 0, list[str]()
    for k, (name, mistake) in enumerate(PHYSICAL.items()):
        for draw_ in range(draws):
            made = files()
            mistake.make(np.random.default_rng([seed, draw_, k]), made)
            said = run(made, folder / f"{k}-{draw_}")
            is_first, found = mistake.suspects(said, expected), outcome(said, expected)
            first += is_first
            if not is_first:
                mark = "" if found in (TOLD, HARMLESS) else "WRONG "
                missed.append(f"{mark}{name}: {found}, {said.verdict} {said.suspects[:3]} {said.text[:300]}")
            if say:
                print(f"{name:30} {'ok' if is_first else 'other':6} {found:10} {said.suspects[:3]}", flush=True)
    return draws * len(PHYSICAL), first, missed


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.tools.wrong", description=__doc__)
    parser.add_argument("--count", type=int, default=240)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--physical", type=int, metavar="DRAWS", help="draws of each mistake at a machine instead")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="fmu_didim-wrong-") as folder:
        if options.physical:
            made, first, missed = physical(options.physical, options.seed, Path(folder), say=True)
            print("\n".join(missed))
            print(f"{first} of {made} ({100 * first / made:.1f} %): the right thing is suspected first")
            return 0 if first >= SUSPECTED * made and not any(m.startswith("WRONG") for m in missed) else 1
        tally, wrong = count(options.count, options.seed, Path(folder), say=True)
    print("\n".join(wrong))
    print(", ".join(f"{number} {what}" for what, number in tally.most_common()))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
