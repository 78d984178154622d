"""Calibrates FMUs of other tools by the command line, beside scipy's fit of the same data, for the page on them.

    git clone https://github.com/OWNER/NAME CHECKOUTS/OWNER/NAME
    pythonfmu build -f tests/tools/calibrated/tank.py -d CHECKOUTS/NTNU-IHB/PythonFMU    # pip install pythonfmu
    python -m tests.tools.calibrated CHECKOUTS --draws 100 --figures docs/figures/calibrated.json

The data are what FMPy simulates with known values, and white noise. The programs in the FMUs are those of others and
run here: use a machine without secrets. A trial whose repository is not in CHECKOUTS is left out, and so said.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from tests.figures import command_of, table, write_figures
from tests.tools.calibrated.outcome import Outcome, covered, discovered, tried
from tests.tools.calibrated.trials import COVERED, TRIALS, Trial

HEADS = ("FMU", "made by", "sought", "lines of YAML (edited)", "verdict", "from scipy's optimum", "σ over scipy's", "s")
COVERAGE_HEADS = ("FMU", "draws", "valid", "true values within their 95 % intervals")


def row(trial: Trial, outcome: Outcome) -> tuple[str, ...]:
    """The outcome in words."""
    low, high = outcome.ratio
    return (
        f"{trial.name} ({trial.repository})", trial.made_by, ", ".join(trial.truth),
        f"{outcome.lines} ({outcome.edits})", outcome.verdict, f"{outcome.apart:.1e} σ", f"{low:.3f}–{high:.3f}",
        f"{outcome.seconds:.1f}",
    )  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.calibrated", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("checkouts", type=Path, help="folder with OWNER/NAME below it")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="these trials", default=[t.name for t in TRIALS])
    parser.add_argument(
        "--discover", action="store_true", help="also how long identify and discover take, and the processor for them"
    )
    parser.add_argument("--draws", type=int, default=0, help="of the noise, for the coverage of some of them")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--figures", type=Path, help="file for the figures of the page")
    asked = parser.parse_args(arguments)
    rows, coverage, left_out = [], [], []
    with tempfile.TemporaryDirectory() as name:
        for trial in (t for t in TRIALS if t.name in asked.only):
            fmu, folder = trial.path(asked.checkouts), Path(name, trial.name)
            if not fmu.is_file():
                left_out.append(trial.name)
                print(f"{trial.name}: {fmu} is not there", file=sys.stderr)
                continue
            outcome = tried(trial, fmu, folder, asked.seed)
            rows.append(row(trial, outcome))
            print(" | ".join(rows[-1]), flush=True)
            if asked.discover:
                for verb, taken in (("identify", (outcome.seconds, outcome.cpu_s)), ("discover", discovered(folder))):
                    print(f"{trial.name} | {verb}: {taken[0]:.1f} s, {taken[1]:.1f} s of the processor", flush=True)
            if asked.draws and trial.name in COVERED:
                share, valid = covered(trial, fmu, folder.with_name(f"{trial.name}-draws"), asked.draws, asked.seed)
                coverage.append((trial.name, str(asked.draws), str(valid), f"{100 * share:.1f} %"))
                print(" | ".join(coverage[-1]), flush=True)
    if asked.figures and not left_out:
        figures = {"trials": table(HEADS, rows)} | ({"coverage": table(COVERAGE_HEADS, coverage)} if coverage else {})
        given = sys.argv[1:] if arguments is None else arguments
        shown = [a if a != str(asked.checkouts) else "CHECKOUTS" for a in given]
        write_figures(asked.figures, command_of("tests.tools.calibrated", shown), figures)
    return 1 if left_out else 0


if __name__ == "__main__":
    sys.exit(main())
