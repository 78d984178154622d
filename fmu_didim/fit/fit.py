"""A point of the closed loop with its sensitivity: start and result of a fit."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from fmu_didim.base.tall import in_blocks
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.prior import Prior
from fmu_didim.fit.confounding import refuse_ridge
from fmu_didim.fit.derivatives.differences import Steps
from fmu_didim.fit.derivatives.sensitivity import parameter_sizes, sensitivity
from fmu_didim.fit.ending import Ending
from fmu_didim.fit.iteration import Iteration
from fmu_didim.fit.linear_problem import LinearProblem
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.fit.noise.shared import counted_once, variance_by_sharing
from fmu_didim.fit.noise.weighting import Weighting, whitened
from fmu_didim.model.loop_model import LoopModel, Simulation
from fmu_didim.model.prediction import Prediction, predict

LITTLE_NOISE = 1e-3
"""[1] Of an output: noise that is less than that of nearly all sensors, so that what it hides at a start, the noise of
the data, which is known at the end, hides all the more."""


@dataclass(frozen=True)
class Fit:
    """A point of the closed loop, usually a minimum.

    Attributes:
        model: with its values; values: (p,); outputs: (M, m) simulated, the torque first; jacobian: (M, m, p), of the
            last sensitivity.
        noise: of the data, as it was known or as the weights stand for it.
        deviation: (m,) that the residual was divided by; chi_square: sum of squares after that.
        ending: how the steps ended.
        iterations: the history, where it was asked for; simulations: how many it took.
        prediction: torque with the regressor, where it is known.
        steps: of the central differences in the sensitivity.
    """

    model: LoopModel
    values: Array
    outputs: Array
    jacobian: Array
    noise: Noise
    deviation: Array
    chi_square: float
    ending: Ending = Ending.NONE
    iterations: tuple[Iteration, ...] = ()
    simulations: int = 0
    prediction: Prediction | None = None
    steps: Steps = field(default_factory=dict)

    @property
    def settled(self) -> bool:
        """Whether the steps became small, by the tolerance."""
        return self.ending is Ending.SETTLED

    @property
    def given_up(self) -> bool:
        """Whether they ended early, at no minimum, because nothing good enough was in reach or the time was over."""
        return self.ending in (Ending.HOPELESS, Ending.OUT_OF_TIME)

    @property
    def residual(self) -> Array:
        """(M, m) measured minus simulated outputs; of the torque alone (N, n)."""
        return self.model.measured_outputs - self.outputs

    @property
    def equations(self) -> LinearProblem:
        """The linear problem of the next step, the prior among its rows."""
        prior = prior_rows(self.model.prior, self.values)
        return LinearProblem.of(self.jacobian, self.residual, prior=prior, deviation=self.deviation)

    @property
    def torque(self) -> Array:
        """(N, n) simulated torque."""
        return self.model.torque_of(self.outputs)

    @property
    def torque_alone(self) -> Fit:
        """The same point, with the torque for all that was measured."""
        if not self.model.experiments.channels:
            return self
        model, n = self.model.torque_alone, self.model.joint_count
        noise, deviation, torque = self.noise.of(slice(0, n)), self.deviation[:n], self.torque
        return replace(
            self, model=model, outputs=torque, jacobian=self.model.torque_of(self.jacobian), noise=noise,
            deviation=deviation, chi_square=sum_of_squares(model.measured - torque, deviation),
            steps={key: replace(step, jitter=step.jitter[:n]) for key, step in self.steps.items()},
        )  # fmt: skip

    def simulation(self, label: str) -> Simulation:
        """An experiment, held out or not, with these values."""
        return self.model.simulation(self.values, label)

    def residual_in(self, label: str) -> Array:
        """(N, n) measured minus simulated torque of one experiment, held out or not; raises SimulationError."""
        return self.model.residual(self.values, label)

    @cached_property
    def held_out_jacobian(self) -> Array:
        """(Mv, m, p) sensitivity of all outputs of all held-out experiments; raises SimulationError."""
        columns, experiments = [], self.model.experiments
        for label in experiments.validation_labels if self.values.size else ():
            model = self.model.on(label)
            model = model if experiments.channels else model.torque_alone
            table = sensitivity(model, self.values, model.outputs(self.values))
            if experiments.channels:  # whose order, and more of them, may be that of the experiment
                own = model.experiments.channels_of(label, table)
                torque = table[experiments[label].row_of(experiments[label].time), : self.model.joint_count]
                table = experiments.outputs_of(label, torque, [own[c.name] for c in experiments[label].channels])
            columns.append(table)
        return np.concatenate(columns) if columns else np.zeros((0, self.outputs.shape[1], 0))

    @property
    def covariance(self) -> Array:
        """(p, p) covariance of the values by the Cramer-Rao bound, with the effective number of samples; what outputs
        share is counted once."""
        return counted_once(self._independent_covariance, self.shared_variance)

    @cached_property
    def shared_variance(self) -> Array:
        """(p,) variance of each value over that of independent outputs, at least 1: what feedback carries from one
        output into another is no second sample."""
        weight = self.noise.weight[:, None]
        if not self.model.experiments.channels:
            return np.ones(self.jacobian.shape[2])
        influence = (self.jacobian * weight**2) @ self._independent_covariance
        return variance_by_sharing(influence, self.residual, self.model.experiments)

    @cached_property
    def _independent_covariance(self) -> Array:
        weighted = (block * self.noise.weight[:, None] for block in in_blocks(self.jacobian))
        products = sum(np.einsum("mjp,mjq->pq", block, block, optimize=True) for block in weighted)
        scale = np.sqrt(np.diag(products))
        scale[scale == 0] = np.inf
        parts, axes = np.linalg.eigh(products / np.outer(scale, scale))
        told = parts > parts.size * np.finfo(float).eps * parts.max(initial=0.0)  # the others are rounding, of any sign
        root = axes[:, told] / np.sqrt(parts[told]) / scale[:, None]
        return np.asarray(root @ root.T)

    @property
    def condition_number(self) -> float:
        """Of the weighted sensitivity with columns of length one."""
        return LinearProblem.of(self.jacobian, self.residual, deviation=self.deviation).condition


def point(model: LoopModel, weighting: Weighting, prediction: Prediction | None = None) -> Fit:
    """The closed loop at the values of a model: torque and exact sensitivity.

    Args:
        prediction: saves the first simulation where it is known.

    Raises:
        SimulationError: the values cannot be simulated.
    """
    values = model.start
    prediction = prediction or predict(model, values)
    outputs = model.outputs(values) if model.experiments.channels else prediction.torque
    sizes = parameter_sizes(model, values, prediction)
    steps: Steps = {}
    jacobian = sensitivity(model, values, outputs, sizes=sizes, steps=steps)
    residual = model.measured_outputs - outputs
    if not model.loop.shows_torque:
        _refuse_ridge_of_start(model, outputs, jacobian)
    deviation = weighting.deviation(residual, jacobian)
    return Fit(
        model,
        values,
        outputs,
        jacobian,
        weighting.noise(deviation),
        deviation,
        sum_of_squares(residual, deviation),
        prediction=prediction,
        steps=steps,
    )


def _refuse_ridge_of_start(model: LoopModel, outputs: Array, jacobian: Array) -> None:
    """Raise IdentificationError where outputs with hardly any noise would not tell parameters apart at a start: a fit
    would wander along them."""
    size = np.sqrt((outputs**2).sum(axis=0) / np.maximum(model.output_counts, 1.0))
    noise = LITTLE_NOISE * np.where(size > 0, size, 1.0)
    norm = float(np.linalg.norm(outputs / noise))
    known = [k.scale if k.is_start else v for k, v in zip(model.free_parameters, model.start, strict=True)]
    refuse_ridge(whitened(jacobian, noise), np.array(known), model.names, outputs=norm, at=", at the start of the fit")


def prior_rows(prior: Prior | None, values: Array) -> tuple[Array, Array] | None:
    """Rows (r, p) of a prior, and what values (p,) leave of their targets (r,); None without one."""
    return None if prior is None else (prior.padded(values.size), prior.residual(values))


def prior_squares(prior: Prior | None, values: Array) -> float:
    """The sum of squares that values (p,) leave of a prior; zero without one."""
    return 0.0 if prior is None else float(np.sum(prior.residual(values) ** 2))


def sum_of_squares(residual: Array, deviation: Array) -> float:
    """Of a residual (M, m) divided by deviations (m,)."""
    return float(np.sum((residual / deviation) ** 2))
