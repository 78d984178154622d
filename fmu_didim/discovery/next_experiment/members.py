"""The members of an ambiguous set as columns on a motion, and the base model that absorbs a part of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.discovery.augmentation.places import Proposal, parameter_cost
from fmu_didim.discovery.screening.catalogue import LARGEST_COLUMN
from fmu_didim.dynamics.effects import Effect, JointTorque, TorqueEffect
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.dynamics.robot.observed_states import observed_along
from fmu_didim.estimators.starts.reference_start import reference_motion
from fmu_didim.fit.base_projection import BaseProjection
from fmu_didim.fit.derivatives.torque_signature import TorqueSignature, search_grid
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.model.motion import Motion, motion_of

GRID = 24
"""[shapes] Tried of one effect before refinement."""
SHAPE_STEP = 1e-3
"""[1] Relative step of the differences by which the slopes of the base's shapes are found."""
DISPLACEMENT = 1e-5
"""[rad or m] Of a link, by which the change of its torque is found."""
SMALLEST_DISPLACEMENT = 1e-12
"""[rad or m] By which that is divided."""
BASE_DEPENDENT = 1e-7
"""[1] Singular value of columns of the base, relative to the largest, that tell nothing more."""
BASE_IDLE = 1e-9
"""[1] Length of a column of the base, relative to the longest, that is rounding."""
TRAVELLED = (0.02, 0.98)
"""[1] Quantiles of the positions between which effects have their place."""

Follow = Callable[[Trajectory], tuple[Array, Array, Array]]
"""Reference -> q, dq, ddq (K, n) of the robot that follows it, one row a control period."""


def _joint_torque(motion: Motion, joint: int) -> JointTorque:
    return JointTorque(motion.torque[:, joint], motion.load[:, joint], motion.step)


def _displaced(model: RobotModel, chi: Array, motion: Motion, joint: int, displacement: Array) -> Array:
    """(K, n, 1) change of the torque of the links by a small displacement of one of them, for a unit of it."""
    size = DISPLACEMENT / max(float(np.abs(displacement).max()), SMALLEST_DISPLACEMENT)
    change = displacement * size
    moved = [motion.q.copy(), motion.dq.copy(), motion.ddq.copy()]
    for table in moved:
        table[:, joint] += change
        change = np.gradient(change, motion.step)
    torque = model.at_points("transmitted", *(m.T for m in moved), chi)
    return np.asarray((torque - motion.load) / size)[:, :, None]


@dataclass(frozen=True)
class DesignContext:
    """The known quantities of a design.

    Attributes:
        description, chi: the base robot and its (ns,) standard parameters; effects: the catalogue.
        noise, rate_hz: of the torque log; follow: how the robot follows a reference, None: exactly.
    """

    description: RobotDescription
    chi: Array
    noise: Noise
    rate_hz: float
    effects: Mapping[str, Effect]
    follow: Follow | None = None


class ProjectedMotion:
    """The base model on one motion, and what it absorbs there.

    Args:
        most: at most so many samples, spread evenly, stand for all; shapes are then searched for on a coarser grid.
    """

    def __init__(
        self, context: DesignContext, model: RobotModel, reference: Trajectory, *, most: int | None = None
    ) -> None:
        self._setting, self._model, self.joints = context, model, model.joint_count
        self.is_quick = most is not None
        moved = reference_motion(reference, self.joints) if context.follow is None else context.follow(reference)
        time = reference.time
        step, none = float(time[1] - time[0]), np.zeros_like(moved[0])
        # Only what states need; torque and load are computed where something asks for them.
        self.path = Motion(time, *moved, none, none, step, {})
        ticks = np.unique(np.round(np.arange(0, time[-1] - time[0], 1 / context.rate_hz) / step).astype(int))
        self.samples = ticks.size * context.noise.factor
        self.ticks = ticks
        if most is not None and ticks.size > most:
            self.ticks = ticks[np.linspace(0, ticks.size - 1, most).round().astype(int)]
        every = observed_along(model, time, *moved, context.chi) if model.observed else np.zeros((time.size, 0))
        q, dq, ddq, self._observed = (np.ascontiguousarray(v[self.ticks]) for v in (*moved, every))
        rows = model.regressor_rows(q, dq, ddq, observed=self._observed)
        self.sampled = motion_of(model, context.chi, time[self.ticks], q, dq, ddq, rows @ context.chi)
        columns = np.concatenate([rows[:, :, list(model.active)], *self._slopes()], axis=2)
        weight = context.noise.weight * np.sqrt(ticks.size / self.ticks.size)
        self.base = BaseProjection.of(columns, weight, tolerance=BASE_DEPENDENT, idle=BASE_IDLE)

    @cached_property
    def motion(self) -> Motion:
        """The motion at all ticks, with torque and load."""
        path, chi = self.path, self._setting.chi
        observed = observed_along(self._model, path.time, path.q, path.dq, path.ddq, chi)
        torque = self._model.regressor_rows(path.q, path.dq, path.ddq, observed=observed) @ chi
        return motion_of(self._model, chi, path.time, path.q, path.dq, path.ddq, torque)

    def _slopes(self) -> list[Array]:
        """d torque / d shape of the base at the samples, (N, n, 1) each: shapes such as v0 are never known exactly."""
        model, at, chi = self._model, self.sampled, self._setting.chi
        extra = [self._observed[:, : len(model.extra)].T] if model.extra else []

        def torque(shapes: Array) -> Array:
            return model.at_points("inverse", at.q.T, at.dq.T, at.ddq.T, chi, shapes, *extra)

        base, result = torque(model.shape_values), []
        for i, value in enumerate(model.shape_values):
            moved = model.shape_values.copy()
            moved[i] += SHAPE_STEP * (abs(value) or 1.0)
            result.append(((torque(moved) - base) / (moved[i] - value))[:, :, None])
        return result

    def per_joint(self, rest: Array) -> Array:
        """(n,) sums of squares of a weighted residual (N n,)."""
        return np.asarray((rest.reshape(-1, self.joints) ** 2).sum(axis=0))


