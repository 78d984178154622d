"""Machines whose controller is hidden, drawn by seed: is it named by its log?

    python -m tests.tools.hidden_controllers make FOLDER --seeds 1 20      write cases, to be looked at by hand
    python -m tests.tools.hidden_controllers run FILE --seeds 1 20         name the laws; one JSON line a case
    python -m tests.tools.hidden_controllers publish FILE [FILE ...] --figures docs/figures/controllers.json

``run`` goes on with a FILE that holds some of the cases. ``publish`` takes a file of figures, too, which holds its
cases. Seconds are those of the processor.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from multiprocessing import get_context
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # several cases run at once

from fmu_didim import InputError, name_controller
from tests.figures import command_of, write_figures
from tests.tools.hidden_controllers.draw import TITLES, draw
from tests.tools.hidden_controllers.score import Row, judged, lines, totals

ROBOTS, RATES = ("scara", "tx40"), (200.0, 20.0)
Key = tuple[str, str, float, int]
"""Robot, hidden law, rate of the log in Hz, seed."""


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.hidden_controllers", description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )  # fmt: skip
    parser.add_argument("what", choices=("make", "run", "publish"))
    parser.add_argument("paths", type=Path, nargs="+", metavar="FILE", help="folder of cases, or file of JSON lines")
    parser.add_argument("--seeds", type=int, nargs=2, default=(1, 20), metavar=("FIRST", "LAST"))
    parser.add_argument("--robots", nargs="+", choices=ROBOTS, default=ROBOTS)
    parser.add_argument("--rates", nargs="+", type=float, default=RATES, metavar="HZ", help="of the log (200 20)")
    parser.add_argument("--laws", nargs="+", choices=tuple(TITLES), default=tuple(TITLES))
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--tree", default="", help="of the code, for the file of figures")
    parser.add_argument("--figures", type=Path, help="file of figures for docs/include.py")
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(given)
    if options.what == "publish":
        _publish(options.paths, options.figures, given, options.tree)
        return 0
    (path,) = options.paths
    keys = list(_keys(options))
    if options.what == "make":
        for key in keys:
            folder = path / "_".join(f"{part:g}" if isinstance(part, float) else str(part) for part in key)
            folder.mkdir(parents=True, exist_ok=True)
            drawn = draw(*key)
            drawn.write(folder)
            (folder / "truth.json").write_text(json.dumps(dict(drawn.truth), indent=1), encoding="utf-8")
        return 0
    known = {key_of(row) for row in read_rows(path)}
    with path.open("a", encoding="utf-8") as stream:
        for row in _all([key for key in keys if key not in known], options.jobs):
            stream.write(json.dumps(row) + "\n")
            stream.flush()
            print(*key_of(row), row["verdict"], row["named"], f"{row['seconds']:.0f} s", flush=True)
    return 0


def _keys(options: argparse.Namespace) -> Iterator[Key]:
    """Seed by seed, so that a run that is ended holds all kinds."""
    seeds = range(options.seeds[0], options.seeds[1] + 1)
    for seed, robot, rate, law in itertools.product(seeds, options.robots, options.rates, options.laws):
        yield robot, law, rate, seed


def key_of(row: Row) -> Key:
    """Of a line."""
    return row["robot"], row["hidden"], row["log_hz"], row["seed"]


def read_rows(path: Path) -> list[Row]:
    """The lines of a file, or the cases of a file of figures; none where it is not there."""
    if path.suffix == ".json":
        return list(json.loads(path.read_text(encoding="utf-8"))["data"]["rows"])
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    return [json.loads(line) for line in text.splitlines()]


def _all(keys: Sequence[Key], jobs: int) -> Iterator[Row]:
    if jobs == 1:
        yield from map(one, keys)
        return
    with get_context("spawn").Pool(jobs, maxtasksperchild=8) as pool:
        yield from pool.imap_unordered(one, keys)


def one(key: Key) -> Row:
    """A case: drawn, named and judged."""
    robot, hidden, log_hz, seed = key
    drawn = draw(robot, hidden, log_hz, seed)  # type: ignore[arg-type]
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        path = drawn.write(Path(folder))
        try:
            row = judged(hidden, drawn.truth, name_controller(path))
        except InputError as error:
            row = {"verdict": "refused", "named": error.what, "set": [], "codes": [], "law": drawn.truth["law"],
                   "right_law": False, "right_set": False, "gains": {}, "scale": []}  # fmt: skip
    own: Row = {"robot": robot, "hidden": hidden, "log_hz": log_hz, "seed": seed}
    return own | row | {"seconds": time.process_time() - began}


def texts(data: Mapping[str, Any]) -> dict[str, str | list[str]]:
    """What the page shows of the rows of cases."""
    rows: list[Row] = list(data["rows"])
    found: dict[str, str | list[str]] = {**totals(rows), "table": lines(rows)}
    for robot, rate in itertools.product(ROBOTS, RATES):
        own = [row for row in rows if (row["robot"], row["log_hz"]) == (robot, rate)]
        if own:
            found |= {f"{robot}_{rate:g}.{name}": text for name, text in totals(own).items()}
            seeds = sorted({row["seed"] for row in own})
            found[f"{robot}_{rate:g}.seeds"] = ", ".join(map(str, seeds))
            found[f"{robot}_{rate:g}.seconds"] = f"{sum(row['seconds'] for row in own) / len(own):.0f} s"
    return found


def _publish(paths: Sequence[Path], figures: Path | None, given: Sequence[str], tree: str) -> None:
    data = {"tree": tree, "rows": sorted((row for path in paths for row in read_rows(path)), key=key_of)}
    found = texts(data)
    if figures is not None:
        write_figures(figures, command_of("tests.tools.hidden_controllers", given), found, data=data)
    for name, text in found.items():
        print(f"{name}: {text}" if isinstance(text, str) else "\n".join(text))


if __name__ == "__main__":
    sys.exit(main())
