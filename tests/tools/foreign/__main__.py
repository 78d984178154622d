"""What the check says of the FMUs and systems of public repositories, for the page on them.

    git clone https://github.com/OWNER/NAME CHECKOUTS/OWNER/NAME
    python -m tests.tools.foreign CHECKOUTS --figures docs/figures/foreign.json

The programs in them are those of others and run here: use a machine without secrets, and no network (``unshare -rn``).
A repository that is not in CHECKOUTS keeps the rows that it has, with their date.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from fmu_didim import __version__
from fmu_didim.base.cache import file_digest
from tests.figures import command_of, table, today, write_figures
from tests.tools.foreign.look import FAILS, REFUSED, RUNS, look

Record = Mapping[str, Any]
STRUCTURE = "SystemStructure.ssd"
SHOWN = 4
"""Names in a row of the table; of more only the number is told."""
FMU_HEADS = ("repository", "FMU", "made by", "FMI", "FMUs", "what the check says", "tried")
SYSTEM_HEADS = ("archives of", "what the archive is", "archives", "what happens", "tried")
UNKNOWN = "not recorded"
"""The commit of rows from before it was written down."""


def repositories(checkouts: Path) -> dict[str, Path]:
    """``owner/name`` -> folder, of all folders two levels below."""
    return {f"{p.parent.name}/{p.name}": p for p in sorted(checkouts.glob("*/*")) if p.is_dir()}


def records(repository: str, folder: Path, seen: set[str], say: Callable[[str], None]) -> Iterator[Record]:
    """One for each FMU and each system of a repository, those of equal content once.

    Args:
        seen: digests of the FMUs before; this adds to them.
    """
    shared = {
        "repository": repository, "commit": _commit(folder), "date": today(),
        "by": f"fmu_didim {__version__}, FMPy {version('fmpy')}, {_wine()}",
    }  # fmt: skip
    for path in sorted(folder.rglob("*.fmu")):
        digest = file_digest(path)
        if not path.is_file() or digest in seen:
            continue
        seen.add(digest)
        say(f"{repository}: {path.relative_to(folder)}")
        yield {**shared, "kind": "fmu", "names": [path.stem], "count": 1, **look(path)}
    for path in sorted(folder.rglob(STRUCTURE)):
        say(f"{repository}: {path.relative_to(folder)}")
        yield {**shared, "kind": "system", "names": [path.parent.name], "count": 1, **look(path)}


def _commit(folder: Path) -> str:
    done = subprocess.run(["git", "-C", str(folder), "rev-parse", "HEAD"], capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else UNKNOWN


def _wine() -> str:
    try:
        done = subprocess.run(["wine", "--version"], capture_output=True, text=True, check=False)
    except OSError:
        return "without Wine"
    return done.stdout.strip() or "without Wine"


def _letters(found: Sequence[Record]) -> dict[str, str]:
    """By which versions and when something was tried -> the letter that stands for it in the tables."""
    return {by: chr(ord("a") + k) for k, by in enumerate(dict.fromkeys(_tried(r) for r in found))}


def texts(found: Sequence[Record]) -> dict[str, str | list[str]]:
    """The tables, and the counts above them."""
    fmus, systems = ([r for r in found if r["kind"] == kind] for kind in ("fmu", "system"))

    def count(answer: str, of: Sequence[Record] = fmus) -> str:
        return str(sum(r["count"] for r in of if r["answer"] == answer))

    letters = _letters(found)
    total = sum(r["count"] for r in fmus)
    ours_alone = sum(r["count"] for r in fmus if r["answer"] != RUNS and r.get("peer") == RUNS)
    return {
        "fmus": str(total), "repositories": str(len({r["repository"] for r in fmus})),
        "run": count(RUNS), "fail": count(FAILS), "refused": count(REFUSED), "peer_runs": str(ours_alone),
        "table": table(FMU_HEADS, _rows(fmus, letters)),
        "tried": [f"* {letter}: {by}" for by, letter in letters.items()],
        "systems": table(SYSTEM_HEADS, _systems(systems, letters)),
    }  # fmt: skip


def _rows(fmus: Sequence[Record], letters: Mapping[str, str]) -> list[list[str]]:
    groups: dict[tuple[str, ...], list[Record]] = {}
    for r in fmus:
        key = (_place(r), r["answer"], r["made_by"] or "?", r["fmi"] or "?", _said(r), letters[_tried(r)])
        groups.setdefault(key, []).append(r)
    order = (RUNS, FAILS, REFUSED)
    rows = []
    for key in sorted(groups, key=lambda key: (key[0].lower(), order.index(key[1]), key[2], key[3], key[4])):
        repository, _, made_by, fmi, said, tried = key
        total = str(sum(r["count"] for r in groups[key]))
        rows.append([repository, _names(groups[key]), made_by, fmi, total, said, tried])
    return [[cell.replace("|", "\\|") for cell in row] for row in rows]


def _systems(systems: Sequence[Record], letters: Mapping[str, str]) -> list[list[str]]:
    groups: dict[tuple[str, ...], list[Record]] = {}
    for r in systems:
        groups.setdefault((_place(r), _said(r), letters[_tried(r)]), []).append(r)
    rows = []
    for (repository, said, tried), group in groups.items():
        rows.append([repository, _names(group), str(sum(r["count"] for r in group)), said, tried])
    return [[cell.replace("|", "\\|") for cell in row] for row in rows]


def _names(group: Sequence[Record]) -> str:
    names = list(dict.fromkeys(name for r in group for name in r["names"]))
    more = len(names[SHOWN:]) + sum(r.get("unnamed", 0) for r in group)
    return ", ".join(names[:SHOWN]) + (f" and {more} more" if more else "")


def _place(r: Record) -> str:
    """The repository, with the commit where it is known."""
    return r["repository"] + (f" @ {r['commit'][:7]}" if r["commit"] != UNKNOWN else "")


def _said(r: Record) -> str:
    said = r["answer"] + (f": {r['says']}" if r["says"] else "")
    beside = {RUNS: " (FMPy RUNS it)", FAILS: " (FMPy neither)", "hangs": " (FMPy hangs)"}
    return said + beside.get(r.get("peer", ""), "")


def _tried(r: Record) -> str:
    return f"{r['date']}, {r['by']}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Look at all repositories, and put what is found into the file."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.tools.foreign", description="FMUs and systems of other tools"
    )
    parser.add_argument("checkouts", type=Path, help="folder with checked-out repositories, OWNER/NAME each")
    parser.add_argument("--only", nargs="+", default=[], metavar="OWNER/NAME", help="only these repositories")
    parser.add_argument("--figures", type=Path, required=True, help="file of figures for docs/include.py")
    options = parser.parse_args(arguments)
    there = repositories(options.checkouts)
    missing = sorted(set(options.only) - set(there))
    if missing or not there:
        parser.error(f"{options.checkouts} holds no repository {', '.join(missing) or 'OWNER/NAME'}")
    chosen = options.only or list(there)
    before = json.loads(options.figures.read_text(encoding="utf-8"))["data"] if options.figures.is_file() else []
    found = [r for r in before if r["repository"] not in chosen]
    seen: set[str] = set()
    for name in chosen:
        found += records(name, there[name], seen, lambda text: print(text, file=sys.stderr, flush=True))
    command = command_of("tests.tools.foreign", ["CHECKOUTS", "--figures", str(options.figures)])
    write_figures(options.figures, command, texts(found), data=found)
    print(f"{len(found)} records of {len({r['repository'] for r in found})} repositories in {options.figures}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
