"""Runs discovery on folders of blind cases; it never opens what they hide."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from fmu_didim.base.errors import InputError
from fmu_didim.campaigns.campaign import campaign
from fmu_didim.campaigns.running.runner import Progress
from tests.tools.blind.translate import CASE_FILE, translate

Discover = Callable[[Path, Path], Mapping[str, Any]]
"""(case file, folder for the results) -> verdict (the ``answer``), findings and gap, as in ``findings.json``."""
RUNS = {"estimation": "train", "validation": "test"}
"""Label of an experiment of the project -> name of the run in a blind case, and in a line."""
CURVE = ("joint", "variable", "at", "torque", "half_width")
VERDICTS = ("nothing", "named", "named_with_remainder", "unknown", "disagreement")


def project_discover(case: Path, out: Path) -> Mapping[str, Any]:
    """The project's ``discover``; what it wrote to ``findings.json`` is what counts."""
    from fmu_didim import discover

    discover(case, out)
    return _line(json.loads((out / "findings.json").read_text(encoding="utf-8")))


def _line(found: dict[str, Any]) -> Mapping[str, Any]:
    gap = {RUNS[label]: [pair["before"], pair["after"]] for label, pair in found["gap"].items()}
    findings = [{**item, "ambiguous": [rival["effect"] for rival in item["ambiguous"]]} for item in found["findings"]]
    gap["ratio_interval"] = found["ratio_interval"]
    return {**found, "verdict": found["answer"], "judged": found["verdict"], "findings": findings, "gap": gap}


def case_folders(folder: Path, only: Sequence[str] = ()) -> list[Path]:
    """The folders below ``folder`` that hold a case, by name.

    Raises:
        FileNotFoundError: there is none, or one of ``only`` is absent.
    """
    found = sorted(path.parent for path in folder.glob(f"*/{CASE_FILE}"))
    missing = set(only) - {path.name for path in found}
    if missing or not found:
        raise FileNotFoundError(f"no case {', '.join(sorted(missing)) or '*'} in {folder}")
    return [path for path in found if not only or path.name in only]


def run_case(
    folder: Path, work: Path, discover: Discover = project_discover, *, plant: str = "model"
) -> dict[str, Any]:
    """One case: translated, discovered, and reduced to its JSON line. A failure is a line with ``error``."""
    begin = time.monotonic()
    line: dict[str, Any] = {"case": folder.name}
    try:
        case = translate(folder, work / folder.name / "input", plant=plant)
        line |= reduced(discover(case, work / folder.name / "result"))
    except Exception as error:  # noqa: BLE001 - one bad case must not end the evaluation; it is counted as failed
        line |= {"verdict": "error", "findings": [], "gap": {}, "error": f"{type(error).__name__}: {error}"}
    line["seconds"] = round(time.monotonic() - begin, 3)
    return line


def reduced(found: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of the JSON line; raises ValueError where they do not have the agreed form."""
    if found.get("verdict") not in VERDICTS:
        raise ValueError(f"verdict {found.get('verdict')!r} is none of {', '.join(VERDICTS)}")
    keys = ("effect", "class", "joint", "ambiguous")
    findings = [{key: item.get(key) for key in keys} for item in found.get("findings", ())]
    for item in findings:
        if not isinstance(item["effect"], str):
            raise ValueError(f"a finding without effect: {item}")
    gap = found.get("gap", {})
    return {
        "verdict": found["verdict"],
        "judged": found.get("judged", ""),
        "findings": findings,
        "gap": {key: gap.get(key) for key in ("train", "test", "ratio_interval")},
        "curves": [{key: curve[key] for key in CURVE} for curve in found.get("curves", ())],
    }


def evaluate(
    folders: Sequence[Path],
    out: Path,
    work: Path,
    discover: Discover = project_discover,
    *,
    jobs: int = 1,
    plant: str = "model",
    resume: bool = False,
    progress: Callable[[int, int, Mapping[str, Any]], None] = lambda done, count, line: None,
) -> list[dict[str, Any]]:
    """All cases; lines go to ``out`` as they come, sorted by case at the end.

    Args:
        jobs: processes; with more than one, ``discover`` must be importable.
        resume: keep the lines that ``out`` holds, and run only the other cases.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    lines: list[dict[str, Any]] = read_lines(out) if resume and out.exists() else []
    known = {line["case"] for line in lines}
    waiting_for = [folder for folder in folders if folder.name not in known]
    # The same robot at another rate stands beside it: apart, the second one finds its models compiled.
    waiting_for = [*waiting_for[::2], *waiting_for[1::2]]
    with out.open("a" if resume else "w", encoding="utf-8") as stream:

        def note(line: dict[str, Any]) -> None:
            lines.append(line)
            stream.write(json.dumps(line) + "\n")
            stream.flush()
            progress(len(lines), len(folders), line)

        if jobs == 1:
            for folder in waiting_for:
                note(run_case(folder, work, discover, plant=plant))
        else:
            with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
                waiting = [pool.submit(run_case, folder, work, discover, plant=plant) for folder in waiting_for]
                for ready in as_completed(waiting):
                    note(ready.result())
    lines.sort(key=lambda line: line["case"])
    out.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    return lines


def by_campaign(
    folders: Sequence[Path], out: Path, work: Path, *, jobs: int, plant: str, files: bool
) -> list[dict[str, Any]]:
    """The same lines from the project's ``discover`` as a campaign in ``work``, which is resumed.

    Args:
        files: whether models, splitting experiments and reports are written.
    """
    cases, lines = {}, []
    for folder in folders:
        try:
            cases[folder.name] = str(translate(folder, work / folder.name / "input", plant=plant).resolve())
        except InputError as error:
            lines.append({"case": folder.name, "verdict": "error", "findings": [], "gap": {}, "error": str(error)})
    entries = [{"case": path, "label.case": name} for name, path in cases.items()]
    content = {"name": "blind cases", "verb": "discover", "vary": [{"list": entries}], "keep": files}
    results = campaign(content, work / "campaign").run(workers=jobs, progress=_told)
    for row in results.to_frame(parameters=False).to_dict("records"):
        line: dict[str, Any] = {"case": row["label.case"], "seconds": round(row["seconds"], 3)}
        if isinstance(row["findings"], str):
            line |= reduced(_line({**json.loads(row["findings"]), "verdict": row["verdict"]}))
        else:
            line |= {"verdict": "error", "findings": [], "gap": {}, "error": row["message"]}
        lines.append(line)
    lines.sort(key=lambda line: line["case"])
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    return lines


def _told(now: Progress) -> None:
    print(f"{now.known + now.done} of {now.known + now.count} cases, {now.failed} failed", file=sys.stderr, flush=True)


def read_lines(path: Path) -> list[dict[str, Any]]:
    """The lines of an earlier evaluation."""
    return [json.loads(row) for row in path.read_text(encoding="utf-8").splitlines() if row.strip()]
