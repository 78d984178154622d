"""Random starts: whether the answer depends on the values that an identification begins with.

    python -m tests.tools.verdict.random_starts --robots scara arm --seeds 200

Every base parameter starts at its true value times a factor between 1/1000 and 1000, drawn evenly in its logarithm and
apart from the others: many starts are no machines, or machines that the controller makes unstable, and are given up for
another start. A run holds where the identification is not refused and its values are those of the usual start for the
same data, to a tenth of a standard deviation. Steps from a point that was simulated to one that cannot be are counted.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass

import numpy as np

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.estimators import Didim
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.iteration import Iteration
from fmu_didim.model.loop_model import LoopModel
from tests.checks.data.right import CASES, loaded
from tests.tools.verdict.catalogue import right

DECADES = 3.0
"""Of the factors, up and down."""
SAME = 0.1
"""Standard deviations within which two answers are the same."""
DATA = 10
"""Draws of motion and noise; each serves several starts."""


@dataclass(frozen=True)
class Run:
    """What became of one start.

    Attributes:
        refused: why there is no answer; apart: distance from the usual start's answer, in standard deviations.
        failed: steps to values that could not be simulated; another: whether another start gave the answer.
    """

    refused: str
    apart: float
    failed: tuple[str, ...]
    another: bool
    seconds: float

    @property
    def holds(self) -> bool:
        return not self.refused and self.apart <= SAME


def draw(model: LoopModel, seed: int) -> dict[str, float]:
    """Start values by name."""
    factors = 10 ** np.random.default_rng([seed, 1]).uniform(-DECADES, DECADES, model.linear_count)
    return dict(zip(model.names, (model.start[: model.linear_count] * factors).tolist(), strict=False))


def run(model: LoopModel, usual: Estimate, start: dict[str, float]) -> Run:
    """The answer from a start beside the usual one."""
    failed: list[str] = []

    def watch(iteration: Iteration) -> None:
        if not np.isfinite(iteration.relative_error_percent) and "restarted" not in iteration.note:
            failed.append(iteration.note)

    begin = time.monotonic()
    try:
        found = Didim(start=start).estimate(model, progress=watch)
    except FmuDidimError as error:
        return Run(f"{error.what} {error.got}", np.inf, tuple(failed), False, time.monotonic() - begin)
    apart = float(np.abs((found.value - usual.value) / usual.standard_deviation).max())
    another = any(remark.startswith("Started from") for remark in found.remarks)
    return Run("", apart, tuple(failed), another, time.monotonic() - begin)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.verdict.random_starts", description=__doc__.split("\n")[0]
    )
    parser.add_argument("--robots", nargs="+", default=["scara", "arm"], choices=sorted(CASES))
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first", type=int, default=1)
    options = parser.parse_args(arguments)
    holds = True
    for robot in options.robots:
        true = loaded(robot)
        usual: dict[int, tuple[LoopModel, Estimate]] = {}
        runs = []
        for seed in range(options.first, options.first + options.seeds):
            data = seed % DATA
            if data not in usual:
                model = right(robot, 500 + data)
                usual[data] = model, Didim(start="torque").estimate(model)
            found = run(*usual[data], draw(true, seed))
            runs.append(found)
            if not found.holds or found.failed:
                print(f"{robot}, start {seed}: {found.apart:.2f} sigma apart, {found.seconds:.1f} s; "
                      f"{found.refused or 'answered'}; {'; '.join(found.failed)}", flush=True)  # fmt: skip
        good, refused = sum(r.holds for r in runs), sum(bool(r.refused) for r in runs)
        another, failed = sum(r.another for r in runs), sum(len(r.failed) for r in runs)
        seconds = [r.seconds for r in runs]
        print(f"{robot}: {good} of {len(runs)} random starts hold; {refused} refused, {another} given up for another "
              f"start, {failed} steps to values that could not be simulated; {np.median(seconds):.1f} s in the "
              f"median, {max(seconds):.1f} s at most", flush=True)  # fmt: skip
        holds &= good == len(runs)
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
