"""Runs the comparison on pairs; it never opens what they hide."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import yaml

from tests.tools.blind.translate import translate
from tests.tools.changes.draw import REFERENCE

Line = Mapping[str, Any]
SHARP = 0.003
"""[rad/s] Smoothing velocity of the description: the simulator's is a thirtieth of it, and no log tells them apart."""


def run_pair(folder: Path) -> dict[str, Any]:
    """What ``compare`` says of a pair, as a line; a failure is a line with ``error``."""
    from fmu_didim import compare

    begin = time.process_time()
    line: dict[str, Any] = {"pair": folder.name}
    try:
        cases = [case_of(folder, place) for place in ("before", "after")]
        document = compare(*cases, folder / "result").document
        line |= {
            "answer": document.answer, "verdict": document.verdict, "p_value": document.p_value,
            "codes": sorted({reason.code for reason in document.reasons}), "text": document.text,
            "causes": [[[p.kind, p.joint, p.title] for p in cause.parts] for cause in document.causes],
        }  # fmt: skip
    except Exception as error:  # noqa: BLE001 - one bad pair must not end the run; it is counted as wrong
        why = f"{type(error).__name__}: {error}"
        line |= {"answer": "error", "verdict": "", "causes": [], "codes": [], "error": why}
    line["cpu_s"] = round(time.process_time() - begin, 2)
    return line


def run_history(folder: Path) -> dict[str, Any]:
    """What ``watch`` says of a history, as a line."""
    from fmu_didim import watch

    begin = time.process_time()
    found = watch(folder / "logs", case_of(folder, "before"), folder / "result", reference=REFERENCE).document
    line: dict[str, Any] = {"pair": folder.name, "states": [log.state for log in found.logs[REFERENCE:]]}
    line |= {"causes": [log.causes for log in found.logs[REFERENCE:]], "verdict": found.verdict}
    line["onset"] = None if found.onset is None else [log.name for log in found.logs].index(found.onset.log)
    return line | {"cpu_s": round(time.process_time() - begin, 2)}


def case_of(folder: Path, place: str) -> Path:
    """The case of a log; dry friction is known to be sharp, as a description says it by its smoothing velocity."""
    case = translate(folder / place, folder / f"{place}_input")
    path = case.parent / "robot.yaml"
    robot = yaml.safe_load(path.read_text(encoding="utf-8"))
    for joint in robot["joints"]:
        joint["parameters"]["v0"] = SHARP
    path.write_text(yaml.safe_dump(robot, sort_keys=False), encoding="utf-8")
    return case


def run(
    folders: Iterable[Path], out: Path, *, jobs: int = 1, what: Callable[[Path], dict[str, Any]] = run_pair
) -> list[dict[str, Any]]:
    """All pairs, or histories; lines go to ``out`` as they come, and those that it holds are not run again."""
    lines = read_lines(out) if out.exists() else []
    known = {line["pair"] for line in lines}
    waiting = [folder for folder in folders if folder.name not in known]
    with out.open("a", encoding="utf-8") as stream, ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        for ready in as_completed([pool.submit(what, folder) for folder in waiting]):
            lines.append(ready.result())
            stream.write(json.dumps(lines[-1]) + "\n")
            stream.flush()
    return sorted(lines, key=lambda line: str(line["pair"]))


def read_lines(path: Path) -> list[dict[str, Any]]:
    """Lines of an earlier run."""
    return [json.loads(row) for row in path.read_text(encoding="utf-8").splitlines() if row.strip()]
