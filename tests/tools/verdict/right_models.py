"""Right models: how often they are called valid, how often intervals hold the truth, and the worst value of each run.

    python -m tests.tools.verdict.right_models --robots scara arm --seeds 200 --rates 4 20 200 --noise white
    python -m tests.tools.verdict.right_models --robots tx40 puma560 rv2sq --seeds 10 --rates 20 100
    python -m tests.tools.verdict.right_models --robots scara arm --seeds 40 --rates 20 100 --bits 8 12 --size 0.001

Each seed draws motion, noise and start values. A run is lost where it was refused, did not settle, or has a value
beyond four sigma.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path

from fmu_didim.data.filters import LowPass
from tests.checks.data.right import CASES, loaded, quantised
from tests.tools.verdict.__main__ import VALID
from tests.tools.verdict.catalogue import NOISE, right
from tests.tools.verdict.run import SIGMA, Answer, answer, named

COVERAGE = (0.92, 0.97)
"""Between these must lie the share of the true values that the 95 % intervals hold."""
COLOURED = {"white": 0.0, "half-coloured": 0.5}


@dataclass(frozen=True)
class Setting:
    """What all seeds of one row share."""

    robot: str
    rate_hz: float
    noise: str
    size: float
    low_pass_hz: float | None
    bits: int | None

    def __str__(self) -> str:
        filtered = f", low-pass {self.low_pass_hz:g} Hz" if self.low_pass_hz else ""
        steps = f", {self.bits} bits" if self.bits else ""
        return f"{self.robot}, {self.rate_hz:g} Hz, {self.noise}, noise {100 * self.size:g} %{filtered}{steps}"


def one(task: tuple[Setting, int]) -> tuple[Answer, float]:
    """The answer on one seed, and its seconds."""
    setting, seed = task
    begin = time.monotonic()
    coloured = COLOURED[setting.noise]
    model = right(setting.robot, seed, rate_hz=setting.rate_hz, coloured=coloured, noise=setting.size)
    if setting.bits:
        model = quantised(model, setting.bits)
    if setting.low_pass_hz:
        model = model.with_low_pass(LowPass(setting.low_pass_hz))
    right.func.cache_clear()
    return answer(model, named(loaded(setting.robot))), time.monotonic() - begin


def settings(options: argparse.Namespace) -> Iterator[Setting]:
    """One for each row; a filter above half the rate of the log does nothing and is left out."""
    for robot, rate, noise, size, cutoff, bits in product(
        options.robots, options.rates, options.noise, options.size, options.low_pass, options.bits
    ):
        if not cutoff or cutoff < rate / 2:
            yield Setting(robot, rate, noise, size, cutoff or None, bits or None)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.verdict.right_models", description=__doc__.split("\n")[0]
    )
    parser.add_argument("--robots", nargs="+", default=["scara", "arm"], choices=sorted(CASES))
    parser.add_argument("--rates", nargs="+", type=float, default=[20.0])
    parser.add_argument("--noise", nargs="+", default=["white"], choices=sorted(COLOURED))
    parser.add_argument("--low-pass", nargs="+", type=float, default=[0.0], help="cut-off in Hz; 0 is no filter")
    parser.add_argument("--size", nargs="+", type=float, default=[NOISE], help="of the noise, of that of the torque")
    parser.add_argument("--bits", nargs="+", type=int, default=[0], help="of the converter of the torque; 0 is none")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1000, help="the first seed")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    rows, holds = [], True
    seeds = range(options.first, options.first + options.seeds)
    with multiprocessing.get_context("spawn").Pool(options.processes) as pool:
        for setting in settings(options):
            found = pool.map(one, [(setting, seed) for seed in seeds], chunksize=1)
            rows.append({"setting": asdict(setting), "answers": [asdict(a) for a, _ in found]})
            holds &= _row(setting, [a for a, _ in found], seeds, sum(s for _, s in found))
            if options.json:
                options.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    return 0 if holds else 1


def _row(setting: Setting, answers: list[Answer], seeds: range, seconds: float) -> bool:
    """Prints one row, and says whether it holds."""
    valid = sum(a.verdict == "valid" for a in answers) / len(answers)
    coverage = sum(a.inside for a in answers) / max(sum(a.compared for a in answers), 1)
    lost = [seed for seed, a in zip(seeds, answers, strict=True) if not a.compared or a.farthest > SIGMA]
    reasons = Counter(code for a in answers for code in a.codes)
    print(f"{setting}: {100 * valid:.1f} % valid, {100 * coverage:.1f} % of the true values in their intervals, "
          f"at most {max(a.farthest for a in answers):.1f} sigma, {seconds / len(answers):.1f} s a run"
          + (f"; lost: {lost}" if lost else "")
          + (f"; told: {', '.join(f'{code} {n}' for code, n in reasons.most_common(6))}" if reasons else ""),
          flush=True)  # fmt: skip
    return valid >= VALID and COVERAGE[0] <= coverage <= COVERAGE[1]


if __name__ == "__main__":
    sys.exit(main())
