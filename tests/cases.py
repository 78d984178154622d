"""The SCARA example as a case file, with changes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.export import build_fmu

SCARA = Path("examples/scara/identify.yaml")
TRUTH = np.array([3.43, 0.03, 0.82, 0.063, 0.241, 0.014, 0.013, 0.137])
"""Its base parameters: ZZ1R, Fv1, Fc1, ZZ2, MX2, MY2, Fv2, Fc2."""
ENTRIES = {
    "inertia 1": {"parameter": "ZZ1", "start": 3.0, "minimum": 0.0}, "Fv1": {"start": 0.05}, "Fc1": {"start": 0.6},
    "ZZ2": {"start": 0.08}, "MX2": {"start": 0.2}, "MY2": {"start": 0.0}, "Fv2": {"start": 0.0}, "Fc2": {"start": 0.1},
}  # fmt: skip
"""They, as parameters of a plant without robot description."""


def scara_case(folder: Path, **changes: Any) -> Path:
    """A copy of the SCARA example with other top-level entries; paths made absolute."""
    content = yaml.safe_load(SCARA.read_text(encoding="utf-8"))
    here = SCARA.parent.resolve()
    content["robot"] = str(here / content["robot"])
    content["controller"]["source"] = str(here / content["controller"]["source"])
    for name in ("train", "validation"):
        content[name]["torque"]["file"] = str(here / content[name]["torque"]["file"])
    for key, value in changes.items():
        if isinstance(value, dict) and isinstance(content.get(key), dict):
            content[key] = {**content[key], **value}
        else:
            content[key] = value
    path = folder / "case.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def plant_case(folder: Path, identify_entries: dict[str, Any], **estimator: Any) -> Path:
    """The SCARA with its plant as a mere FMU: no robot description in the case."""
    fmu = build_fmu(RobotModel(read_robot("fmus/scara/robot.yaml")).block(), directory=folder)
    path = scara_case(folder, plant={"kind": "fmu", "source": str(fmu)})
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    del content["robot"]
    content["identify"] = identify_entries
    content["estimator"] = {"kind": "clie", **estimator}
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path
