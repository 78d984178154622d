"""Identifications of logs that are kept: a log of which log, case and code are the same is not identified again."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.base.cache import file_digest
from fmu_didim.base.diagnostics import DiagnosedError, refuse_problems
from fmu_didim.base.errors import FmuDidimError, IdentificationError, InputError
from fmu_didim.base.files import file_name, is_file, whole_file
from fmu_didim.case import Case, CaseDocument
from fmu_didim.case.build import contents_of
from fmu_didim.case.files import resolve
from fmu_didim.case.sources import DataFile
from fmu_didim.checks.data.checks import without_outliers
from fmu_didim.discovery.change.answers import Answer
from fmu_didim.discovery.change.log_fit import LogFit
from fmu_didim.fit.estimate import RefusedError
from fmu_didim.results.provenance import code_digest, digest
from fmu_didim.results.result import RESULT_FILE
from fmu_didim.workflow.case_files import case_files
from fmu_didim.workflow.compare.answer import answer_of, log_of, why_no_effects
from fmu_didim.workflow.data import case_diagnostics
from fmu_didim.workflow.discover import described_plant
from fmu_didim.workflow.identify import identify
from fmu_didim.workflow.output.result import Result, result_folder
from fmu_didim.workflow.output.result_folder import reported_unwritable

KEPT = "logs"
RECORD = "watch_log.json"
"""Beside the result of a log: what it is of, and why there is none."""
FAILED = "it could not be identified"


@dataclass(frozen=True)
class Place:
    """Where the log of a case stands: what must be another file for another log.

    Attributes:
        label: of its experiment; file: name in the case; entries: of that experiment that name it.
        of_model: whether they are entries of the case itself.
    """

    label: str
    file: str
    entries: tuple[str, ...]
    of_model: bool

    @staticmethod
    def of(case: Case) -> Place:
        """Raises InputError where a case has not one log that another can stand for."""
        document = case.document
        fitted = [label for label, run in document.runs.items() if run.role == "estimation"]
        if len(fitted) != 1:
            raise InputError(
                "The case does not say which log is replaced by those of the folder: it fits several experiments."
                if fitted else "The case fits no experiment.", where="experiments", got=", ".join(fitted) or "none",
                valid="one experiment with the role estimation", next_step="Watch with a case of one experiment.",
            )  # fmt: skip
        run, label = document.runs[fitted[0]], fitted[0]
        names = {
            key: _files(getattr(run, key))
            for key in ("torque", "reference", "positions", "instants", "inputs", "measured")
        }
        log = names["torque" if document.model is None else "measured"]
        if len(set(log)) != 1 or any(name in case.signals for name in log):
            raise InputError(
                "The case does not say how a log file is read: it names none, or several.", where=label,
                got=", ".join(log) or "none", valid="torque: {file: ...}, of a model measured: with one file",
                next_step="Name any of the logs in it, with its columns; those of the folder stand in its place.",
            )  # fmt: skip
        apart = [key for key in ("positions", "instants", "inputs") if any(name != log[0] for name in names[key])]
        if apart or (names["measured"] and set(names["measured"]) != set(log)):
            raise InputError(
                "Beside the log, the case reads another file of the same run, which other logs do not have.",
                where=f"{label}: {', '.join(apart) or 'measured'}",
                valid="one file with all that was recorded of a run",
                next_step="Record them in one file with the log.",
            )  # fmt: skip
        entries = tuple(key for key, own in names.items() if own and set(own) == set(log))
        return Place(label, log[0], entries, document.model is not None)

    def with_log(self, case: Case, path: Path) -> Case:
        """The case with another log, and without held-out data, which are of another day."""
        run, file = case.document.runs[self.label], str(path.resolve())
        changed: dict[str, Any] = {}
        for key in self.entries:
            source = getattr(run, key)
            parts = [
                part.model_dump(mode="json", by_alias=True, exclude_unset=True) | {"file": file}
                for part in (source if isinstance(source, tuple) else (source,))
            ]  # fmt: skip
            changed[key] = parts if isinstance(source, tuple) else {"file": file}
        others = {label: None for label in case.document.experiments if label != self.label}
        if case.document.experiments:
            changed = {"experiments": {self.label: changed, **others}}
        elif not self.of_model or case.document.train is not None:
            changed = {"train": changed}
        return case.with_(**changed, name=path.stem, validation=None)


def _files(source: object) -> list[str]:
    parts = source if isinstance(source, tuple) else (source,)
    return [part.file for part in parts if isinstance(part, DataFile)]


@dataclass(frozen=True)
class Store:
    """The identifications of logs with a case.

    Attributes:
        folder: of the watch; case, place: as they are; known: digest of all that a result depends on beside the log.
    """

    folder: Path
    case: Case
    place: Place
    known: str = field(default="")

    @staticmethod
    def of(folder: Path, case: Case) -> Store:
        """With a case."""
        place = Place.of(case)
        files = {name: value for name, value in case_files(case).items() if name != place.file}
        content = contents_of(case.document)
        for key in ("name", "description", "validation"):
            content.pop(key, None)
        return Store(folder, case, place, digest([content, files, code_digest()]))

    def answer(self, path: Path, say: Callable[[str], None]) -> Kept:
        """What a log says, identified now if that was not done before."""
        key = file_digest(path)
        own = self.folder / KEPT / f"{file_name(path.stem)}-{digest([self.known, key])}"
        if (found := _read(own, key)) is not None:
            return found
        say(f"identifying {path.name}")
        result_folder(own).check()
        try:
            identify(self.place.with_log(self.case, path), own)
        except (DiagnosedError, RefusedError, IdentificationError) as error:
            _write(own, path, key, _why(error))
        except FmuDidimError as error:  # which another machine, or another day, may not have: it is tried again
            return Kept(None, f"{FAILED}: {_why(error)}", own, key, is_new=True)
        else:
            _write(own, path, key, "")
        kept = _read(own, key)
        assert kept is not None
        return Kept(kept.answer, kept.why, own, key, is_new=True)

    def log(self, path: Path, answer: Answer) -> LogFit:
        """A log with its loop, at the values that were identified from it, in which effects can be looked for.

        Raises:
            FmuDidimError: it tells nothing of effects, or cannot be simulated.
        """
        case = self.place.with_log(self.case, path)
        model, _ = without_outliers(case.model, refuse_problems(case_diagnostics(case)))
        if why := why_no_effects(model):
            raise InputError(
                "In this log effects cannot be looked for.", where=path.name, got=why,
                next_step="Watch without effects (--no-effects).",
            )  # fmt: skip
        known = answer.document.parameters
        values = [known[n].value if n in known else s for n, s in zip(model.names, model.start, strict=True)]
        return log_of(model.with_values(np.array(values)), described_plant(case))


def _why(error: FmuDidimError) -> str:
    return " ".join(part for part in (error.what, f"({error.got})" if error.got else "") if part).rstrip(".")


def _write(own: Path, path: Path, key: str, why: str) -> None:
    """Say that the result in a folder is that of a log, or why there is none: the last that is written."""
    with reported_unwritable(own):
        own.mkdir(parents=True, exist_ok=True)
        with whole_file(own / RECORD) as temporary:
            temporary.write_text(json.dumps({"log": path.name, "sha256": key, "why": why}), encoding="utf-8")


@dataclass(frozen=True)
class Kept:
    """What is kept of a log: its answer, or why there is none; and its folder and digest."""

    answer: Answer | None
    why: str
    folder: Path
    digest: str
    is_new: bool = False


def _read(own: Path, key: str) -> Kept | None:
    """What is kept in a folder; None where that is nothing whole."""
    record: dict[str, Any] = {}
    with suppress(OSError, ValueError):
        record = json.loads((own / RECORD).read_text(encoding="utf-8"))
    if record.get("sha256") != key:
        return None
    why = str(record.get("why", ""))
    if why:
        return Kept(None, f"{FAILED}: {why}", own, key)
    if not is_file(own / RESULT_FILE):
        return None
    try:
        result = Result.load(own)
    except FmuDidimError:
        return None
    return Kept(answer_of(result, str(own / RESULT_FILE), own.name), "", own, key)


def beside_logs(case: Case) -> Iterable[Path]:
    """Files of a case that are no logs of the machine, though they may stand in the folder."""
    document: CaseDocument = case.document
    place = Place.of(case)
    for run in document.runs.values():
        for key in ("reference", "torque", "positions", "instants", "inputs", "measured"):
            for source in (s for s in _parts(getattr(run, key)) if isinstance(s, DataFile)):
                if run is not document.runs[place.label] or source.file != place.file:
                    yield resolve(source, case.folder)


def _parts(source: object) -> tuple[object, ...]:
    return source if isinstance(source, tuple) else (source,)
