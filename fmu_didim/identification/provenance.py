"""From what a result came: versions, hashes of the inputs, options, the loop."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

from fmu_didim import statistics
from fmu_didim.components.fmu import thresholds as fmu
from fmu_didim.diagnosis import thresholds as diagnosis
from fmu_didim.diagnosis.data import thresholds as data
from fmu_didim.identification import thresholds as identification
from fmu_didim.prediction import thresholds as prediction
from fmu_didim.prediction.experiment import Experiment
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.tables import thresholds as tables
from fmu_didim.thresholds import recorded

TABLES = (
    statistics.TABLE,
    prediction.TABLE,
    diagnosis.TABLE,
    data.TABLE,
    identification.TABLE,
    fmu.TABLE,
    tables.TABLE,
)
PACKAGES = ("fmu_didim", "numpy", "scipy", "casadi", "fmpy", "control")


def provenance(model: LoopModel, estimator: Mapping[str, Any], *, files: Mapping[str, str]) -> dict[str, Any]:
    """The record that goes with an estimate.

    Args:
        estimator: its name and options.
        files: name -> SHA-256 of the files read.
    """
    return {
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}},
        "platform": f"{platform.system()} {platform.machine()}",
        "estimator": dict(estimator),
        "joint_weights": model.joint_weights,
        "low_pass_hz": model.low_pass.cutoff_hz if model.low_pass else None,
        "substep_factor": model.substep_factor,
        "files": dict(files),
        "experiments": {label: _experiment(experiment) for label, experiment in model.experiments.items()},
        "shape_parameters": model.parameters.shape_values(),
        "thresholds": recorded(TABLES),
    }


def _experiment(experiment: Experiment) -> dict[str, Any]:
    return {
        "role": experiment.role,
        "reference_sha256": experiment.reference.digest(),
        "torque_samples": int(experiment.time.size),
        "torque_rate_hz": round(experiment.rate_hz, 6),
        "first_s": float(experiment.time[0]),
        "last_s": float(experiment.time[-1]),
    }