class AmbiguousEffect:
    """One effect of an ambiguous set: its columns on any motion.

    Raises:
        InputError: the effect has no signature on a motion, so that only closed-loop simulations show it, or follows
            what is measured beside one.
    """

    def __init__(self, proposal: Proposal, context: DesignContext, model: RobotModel) -> None:
        self.effect_at, self._setting, self._model = proposal.effect_at, context, model
        self.effect, self.joint = context.effects[proposal.effect_at.effect], proposal.effect_at.joint - 1
        joints = context.description.joints
        self._kind, types = joints[self.joint].type, tuple(j.type for j in joints)
        known = dict(zip((v.name for v in model.shapes), model.shape_values, strict=True))
        shapes = {
            v.name: known.get(f"{v.name}_{proposal.effect_at.joint}", v.start) for v in self.effect.shapes(self._kind)
        }
        self.shapes = {n: float(proposal.values.get(n, v)) for n, v in shapes.items()}
        self.amplitudes = tuple(v.name for v in self.effect.parameters(self._kind))
        # First-order columns of wiring and structure know no shapes.
        searched = self.effect.search(self._kind) if self.effect.is_linear else {}
        self.search = {n: s for n, s in searched.items() if n in self.shapes}
        neutral, first_order = self.effect.neutral, self.effect.first_order
        # Of a structure the column stands for a compliance or a gap; it is found by likeness.
        is_moved = first_order is not None and first_order.changes == "link position"
        self.theta: Array | None = None
        if all(name in proposal.values for name in self.amplitudes) and not is_moved:
            self.theta = np.array([proposal.values[n] - neutral.get(n, 0.0) for n in self.amplitudes])
        self._made: TorqueSignature | None = None
        if self.effect.given_states:
            raise InputError(
                f"The effect '{self.effect.name}' follows what is measured, and not a motion.",
                where="splitting experiment", next_step=self.effect.experiment,
            )  # fmt: skip
        if isinstance(self.effect, TorqueEffect):
            self._made = TorqueSignature(self.effect, self.joint, types, tuple(self.shapes))
        elif first_order is None:
            raise InputError(
                f"The effect '{self.effect.name}' shows in closed-loop simulations only, not on a given motion.",
                where="splitting experiment", next_step=self.effect.experiment,
            )  # fmt: skip

    def columns(self, motion_projection: ProjectedMotion, shapes: Mapping[str, float]) -> Array | None:
        """(N n, m) weighted columns, None where the offline integration of states fails."""
        if self._made is not None:
            made, ticks = self._made, motion_projection.ticks
            states = made.states(motion_projection.path, shapes)[ticks] if made.has_states else None
            table = self._made.columns(motion_projection.sampled, shapes, states)
        else:
            table = self._by_first_order(motion_projection.motion)[motion_projection.ticks]
        if not np.isfinite(table).all() or np.abs(table).max() > LARGEST_COLUMN:
            return None
        return motion_projection.base.weighted(table)

    def _by_first_order(self, motion: Motion) -> Array:
        """(K, n, 1) column of an effect outside the torque balance, at all ticks."""
        first_order = self.effect.first_order
        assert first_order is not None
        if first_order.changes == "link position":
            shift = first_order.column(_joint_torque(motion, self.joint))
            return _displaced(self._model, self._setting.chi, motion, self.joint, shift)
        table = np.zeros((*motion.q.shape, 1))
        for joint in range(motion.joint_count) if self.effect.is_of_log else (self.joint,):
            table[:, joint, 0] = first_order.column(_joint_torque(motion, joint))
        return table

    @property
    def distance(self) -> float:
        """The distance over which the effect builds up after a reversal; NaN without one."""
        return self.shapes.get(self.effect.distance, float("nan"))

    def grid(self, motion: Motion, *, coarse: bool) -> list[dict[str, float]]:
        """Shapes to try, the fitted ones first, positions where the motion is; every second one if ``coarse``."""
        units = {v.name: v.unit for v in self.effect.shapes(self._kind)}
        search = dict(self.search)
        for name, s in self.search.items():
            if not s.logarithmic and units[name] in ("rad", "m"):
                low, high = (float(v) for v in np.quantile(motion.q[:, self.joint], TRAVELLED))
                search[name] = type(s)(low, high, s.count, s.logarithmic, s.cost)
        found = list(search_grid(search, self.shapes)) if search else []
        if len(found) > GRID:
            found = [found[i] for i in np.linspace(0, len(found) - 1, GRID).astype(int)]
        return [dict(self.shapes), *found[:: 2 if coarse else 1]]

    @property
    def cost(self) -> float:
        """Parameters that it counts as when models are compared."""
        return parameter_cost(self.amplitudes, self.effect.search(self._kind))
