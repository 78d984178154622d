"""CLIE: closed-loop input error.

    theta = argmin | W^(1/2) (y - tau_s(theta)) |^2

by Gauss-Newton with the true sensitivity of the simulated torque, one further closed-loop simulation a
parameter. It needs no inverse model, so the parameters may enter the plant, an FMU say, in any way. Source:
Gautier, Janot, Vandanjon, IEEE TCST 21(2), 2013, where it is compared with DIDIM.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fmu_didim.errors import SimulationError
from fmu_didim.estimators.base import Estimator, Progress, no_progress
from fmu_didim.identification.conclude import minimise, torque_estimate
from fmu_didim.identification.estimate import Estimate, RefusedError, Stage
from fmu_didim.identification.start import start_values
from fmu_didim.prediction.finish import evaluate
from fmu_didim.prediction.guard import mass_matrix_problem, physical_problem, tracking_problem
from fmu_didim.prediction.iteration import Iteration
from fmu_didim.prediction.problem import Problem

ADVICE = (
    "Start nearer to the truth (start: {name: value}), check the sign, unit and clock of the torque, the controller, "
    "and the delay of the loop."
)


@dataclass(frozen=True)
class Clie(Estimator):
    """The estimator ``clie``.

    Attributes:
        start: ``description`` (the values of the plant), ``reference`` (robots only) or values by name.
        tolerance: no parameter moves by more than this part of its size or of its standard deviation.
        maximum_iterations: Gauss-Newton steps.
        estimate_delay: whether the delay of the loop is estimated too.
    """

    name = "clie"
    needs_positions = False

    start: Any = "description"
    tolerance: float = 1e-6
    maximum_iterations: int = 40
    estimate_delay: bool = False

    def estimate(self, problem: Problem, *, progress: Progress = no_progress) -> Estimate:
        theta = problem.parameters.limited(start_values(problem, self.start))
        reason = mass_matrix_problem(problem, theta)
        if reason:
            raise RefusedError("The start cannot be simulated.", iterations=[], got=reason, next_step=ADVICE)
        try:
            point = evaluate(problem, np.append(theta, problem.delay) if self.estimate_delay else theta)
        except SimulationError as error:
            raise RefusedError(
                "The start cannot be simulated.", iterations=[Iteration("clie", 1, theta, np.nan, note=error.what)],
                got=str(error), next_step=ADVICE,
            ) from error  # fmt: skip
        minimum = minimise(
            problem, point, tolerance=self.tolerance, progress=progress, stage=self.name,
            maximum_iterations=self.maximum_iterations,
        )  # fmt: skip
        point, covariance = minimum.point, minimum.point.covariance
        sigma = np.sqrt(np.diag(covariance))
        count = problem.parameters.count
        reason = physical_problem(problem, point.theta[:count], sigma[:count]) or tracking_problem(
            problem, point.prediction.torque
        )
        if reason:
            raise RefusedError(
                "The identified model is not physical.",
                iterations=list(minimum.iterations),
                got=reason,
                next_step=ADVICE,
            )
        return torque_estimate(
            problem, point, covariance, estimator=self.name, settled=minimum.settled, iterations=minimum.iterations,
            stages={self.name: Stage(point.theta, sigma)}, difference=minimum.integration_error,
            remarks=minimum.remarks,
        )  # fmt: skip
