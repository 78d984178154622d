"""Command line.

python -m tests.tools.acrobot make LEADERBOARD FOLDER [--robot pendubot]   cases of the drives, without the pulses
python -m tests.tools.acrobot run FOLDER --jobs 2                          discovery on each
python -m tests.tools.acrobot score LEADERBOARD FOLDER [--figures FILE]    windows against the pulses
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from tests.figures import command_of, write_figures
from tests.tools.acrobot.cases import pulses, read, runs_of, write_cases
from tests.tools.acrobot.run import RESULT, discovered
from tests.tools.acrobot.score import figures_of, scored, text


def main(arguments: Sequence[str] | None = None) -> int:
    """0: done; 2: wrong usage."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.acrobot", description="Pulses on a real double pendulum."
    )
    parser.add_argument("what", choices=("make", "run", "score"))
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER", help="LEADERBOARD (not for run), FOLDER")
    parser.add_argument("--robot", choices=("acrobot", "pendubot"), default="acrobot")
    parser.add_argument("--least", type=float, default=0.5, help="smallest pulse that is asked for, N.m (0.5)")
    parser.add_argument("--time-limit", type=float, help="seconds of search for a name in each run (none)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (1)")
    parser.add_argument("--figures", type=Path, help="file of figures for docs/include.py")
    options = parser.parse_args(arguments)
    if len(options.folders) != (1 if options.what == "run" else 2):
        parser.error("make and score take LEADERBOARD and FOLDER, run takes FOLDER")
    folder = options.folders[-1]
    if options.what == "run":
        with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
            search = partial(discovered, time_limit=options.time_limit)
            list(pool.map(search, sorted(folder.glob("*/case.yaml"))))
        return 0
    try:
        runs = runs_of(options.folders[0], options.robot)
    except FileNotFoundError as error:
        parser.error(str(error))
    if options.what == "make":
        print(f"{write_cases(runs, folder)} cases in {folder}")
        return 0
    found = [
        scored(name, json.loads(path.read_text("utf-8")), pulses(read(log), options.least), least=options.least,
               log=read(log))
        for name, log in runs if (path := folder / name / RESULT / "findings.json").is_file()
    ]  # fmt: skip
    print(text(found))
    if options.figures:
        chosen = ["--robot", options.robot, "--least", f"{options.least:g}"]
        command = command_of("tests.tools.acrobot", ["score", "leaderboard", "FOLDER", *chosen])
        write_figures(options.figures, command, figures_of(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
