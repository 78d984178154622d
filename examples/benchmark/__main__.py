"""Command line: ``python -m examples.benchmark OUT``, from the folder of the project."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

# One case a process: threads of the linear algebra would only get into each other's way.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from examples.benchmark.cases import CLEAN, FIRST_SEED, KINDS, OUTSIDE, SEEDS, Order, made
from examples.benchmark.methods import METHODS, NEEDS, TITLES
from examples.benchmark.run import run
from examples.benchmark.score import GROUPS, counted, texts
from fmu_didim.base.errors import InputError
from tests.figures import command_of, write_figures
from tests.tools.blind.score import read_truth


def main(arguments: Sequence[str] | None = None) -> int:
    """0: done; 2: wrong usage."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    parser = _parser()
    options = parser.parse_args(given)
    missing = {m: NEEDS[m] for m in options.methods if m in NEEDS and find_spec(NEEDS[m]) is None}
    order = Order(tuple(options.kinds), options.first_seed, options.seeds, options.clean)
    if options.figures and (missing or set(options.methods) != set(METHODS) or order != Order()):
        install = f" Install them first: pip install {' '.join(missing.values())}" if missing else ""
        parser.error(f"--figures is for all methods on the published cases.{install}")
    for method, package in missing.items():
        print(f"{TITLES[method]} is left out: it needs {package} (pip install {package}).", file=sys.stderr)
    options.out.mkdir(parents=True, exist_ok=True)
    try:
        folders = made(options.out, order, jobs=options.jobs)
    except InputError as error:
        parser.error(str(error))
    chosen = [method for method in METHODS if method in options.methods and method not in missing]
    lines = {method: run(folders, options.out, method, jobs=options.jobs) for method in chosen}
    # Only here, when all answers are there, is the truth opened.
    data = {
        "order": asdict(order),
        "packages": {NEEDS[method]: version(NEEDS[method]) for method in chosen if method in NEEDS},
        "methods": counted(lines, {folder.name: read_truth(folder) for folder in folders}),
    }
    shown = texts(data)
    if options.figures:
        command = command_of("examples.benchmark", ["OUT", "--figures", str(options.figures)])
        write_figures(options.figures, command, shown, data=data)
    for name, title in {**GROUPS, "kinds": "right, by what is hidden", "cost": "parameters and time"}.items():
        print("\n".join([f"\n{title}\n", *shown[name]]))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m examples.benchmark", description="Make cases, run methods on them, and score their answers."
    )
    parser.add_argument("out", type=Path, metavar="OUT", help="folder; what is there is not made or run again")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS), help="(all)")
    kinds = (*KINDS, *OUTSIDE)
    parser.add_argument("--kinds", nargs="+", choices=kinds, default=list(kinds), help="of what is hidden (all)")
    parser.add_argument("--seeds", type=int, default=SEEDS, help=f"plants of each kind ({SEEDS})")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED, help=f"({FIRST_SEED})")
    parser.add_argument("--clean", type=int, default=CLEAN, help=f"plants that hide nothing ({CLEAN})")
    parser.add_argument("--jobs", type=int, default=1, help="processes (1)")
    parser.add_argument("--figures", type=Path, metavar="JSON", help="file of figures for docs/include.py")
    return parser


if __name__ == "__main__":
    sys.exit(main())
