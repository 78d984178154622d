"""A lower minimum beyond a barrier: light joints whose loop resonates above half the rate of the log.

Such a resonance shows folded back in the samples, and several inertias explain it nearly alike: along the inertia of
the joint the torque error has a minimum at each, and the iterations end in the one they started in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fmu_didim.diagnosis.motion_dependence import motion_diagnostics
from fmu_didim.errors import SimulationError
from fmu_didim.identification import thresholds as limits
from fmu_didim.identification.conclude import Minimum
from fmu_didim.prediction.fit import Fit, point, sum_of_squares
from fmu_didim.prediction.guard import mass_matrix_problem
from fmu_didim.prediction.light_plant import stiffness
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.prediction.parameters import RobotParameters
from fmu_didim.prediction.weighting import NoiseOfResidual
from fmu_didim.signals import Array


def lowest(minimum: Minimum, finish: Callable[[Fit], Minimum]) -> Minimum:
    """The same minimum, or a lower one beyond it where its residual is no noise: at a wrong one it follows the motion.

    Args:
        finish: minimises the torque error from a point.
    """
    for _ in range(limits.OTHER_MINIMA):
        fit = minimum.fit
        if not motion_diagnostics(minimum.dependence):
            break
        other = lower_elsewhere(fit)
        if other is None:
            break
        values, name = other
        found = finish(point(fit.model.with_values(values), NoiseOfResidual(fit.model)))
        place = found.fit.model.index(name)
        text = (
            f"The torque error has several minima along {name}: {fit.values[place]:.4g} was left for "
            f"{found.fit.values[place]:.4g}, where it is smaller. A log at a higher rate would show one alone."
        )
        minimum = replace(found, iterations=(*minimum.iterations, *found.iterations), remarks=(*found.remarks, text))
    return minimum


def lower_elsewhere(fit: Fit) -> tuple[Array, str] | None:
    """Values (p,) with a lower torque error beyond a barrier and the parameter that moves, or None.

    Along each such inertia the error is taken on a grid; the others stay where they are.
    """
    model = fit.model.integrated_as(fit.values)
    places = folded_inertias(model, fit.values)
    if not places:
        return None
    begin = _first_samples(model, limits.SCANNED)
    factors = np.geomspace(1 / limits.FARTHEST_FACTOR, limits.FARTHEST_FACTOR, limits.SCAN_POINTS)
    for place in places:
        here = _cost(begin, fit.values, fit.deviation)
        costs = np.array([_cost(begin, _scaled(fit.values, place, f), fit.deviation) for f in factors])
        best = _scaled(fit.values, place, float(factors[int(np.argmin(costs))]))
        if costs.min() < here and _cost(model, best, fit.deviation) < fit.chi_square:
            return best, model.names[place]
    return None


def folded_inertias(model: LoopModel, values: Array) -> list[int]:
    """Places of the motor or link inertias of joints whose loop resonates above half the rate of the log: there
    |C(i w)| > M_jj w^2 with the response C of the controller at that frequency w."""
    parameters = model.parameters
    if not isinstance(parameters, RobotParameters):
        return []
    run = model.simulation(values)
    frequency = np.pi * run.experiment.rate_hz
    if frequency * run.step_size > 1:
        return []  # the control is not faster than the log
    try:
        response = np.abs(stiffness(run, frequency))
    except SimulationError:
        return []
    robot, base = parameters.model, parameters.base
    mass = robot.inertia_columns(np.zeros(model.joint_count)) @ base.expand(run.theta)
    fast = response > np.diag(mass) * frequency**2
    found = []
    for j in np.flatnonzero(fast) + 1:
        own = [i for i, name in enumerate(base.standard) if name in (f"Ia{j}", f"ZZ{j}", f"M{j}")]
        found += own[-1:]
    return found


def _scaled(values: Array, place: int, factor: float) -> Array:
    result = values.copy()
    result[place] *= factor
    return result


def _first_samples(model: LoopModel, count: int) -> LoopModel:
    """The model with the first samples of each fitted experiment alone."""
    for label in model.estimation_labels:
        one = model.experiments[label]
        if one.time.size > count:
            short = replace(one, time=one.time[:count], torque=one.torque[:count], operator=one.operator.before(count))
            model = model.with_experiment(label, short)
    return model


def _cost(model: LoopModel, values: Array, deviation: Array) -> float:
    if mass_matrix_problem(model, values):
        return np.inf
    try:
        return sum_of_squares(model.residual(values), deviation)
    except SimulationError:
        return np.inf
