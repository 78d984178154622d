"""Output error on positions (section 3 of the DIDIM paper), in closed loop.

    chi = argmin sum_j |q_j - q_sj(chi)|^2 / s_j^2

by SciPy's trust-region least squares; every derivative is a further simulation. Needs positions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from fmu_didim.errors import SimulationError
from fmu_didim.estimators.base import Estimator, Progress, no_progress
from fmu_didim.identification.estimate import Estimate, RefusedError, Stage, Status
from fmu_didim.identification.start import start_values
from fmu_didim.master import sample_operator, simulate
from fmu_didim.prediction.guard import mass_matrix_problem, physical_problem
from fmu_didim.prediction.iteration import Iteration
from fmu_didim.prediction.plant_sensitivity import parameter_scale
from fmu_didim.prediction.problem import Problem, joint_signals, predict
from fmu_didim.signals import Array
from fmu_didim.statistics import covariance_efficient, relative_error_percent

PENALTY = 1e3
"""Residual, in standard deviations, of parameters whose simulation fails: the trust region shrinks away."""


@dataclass(frozen=True)
class OutputError(Estimator):
    """The estimator ``output_error``.

    Attributes:
        start: ``reference``, ``description`` or values by name.
        tolerance: relative change of the sum of squares and of the parameters at which it stops.
        maximum_iterations: evaluations of the residual, those for derivatives not counted.
    """

    name = "output_error"
    needs_positions = True

    start: Any = "reference"
    tolerance: float = 1e-8
    maximum_iterations: int = 100

    def estimate(self, problem: Problem, *, progress: Progress = no_progress) -> Estimate:
        positions = self.positions(problem)
        start = start_values(problem, self.start)
        scale = _scale(problem, start)
        measured = positions.select([f"q{j}" for j in range(1, problem.joint_count + 1)])
        spread = np.sqrt(((measured - measured.mean(axis=0)) ** 2).mean(axis=0))
        history: list[Iteration] = []

        def residual(z: Array) -> Array:
            simulated = _positions(problem, z * scale, positions.time)
            if simulated is None:
                return np.full(measured.size, PENALTY)
            return np.asarray((measured - simulated) / spread).ravel()

        def told(z: Array, value: Array) -> None:
            error = 100 * np.linalg.norm(value) / np.linalg.norm(measured / spread)
            history.append(Iteration(self.name, len(history) + 1, z * scale, float(error)))
            progress(history[-1])

        def jacobian(z: Array) -> NDArray[np.float64]:
            here = residual(z)
            told(z, here)
            columns = []
            for i in range(z.size):
                moved = z.copy()
                moved[i] += STEP
                columns.append((residual(moved) - here) / (moved[i] - z[i]))
            return np.column_stack(columns)

        found = least_squares(
            residual, start / scale, jac=jacobian, method="trf", x_scale="jac",
            ftol=self.tolerance, xtol=self.tolerance, gtol=None, max_nfev=self.maximum_iterations,
        )  # fmt: skip
        return self._conclude(problem, found, scale, spread, history)

    def _conclude(
        self, problem: Problem, found: Any, scale: Array, spread: Array, history: list[Iteration]
    ) -> Estimate:
        value = found.x * scale
        n = problem.joint_count
        freedom = float(found.fun.size - value.size)
        # The noise of each joint from its own residual, as the weights assume one for all.
        per_joint = found.fun.reshape(-1, n)
        deviation = np.sqrt((per_joint**2).sum(axis=0) / (freedom / n)) + 1e-300
        s = (found.jac.reshape(-1, n, value.size) / deviation[None, :, None]).reshape(-1, value.size)
        covariance = covariance_efficient(s) * np.outer(scale, scale)
        sigma = np.sqrt(np.diag(covariance))
        reason = physical_problem(problem, value, sigma)
        if reason or (np.abs(found.fun) >= PENALTY).all():
            raise RefusedError(
                "The identified model is not physical.", iterations=history, got=reason or "no simulation succeeded",
                next_step="Start from the reference trajectory (start: reference).",
            )  # fmt: skip
        prediction = predict(problem, value)
        singular = np.linalg.svd(found.jac / np.linalg.norm(found.jac, axis=0), compute_uv=False)
        measured = problem.measured
        error = relative_error_percent(measured, prediction.torque)[0]
        return Estimate(
            estimator=self.name,
            names=problem.parameters.names,
            units=problem.parameters.units,
            value=value,
            standard_deviation=sigma,
            covariance=covariance,
            freedom=freedom,
            time=problem.experiment.time,
            measured=measured,
            simulated=prediction.torque,
            noise=np.sqrt(((measured - prediction.torque) ** 2).mean(axis=0)),
            condition_number=float(singular[0] / singular[-1]),
            status=Status.CONVERGED if found.status > 0 else Status.MAXIMUM_ITERATIONS,
            iterations=tuple(history),
            stages={self.name: Stage(value, sigma)},
            base_count=value.size,
            remarks=(
                f"Standard deviation of the position residual: {', '.join(f'{v:.3g}' for v in deviation * spread)}.",
                f"Torque error at the solution: {error:.2f} % (the positions were fitted, not the torque).",
            ),
        )


STEP = 1e-5
"""Relative step of the derivatives, of the value at which a parameter alone makes up the whole torque."""


def _scale(problem: Problem, theta: Array) -> Array:
    """(p,) size of each parameter."""
    return parameter_scale(problem, theta, predict(problem, theta))


def _positions(problem: Problem, theta: Array, time: Array) -> Array | None:
    """Simulated positions (N, n) at the instants, or None if the parameters cannot be simulated."""
    if mass_matrix_problem(problem, theta):
        return None
    reference, step = problem.experiment.reference, problem.system.step_size
    operator = sample_operator(time, start=float(reference.time[0]), step=step, tick_count=reference.time.size)
    try:
        recording = simulate(
            problem.system_with(theta), reference, ticks=operator.ticks, bounds=problem.position_bounds()
        )
    except SimulationError:
        return None
    return operator.apply(recording.table(joint_signals(problem, "q"), sampled=True))
