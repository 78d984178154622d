"""Command line.

python -m tests.tools.changes make FOLDER --pairs 200 --seed 1     draw pairs of logs
python -m tests.tools.changes run FOLDER --out FILE --jobs 2       compare them; what FILE holds is not run again
python -m tests.tools.changes score FOLDER --out FILE [--figures JSON]    beside the truth
python -m tests.tools.changes histories FOLDER --out FILE --seed 1    a history of each cause, made, watched and scored
python -m tests.tools.changes results FOLDER --machines 12 --histories 60 --seed 1    histories of drawn results, scored
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

# Several pairs run at once: threads of the linear algebra would only get into each other's way.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from tests.conftest import ROOT
from tests.figures import command_of, write_figures
from tests.tools.changes.draw import CAUSES, PLAN, draw, write, write_history
from tests.tools.changes.results import counted, figures
from tests.tools.changes.run import read_lines, run, run_history
from tests.tools.changes.score import by_cause, criteria, histories, judged, shares, truth_of


def main(arguments: Sequence[str] | None = None) -> int:
    """0: done; 2: wrong usage."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    parser = argparse.ArgumentParser(prog="python -m tests.tools.changes", description="Pairs of logs, compared.")
    parser.add_argument("what", choices=("make", "run", "score", "histories", "results"))
    parser.add_argument("folder", type=Path, help="folder of pairs")
    parser.add_argument("--pairs", type=int, default=200, help="how many (200)")
    parser.add_argument("--seed", type=int, default=1, help="of the draws (1)")
    parser.add_argument("--out", type=Path, help="file of JSON lines, one a pair")
    parser.add_argument("--jobs", type=int, default=1, help="processes (1)")
    parser.add_argument("--machines", type=int, default=12, help="whose results are drawn (12)")
    parser.add_argument("--histories", type=int, default=60, help="of each machine (60)")
    parser.add_argument("--figures", type=Path, help="file of figures for docs/include.py")
    options = parser.parse_args(given)
    if options.what == "make":
        for number in range(options.pairs):
            write(draw(number, options.seed), options.folder / f"p{number:03d}")
        return 0
    if options.what == "results":
        return _results(options, command_of("tests.tools.changes", given))
    if options.out is None:
        parser.error("--out is missing")
    if options.what == "run":
        run(sorted(path.parent for path in options.folder.glob("*/truth.json")), options.out, jobs=options.jobs)
        return 0
    if options.what == "histories":
        return _histories(options)
    lines = read_lines(options.out)
    truths = {line["pair"]: truth_of(options.folder / line["pair"]) for line in lines}
    rows = {line["pair"]: judged(line, truths[line["pair"]]) for line in lines}
    for line in sorted(lines, key=lambda line: str(line["pair"])):
        row, truth = rows[line["pair"]], truths[line["pair"]]
        if row.alarm or (row.truth and not row.right) or row.wrong:
            hidden = "; ".join(f"{c['cause']} {c['joint']} {c['size']}" for c in truth["changes"]) or "nothing"
            said = " | ".join(" & ".join(p[2] for p in cause) for cause in line["causes"][:4])
            print(
                f"{line['pair']} {truth['robot']} {truth['rate_hz']} Hz{' clutter' * truth['clutter']}"
                f"{' other motion' * truth['other_motion']}{' repaired' * truth['repaired']}: {hidden} -> "
                f"{line['answer']} {line['verdict']} {line.get('error', said)} {','.join(line['codes'])}"
            )  # fmt: skip
    found = list(rows.values())
    print("\n".join([*criteria(found), "", *by_cause(found)]))
    if options.figures:
        seeds = sorted({truth["seed"] for truth in truths.values()})
        counts = {f"{key}_cases": f"{good} of {count}" for key, (good, count) in shares(found).items()}
        write_figures(
            options.figures, command_of("tests.tools.changes", given),
            {"pairs": str(len(lines)), "seeds": ", ".join(map(str, seeds)),
             "tree": _tree(), "criteria": criteria(found), "causes": by_cause(found), **counts},
        )  # fmt: skip
    return 0


def _results(options: argparse.Namespace, command: str) -> int:
    asked = (options.seed, options.machines, options.histories)
    found = figures(counted(*asked, options.folder), options.machines, options.histories, options.seed)
    print("\n".join(found["criteria"]))
    if options.figures:
        write_figures(options.figures, command, found | {"tree": _tree()})
    return 0


def _tree() -> str:
    """The last commit that changed the package."""
    asked = ["git", "log", "-1", "--format=%h", "--", "fmu_didim"]
    return subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


def _histories(options: argparse.Namespace) -> int:
    folders = []
    for cause in CAUSES:
        number = PLAN.index(cause) + len(PLAN) * (PLAN.index(cause) // 2 % 2)  # half of them at each rate
        folders.append(options.folder / f"h{number:03d}")
        if not folders[-1].exists():
            write_history(number, options.seed, folders[-1])
    lines = run(folders, options.out, jobs=options.jobs, what=run_history)
    truths = [truth_of(options.folder / str(line["pair"])) for line in lines]
    found = histories(lines, truths)
    for line, truth in zip(lines, truths, strict=True):
        print(
            line["pair"], truth["robot"], truth["rate_hz"], truth["changes"], {k: line[k] for k in line if k != "pair"}
        )
    print(found)
    if options.figures:
        counts = {name: f"{good} of {count}" for name, (good, count) in found.items()}
        command = command_of("tests.tools.changes", sys.argv[1:])
        write_figures(
            options.figures, command,
            {"count": str(len(lines)), "seed": str(options.seed), "tree": _tree(), **counts},
        )  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
