"""Logs of one SCARA before and after something has happened to it, and the results of both."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fmu_didim import Log, RobotDescription, Trajectory, identify, load_case, read_robot, simulate
from fmu_didim.discovery.change.answers import Answer
from fmu_didim.workflow.output.result import Result

CASE = "examples/scara/identify.yaml"
ROBOT = "fmus/scara/robot.yaml"
NOISE = np.array([0.17, 0.0065])
"""[N.m] Of the torque of each joint, as in the example."""


def with_mass(robot: RobotDescription, mass: float, x: float, y: float) -> RobotDescription:
    """The robot with a point mass on its last link."""
    values = {v.name: v.start for v in robot.standard_parameters()}
    added = {"M2": mass, "MX2": mass * x, "MY2": mass * y, "ZZ2": mass * (x * x + y * y)}
    # the description regroups 0.25 M2 into ZZ1
    return robot.with_values({name: values[name] + value for name, value in added.items()})


@cache
def _motion(values: tuple[tuple[str, float], ...], mass: tuple[float, float, float] | None) -> Trajectory:
    robot = read_robot(ROBOT).with_values(dict(values))
    if mass is not None:
        robot = with_mass(robot, *mass)
    return simulate(load_case(CASE).with_(), robot=robot)


def log_of(
    rate_hz: float,
    seed: int,
    *,
    values: Mapping[str, float] | None = None,
    mass: tuple[float, float, float] | None = None,
    gain: tuple[float, float] = (1.0, 1.0),
    noise: float = 1.0,
    every: int = 1,
    late_s: float = 0.0,
    offset: tuple[float, float] = (0.0, 0.0),
) -> Log:
    """A log of the torque.

    Args:
        values: of the robot, where they are not those of the description; mass: of a payload, kg, and its place, m.
        gain: what the log says over what the drive gives; every: of its samples, that are kept.
        late_s: by which its stamps are late; offset: of the torque, N.m.
    """
    table = _motion(tuple(sorted((values or {}).items())), mass)
    step = table.time[1] - table.time[0]
    rows = slice(0, table.time.size - 1, round(1 / rate_hz / step))
    instants = table.time[rows] - late_s
    torque = np.column_stack([np.interp(instants, table.time, table.column(f"tau{j}")) for j in (1, 2)]) * gain + offset
    torque = torque + noise * NOISE * np.random.default_rng(seed).normal(size=torque.shape)
    return Log(table.time[rows][::every], torque[::every])


def identified(log: Log, **changes: object) -> Result:
    """What is identified from a log."""
    return identify(_content() | changes, log=log)


def _content() -> dict[str, Any]:
    content = yaml.safe_load(Path(CASE).read_text(encoding="utf-8"))
    del content["validation"], content["estimator"]
    for part in (content, content["controller"]):
        for key in {"robot", "source"} & set(part):
            part[key] = str((Path(CASE).parent / part[key]).resolve())
    return dict(content)


def write_case(path: Path, log: Log, **changes: Any) -> None:
    """Write a case of a log, and the log beside it."""
    content = _content() | changes
    table = path.with_suffix(".csv")
    rows = np.column_stack([log.time, log.torque])
    np.savetxt(table, rows, fmt="%.9g", delimiter=",", header="t,tau1,tau2", comments="")
    content["train"]["torque"] = {"file": table.name}
    path.write_text(yaml.safe_dump(content), encoding="utf-8")


def answer(place: str, result: Result) -> Answer:
    """A result as it is compared."""
    return Answer(place, "", result.document, result.validations, result.robot)
