"""Friction curves: the torque of a joint that depends on its velocity alone, by the base and by the final model.

    tau_f(v) = sum_i p_i c_i(v; shapes),        sigma(v)^2 = g C g',  g = d tau_f / d theta

over all effects of the joint whose columns depend on nothing but its velocity, with the covariance C of the fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from fmu_didim.base.distributions import normal_isf
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.dynamics.effects import UNITS, Surroundings
from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.dynamics.robot.description import Joint
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.statistics import CONFIDENCE
from fmu_didim.model.free_parameter import PLANT
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.simulated_table import simulated_table
from fmu_didim.results.findings import FrictionResult

CURVE_POINTS = 161
"""[points] Of a friction curve on the page: a line without visible corners."""
CURVE_DENSITY = 4.0
"""[1] c of the velocities sinh(c x) / sinh(c): seven times as dense about zero as equally spaced ones."""
CURVE_STEP = 1e-5
"""[1] Step of the differences that give its band, as a fraction of a value or, where that is larger, of its standard
deviation: between what rounding and what curvature would spoil."""
CURVE_SMALLEST = 1e-9
"""[1] Smallest size of a value for that step, in its unit."""


def friction_curves(builder: LoopModelBuilder, base: Fit, final: Fit) -> list[FrictionResult]:
    """The curves of the joints that got an effect of this kind."""
    before, after = builder.description, builder.described(final.model.added_effects)
    added = {e.joint for e in final.model.added_effects}
    if before is None or after is None:
        return []
    found = []
    for j in sorted(added):
        joint = after.joints[j - 1]
        curve, former = _curve(joint, j), _curve(before.joints[j - 1], j)
        if curve is None or former is None or len(curve.names) == len(former.names):
            continue
        velocity = _velocities(final, j)
        if velocity is None:
            continue
        torque = curve.at(velocity, _named(after, final.model, final.values))
        deviation = np.sqrt(np.maximum(_variance(curve, velocity, after, final), 0.0))
        found.append(
            FrictionResult(
                joint=j, unit=UNITS[joint.type].velocity, velocity=velocity.tolist(),
                base=former.at(velocity, _named(before, base.model, base.values)).tolist(), final=torque.tolist(),
                half_width=(float(normal_isf((1 - CONFIDENCE) / 2)) * deviation).tolist(),
            )
        )  # fmt: skip
    return found


@dataclass(frozen=True)
class _Curve:
    """The friction of a joint as a compiled function of its velocity and of named parameters."""

    names: tuple[str, ...]
    function: ca.Function

    def at(self, velocity: Array, values: dict[str, float]) -> Array:
        """Torque (m,) at velocities (m,)."""
        point = np.array([values[name] for name in self.names])
        return np.array(self.function(velocity[None, :], point)).reshape(-1)


def _curve(joint: Joint, number: int) -> _Curve | None:
    """The torque of the joint that depends on its velocity alone; None without any."""
    q, dq, ddq = (ca.SX.sym(name) for name in ("q", "dq", "ddq"))
    at = Surroundings(0, joint.type, q, dq, ddq)
    torque, symbols = ca.SX(0), dict[str, ca.SX]()
    for effect in joint.effect_objects():
        if effect.states(joint.type) or effect.needs or effect.reach:
            continue
        amplitudes = {v.name: ca.SX.sym(v.name) for v in effect.parameters(joint.type)}
        shapes = {v.name: symbols.get(f"{v.name}_{number}", ca.SX.sym(v.name)) for v in effect.shapes(joint.type)}
        columns = effect.columns(at, shapes)
        if any(not isinstance(column, ca.SX) for column in columns):  # it acts on other joints
            continue
        own = ca.SX(sum(a * c for a, c in zip(amplitudes.values(), columns, strict=True)))
        if not ca.depends_on(own, dq) or ca.depends_on(own, ca.vertcat(q, ddq)):
            continue
        torque += own
        symbols |= {f"{name}{number}": s for name, s in amplitudes.items()}
        symbols |= {f"{name}_{number}": s for name, s in shapes.items()}
    if not symbols:
        return None
    return _Curve(tuple(symbols), ca.Function("friction", [dq, ca.vertcat(*symbols.values())], [torque]))


def _named(robot: RobotDescription, model: LoopModel, values: Array) -> dict[str, float]:
    """Standard and shape parameters of the robot by name, with fitted values (p,)."""
    found = {v.name: v.start for v in (*robot.standard_parameters(), *robot.shape_parameters())}
    found |= model.parameters.values(values[: model.parameters.count])
    free = zip(model.free_parameters, values, strict=True)
    return found | {p.key: float(v) for p, v in free if p.owner == PLANT}


def _velocities(fit: Fit, joint: int) -> Array | None:
    """Velocities (m,) over the range of the fitted motions, dense about zero; None if the plant does not give it."""
    tables = [simulated_table(fit.simulation(label)) for label in fit.model.estimation_labels]
    if any(f"dq{joint}" not in table.names for table in tables):
        return None
    columns = np.concatenate([table.column(f"dq{joint}") for table in tables])
    spaced = np.sinh(np.linspace(-CURVE_DENSITY, CURVE_DENSITY, CURVE_POINTS)) / np.sinh(CURVE_DENSITY)
    return np.asarray(np.where(spaced < 0, -spaced * min(columns.min(), 0.0), spaced * max(columns.max(), 0.0)))


def _variance(curve: _Curve, velocity: Array, robot: RobotDescription, fit: Fit) -> Array:
    """Variance (m,) of the torque by the covariance of the fit, to first order."""
    deviation = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    slopes = []
    for i, value in enumerate(fit.values):
        known = float(deviation[i]) if np.isfinite(deviation[i]) else 0.0
        step = CURVE_STEP * max(abs(float(value)), known, CURVE_SMALLEST)
        change = step * (np.arange(fit.values.size) == i)
        up, down = (curve.at(velocity, _named(robot, fit.model, fit.values + c)) for c in (change, -change))
        slopes.append((up - down) / (2 * step))
    gradient = np.column_stack(slopes)
    nonzero = np.abs(gradient).max(axis=0) > 0
    gradient, covariance = gradient[:, nonzero], fit.covariance[np.ix_(nonzero, nonzero)]
    return np.asarray(np.einsum("ij,jk,ik->i", gradient, covariance, gradient))
