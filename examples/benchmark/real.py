"""Logs of real machines, of which something is known by other means than a method of this benchmark.

    python -m examples.benchmark.real --figures docs/figures/benchmark_real.json

Both are of the EMPS (``examples/emps``; its data are no part of the project, and a case that lacks them says where they
are found). What is known: that its friction is another one each way, by the authors of the data (A. Janot, M. Gautier,
M. Brunot, "Data set and reference models of EMPS", 2019), and that pulses of 5 V were added to the command of the
second log, which the case does not tell. Friction at low speed is neither right nor wrong: nobody knows its law.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from examples.benchmark.methods import METHODS, NEEDS, TITLES
from examples.benchmark.run import line_of
from examples.benchmark.score import HEADS, OUTCOMES, outcome
from fmu_didim import load_case
from fmu_didim.base.errors import InputError
from tests.figures import command_of, table, write_figures
from tests.tools.blind.score import Truth

EXAMPLES = Path(__file__).resolve().parents[1]
LOW_SPEED = frozenset({"stribeck", "presliding", "lugre"})


@dataclass(frozen=True)
class Log:
    """A log of a real machine.

    Attributes:
        title: in words; case: that a user would write; known: effect and joint that are there.
        open: effects of which nobody knows whether they are there, or that are known to be there beside it.
    """

    title: str
    case: Path
    known: tuple[str, int]
    open: frozenset[str]

    def outcome(self, line: Mapping[str, Any]) -> str:
        """One of ``OUTCOMES``, by the first name that is not open."""
        judged = {**line, "findings": [name for name in line["findings"] if name["effect"] not in self.open]}
        return outcome(judged, Truth((self.known,), math.inf, False, math.nan))


LOGS = (
    Log(
        "EMPS: friction is another one each way", EXAMPLES / "emps/discover.yaml", ("asymmetric_viscous", 1), LOW_SPEED,
    ),
    Log(
        "EMPS: pulses were added", EXAMPLES / "emps/discover_pulses.yaml", ("external_force", 1),
        LOW_SPEED | {"asymmetric_viscous"},
    ),
)  # fmt: skip


def cell(log: Log, line: Mapping[str, Any]) -> str:
    """What a method says of a log, and what that is worth."""
    worth = HEADS[OUTCOMES.index(log.outcome(line))]
    names = [name["effect"].replace("_", " ") for name in line["findings"]]
    return f"{worth}: {', '.join(names) or line['verdict']}"


def main(arguments: Sequence[str] | None = None) -> int:
    """0: done; 2: wrong usage, or data that are not there."""
    parser = argparse.ArgumentParser(prog="python -m examples.benchmark.real", description=__doc__.split("\n")[0])
    parser.add_argument("--figures", type=Path, metavar="JSON", help="file of figures for docs/include.py")
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(given)
    missing = {method: package for method, package in NEEDS.items() if find_spec(package) is None}
    if options.figures and missing:
        parser.error(f"--figures is for all methods. Install them first: pip install {' '.join(missing.values())}")
    try:
        for log in LOGS:
            load_case(log.case)
    except InputError as error:
        parser.error(str(error))
    methods = [method for method in METHODS if method not in missing]
    lines = {
        log.title: {method: line_of(log.title, lambda m=method, c=log.case: METHODS[m](c)) for method in methods}
        for log in LOGS
    }
    rows = [[TITLES[m], *(cell(log, lines[log.title][m]) for log in LOGS)] for m in methods]
    shown = table(["method", *(log.title for log in LOGS)], rows)
    print("\n".join(shown))
    if options.figures:
        packages = {name: version(name) for name in NEEDS.values()}
        write_figures(
            options.figures, command_of("examples.benchmark.real", given), {"table": shown},
            data={"packages": packages, "lines": lines},
        )  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
