"""Command line.

python -m tests.tools.known_ripples make FOLDER --seeds 12 --levels 0.3 0.5 0.8 --clean 12   plants
python -m tests.tools.known_ripples make FOLDER --seeds 0 --clean 0 --others                  those of other effects
python -m tests.tools.known_ripples run FOLDER [--stated nothing right wrong]                discovery on each
python -m tests.tools.known_ripples score FOLDER [--figures FILE]                            what was named
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from fmu_didim import discover
from tests.figures import command_of, write_figures
from tests.tools.blind.simulator.hidden import EFFECTS
from tests.tools.known_ripples.cases import STATED, make, make_other, stated
from tests.tools.known_ripples.score import RIPPLES, figures_of, read, text

RATES = (100, 20)
OTHERS = tuple(effect for effect in EFFECTS if effect not in RIPPLES)


def main(arguments: Sequence[str] | None = None) -> int:
    """0: done; 2: wrong usage."""
    parser = argparse.ArgumentParser(prog="python -m tests.tools.known_ripples", description=__doc__)
    parser.add_argument("what", choices=("make", "run", "score"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, default=12, help="plants of each level (12)")
    parser.add_argument("--levels", type=float, nargs="*", default=[0.3, 0.5, 0.8], help="gaps, in noise deviations")
    parser.add_argument("--clean", type=int, default=12, help="plants without a ripple (12)")
    parser.add_argument("--others", action="store_true", help="a plant of each other effect, without a ripple")
    parser.add_argument("--stated", nargs="+", choices=STATED, default=list(STATED))
    parser.add_argument("--only", default="*", metavar="PATTERN", help="names of the plants that are run (all)")
    parser.add_argument("--figures", type=Path, help="file of figures for docs/include.py")
    options = parser.parse_args(arguments)
    if options.what == "make":
        for level, count in [*((level, options.seeds) for level in options.levels), (0.0, options.clean)]:
            for seed in range(1, count + 1):
                make(options.folder, seed, level, RATES)
        for seed, effect in enumerate(OTHERS if options.others else (), start=1):
            make_other(options.folder, effect, seed, RATES)
    elif options.what == "run":
        _run(options.folder, options.only, options.stated)
    else:
        found = read(options.folder)
        print(text(found))
        if options.figures:
            given = ["score", options.folder.name, "--figures", str(options.figures)]
            write_figures(options.figures, command_of("tests.tools.known_ripples", given), figures_of(found))
    return 0


def _run(folder: Path, only: str, what: Sequence[str]) -> None:
    for case in sorted(path.parent for path in folder.glob(f"{only}/motor.json")):
        for how in what:
            if (how == "wrong" and not json.loads((case / "motor.json").read_text())["hidden"]) or (
                case / how / "result" / "findings.json"
            ).is_file():
                continue
            begin = time.monotonic()
            try:
                discover(stated(case, case / how, how), case / how / "result")
            except Exception as error:  # noqa: BLE001 - one bad case must not end the rest; it is counted
                print(f"{case.name} {how}: {type(error).__name__}: {error}", flush=True)
            print(f"{case.name} {how}: {time.monotonic() - begin:.1f} s", flush=True)


if __name__ == "__main__":
    sys.exit(main())
