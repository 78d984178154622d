"""The true sensitivity of the simulated torque: by differentiating the closed loop, or by its finite differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fmu_didim.components.varied import derivative_name
from fmu_didim.errors import SimulationError
from fmu_didim.master import logged_torque, simulate
from fmu_didim.master.variation import with_derivatives
from fmu_didim.prediction.problem import Prediction, Problem, predict_torque
from fmu_didim.prediction.workers import allowed_workers, side_by_side
from fmu_didim.signals import Array

RELATIVE_STEP = 3e-7
"""Of the value at which a parameter alone would make up the whole torque. The simulations of our own plants are
smooth in the parameters, so that truncation and rounding both stay at some 1e-6 of the sensitivity."""
ROUGH_STEPS = (1e-4, 1e-3, 1e-2, 0.03, 0.1)
"""Relative steps tried on a plant whose integrator is not ours: with its own step control, torque jitters when a
parameter changes ever so little."""
ROUGHNESS = 0.1
"""A step is long enough when the second difference is this part of the first; otherwise jitter rules."""
DELAY_STEP = 1e-3
"""Step in the delay of the loop, in samples."""


def sensitivity(problem: Problem, theta: Array, prediction: Prediction, *, with_delay: bool = False) -> Array:
    """S = d tau_s / d theta, (N, n, p); a last column for the delay on request.

    Where the equations of all components are known, one run of the loop with its derivatives gives all columns (see
    :func:`fmu_didim.master.variation.with_derivatives`). Otherwise one further simulation a column for a robot; central
    differences with a step found by trial for parameters that enter a plant in any way. Where compiled code runs the
    loop, ``problem.workers`` of them run side by side.

    Args:
        theta: (p,) parameters; prediction: of the simulation there.
    """
    varied = _by_variation(problem, theta, prediction)
    if varied is not None:
        delayed = [_by_delay(problem, theta, prediction)()] if with_delay else []
        return np.concatenate([varied, *(column[:, :, None] for column in delayed)], axis=2)
    column = _forward if problem.can_refine else _central
    sizes = parameter_scale(problem, theta, prediction)
    tasks = [column(problem, theta, prediction, i, float(size)) for i, size in enumerate(sizes)]
    if with_delay:
        tasks.append(_by_delay(problem, theta, prediction))
    workers = allowed_workers(problem.workers, problem.system, prediction.recording)
    return np.stack(side_by_side(tasks, workers), axis=2)


def _by_variation(problem: Problem, theta: Array, prediction: Prediction) -> Array | None:
    """S from one run of the loop with its derivatives; None where the equations of a component are not known."""
    if not prediction.recording.compiled:
        return None
    system = problem.system_with(theta)
    varied = with_derivatives(system, problem.plant, problem.parameters.plant_names)
    if varied is None:
        return None
    operator, count = problem.experiment.operator, theta.size
    recording = simulate(
        varied, problem.experiment.reference, ticks=operator.ticks, bounds=problem.position_bounds(), pool=problem.pool
    )
    names = [logged_torque(system, j, plant=problem.plant) for j in range(1, problem.joint_count + 1)]
    columns = np.stack(
        [np.column_stack([recording.inputs[derivative_name(name, i)] for i in range(count)]) for name in names], axis=1
    )
    return problem.filtered(operator.apply(columns))


def _forward(problem: Problem, theta: Array, prediction: Prediction, i: int, size: float) -> Callable[[], Array]:
    def column() -> Array:
        moved = theta.copy()
        moved[i] += RELATIVE_STEP * size
        return np.asarray((predict_torque(problem, moved)[0] - prediction.torque) / (moved[i] - theta[i]))

    return column


def _by_delay(problem: Problem, theta: Array, prediction: Prediction) -> Callable[[], Array]:
    def column() -> Array:
        later = predict_torque(problem.with_delay(problem.delay + DELAY_STEP), theta)[0]
        return np.asarray((later - prediction.torque) / DELAY_STEP)

    return column


def _central(problem: Problem, theta: Array, prediction: Prediction, i: int, size: float) -> Callable[[], Array]:
    """The shortest step whose two sides agree; the one whose sides agree best if none does."""

    def column() -> Array:
        best: tuple[float, Array] | None = None
        for relative in ROUGH_STEPS:
            up, down = theta.copy(), theta.copy()
            up[i] += relative * size
            down[i] -= relative * size
            try:
                above, below = predict_torque(problem, up)[0], predict_torque(problem, down)[0]
            except SimulationError:
                break  # a longer step leads still farther away
            first = np.linalg.norm(above - below)
            second = np.linalg.norm(above + below - 2 * prediction.torque)
            rough = float(second / first) if first > 0 else 0.0
            if best is None or rough < best[0]:
                best = rough, (above - below) / (2 * relative * size)
            if rough <= ROUGHNESS:
                break
        if best is None:
            raise SimulationError(
                f"The parameter '{problem.parameters.names[i]}' cannot be varied.",
                got=f"no simulation succeeds near {theta[i]:.6g}",
                next_step="Start from other values.",
            )
        return best[1]

    return column


def parameter_scale(problem: Problem, theta: Array, prediction: Prediction) -> Array:
    """(p,) size of each parameter, never zero."""
    if prediction.regressor is not None:
        return np.asarray(np.linalg.norm(prediction.torque) / np.linalg.norm(prediction.regressor, axis=(0, 1)))
    size = np.maximum(np.abs(theta), np.abs(problem.parameters.nominal()))
    return np.where(size > 0, size, 1.0)
