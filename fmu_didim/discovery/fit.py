"""Least squares of the closed loop: Gauss-Newton with true sensitivities, limits and step halving.

    values = argmin sum_j w_j^2 |y_j - tau_j(values)|^2,   w_j = sqrt(f_j) / sigma_j

so that the minimum is a chi-square with as many degrees of freedom as there are independent samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmu_didim.discovery.loop_model import LoopModel
from fmu_didim.discovery.noise import Noise
from fmu_didim.errors import SimulationError
from fmu_didim.signals import Array

MAXIMUM_HALVINGS = 6
SETTLED = 0.02
"""A step that promises to lower chi-square by less than this is not made: BIC differences of 10 count."""


@dataclass(frozen=True)
class Fit:
    """A minimum.

    Attributes:
        model: with its values; values: (p,); torque: (N, n); jacobian: (N, n, p), exact to the last large step.
        chi_square: weighted sum of squares; simulations: how many it took.
    """

    model: LoopModel
    values: Array
    torque: Array
    jacobian: Array
    chi_square: float
    simulations: int = 0

    @property
    def residual(self) -> Array:
        """(N, n) measured minus simulated torque."""
        return self.model.runs["train"].measured - self.torque

    def covariance(self, noise: Noise) -> Array:
        """(p, p) covariance of the values by the Cramer-Rao bound, with the effective number of samples."""
        weighted = (self.jacobian * noise.weight[:, None]).reshape(-1, self.jacobian.shape[2])
        scale = np.linalg.norm(weighted, axis=0)
        scale[scale == 0] = np.inf
        return np.asarray(np.linalg.pinv((weighted / scale).T @ (weighted / scale)) / np.outer(scale, scale))


def minimise(
    model: LoopModel,
    noise: Noise,
    *,
    jacobian: Array | None = None,
    torque: Array | None = None,
    renew: int = 3,
    iterations: int = 8,
    hopeless: float = np.inf,
) -> Fit:
    """Fit all knobs of a model, from their values.

    Args:
        jacobian: (N, n, p) at the start, if known; stale columns only slow the steps down.
        torque: (N, n) at the start, if known.
        renew: how often the Jacobian may be computed anew after a large step.
        iterations: largest number of steps.
        hopeless: the fit ends early where not even twice what a step promises brings the cost below this.

    Raises:
        SimulationError: the start cannot be simulated.
    """
    weight, measured = noise.weight, model.runs["train"].measured
    low, high = model.limits
    values = np.clip(model.start, low, high)
    count = 0
    if torque is None:
        torque, count = model.torque(values), 1
    cost = _cost(measured - torque, weight)
    fresh = jacobian is None
    if jacobian is None:
        jacobian, count = model.sensitivity(values, torque), count + values.size
    for _ in range(iterations):
        step, promised = _step(jacobian, measured - torque, weight, values, low, high)
        if promised < SETTLED or cost - 2 * promised > hopeless:
            break
        found = _search(model, values, step, measured, weight, cost)
        count += found.tried
        if found.torque is None:
            if fresh or renew <= 0:
                break
            jacobian, fresh, renew = model.sensitivity(values, torque), True, renew - 1
            count += values.size
            continue
        gained = cost - found.cost
        values, torque, cost, fresh = found.values, found.torque, found.cost, False
        # Far from what the linear model promised: its slopes are stale.
        if renew > 0 and not 0.5 * promised <= gained <= 1.5 * promised:
            jacobian, fresh, renew = model.sensitivity(values, torque), True, renew - 1
            count += values.size
    return Fit(model.with_values(values), values, torque, jacobian, cost, count)


@dataclass(frozen=True)
class _Found:
    values: Array
    torque: Array | None
    cost: float
    tried: int


def _search(model: LoopModel, values: Array, step: Array, measured: Array, weight: Array, cost: float) -> _Found:
    low, high = model.limits
    for halving in range(MAXIMUM_HALVINGS):
        trial = np.clip(values + step / 2**halving, low, high)
        try:
            torque = model.torque(trial)
        except SimulationError:
            continue
        reached = _cost(measured - torque, weight)
        if reached < cost:
            return _Found(trial, torque, reached, halving + 1)
    return _Found(values, None, cost, MAXIMUM_HALVINGS)


def _step(
    jacobian: Array, residual: Array, weight: Array, values: Array, low: Array, high: Array
) -> tuple[Array, float]:
    """The Gauss-Newton step with knobs at a limit held there, and how much it promises to lower the cost."""
    size = jacobian.shape[2]
    weighted = (jacobian * weight[:, None]).reshape(-1, size)
    right = (residual * weight).ravel()
    scale = np.linalg.norm(weighted, axis=0)
    free = scale > 0
    step = np.zeros(size)
    for _ in range(size):
        step = np.zeros(size)
        table = weighted[:, free] / scale[free]
        step[free] = np.linalg.lstsq(table, right, rcond=1e-10)[0] / scale[free]
        # At a limit and pushed outwards: held.
        stuck = free & (((values <= low) & (step < 0)) | ((values >= high) & (step > 0)))
        if not stuck.any():
            break
        free &= ~stuck
    promised = float(right @ right - np.sum((right - weighted @ step) ** 2))
    return step, promised


def _cost(residual: Array, weight: Array) -> float:
    return float(np.sum((residual * weight) ** 2))
