"""The whole catalogue, and right models beside it."""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter

from fmu_didim.model.loop_model import LoopModel
from tests.checks.data.right import loaded, quantised
from tests.tools.verdict.catalogue import CATALOGUE, Wrong, right
from tests.tools.verdict.run import Answer, answer, named

NAMED = 0.9
"""Share of the wrong runs whose cause must be among the first two reasons."""
VALID = 0.95
"""Share of the right runs that must be valid."""


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.tools.verdict")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=1, help="the first seed")
    parser.add_argument("--robots", nargs="+", default=["scara", "arm", "tx40"])
    parser.add_argument("--only", default="", help="entries whose name contains this")
    parser.add_argument("--right", type=int, default=10, help="right runs a robot")
    parser.add_argument("--bits", type=int, default=0, help="of the converter of the torque; 0 is none")
    options = parser.parse_args(arguments)
    tally: Counter[str] = Counter()
    for wrong in CATALOGUE:
        if options.only not in wrong.name:
            continue
        for robot in (r for r in wrong.robots if r in options.robots):
            for seed in range(options.first, options.first + options.seeds):
                begin = time.monotonic()
                found = answer(seen(wrong.make(robot, seed), options.bits), named(loaded(robot)))
                told = is_named(wrong, found)
                tally.update(runs=1, named=int(told))
                tally.update(wrong=int(found.is_wrong), valid=int(found.verdict == "valid"))
                _line(f"{wrong.name} ({robot}, {seed})", found, told, time.monotonic() - begin)
    for robot in options.robots:
        for seed in range(1, options.right + 1):
            begin = time.monotonic()
            found = answer(seen(right(robot, 100 + seed), options.bits), named(loaded(robot)))
            tally.update(right=1, right_valid=int(found.verdict == "valid"), right_wrong=int(found.is_wrong))
            _line(f"right ({robot}, {seed})", found, True, time.monotonic() - begin)
    runs, rights = max(tally["runs"], 1), max(tally["right"], 1)
    print(f"{tally['runs']} wrong runs: {tally['wrong']} called valid and wrong, {tally['valid']} valid at all, "
          f"cause among the first two reasons in {100 * tally['named'] / runs:.1f} %")  # fmt: skip
    print(f"{tally['right']} right runs: {100 * tally['right_valid'] / rights:.1f} % valid")
    holds = not tally["wrong"] and tally["named"] >= NAMED * runs and tally["right_valid"] >= VALID * rights
    return 0 if holds else 1


def seen(model: LoopModel, bits: int) -> LoopModel:
    """The model with its logs, by a converter of so many bits where there is one."""
    return quantised(model, bits) if bits else model


def is_named(wrong: Wrong, found: Answer) -> bool:
    """Whether what is wrong is among the first two reasons, or no answer was given at all."""
    return bool(set(found.codes[:2]) & set(wrong.codes)) or (found.verdict == "refused" and not found.codes)


def _line(name: str, found: Answer, told: bool, seconds: float) -> None:
    mark = "WRONG" if found.is_wrong else "ok" if told else "other"
    print(f"{mark:6}{name}: {found.verdict} {', '.join(found.codes[:4])} "
          f"({found.farthest:.1f} sigma, held out {found.held_out:.2f}, {seconds:.1f} s)", flush=True)  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
