"""Which files of signals belong to one run: a log, and the reference that was followed in it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from fmu_didim.base.errors import InputError
from fmu_didim.workflow.init.data_file import TORQUES, DataFile
from fmu_didim.workflow.init.inventory import Inventory, key_of

HELD_OUT = r"valid|test|check|hold|pruef|prüf"
"""In the name of a file: it is to judge only."""


@dataclass(frozen=True)
class FilesOfRun:
    """Files of one run.

    Attributes:
        label: of the run; held_out: whether it is to judge only.
        reason: why this reference belongs to this log; is_guess: whether only the order of the files says so.
    """

    label: str
    reference: DataFile
    torque: DataFile
    held_out: bool
    reason: str = ""
    is_guess: bool = False


def runs(found: Inventory) -> list[FilesOfRun]:
    """The runs that the data files belong to, those for the estimation first.

    A log and a reference belong together if their names differ only by words such as ``reference`` and ``torque``, else
    if they share a word or a number that no other has, else in the order in which they are given. One reference without
    a log is that of all logs without one; of several, none is taken twice.

    Raises:
        InputError: there are several references without a log, and another number of logs without a reference.
    """
    groups: dict[str, list[DataFile]] = {}
    for data in found.data:
        if not (data.is_loop_log or data.is_temperature_log):
            groups.setdefault(key_of(data.path), []).append(data)
    made, logs, references = list[FilesOfRun](), list[DataFile](), list[DataFile]()
    for key, files in groups.items():
        torque = next((d for d in files if d.has(*TORQUES)), None)
        reference = next((d for d in files if d.has("q") and d is not torque), None)
        if torque is not None and reference is not None:
            made.append(_run(key, reference, torque, "by their names"))
        elif reference is not None:
            references.append(reference)
        else:
            logs.append(torque or files[-1])
    made += _paired(logs, references, made)
    made.sort(key=lambda run: run.held_out)
    if len(made) > 1 and not any(run.held_out for run in made):
        made[-1] = replace(made[-1], held_out=True)
    return made


def _run(label: str, reference: DataFile, torque: DataFile, reason: str, *, is_guess: bool = False) -> FilesOfRun:
    return FilesOfRun(label, reference, torque, bool(re.search(HELD_OUT, label)), reason, is_guess)


def _paired(logs: list[DataFile], references: list[DataFile], made: Sequence[FilesOfRun]) -> Iterator[FilesOfRun]:
    """The runs of logs and references that have no partner of the same name."""
    if not logs:  # logs whose torque has a name that is not known
        alone = [d for d in references if not made or d.has("other")]
        yield from (_run(key_of(d.path), d, d, "") for d in alone)
        return
    followed = [d for d in logs if any(g.role == "q" and g.side == "reference" for g in d.guesses)]
    yield from (_run(key_of(d.path), d, d, "in the same file") for d in followed)
    logs = [d for d in logs if d not in followed]
    for log, reference, word in _alike(logs, references) if len(references) > 1 else []:
        yield _run(key_of(log.path), reference, log, f"both have '{word}' in their names")
        logs, references = [d for d in logs if d is not log], [d for d in references if d is not reference]
    if len(references) > 1 and logs and len(references) != len(logs):
        raise InputError(
            "Which reference belongs to which log is not clear.", where=", ".join(d.path.name for d in logs),
            got=", ".join(d.path.name for d in references), valid="one reference, or one for each log",
            next_step="Name the files of a run alike: slow_reference.csv, slow_torque.csv.",
        )  # fmt: skip
    if len(references) > 1:
        told = "in the order of the files"
        yield from (
            _run(key_of(log.path), reference, log, told, is_guess=True)
            for log, reference in zip(logs, references, strict=False)
        )
        return
    for log in logs:
        if references:
            yield _run(key_of(log.path), references[0], log, "the only one")
        elif log.has("q") or not made:
            yield _run(key_of(log.path), log, log, "in the same file")
        else:
            yield _run(key_of(log.path), made[0].reference, log, "it has none of its own", is_guess=len(made) > 1)


def _alike(logs: list[DataFile], references: list[DataFile]) -> list[tuple[DataFile, DataFile, str]]:
    """Log, reference and the word of their names that no other one of them has."""
    found, taken = list[tuple[DataFile, DataFile, str]](), list[DataFile]()
    for log in logs:
        for word in sorted(words_of(log)):
            with_it = [[d for d in side if word in words_of(d)] for side in (logs, references)]
            if [len(side) for side in with_it] == [1, 1] and with_it[1][0] not in taken:
                found.append((log, with_it[1][0], word))
                taken.append(with_it[1][0])
                break
    return found


def words_of(data: DataFile) -> set[str]:
    """The words and numbers of the name of a file; 001 is 1."""
    parts = re.findall(r"[^\W\d_]+|\d+", data.path.stem.lower())
    return {str(int(part)) if part.isdecimal() else part for part in parts}
