"""Least squares of the closed loop: Gauss-Newton with true sensitivities and limits, damped where it must be.

    values = argmin sum_j w_j^2 |y_j - tau_j(values)|^2,   w_j = sqrt(f_j) / sigma_j

so that the minimum is a chi-square with as many degrees of freedom as there are independent samples. A step is damped
(Levenberg, Marquardt) if after it the cost is not lower, an experiment, held out or not, cannot be simulated, or the
inertia matrix is not positive definite somewhere along its motion: what the data hardly show moves less then, as where
the base parameters make up for an effect that is missing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.errors import SimulationError
from fmu_didim.prediction.guard import mass_matrix_problem
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.prediction.noise import Noise
from fmu_didim.prediction.sensitivity import sensitivity
from fmu_didim.signals import Array

DAMPINGS = (0.0, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0)
"""Tried one after the other, for columns of the Jacobian of length one."""
CREEPING = 0.01
"""Part of the cost that a step must gain along the edge of what can be simulated."""
POLISHING = 2
"""Steps from the minimum of a coarse integration to that of the full one, a small part of the noise away."""
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
    jacobian_updates: int = 3,
    iterations: int = 8,
    give_up_above: float = np.inf,
    everywhere: bool = True,
    exact: bool = False,
) -> Fit:
    """Fit all free parameters of a model, from their values.

    Args:
        jacobian: (N, n, p) at the start, if known; stale columns only slow the steps down.
        torque: (N, n) at the start, if known.
        jacobian_updates: how often the Jacobian may be computed anew after a large step.
        iterations: largest number of steps.
        give_up_above: the fit ends early where not even twice what a step promises brings the cost below this.
        everywhere: whether each step must leave all experiments simulable, not only the fitted one.
        exact: whether the Jacobian is computed anew at the minimum; of gears that open it changes within a per cent.

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
        jacobian, count = sensitivity(model, values, torque), count + values.size
    for _ in range(iterations):
        equations = _Equations.of(jacobian * weight[:, None], (measured - torque) * weight)
        _, promised = equations.step(values, low, high, 0.0)
        if promised < SETTLED or cost - 2 * promised > give_up_above:
            break
        found = _search(model, equations, values, weight, cost, everywhere)
        count += found.tried
        if found.torque is None:
            if fresh or jacobian_updates <= 0:
                break
            jacobian, fresh, jacobian_updates = sensitivity(model, values, torque), True, jacobian_updates - 1
            count += values.size
            continue
        gained = cost - found.cost
        values, torque, cost, fresh = found.values, found.torque, found.cost, False
        if found.at_edge and gained < CREEPING * cost:
            break
        # Far from what the linear model promised: its slopes are stale.
        if jacobian_updates > 0 and not 0.5 * found.promised <= gained <= 1.5 * found.promised:
            jacobian, fresh, jacobian_updates = sensitivity(model, values, torque), True, jacobian_updates - 1
            count += values.size
    if exact and not fresh:
        jacobian, count = sensitivity(model, values, torque), count + values.size
    return Fit(model.with_values(values), values, torque, jacobian, cost, count)


def integrated(fit: Fit, noise: Noise, *, coarse: bool) -> Fit:
    """The same minimum with coarse or full integration; raises SimulationError where that cannot be simulated."""
    if fit.model.coarse == coarse:
        return fit
    return minimise(
        replace(fit.model, coarse=coarse), noise, jacobian=fit.jacobian, jacobian_updates=0, iterations=POLISHING
    )


@dataclass(frozen=True)
class _Found:
    values: Array
    torque: Array | None
    cost: float
    promised: float
    tried: int
    at_edge: bool


def _search(
    model: LoopModel, equations: _Equations, values: Array, weight: Array, cost: float, everywhere: bool
) -> _Found:
    """The least damped step that lowers the cost; the next more damped one where less damping is not feasible, because
    at the edge of what can be simulated a loop hardly damps itself any more."""
    low, high = model.limits
    others = [label for label in model.runs if label != "train"] if everywhere else []
    tried, edge, best = 0, False, None
    for damping in DAMPINGS:
        step, promised = equations.step(values, low, high, damping)
        trial = np.clip(values + step, low, high)
        if any(mass_matrix_problem(run.problem, trial[: model.base_count]) for run in model.runs.values()):
            edge = True
            continue
        tried += 1
        try:
            torque = model.torque(trial)
            reached = _cost(model.runs["train"].measured - torque, weight)
            if reached < cost:
                for label in others:  # what was measured there is not looked at
                    model.torque(trial, label)
        except SimulationError:
            edge = True
            continue
        if reached < cost:
            found = _Found(trial, torque, reached, promised, tried, edge)
            if best is not None or not edge:
                return found
            best = found
    return best or _Found(values, None, cost, 0.0, tried, edge)


@dataclass(frozen=True)
class _Equations:
    """The linear least squares problem of a step, min |table (step * scale) - right|, brought to (p, p) by QR.

    Attributes:
        table: (p, p) columns of length one; right: (p,); scale: (p,) lengths of the columns, zero for idle free
        parameters.
    """

    table: Array
    right: Array
    scale: Array

    @staticmethod
    def of(jacobian: Array, residual: Array) -> _Equations:
        """From (N, n, p) and (N, n), both weighted."""
        flat = jacobian.reshape(-1, jacobian.shape[2])
        scale = np.linalg.norm(flat, axis=0)
        q, r = np.linalg.qr(flat / np.where(scale > 0, scale, 1.0))
        return _Equations(r, q.T @ residual.ravel(), scale)

    def step(self, values: Array, low: Array, high: Array, damping: float) -> tuple[Array, float]:
        """The step with free parameters at a limit held there, and how much it promises to lower the cost."""
        size = self.scale.size
        free = self.scale > 0
        step = np.zeros(size)
        for _ in range(size):
            step = np.zeros(size)
            table = np.vstack([self.table[:, free], np.sqrt(damping) * np.eye(int(free.sum()))])
            right = np.concatenate([self.right, np.zeros(int(free.sum()))])
            step[free] = np.linalg.lstsq(table, right, rcond=1e-10)[0] / self.scale[free]
            # At a limit and pushed outwards: held.
            stuck = free & (((values <= low) & (step < 0)) | ((values >= high) & (step > 0)))
            if not stuck.any():
                break
            free &= ~stuck
        promised = self.right @ self.right - np.sum((self.right - self.table @ (step * self.scale)) ** 2)
        return step, float(promised)


def _cost(residual: Array, weight: Array) -> float:
    return float(np.sum((residual * weight) ** 2))
