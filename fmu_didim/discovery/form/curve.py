"""The form of what a model lacks, where the catalogue does not explain it: a curve of one variable, fitted in the loop.

The curve is a sum of cubic splines (:mod:`fmu_didim.dynamics.effects.curve`) of the position, velocity, transmitted
torque or time of a joint, of the position of its neighbour, or of the distance since the last reversal. All are
compared to first order, by the response of the closed loop to their splines beside the sensitivities of the model; the
best is fitted in the loop and looked for in what was held out. What the model can make itself belongs to no curve: with
the sensitivities J of the model, an orthonormal basis Q of W J, W = 1 / noise, the response S to the splines, the
residual r and second differences D,

    (I - Q Q') W S = U diag(s) V',    c = V_k z,    z = argmin |diag(s_k) z - U_k' W r|^2 + m |D V_k z|^2

over the directions V_k of the amplitudes c whose singular value s is at least :data:`OWN` of the largest. The penalty m
is that of the greatest gain in the information criterion of Akaike, of the effective parameters

    e = tr (diag(s_k^2) + m V_k' D' D V_k)^-1 diag(s_k^2),    Cov c = g V_k (diag(s_k^2) + m V_k' D' D V_k)^-1 V_k' / f

with the mean square g of what remains beside the curve on its joint, in units of the noise and at least one, and the
part f of its samples that counts, by its colour. This covariance is that of a curve whose roughness is as likely as the
penalty says: averaged over the range its interval holds what was smoothed away as well as noise.

What it makes of the names on its joint stands in :mod:`fmu_didim.discovery.form.names`.

Sources: de Boor, A practical guide to splines, 1978; truncated singular values: Hansen, Rank-deficient and discrete
ill-posed problems, SIAM 1998; the penalty: Eilers and Marx, Statistical Science 11 (1996); the interval: Nychka,
Journal of the American Statistical Association 83 (1988).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fmu_didim.base.distributions import normal_isf
from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.dynamics.effects import Curve, JointType, Surroundings
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.fit.base_projection import BaseProjection
from fmu_didim.fit.derivatives.load_response import LoadResponse, load_response
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.derivatives.torque_signature import TorqueSignature
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import bic_gain, delta_bic
from fmu_didim.fit.noise.noise import TINY, effective_fraction
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.fit.statistics import CONFIDENCE
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from fmu_didim.model.motion import Motion, simulated_motion

OWN = 0.05
"""[1] Of the largest singular value of the splines beside the model: what shows less, the model makes itself."""
PENALTIES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0)
"""[1] Of the second differences of the amplitudes that are tried, over the square of the largest singular value of the
splines: from hardly any to a curve of hardly more than a bend."""
PER_PARAMETER = 2.0
"""[1] Of each effective parameter in the choice of the penalty: Akaike's, which asks for the best prediction."""
TURNS = 3
"""[fits] Of the model beside the curve, and of the curve beside the model, in turn."""
POINTS = 61
"""[points] Of a curve that is drawn."""


@dataclass(frozen=True)
class TriedCurve:
    """A curve to first order.

    Attributes:
        unit, ends: of its range; sizes: (m,) amplitudes; count: their effective number.
        delta_bic: gain over the model without it.
    """

    effect_at: EffectAtJoint
    effect: Curve
    unit: str
    ends: tuple[float, float]
    sizes: Array
    count: float
    delta_bic: float

    def proposal(self, names: list[str]) -> Proposal:
        """It as an effect, with the names of its amplitudes."""
        sizes = dict(zip(names, self.sizes.tolist(), strict=True))
        return Proposal(self.effect_at, {**self.effect.shape_values(*self.ends), **sizes})


@dataclass(frozen=True)
class FoundCurve:
    """A curve that was fitted in the loop.

    Attributes:
        fit: of the model with it, ``before`` without it and without what was named on its joint.
        covariance: (m, m) of its amplitudes; rivals: the other variables, with the BIC by which each is behind.
        instead_of: effects that had been named, and have no place beside it.
    """

    tried: TriedCurve
    before: Fit
    fit: Fit
    delta_bic: float
    covariance: Array
    rivals: tuple[tuple[str, float], ...]
    instead_of: tuple[EffectAtJoint, ...] = ()

    def drawn(self) -> tuple[Array, Array, Array]:
        """(K,) values of the variable over its range, the torque there and the half of its 95 % interval."""
        at = np.linspace(*self.tried.ends, POINTS)
        basis = self.tried.effect.basis(at, *self.tried.ends)
        variance = np.einsum("ij,jk,ik->i", basis, self.covariance, basis)
        half = float(normal_isf((1 - CONFIDENCE) / 2)) * np.sqrt(np.maximum(variance, 0.0))
        return at, np.asarray(basis @ self.tried.sizes), np.asarray(half)


def tried_curves(builder: LoopModelBuilder, fit: Fit, joint: int) -> Iterator[TriedCurve]:
    """The curves at a joint, to first order beside a fit."""
    robot = None if builder.description is None else RobotModel(builder.description)
    parts = list[tuple[LoadResponse, Motion]]()
    for run in map(fit.simulation, fit.model.estimation_labels):
        motion = simulated_motion(run, robot)
        if motion is None:
            return
        parts.append((load_response(run), motion))
    kinds = tuple(builder.loop.joint_type(j) for j in range(1, fit.model.joint_count + 1))
    beside = _Beside.of(fit, range(fit.values.size))
    for name, effect in builder.effects.items():
        effect_at = EffectAtJoint(name, joint)
        if not isinstance(effect, Curve) or not builder.at(effect_at).can_be_added:
            continue
        ends = [effect.ends_on(_arrays(motion, joint - 1, kinds)) for _, motion in parts]
        low, high = min(low for low, _ in ends), max(high for _, high in ends)
        if not high > low or (effect.needs and len(kinds) == 1 and "other joints" in effect.needs):
            continue
        shapes = effect.shape_values(low, high)
        known = {v.name: v.start for v in effect.shapes(kinds[joint - 1])} | shapes
        made = TorqueSignature(effect, joint - 1, kinds, tuple(known))
        table = np.concatenate([response.at_samples(_columns(made, m, response.ticks, known)) for response, m in parts])
        sizes, _, count = beside.solved(table, fit.residual)
        before, after = (beside.rest(residual) for residual in (fit.residual, fit.residual - table @ sizes))
        gain = delta_bic(before, after, count, fit.noise)
        unit = effect.shapes(kinds[joint - 1])[-1].unit
        yield TriedCurve(effect_at, effect, unit, (low, high), sizes, count, gain)


