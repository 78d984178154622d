"""The files that a case reads, with their digests."""

from __future__ import annotations

from pathlib import Path

from fmu_didim.cache import file_digest
from fmu_didim.case import Case
from fmu_didim.case.data import resolve
from fmu_didim.case.document import ExperimentSource, SignalFile


def case_files(case: Case) -> dict[str, str]:
    """SHA-256 of the files that the case reads, under the names it gives them."""
    document = case.document
    named: dict[str, Path] = {}
    controller = document.controller.source if document.controller is not None else None
    archive = document.system.source if document.system is not None else None
    for source in (document.robot, document.plant.source, controller, archive):
        if source is not None and ":" not in source:
            named[source] = case.folder / source
    for experiment in (document.train, document.validation):
        for signal in _signals(experiment):
            named[signal.file] = resolve(signal, case.folder)
    return {name: file_digest(path) for name, path in named.items() if path.is_file()}


def _signals(experiment: ExperimentSource | None) -> list[SignalFile]:
    if experiment is None:
        return []
    parts = (experiment.reference, experiment.torque, experiment.positions)
    return [part for part in parts if isinstance(part, SignalFile)]
