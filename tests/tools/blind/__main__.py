"""Command line.

python -m tests.tools.blind make FOLDER --seeds 20 --rates 100 20     make cases
python -m tests.tools.blind FOLDER --out FILE [--score]               run discovery on cases, and score it
python -m tests.tools.blind publish CSV FOLDER FILE [FOLDER FILE ...] all cases of campaigns as a table
python -m tests.tools.blind publish CSV --figures JSON                what the documentation says of that table
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

# Several cases run at once: threads of the linear algebra would only get into each other's way.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from tests.figures import command_of, write_figures
from tests.tools.blind.campaign import PAIRS, make_campaign
from tests.tools.blind.harness import by_campaign, case_folders, read_lines
from tests.tools.blind.publish import collected, figures, read_rows, write_rows
from tests.tools.blind.score import read_truth, score, text
from tests.tools.blind.simulator.hidden import CURVES, EFFECTS, GEARS, LIMITS, UNKNOWN


def main(arguments: Sequence[str] | None = None) -> int:
    """0: done, and every bar is reached if scored; 1: a bar is missed; 2: wrong usage."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given[:1] == ["make"]:
        return _make(given[1:])
    if given[:1] == ["publish"]:
        return _publish(given[1:])
    parser = argparse.ArgumentParser(prog="python -m tests.tools.blind", description="Run discovery on blind cases.")
    parser.add_argument("folder", type=Path, help="folder of case folders")
    parser.add_argument("--out", type=Path, required=True, help="file of JSON lines, one a case")
    parser.add_argument("--work", type=Path, help="keep translated cases and the campaign there, and go on with it")
    parser.add_argument("--only", nargs="+", default=[], metavar="CASE", help="only these cases")
    parser.add_argument("--jobs", type=int, default=1, help="processes (1)")
    parser.add_argument("--plant", choices=("model", "fmu"), default="model", help="how plant and controller run")
    parser.add_argument("--score", action="store_true", help="compare with the truth afterwards")
    parser.add_argument(
        "--findings-only", action="store_true", help="write no models and reports, which takes half the time"
    )
    parser.add_argument("--no-run", action="store_true", help="score the lines that --out already holds")
    options = parser.parse_args(given)
    try:
        folders = case_folders(options.folder, options.only)
    except FileNotFoundError as error:
        parser.error(str(error))
    if options.no_run:
        lines = read_lines(options.out)
    else:
        with tempfile.TemporaryDirectory() as scratch:
            lines = by_campaign(
                folders, options.out, options.work or Path(scratch), jobs=options.jobs, plant=options.plant,
                files=not options.findings_only,
            )  # fmt: skip
    if not options.score:
        return 0
    truths = {folder.name: read_truth(folder) for folder in folders}
    found = score([line for line in lines if line["case"] in truths], truths)
    print(text(found))
    return 0 if found.passed else 1


def _publish(given: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.tools.blind publish", description="Publish campaigns.")
    parser.add_argument("csv", type=Path, help="table of cases, one row each")
    parser.add_argument(
        "campaigns", type=Path, nargs="*", metavar="FOLDER FILE", help="write the table anew: cases and their lines"
    )
    parser.add_argument("--figures", type=Path, help="file of figures for docs/include.py, from the table alone")
    options = parser.parse_args(given)
    if len(options.campaigns) % 2:
        parser.error("every folder of cases needs its file of lines")
    if options.campaigns:
        write_rows(options.csv, *collected(list(zip(options.campaigns[::2], options.campaigns[1::2], strict=True))))
    found = figures(*read_rows(options.csv))
    if options.figures:
        arguments = ["publish", str(options.csv), "--figures", str(options.figures)]
        write_figures(options.figures, command_of("tests.tools.blind", arguments), found)
    print("\n".join([*found["criteria"], "", *found["matrix"]]))
    return 0


def _make(given: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.tools.blind make", description="Make blind cases.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, default=20, help="cases of each effect (20)")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--rates", type=int, nargs="+", default=[100, 20], help="torque rates in Hz (100 20)")
    parser.add_argument("--effects", nargs="*", metavar="EFFECT", default=[*EFFECTS, *UNKNOWN, *PAIRS],
                        help="effects, or two of them as one+other (all of them, and a choice of pairs)")  # fmt: skip
    parser.add_argument(
        "--level", type=float, default=2.0, help="gap after refitting the base, in noise deviations (2)"
    )
    parser.add_argument(
        "--clean", type=int, default=20, help="cases that hide nothing, half of them without clutter (20)"
    )
    parser.add_argument("--triples", type=int, default=0, help="cases that hide three effects, drawn anew (0)")
    parser.add_argument("--robots", choices=("varied", "development"), default="varied")
    parser.add_argument("--one-joint", action="store_true", help="all effects of a plant act on one of its joints")
    parser.add_argument("--reach", type=float, default=1.0, help="times the limit of an effect that it may reach (1)")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(given)
    known = {**EFFECTS, **UNKNOWN, **CURVES, **GEARS, **LIMITS}
    unknown = [e for name in options.effects for e in name.split("+") if e not in known]
    if unknown:
        parser.error(f"unknown effects {', '.join(unknown)}; valid: {', '.join(known)}")
    count = make_campaign(
        options.folder, options.effects, seeds=range(options.first_seed, options.first_seed + options.seeds),
        rates=options.rates, level=options.level, clean=options.clean, triples=options.triples, robots=options.robots,
        one_joint=options.one_joint, reach=options.reach, jobs=options.jobs,
    )  # fmt: skip
    print(f"{count} cases in {options.folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
