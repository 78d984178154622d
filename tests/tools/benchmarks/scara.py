"""The SCARA example as loop model and as C program."""

from __future__ import annotations

from functools import cache

import numpy as np

from fmu_didim.case import Case, load_case
from fmu_didim.controllers import read_controller
from fmu_didim.dynamics.block import choose_substeps
from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.model.loop_model import LoopModel
from tests.helpers import ROOT
from tests.tools.benchmarks.c_program import ClosedLoop


@cache
def case() -> Case:
    """Torque at 10 Hz, plant and controller as FMUs, control at 200 Hz, 10 s."""
    return load_case(ROOT / "examples/scara/identify.yaml")


def model() -> LoopModel:
    """Its loop with the data."""
    found = case().model
    assert found is not None
    return found


def program(theta: np.ndarray) -> ClosedLoop:
    """The same loop as one C program, with these base parameters."""
    here = model()
    reference = here.experiments[here.first].reference
    first = dict(zip(reference.names, reference.values[0], strict=True))
    starts = {f"{s}_start{j}": float(first[f"{s}{j}"]) for s in ("q", "dq") for j in (1, 2)}
    robot = RobotModel(read_robot(ROOT / "fmus/scara/robot.yaml"))
    plant = robot.block({**here.parameters.values(theta), **starts})
    p = plant.parameter_values
    rate = float(plant.rate_bound(plant.start(np.zeros(2), p), p)) if plant.rate_bound is not None else 0.0
    step = here.loop.systems[here.first].step_size
    return ClosedLoop(
        plant, read_controller(ROOT / "controllers/scara_pd.yaml"), reference, (1.0, 1.0), step,
        choose_substeps(rate, step),
    )  # fmt: skip