def _arrays(motion: Motion, joint: int, kinds: tuple[JointType, ...]) -> Surroundings:
    """A motion as the surroundings of a joint; the expressions of an effect take arrays as well."""
    of: Any = motion
    return Surroundings(joint, kinds[joint], of.q.T, of.dq.T, of.ddq.T, load=of.load[:, joint], time=of.time)


def _columns(made: TorqueSignature, motion: Motion, ticks: Indices, shapes: Mapping[str, float]) -> Array:
    """(K, n, m) columns of a curve at some ticks of a motion."""
    states = made.states(motion, shapes)[ticks] if made.has_states else None
    return made.columns(motion.at(ticks), shapes, states)


@dataclass(frozen=True)
class _Beside:
    """Least squares of splines beside the sensitivities of a fit.

    Attributes:
        base: of the sensitivities, by the noise; weight: (n,) 1 / noise; shape: (N, n) of the outputs.
    """

    base: BaseProjection
    weight: Array
    shape: tuple[int, ...]

    @staticmethod
    def of(fit: Fit, places: Any) -> _Beside:
        """Beside some of the parameters of a fit."""
        weight = 1 / fit.noise.deviation
        return _Beside(BaseProjection.of(fit.jacobian[:, :, list(places)], weight), weight, fit.residual.shape)

    def rest(self, residual: Array) -> Array:
        """(N, n) what the parameters cannot make of a residual."""
        return self.base.rest_of((residual * self.weight).ravel()).reshape(self.shape) / self.weight

    def solved(self, columns: Array, residual: Array) -> tuple[Array, Array, float]:
        """Amplitudes (m,) of columns (N, n, m), their covariance (m, m) for independent samples of the noise, and their
        effective number."""
        table = self.base.rest_of((columns * self.weight[:, None]).reshape(-1, columns.shape[2]))
        left = self.base.rest_of((residual * self.weight).ravel())
        u, s, vt = np.linalg.svd(table, full_matrices=False)
        own = s > OWN * s[0]
        u, s, v = u[:, own], s[own], vt[own].T
        rough, best, counted = np.diff(v, n=2, axis=0), (np.inf, s, np.diag(s), 0.0), None
        for penalty in PENALTIES:
            inverse = np.linalg.inv(np.diag(s**2) + penalty * s[0] ** 2 * rough.T @ rough)
            z, count = inverse @ (s * (u.T @ left)), float(np.trace(inverse * s**2))
            after = (left - u @ (s * z)).reshape(self.shape)
            counted = after.shape[0] * effective_fraction(after) if counted is None else counted
            square = np.maximum(np.mean(after**2, axis=0), TINY)
            loss = float(counted @ np.log(square)) + PER_PARAMETER * count
            best = min(best, (loss, z, inverse, count), key=lambda one: one[0])
        _, z, inverse, count = best
        return v @ z, v @ inverse @ v.T, count


def fitted_curve(builder: LoopModelBuilder, fit: Fit, ranked: list[TriedCurve]) -> FoundCurve | None:
    """The first of the curves, fitted in the loop: the model beside the curve, and the curve beside the model."""
    best, best_fit = ranked[0], None
    names = [v.name for v in best.effect.parameters(builder.at(best.effect_at).joint_type)]
    covariance, present = np.zeros((len(names), len(names))), fit.model
    for _ in range(TURNS):
        model = builder.build(present, [best.proposal(names)])
        found = minimise(_held(model), fit.noise, stopping=Stopping(updates=1))
        if best_fit is not None and found.chi_square >= best_fit.chi_square:
            break
        best_fit, kept = found, best
        index = found.model.added_effects.index(best.effect_at)
        own = [i for i, p in enumerate(found.model.free_parameters) if p.effect == index and not p.is_shape]
        others = [i for i, p in enumerate(found.model.free_parameters) if p.effect != index]
        slopes = sensitivity(model, found.values, found.outputs, only=own)
        wanted = found.residual + slopes @ best.sizes
        sizes, covariance, count = _Beside.of(found, others).solved(slopes, wanted)
        best = replace(best, sizes=sizes, count=count)
        present = fit.model.with_values(found.values[others])
    if best_fit is None:
        return None
    gain, at = bic_gain(fit, best_fit, kept.count, fit.noise), best.effect_at.joint - 1
    counted = float(effective_fraction(best_fit.residual)[at])
    remains = max(float(np.mean((best_fit.residual[:, at] / fit.noise.deviation[at]) ** 2)), 1.0)
    rivals = tuple((t.effect.variable, ranked[0].delta_bic - t.delta_bic) for t in ranked[1:])
    return FoundCurve(kept, fit, best_fit, gain, remains * covariance / counted, rivals)


def _held(model: LoopModel) -> LoopModel:
    """The model whose last effect stays as it is."""
    last = len(model.added_effects) - 1
    return model.with_free(p.held() if p.effect == last else p for p in model.free_parameters)
