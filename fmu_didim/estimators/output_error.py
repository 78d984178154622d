"""Output error on positions (section 3 of the DIDIM paper), in closed loop.

    chi = argmin sum_j |q_j - q_sj(chi)|^2 / s_j^2

by SciPy's trust-region least squares; every derivative is a further simulation. Needs positions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.documents import Positive
from fmu_didim.base.errors import SimulationError
from fmu_didim.cosim import sample_operator
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.estimators.base import Estimator, Progress, no_progress
from fmu_didim.estimators.clie import Clie
from fmu_didim.estimators.starts.start import start_values
from fmu_didim.fit.derivatives.sensitivity import parameter_sizes
from fmu_didim.fit.estimate import Estimate, RefusedError, Stage, Status
from fmu_didim.fit.iteration import History, Iteration
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.solver.admissible import mass_matrix_problem, physical_problem
from fmu_didim.fit.statistics import influence_efficient, relative_error_percent
from fmu_didim.fit.uncertainty import Stretch, stretches, uncertainty
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.prediction import predict

TOLERANCE = 1e-8
"""[1] Relative change of the sum of squares and of the parameters at which a fit of positions stops."""
PENALTY = 1e3
"""Residual, in standard deviations, of parameters whose simulation fails: the trust region shrinks away."""


@dataclass(frozen=True)
class OutputError(Estimator):
    """The estimator ``output_error``.

    Attributes:
        start: ``reference``, ``description`` or values by name; of a model without controller its own values, or
            values by name.
        tolerance: relative change of the sum of squares and of the parameters at which it stops, 1e-8 by default; of a
            model without controller as of ``clie``.
        maximum_iterations: evaluations of the residual, those for derivatives not counted.
    """

    name = "output_error"
    needs_positions = True

    start: Any = "reference"
    tolerance: Positive | None = None
    maximum_iterations: int = 100

    @property
    def fits_outputs(self) -> bool:
        """It does."""
        return True

    def finds_minima(self, model: LoopModel) -> bool:
        """Where it is the least squares of outputs; of robots it fits positions."""
        return not model.loop.shows_torque

    def estimate(self, model: LoopModel, *, progress: Progress = no_progress) -> Estimate:
        if not model.loop.shows_torque:  # the least squares of CLIE, with outputs in the place of the torque
            own = Clie(self.start, self.tolerance or Clie.tolerance, self.maximum_iterations)
            return own.estimate(model, progress=progress)
        from scipy.optimize import least_squares  # slow to import

        self.base_alone(model)
        logs = {label: self.positions(model, label) for label in model.estimation_labels}
        start = start_values(model, self.start)
        scale = parameter_sizes(model, start, predict(model, start))
        joints = [f"q{j}" for j in range(1, model.joint_count + 1)]
        measured = np.concatenate([log.select(joints) for log in logs.values()])
        spread = np.sqrt(((measured - measured.mean(axis=0)) ** 2).mean(axis=0))
        history = History(progress)

        def residual(z: Array) -> Array:
            simulated = _positions(model, z * scale, logs)
            if simulated is None:
                return np.full(measured.size, PENALTY)
            return np.asarray((measured - simulated) / spread).ravel()

        def jacobian(z: Array) -> NDArray[np.float64]:
            here = residual(z)
            error = 100 * np.linalg.norm(here) / np.linalg.norm(measured / spread)
            history.add(Iteration(self.name, history.count + 1, z * scale, float(error)))
            columns = []
            for i in range(z.size):
                moved = z.copy()
                moved[i] += STEP
                columns.append((residual(moved) - here) / (moved[i] - z[i]))
            return np.column_stack(columns)

        tolerance = self.tolerance or TOLERANCE
        found = least_squares(
            residual, start / scale, jac=jacobian, method="trf", x_scale="jac",
            ftol=tolerance, xtol=tolerance, gtol=None, max_nfev=self.maximum_iterations,
        )  # fmt: skip
        rows = stretches([log.time for log in logs.values()])
        return self._conclude(model, found, scale, spread, history.iterations, rows)

    def _another_start(self) -> str:
        """The next step where the answer cannot be true."""
        other = "description" if self.start == "reference" else "reference"
        return f"Check units, offset and clock of the positions; or start elsewhere (start: {other})."

    def _conclude(
        self,
        model: LoopModel,
        found: Any,
        scale: Array,
        spread: Array,
        history: Sequence[Iteration],
        rows: Sequence[Stretch],
    ) -> Estimate:
        value = found.x * scale
        n = model.joint_count
        freedom = float(found.fun.size - value.size)
        # The noise of each joint from its own residual, while the weights take one for all.
        per_joint = found.fun.reshape(-1, n)
        deviation = np.sqrt((per_joint**2).sum(axis=0) / (freedom / n)) + TINY
        sensitivity = -found.jac / scale
        influence = influence_efficient(sensitivity).reshape(-1, n, value.size)
        known = uncertainty(per_joint, sensitivity.reshape(influence.shape), influence, deviation, rows)
        reason = physical_problem(model, value, known.deviation)
        if reason or (np.abs(found.fun) >= PENALTY).all():
            raise RefusedError(
                "The identified model is not physical.", iterations=history, got=reason or "no simulation succeeded",
                next_step=self._another_start(), values=value, deviation=known.deviation,
            )  # fmt: skip
        torque, measured = model.torque(value), model.measured
        singular = np.linalg.svd(found.jac / np.linalg.norm(found.jac, axis=0), compute_uv=False)
        error = relative_error_percent(measured, torque)[0]
        return Estimate(
            estimator=self.name,
            model=model.with_values(value),
            covariance=known.covariance,
            freedom=freedom / known.inflation**2,
            time=model.experiments.time,
            measured=measured,
            simulated=torque,
            noise=np.sqrt(((measured - torque) ** 2).mean(axis=0)),
            condition_number=float(singular[0] / singular[-1]),
            status=Status.CONVERGED if found.status > 0 else Status.MAXIMUM_ITERATIONS,
            iterations=tuple(history),
            stages={self.name: Stage(value, known.deviation)},
            colours=known.colours,
            remarks=(
                f"Standard deviation of the position residual: {', '.join(f'{v:.3g}' for v in deviation * spread)}.",
                f"Torque error at the solution: {error:.2f} % (the positions were fitted, not the torque).",
            ),
        )


STEP = 1e-5
"""Relative step of the derivatives, of the value at which a parameter alone makes up the whole torque."""


def _positions(model: LoopModel, values: Array, logs: Mapping[str, Trajectory]) -> Array | None:
    """Simulated positions (N, n) at the instants of the logs, or None if the values cannot be simulated."""
    if mass_matrix_problem(model, values):
        return None
    found = []
    for label, log in logs.items():
        run = model.simulation(values, label)
        first, count = float(run.experiment.reference.time[0]), run.experiment.reference.time.size
        held = sample_operator(log.time, start=first, step=run.step_size, tick_count=count, instants=run.instants)
        operator = held.stamped_later(0.0, count, between=True)  # a position moves on between ticks
        try:
            recording = run.record(ticks=operator.ticks)
        except SimulationError:
            return None
        found.append(operator.apply(recording.table(model.loop.joint_signals("q"), sampled=True)))
    return np.concatenate(found)
