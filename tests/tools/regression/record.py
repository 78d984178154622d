"""Runs the cases and writes down what the verbs give, one JSON file a case."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal

from fmu_didim import discover, identify
from fmu_didim.base.version import __version__
from fmu_didim.case import Case, load_case
from fmu_didim.model.workers import default_workers
from tests.helpers import ROOT
from tests.tools.blind.translate import translate
from tests.tools.regression.cases import Job, digests_of_blind, digests_of_case

PLANT: Literal["model", "fmu"] = "model"
"""How plant and controller of a blind case run; examples say it themselves."""
PACKAGE = ROOT / "fmu_didim"


@dataclass(frozen=True)
class Project:
    """The project that gave a record.

    Attributes:
        version: of the package; commit: of git, None without it; changed: whether the package has changes that are not
            in the commit, None without git.
        source: SHA-256 of the files of the package, by which records are told apart.
    """

    version: str
    commit: str | None
    changed: bool | None
    source: str

    def __str__(self) -> str:
        commit = f", commit {self.commit[:12]}" if self.commit else ""
        return f"{self.version}{commit}{' with changes' if self.changed else ''} (source {self.source[:8]})"


class OtherProjectError(Exception):
    """A folder holds records of another project or with other options: one folder is one version."""


def this_project() -> Project:
    """The project as it lies here."""
    commit, changes = _git("rev-parse", "HEAD"), _git("status", "--porcelain", "--", str(PACKAGE))
    return Project(__version__, commit or None, None if changes is None else bool(changes), _source())


def _git(*arguments: str) -> str | None:
    """What git says; None where there is no git, or no repository."""
    try:
        done = subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


def _source() -> str:
    digest = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def options_of(job: Job) -> dict[str, Any]:
    """What the job is run with, beyond the case; the verbs have their defaults."""
    return {"plant": PLANT} if job.is_blind else {}


def file_of(job: Job, records: Path) -> Path:
    """The file of the job's record."""
    return records / f"{job.name.replace('/', '_').replace(' ', '__')}.json"


def record(
    records: Path,
    jobs: Sequence[Job],
    work: Path,
    *,
    workers: int = 1,
    progress: Callable[[str], None] = lambda text: None,
) -> int:
    """Run all jobs that have no record yet; returns how many were run.

    Args:
        records: folder of the records; work: folder for translated cases.
        workers: processes; simulations of one case then run one after the other.

    Raises:
        OtherProjectError: the folder holds records of another version.
    """
    records.mkdir(parents=True, exist_ok=True)
    project = this_project()
    waiting = [job for job in jobs if not _is_recorded(job, records, project)]
    if len(waiting) < len(jobs):
        progress(f"{len(jobs) - len(waiting)} of {len(jobs)} are recorded already")
    for count, (job, content) in enumerate(_results(waiting, work, workers), start=1):
        _write(file_of(job, records), {"case": job.name, "project": asdict(project), **content})
        outcome = content["error"] or _outcome(content["result"])
        progress(f"{count}/{len(waiting)} {job.name}: {outcome} ({content['seconds']:.1f} s)")
    return len(waiting)


def _is_recorded(job: Job, records: Path, project: Project) -> bool:
    file = file_of(job, records)
    if not file.exists():
        return False
    content = json.loads(file.read_text(encoding="utf-8"))
    before = Project(**content["project"])
    if before.source != project.source or content["options"] != options_of(job):
        raise OtherProjectError(
            f"{file} is of {before} with options {content['options']}, here is {project} with {options_of(job)}: "
            "record into another folder."
        )
    return True


def _results(jobs: Sequence[Job], work: Path, workers: int) -> Iterator[tuple[Job, dict[str, Any]]]:
    """Jobs and their records as they come; one that fails is a record with its error."""
    if workers == 1:
        for job in jobs:
            yield job, run(job, work)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        running = {pool.submit(run, job, work): job for job in jobs}
        for ready in as_completed(running):
            yield running[ready], ready.result()


def run(job: Job, work: Path) -> dict[str, Any]:
    """What a job gives: its verb, options, digests of its input, times in s, and the result or the error."""
    content: dict[str, Any] = {
        "verb": job.verb, "options": options_of(job), "inputs": {}, "threads": default_workers(), "result": None,
        "error": "",
    }  # fmt: skip
    begin, begin_cpu = time.perf_counter(), time.process_time()
    try:
        case = _case(job, work)
        content["inputs"] = digests_of_blind(job.path) if job.is_blind else digests_of_case(job.path, case)
        document = identify(case).document if job.verb == "identify" else discover(case).document
        content["result"] = json.loads(document.model_dump_json(by_alias=True))
    except Exception as error:  # noqa: BLE001 - one bad case must not end the others; its record says so
        content["error"] = f"{type(error).__name__}: {error}"
    content["seconds"] = round(time.perf_counter() - begin, 3)
    content["cpu_seconds"] = round(time.process_time() - begin_cpu, 3)
    return content


def _case(job: Job, work: Path) -> Case:
    if job.is_blind:
        return load_case(translate(job.path, work / job.path.name, plant=PLANT))
    return load_case(job.path)


def _outcome(result: Mapping[str, Any]) -> str:
    if "findings" not in result:
        return str(result["status"])
    answer = result.get("answer", result["verdict"])
    return " ".join([answer, *(f"{f['effect']}@{f['joint']}" for f in result["findings"])])


def _write(file: Path, content: Mapping[str, Any]) -> None:
    """Under a temporary name first, so that a file with the name of a record is always a whole one."""
    part = file.with_name(f"{file.name}.{os.getpid()}.part")
    part.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    part.replace(file)
