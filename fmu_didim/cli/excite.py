"""The verb ``excite`` on the command line: its options and what it prints."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fmu_didim.base.terminal import quoted
from fmu_didim.cli.console import since_start
from fmu_didim.cli.numbers import at_least_one, at_least_two, not_negative, positive
from fmu_didim.cli.saved import show_and_save

if TYPE_CHECKING:
    from fmu_didim.workflow.excitation.excited import Excited


def add_excite_options(verb: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    help_ = "folder for reference.yaml, reference.csv and excite.json (results/<case>_excite)"
    verb.add_argument("--out", type=Path, metavar="DIR", help=help_)
    help_ = "position, velocity, acceleration, torque, start (else as the case has them); inside, boxes, capsules"
    verb.add_argument("--limits", type=Path, metavar="LIMITS.yaml", help=help_)
    help_ = "standard deviation of the torque noise of each joint, such as 0.2,0.05 (torque_std of the case)"
    verb.add_argument("--torque-std", type=_several, metavar="LIST", help=help_)
    verb.add_argument("--rate", type=positive, metavar="HZ", help="of the torque log (that of the case)")
    help_ = "parameters that matter, such as ZZ1R,Fc1; the others are unknown, too (all)"
    verb.add_argument("--only", type=_names, default=(), metavar="LIST", help=help_)
    help_ = "what is made best: the determinant of their information, or the mean of their %%σ (determinant)"
    verb.add_argument("--criterion", choices=("determinant", "mean"), default="determinant", help=help_)
    help_ = "a Fourier series, or moves between points, at rest at each (fourier)"
    verb.add_argument("--kind", choices=("fourier", "point_to_point"), default="fourier", help=help_)
    verb.add_argument("--harmonics", type=at_least_two, metavar="N", help="of the Fourier series (5)")
    verb.add_argument("--moves", type=at_least_two, metavar="N", help="from point to point in a period (10)")
    verb.add_argument("--dwell", type=positive, metavar="SECONDS", help="rest after each move (none)")
    verb.add_argument("--period", type=positive, metavar="SECONDS", help="of the motion (that of the case's reference)")
    verb.add_argument("--periods", type=at_least_one, metavar="N", help="number of them (those of that reference)")
    verb.add_argument("--starts", type=at_least_one, default=6, metavar="N", help="random motions to begin from (6)")
    verb.add_argument("--seed", type=not_negative, default=0, metavar="N", help="of them (0)")
    verb.add_argument("--experiment", metavar="LABEL", help="whose loop and log are meant (the first one)")
    help_ = (
        "weights for the last link, kg, of which the best is named: 0.5,1,2; the case has a run without and one with"
    )
    verb.add_argument("--weigh", type=_several, default=(), metavar="LIST", help=help_)
    help_ = "where their centre may be, m in the frame of the last link, as --at=0.1,0,0.05; again for other places"
    verb.add_argument("--at", type=_place, action="append", default=[], metavar="X,Y,Z", help=help_)
    shown = verb.add_mutually_exclusive_group()
    shown.add_argument("--quiet", action="store_true", help="print the tables only")
    shown.add_argument("--json", action="store_true", help="print excite.json and nothing else")


def run_excite(options: argparse.Namespace, stem: Callable[[Path], str]) -> int:
    """Design the motion on which the torque log of a case will tell most of the parameters, and predict how much.

    The exit code is 0, 4 with doubts, 1 where something stands against running it.
    """
    out = options.out or Path("results") / f"{stem(options.case)}_excite"

    def make(progress: Callable[[str], None]) -> Excited:
        from fmu_didim.workflow.excitation.excite import excite

        return excite(
            options.case, limits=options.limits, only=options.only, criterion=options.criterion,
            kind=options.kind, harmonics=options.harmonics, moves=options.moves, dwell_s=options.dwell,
            period_s=options.period, periods=options.periods, rate_hz=options.rate, torque_std=options.torque_std,
            starts=options.starts, seed=options.seed, experiment=options.experiment, weigh=options.weigh,
            at=options.at, progress=progress,
        )  # fmt: skip

    def last(written: Sequence[Path]) -> str:
        return f"Run it, and name it in the case as {quoted(written[0])} has it.   ({since_start():.1f} s)"

    return show_and_save(options, out, make, last)


def _several(text: str) -> tuple[float, ...]:
    """Numbers above 0 between commas; raises ArgumentTypeError."""
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if not values or not all(math.isfinite(value) and value > 0 for value in values):
        raise argparse.ArgumentTypeError(f"it takes numbers above 0 between commas, not '{text}'")
    return values


def _place(text: str) -> tuple[float, ...]:
    """Three numbers between commas; raises ArgumentTypeError."""
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != 3 or not all(map(math.isfinite, values)):
        raise argparse.ArgumentTypeError(f"it takes x,y,z in m, three numbers between commas, not '{text}'")
    return values


def _names(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())
