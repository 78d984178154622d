"""The files that a case reads, with their digests."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from fmu_didim.base.cache import file_digest
from fmu_didim.base.imports import is_reference, located, source_file
from fmu_didim.case import Case
from fmu_didim.case.files import path_of
from fmu_didim.case.in_memory import digest
from fmu_didim.case.sources import DataFile
from fmu_didim.dynamics.effects import find_effect

NO_OPTIONS: Mapping[str, object] = {}


def case_files(case: Case, *, effects: Sequence[str] = ()) -> dict[str, str]:
    """SHA-256 of the files that the case reads, under the names it gives them, or of the objects in their place.

    The code of effects from outside the tree is among them, under ``module:Name`` or ``/path/to/file.py:Name``: of its
    file, or of the class alone where that is in no file.

    Args:
        effects: names of further ones, beside those of the robot.
    """
    files = {name: file_digest(path) for name, path in _named(case).items() if path.is_file()} | case.memory.digests()
    of_robot = () if case.robot is None else (name for joint in case.robot.joints for name in joint.effects)
    for name in filter(is_reference, (*of_robot, *effects)):
        source = source_file(name)
        files[name] = file_digest(source) if source and source.is_file() else digest(type(find_effect(name)))
    return files


def paths_read(case: Case) -> list[Path]:
    """The case file and those that it reads."""
    return [case.path, *_named(case).values()]


def _named(case: Case) -> dict[str, Path]:
    """Files under the names that the case gives them."""
    document = case.document
    named: dict[str, Path] = {}
    archive = document.system.source if document.system is not None else None
    of_prior = document.prior.file if document.prior is not None else None
    for source in (document.robot, *(part.source for part in document.parts.values()), archive, of_prior):
        if source is not None and source not in case.memory.objects:
            file = located(source, case.folder).rpartition(":")[0] if is_reference(source) else source
            named[source] = case.folder / file
    for run in document.runs.values():
        for part in (run.reference, run.inputs, run.torque, run.positions, run.instants, *run.measured_files):
            if isinstance(part, DataFile) and part.file not in case.signals:
                named[part.file] = path_of(part.file, case.folder)  # which need not be there for a verb that plans
    return named


def repeating(verb: str, case: Case, out: Path | None, options: Mapping[str, object] = NO_OPTIONS) -> dict[str, str]:
    """``command``: what repeats a run in ``folder``, the working folder; nothing for a case that is not in files alone.

    Args:
        out: folder of the results; options: name of each option in Python -> its value; those that are empty are left
            out.
    """
    if not case.path.name or case.signals or case.memory.objects:
        return {}
    words = ["fmu-didim", verb, str(case.path), *(["--out", str(out)] if out is not None else [])]
    for name, value in options.items():
        values = value if isinstance(value, list | tuple) else [value]
        for each in values:
            if each is not None:
                words += [f"--{name.replace('_', '-')}", *([] if each is True else [str(each)])]
    return {"folder": str(Path.cwd()), "command": shell_line(words)}


def shell_line(words: Sequence[str]) -> str:
    """A command as it is typed in a shell of this system."""
    return subprocess.list2cmdline(words) if sys.platform == "win32" else shlex.join(words)
