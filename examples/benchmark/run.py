"""Runs methods on cases, one process a case; the truth is not opened here."""

from __future__ import annotations

import json
import resource
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from examples.benchmark.answer import Answer
from examples.benchmark.methods import METHODS
from fmu_didim.base.cache import file_digest
from fmu_didim.results.provenance import code_digest, digest
from tests.tools.blind.harness import read_lines
from tests.tools.blind.translate import translate
from tests.tools.regression.cases import digests_of_blind

BUDGET_S = 120.0
"""[s] Of processor time, for each method on each case alike; who needs more has failed there."""


def run(folders: Sequence[Path], out: Path, method: str, *, jobs: int = 1) -> list[dict[str, Any]]:
    """The lines of a method, one a case, kept in ``out/<method>.jsonl``; what has not changed is not run again."""
    kept = out / f"{method}.jsonl"
    marks = {folder.name: mark(method, folder) for folder in folders}
    held = read_lines(kept) if kept.exists() else []
    known = {line["case"]: line for line in held if line.get("mark") == marks.get(line["case"])}
    waiting = [folder for folder in folders if folder.name not in known]
    with kept.open("a", encoding="utf-8") as stream:
        for line in _lines(waiting, out / "work" / method, method, jobs):
            line["mark"] = marks[line["case"]]
            known[line["case"]] = line
            stream.write(json.dumps(line) + "\n")
            stream.flush()
            print(f"{method}: {len(known)} of {len(folders)} cases", file=sys.stderr, flush=True)
    return [known[folder.name] for folder in folders]


def mark(method: str, folder: Path) -> str:
    """Digest of the code of the project and of a method, and of what a case shows: other lines say nothing of these."""
    modules = ("examples.benchmark.answer", "examples.benchmark.base", METHODS[method].__module__)
    code = [file_digest(Path(sys.modules[name].__file__ or "")) for name in modules]
    return digest([code_digest(), code, digests_of_blind(folder)])


def _lines(folders: Sequence[Path], work: Path, method: str, jobs: int) -> Iterator[dict[str, Any]]:
    if jobs == 1:
        yield from (one(folder, work, method) for folder in folders)
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        waiting = [pool.submit(one, folder, work, method) for folder in folders]
        yield from (ready.result() for ready in as_completed(waiting))


def one(
    folder: Path, work: Path, method: str, methods: Mapping[str, Callable[[Path], Answer]] = METHODS
) -> dict[str, Any]:
    """The line of a method for a case that was made."""
    return line_of(folder.name, lambda: methods[method](translate(folder, work / folder.name)))


def line_of(case: str, answer: Callable[[], Answer]) -> dict[str, Any]:
    """The line of an answer to a case of this name; a failure is a line with ``error``, so that it counts."""
    begin = _processor_s()
    line: dict[str, Any] = {"case": case}
    try:
        line |= answer().line()
    except Exception as error:  # noqa: BLE001 - one bad case must not end the run; it is counted as failed
        line |= {"verdict": "error", "findings": [], "parameters": {}, "error": f"{type(error).__name__}: {error}"}
    line["seconds"] = round(_processor_s() - begin, 2)
    if line["seconds"] > BUDGET_S:
        line |= {"verdict": "error", "findings": [], "parameters": {}, "error": f"more than {BUDGET_S:g} s"}
    return line


def _processor_s() -> float:
    """Time of the processor in this process and in those that it has waited for, s."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)
