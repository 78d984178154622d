"""One run of a campaign apart from it: its case with its data as files, for ``fmu-didim identify`` or ``discover``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from fmu_didim.base.imports import is_reference, located
from fmu_didim.campaigns.planning.fields import written
from fmu_didim.campaigns.planning.identity import NAMING, file_of
from fmu_didim.campaigns.planning.plan import Plan, Run
from fmu_didim.campaigns.planning.truth import noisy_logs, on_simulated, simulated_truth, validated_noise
from fmu_didim.data.signals import write_csv

CASE_FILE = "case.yaml"


def write_alone(plan: Plan, run: Run, folder: Path) -> Path:
    """Write case and data of a run to a folder; returns the case file.

    Raises:
        InputError, SimulationError: the data cannot be simulated.
    """
    folder.mkdir(parents=True, exist_ok=True)
    content = plan.content(run.settings)
    here = Path(content.folder)
    case = content.case
    if content.truth is not None:
        truth = simulated_truth(written(content.truth, folder), here)
        for name, log in noisy_logs(truth, validated_noise(content.noise), run.data).items():
            write_csv(log, folder / name, digits=17)
        case = on_simulated(case)
    path = folder / CASE_FILE
    path.write_text(yaml.safe_dump(_absolute(written(case, folder), here), sort_keys=False), encoding="utf-8")
    return path


def _absolute(value: Any, folder: Path, key: str = "") -> Any:
    """A content whose files are found from everywhere; those of the data folder are so already."""
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
