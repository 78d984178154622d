"""Direct and cross validation: simulated against measured torque, relative error per joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmu_didim.errors import SimulationError
from fmu_didim.prediction.problem import Experiment, Problem, predict_torque
from fmu_didim.signals import Array
from fmu_didim.statistics import relative_error_percent


@dataclass(frozen=True)
class Validation:
    """Measured and simulated torque of one experiment.

    Attributes:
        label: ``train`` or ``validation``.
        time: (N,) s; measured, simulated: (N, n) N.m or N.
        total_percent, per_joint_percent: 100 |y - y_s| / |y|, (n,) for the joints.
        failure: why the simulation failed, or empty; the values are then NaN.
    """

    label: str
    time: Array
    measured: Array
    simulated: Array
    total_percent: float
    per_joint_percent: Array
    failure: str = ""


def validate(problem: Problem, theta: Array, experiment: Experiment, *, label: str) -> Validation:
    """Simulate the loop with the parameters (b,) on an experiment and compare the torques."""
    there = problem.on(experiment)
    measured = there.measured
    try:
        simulated = predict_torque(there, theta)[0]
    except SimulationError as error:
        nothing = np.full_like(measured, np.nan)
        joints = np.full(measured.shape[1], np.nan)
        return Validation(label, experiment.time, measured, nothing, float("nan"), joints, str(error))
    total, per_joint = relative_error_percent(measured, simulated)
    return Validation(label, experiment.time, measured, simulated, total, per_joint)
