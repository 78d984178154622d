"""The SCARA example as problem, loop and C program."""

from __future__ import annotations

from functools import cache

import numpy as np
from fmu_didim.prediction.problem import Problem

from fmu_didim.block import choose_substeps
from fmu_didim.case import Case, load_case
from fmu_didim.controllers import read_controller
from fmu_didim.robot import RobotModel, read_robot
from tests.benchmarks.c_program import ClosedLoop
from tests.helpers import ROOT


@cache
def case() -> Case:
    """Torque at 10 Hz, plant and controller as FMUs, control at 200 Hz, 10 s."""
    return load_case(ROOT / "examples/scara/identify.yaml")


def problem() -> Problem:
    """Its identification problem."""
    found = case().problem
    assert found is not None
    return found


def program(theta: np.ndarray) -> ClosedLoop:
    """The same loop as one C program, with these base parameters."""
    here = problem()
    first = dict(zip(here.experiment.reference.names, here.experiment.reference.values[0], strict=True))
    starts = {f"{s}_start{j}": float(first[f"{s}{j}"]) for s in ("q", "dq") for j in (1, 2)}
    model = RobotModel(read_robot(ROOT / "fmus/scara/robot.yaml"))
    plant = model.block({**here.parameters.values(theta), **starts})
    p = plant.parameter_values
    rate = float(plant.rate_bound(plant.start(np.zeros(2), p), p)) if plant.rate_bound is not None else 0.0
    step = here.system.step_size
    return ClosedLoop(
        plant, read_controller(ROOT / "controllers/scara_pd.yaml"), here.experiment.reference, (1.0, 1.0), step,
        choose_substeps(rate, step),
    )  # fmt: skip
