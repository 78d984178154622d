"""The thresholds of everything that discovery runs, as they go into ``findings.json``."""

from __future__ import annotations

from fmu_didim import statistics
from fmu_didim.components.fmu import thresholds as fmu
from fmu_didim.diagnosis import thresholds as diagnosis
from fmu_didim.diagnosis.data import thresholds as data
from fmu_didim.discovery import thresholds as discovery
from fmu_didim.discovery.augmentation import thresholds as augmentation
from fmu_didim.discovery.external_torques import thresholds as external_torques
from fmu_didim.discovery.next_experiment import thresholds as next_experiment
from fmu_didim.discovery.screening import thresholds as screening
from fmu_didim.discovery.selection import thresholds as selection
from fmu_didim.prediction import thresholds as prediction
from fmu_didim.tables import thresholds as tables
from fmu_didim.thresholds import recorded

TABLES = tuple(
    module.TABLE
    for module in (
        statistics, prediction, diagnosis, data, discovery, augmentation, screening, selection, external_torques,
        next_experiment, fmu, tables,
    )
)  # fmt: skip


def all_thresholds() -> dict[str, float | list[float]]:
    """Name -> value of each of them."""
    return recorded(TABLES)
