"""Logs of the SCARA at 20 Hz that show the size of the torque alone: do they converge, and do their intervals hold?

    python -m tests.tools.unsigned --seeds 1001-1040 2001-2040 --figures docs/figures/unsigned.json

Each seed draws white noise for both logs of the example, whose start values are those of the paper's Table 3, inertias
a hundredth of the true ones; the sizes of the same logs are identified, and, beside them, the logs with their signs.
The machine is the one that the shipped example identifies.

The eight intervals of a run are not independent of each other: the standard deviation of a coverage is taken from the
scatter between runs.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim import Case, Result, identify, load_case, simulate, trajectory
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.data.signals import Trajectory
from tests.figures import command_of, table, write_figures
from tests.helpers import ROOT

SCARA = ROOT / "examples/scara/identify.yaml"
NOISE = (0.17, 0.0065)
"""[N.m] Of the logs of the example."""
TIMES = (1.0, 4.0)
"""[1] By which the noise is larger."""
EVERY = 10
"""[ticks] Of 5 ms between rows of a log: 20 Hz."""
RUNS = {"train": "estimation", "validation": "validation"}
"""Key of the case -> label of the experiment."""


@cache
def truth() -> dict[str, float]:
    """The values of the machine."""
    return dict(identify(SCARA).values)


@cache
def motions() -> dict[str, Trajectory]:
    """Label -> torque of the machine at each tick, without noise."""
    return {label: simulate(load_case(SCARA), parameters=truth(), experiment=label) for label in RUNS.values()}


def logs(seed: int, *, times: float = 1.0, signed: bool = False) -> dict[str, Trajectory]:
    """Label -> log with noise, without its signs."""
    rng, found = np.random.default_rng(seed), {}
    for label, motion in motions().items():
        clean = motion.select(["tau1", "tau2"])[::EVERY]
        torque = clean + times * rng.normal(0, NOISE, clean.shape)
        torque = torque if signed else np.abs(torque)
        found[label] = trajectory(motion.time[::EVERY], {"tau1": torque[:, 0], "tau2": torque[:, 1]})
    return found


def case_of(seed: int, *, says_so: bool = True, times: float = 1.0, signed: bool = False) -> Case:
    """A case with these logs, that says what they are or does not."""
    content = dict(load_case(SCARA).content)
    for run, label in RUNS.items():
        told = {"unsigned": True} if says_so and not signed else {}
        content[run] = content[run] | {"torque": {"file": label, **told}}
    content |= {"plant": {"kind": "model"}, "controller": {**content["controller"], "kind": "model"}}
    return load_case(content, folder=SCARA.parent, signals=logs(seed, times=times, signed=signed))


def errors_of(result: Result) -> list[float]:
    """Errors of the values, over their standard deviations."""
    return [(p.value - truth()[name]) / p.std for name, p in result.parameters.items()]


def measured(seed: int, times: float, *, signed: bool) -> dict[str, Any]:
    """One identification."""
    row: dict[str, Any] = {"seed": seed, "times": times, "signed": signed}
    try:
        found = identify(case_of(seed, times=times, signed=signed))
    except FmuDidimError as error:
        return row | {"converged": False, "verdict": "refused", "why": str(error), "inside": [], "errors": []}
    inside = [bool(p.interval[0] <= truth()[name] <= p.interval[1]) for name, p in found.parameters.items()]
    return row | {
        "converged": found.converged, "verdict": found.verdict, "names": list(found.parameters),
        "inside": inside, "errors": errors_of(found),
    }  # fmt: skip


def share(inside: Sequence[Sequence[bool]]) -> tuple[float, float]:
    """Percent of the intervals that hold, and its standard deviation from the scatter between runs."""
    each = 100 * np.mean(np.array(inside, dtype=float), axis=1)
    return float(each.mean()), float(each.std(ddof=1) / np.sqrt(each.size))


HEADS = ("log", "noise", "seeds", "converged", "valid", "intervals that hold", "of one value at least", "largest error")


def texts(rows: Sequence[dict[str, Any]], ranges: Sequence[tuple[int, int]]) -> dict[str, str | list[str]]:
    """What the page shows."""
    parts = [*((f"{first} to {last}", first, last) for first, last in ranges), ("all", 0, sys.maxsize)]
    lines: list[tuple[str, ...]] = []
    found: dict[str, str | list[str]] = {}
    for times in TIMES:
        for signed in (False, True):
            for seeds, first, last in parts:
                own = [r for r in rows if (r["times"], r["signed"]) == (times, signed) and first <= r["seed"] <= last]
                ended = [r for r in own if r["inside"]]
                mean, deviation = share([r["inside"] for r in ended])
                count = f"{sum(r['converged'] for r in own)} of {len(own)}"
                valid = f"{sum(r['verdict'] == 'valid' for r in own)} of {len(own)}"
                each = np.mean([r["inside"] for r in ended], axis=0)
                least = f"{100 * each.min():.0f} % ({ended[0]['names'][int(each.argmin())]})"
                worst = max(abs(e) for r in ended for e in r["errors"])
                holds = f"{mean:.1f} ± {deviation:.1f} %"
                kind = "with signs" if signed else "sizes alone"
                lines.append((kind, f"{times:g} times", seeds, count, valid, holds, least, f"{worst:.1f} σ"))
                if seeds == "all":
                    name = f"{'signed' if signed else 'unsigned'}_{times:g}"
                    found |= {name: holds, f"{name}.converged": count}
    return {"table": table(HEADS, lines), **found}


def pair(text: str) -> tuple[int, int]:
    """FIRST-LAST."""
    first, last = text.split("-")
    return int(first), int(last)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.unsigned", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seeds", type=pair, nargs="+", default=[(1001, 1040), (2001, 2040)], metavar="FIRST-LAST")
    parser.add_argument("--figures", type=Path, help="file of figures for docs/include.py")
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(given)
    rows = []
    for first, last in options.seeds:
        for seed in range(first, last + 1):
            rows += [measured(seed, times, signed=signed) for times in TIMES for signed in (False, True)]
            print(seed, [row["verdict"] for row in rows[-4:]], file=sys.stderr, flush=True)
    found = texts(rows, options.seeds)
    print("\n".join(found["table"]))
    if options.figures:
        write_figures(options.figures, command_of("tests.tools.unsigned", given), found, data=rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
