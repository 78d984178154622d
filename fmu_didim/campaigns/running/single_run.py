"""One run of a campaign written as a case with its data files, for ``fmu-didim identify`` or ``discover``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from fmu_didim.base.imports import is_reference, located
from fmu_didim.campaigns.planning.fields import with_written_descriptions
from fmu_didim.campaigns.planning.identity import NAMING, file_of
from fmu_didim.campaigns.planning.plan import Plan, PlannedRun
from fmu_didim.campaigns.planning.truth import noisy_logs, simulated_truth, with_simulated_logs
from fmu_didim.data.signals import write_csv

CASE_FILE = "case.yaml"


def write_single_run(plan: Plan, run: PlannedRun, folder: Path) -> Path:
    """Write case and data of a run to a folder; returns the case file.

    Raises:
        InputError, SimulationError: the data cannot be simulated.
    """
    folder.mkdir(parents=True, exist_ok=True)
    content = plan.content(run.settings)
    source = Path(content.folder)
    case = content.case
    if content.truth is not None:
        truth = simulated_truth(with_written_descriptions(content.truth, folder), source)
        for name, log in noisy_logs(truth, content.noise, run.data).items():
            write_csv(log, folder / name, digits=17)
        case = with_simulated_logs(case, truth.outputs)
    path, case = folder / CASE_FILE, _absolute(with_written_descriptions(case, folder), source)
    path.write_text(yaml.safe_dump(case, sort_keys=False), encoding="utf-8")
    return path


def _absolute(value: Any, folder: Path, key: str = "") -> Any:
    """The content with absolute file names; those of the data folder need none."""
    if isinstance(value, Mapping):
        return {k: _absolute(v, folder, str(k)) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_absolute(v, folder, key) for v in value]
    if key not in NAMING or not isinstance(value, str):
        return value
    if is_reference(value):
        return located(value, folder)
    path = file_of(value, folder)
    return value if path is None or not path.is_file() or value.startswith("data:") else str(path.resolve())
