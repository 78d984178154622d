"""What the logged torque would change by, to first order, if the machine had an effect that its model lacks.

An effect acts like a load e on the joints, which the controller compensates: the log changes by the response of the
closed loop to e (:mod:`fmu_didim.fit.derivatives.load_response`). Loads are the columns of effects in the torque
balance, what a drive takes from its command, and the change of the torque of the links by another gravity or geometry.
A clock or a scale that is off changes the log alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, islice, product

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import SimulationError
from fmu_didim.base.tall import in_blocks, triangle_by_parts
from fmu_didim.checks.motion.colour import as_slice
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.effects import (
    EFFECTS,
    Effect,
    JointTorque,
    JointType,
    StatedSize,
    TorqueEffect,
)
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.dynamics.robot.tilt import horizontal_axes
from fmu_didim.fit.derivatives.load_response import MEMORY_S, LoadResponse, load_response
from fmu_didim.fit.derivatives.torque_signature import TorqueSignature
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.noise.weighting import whitened
from fmu_didim.model.free_parameter import BASE, joint_parameter
from fmu_didim.model.motion import Motion, simulated_motion
from fmu_didim.model.parameters import RobotParameters
from fmu_didim.model.workers import side_by_side

AT_ONCE = 16
"""[misfits] That are answered together at most,"""
VALUES = 500_000
"""[values] and of all of them at the ticks, 4 MB: some of a long log take as much memory as the sensitivities of a
fit."""
EPSILON = float(np.finfo(float).eps)
"""[1] Singular value of the largest one, for each row, below which columns depend on each other."""
SMALL_STEP = 1e-4
"""[rad or 1] By which gravity is turned, or gravity and lengths are changed as parts of themselves, for a slope."""

BEGIN = "t_load"
"""The shape of an effect that is the instant at which it begins."""
INSTANTS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
"""[1] Parts of the log at which an effect that begins on the way is looked for: these follow nine tenths of a change
between two of them."""

NO_LOAD = 1e-6
"""[1/rad or 1/m] Change of the torque of the links by a step of a joint, over that torque, below which a zero that is
off does nothing but by rounding: that of an axis along gravity."""
TURNING = 0.1
"""[1] Of the largest speed of a joint, below which it turns round,"""
AT_REVERSALS = 0.5
"""[1] and share of the squares of a load, beside what the fitted parameters make, that must act there for it to be
simulated: Stribeck friction on a light joint of a SCARA shows by 9 % less than by the response that fits the whole
motion."""
LATE_PART = 0.1
"""[periods] By which a log is late for a slope: between two instants of the command it follows a line."""

TORQUE_SCALE = StatedSize("a scale of all torques that is off", "%", 100.0, joints="all")
GRAVITY = StatedSize("a size of gravity that is off", "%", 100.0, joints="all")
LINK_LENGTH = StatedSize("a length of a link that is off", "%", 100.0)
"""What a case says of the machine, and data can show in part only."""
LARGEST_TURN = 10.0
"""[deg] Up to which a zero that is off changes the torque to first order: by a cosine that is 1.5 % off one."""
ZERO_TURNING = StatedSize("a zero of a position that is off", "deg", float(np.degrees(1.0)), largest=LARGEST_TURN)
ZERO_SLIDING = StatedSize("a zero of a position that is off", "mm", 1e3, largest=100.0)
"""The same of where a joint is at zero."""


@dataclass(frozen=True)
class Load:
    """What a misfit does to the joints.

    Attributes:
        effect: its name in the catalogue, or that of a quantity of the description.
        stated: how its size is stated; joint: from 1; place: joint or axis, in words.
        tables: label of each fitted experiment -> (K, n) load at the ticks of the motion, or (N, n) change of the log;
            none any more once its answer is known.
        amplitudes: parameters of the effect, over their neutral values; shapes: at which it is looked at.
        is_of_log: whether it changes the log alone.
    """

    effect: str
    stated: StatedSize
    joint: int
    place: str
    tables: Mapping[str, Array]
    amplitudes: Mapping[str, float] = field(default_factory=dict)
    shapes: Mapping[str, float] = field(default_factory=dict)
    is_of_log: bool = False

    def over(self, size: float) -> Load:
        """The same over a size: of size one."""
        return replace(
            self, tables={label: table / size for label, table in self.tables.items()},
            amplitudes={name: value / size for name, value in self.amplitudes.items()},
        )  # fmt: skip


@dataclass(frozen=True)
class Misfit:
    """A load of size one in the unit in which it is stated, and the change (N, n) of the logged torque by it, in single
    precision: there are many, each as large as the log, and it is one to first order."""

    load: Load
    signature: NDArray[np.float32]

    @property
    def what(self) -> str:
        """It in words, with its place."""
        return self.load.stated.what + (f" ({self.load.place})" if self.load.place else "")


@dataclass(frozen=True)
class FittedMotions:
    """The simulated motions of a fit, at the ticks at which loads are taken.

    Attributes:
        robot: its model; None for a black box.
        responses, motions: label of each fitted experiment -> answer to loads, and motion.
        values: parameters of the plant, by name.
    """

    fit: Fit
    robot: RobotModel | None
    responses: Mapping[str, LoadResponse]
    motions: Mapping[str, Motion]
    values: Mapping[str, float]

    @classmethod
    def of(cls, fit: Fit) -> FittedMotions | None:
        """The motions of a fit; None where the plant does not give them. Raises SimulationError."""
        parameters, theta = fit.model.parameters, fit.model.theta(fit.values)
        robot = parameters.model if isinstance(parameters, RobotParameters) else None
        motions, responses = {}, {}
        for label in fit.model.estimation_labels:
            run = fit.simulation(label)
            responses[label] = load_response(run)
            motion = simulated_motion(run, robot, responses[label].ticks)
            if motion is None:
                return None
            motions[label] = motion
        plant = {v.name: v.start for v in fit.model.loop.plant.parameters}
        return cls(fit, robot, responses, motions, {**plant, **parameters.values(theta)})

    def values_in(self, label: str) -> dict[str, float]:
        """Parameters of the plant in an experiment, with what it carries, by name."""
        return {**self.values, **self.fit.model.parameters.values(self.fit.model.theta(self.fit.values, label))}

    @property
    def description(self) -> RobotDescription | None:
        """Of the robot; None for a black box."""
        return None if self.robot is None else self.robot.description

    @property
    def joint_count(self) -> int:
        """Number of joints n."""
        return self.fit.model.joint_count

    @property
    def joint_types(self) -> tuple[JointType, ...]:
        """(n,) types of the joints."""
        if self.description is not None:
            return tuple(joint.type for joint in self.description.joints)
        units = self.fit.model.parameters.torque_units
        return tuple("prismatic" if unit == "N" else "revolute" for unit in units)

    def peak(self, joint: int) -> float:
        """Largest torque of a joint, from 1."""
        return max(float(np.abs(motion.torque[:, joint - 1]).max()) for motion in self.motions.values())

    def has(self, effect: Effect, joint: int) -> bool:
        """Whether the model has an effect at a joint, from 1."""
        if self.description is not None and effect.name in self.description.joints[joint - 1].effects:
            return True
        names = {joint_parameter(v.name, joint, is_shape=False) for v in effect.parameters(self.joint_types[joint - 1])}
        return self.description is None and bool(names) and names <= self.values.keys()


def fitted_motions(fit: Fit) -> FittedMotions | None:
    """The motions of a fit; None where the plant does not give them, or the loop cannot be simulated."""
    try:
        return FittedMotions.of(fit)
    except SimulationError:
        return None


@dataclass(frozen=True)
class Misfits:
    """All misfits of a fit: those whose size is stated, and those that begin at other instants; and the motions along
    which they act, where the plant gives these."""

    stated: tuple[Misfit, ...] = ()
    on_the_way: tuple[Misfit, ...] = ()
    motions: FittedMotions | None = None

    @classmethod
    def of(cls, fit: Fit) -> Misfits:
        """Those of a fit; none where the plant does not give its motion."""
        return cls.along(fitted_motions(fit))

    @classmethod
    def along(cls, motions: FittedMotions | None, effects: Mapping[str, Effect] = EFFECTS) -> Misfits:
        """Those along the motions of a fit, in the order of a catalogue and then of what a case says; none where there
        are no motions."""
        if motions is None:
            return cls()
        fitted = _FittedColumns.of(motions)
        loads = chain(loads_of_effects(motions, effects), loads_of_case(motions))
        stated, on_the_way = (
            tuple(_all_answered(motions, some, fitted)) for some in (loads, _loads_on_the_way(motions, effects))
        )
        return cls(stated, on_the_way, motions)

    def __iter__(self) -> Iterator[Misfit]:
        yield from (*self.stated, *self.on_the_way)


def _loads_on_the_way(motions: FittedMotions, effects: Mapping[str, Effect]) -> Iterator[Load]:
    """The loads of effects that begin at an instant, at the instants ``INSTANTS``, for each parameter by itself: a load
    need not be shaped like the link."""
    for name, effect in effects.items():
        stated = effect.stated
        if stated is None or BEGIN not in stated.in_log or not isinstance(effect, TorqueEffect):
            continue
        for part, joint in product(INSTANTS, _joints(stated, motions.joint_count)):
            what = stated.what.replace("halfway", f"after {100 * part:.0f} % of the log")
            own = replace(stated, what=what, in_log={**stated.in_log, BEGIN: part})
            for parameter in effect.parameters(motions.joint_types[joint - 1]):
                alone = Load(name, own, joint, _place(own, joint), {}, {parameter.name: 1.0})
                made = None if motions.has(effect, joint) else _by_columns(motions, alone, effect)
                if made is not None:
                    yield made


def _all_answered(motions: FittedMotions, loads: Iterator[Load], fitted: _FittedColumns) -> list[Misfit]:
    """The misfits of loads, some at a time: those of a long log take much memory."""
    found = list[Misfit]()
    size = sum(motion.q.size for motion in motions.motions.values())
    while some := list(islice(loads, min(max(VALUES // size, 1), AT_ONCE))):
        found += _answered(motions, some, fitted)
    return found


@dataclass(frozen=True)
class _FittedColumns:
    """Loads by one of each fitted parameter in which the torque of the plant is linear.

    Attributes:
        columns: label -> (K, n, b); places: (b,) of these among all parameters.
        inverse: (b, b) of their products, without directions that they do not have.
    """

    columns: Mapping[str, Array]
    places: list[int]
    inverse: Array

    @staticmethod
    def of(motions: FittedMotions) -> _FittedColumns:
        columns, places = _columns_of_fit(motions)
        blocks = (_rows(block) for table in columns.values() for block in in_blocks(table))
        r = triangle_by_parts(blocks, len(places))
        size = np.maximum(np.linalg.norm(r, axis=0), TINY)
        rows = sum(table.shape[0] * table.shape[1] for table in columns.values())
        root = np.linalg.pinv(r / size, rcond=max(rows, len(places)) * EPSILON) / size[:, None]
        return _FittedColumns(columns, places, root @ root.T)

    def nearest(self, loads: Mapping[str, Array]) -> Array:
        """(b, w) amounts of the columns that come nearest to loads (K, n, w) along all motions: by their products, and
        once more for what these leave, which is as exact as an orthogonal factorisation (Bjoerck, Linear Algebra and
        its Applications 88/89 (1987))."""
        amounts = self.inverse @ self._along(loads)
        return amounts + self.inverse @ self._along({k: self.beside(k, table, amounts) for k, table in loads.items()})

    def beside(self, label: str, loads: Array, amounts: Array) -> Array:
        """(K, n, w) what amounts (b, w) of the columns leave of loads along the motion of an experiment."""
        return np.asarray(loads - self.columns[label] @ amounts)

    def _along(self, loads: Mapping[str, Array]) -> Array:
        blocks = (
            (_rows(columns), _rows(load))
            for label in self.columns
            for columns, load in zip(in_blocks(self.columns[label]), in_blocks(loads[label]), strict=True)
        )
        return np.asarray(sum(columns.T @ load for columns, load in blocks))


def _answered(motions: FittedMotions, loads: Sequence[Load], fitted: _FittedColumns) -> list[Misfit]:
    """The misfits of loads: what of a load the fitted parameters make acts as these do, by the sensitivities of the
    fit; the loop answers the rest to first order."""
    loads, tables = [_of_unit_size(motions, load) for load in loads], []
    joined = {label: _joined(loads, motion, label) for label, motion in motions.motions.items()}
    amounts, counts = fitted.nearest(joined), [load.is_of_log for load in loads].count(True)
    for label in motions.motions:
        rest = fitted.beside(label, joined.pop(label), amounts)
        answers = iter(_answers(motions, label, rest))
        changes = [load.tables[label] if load.is_of_log else next(answers) for load in loads]
        tables.append(motions.fit.model.experiments.filtered(np.stack(changes, axis=2), label))
    signatures = np.concatenate(tables) if len(tables) > 1 else tables[0]
    if counts < len(loads):
        of_loop = as_slice(np.array([k for k, load in enumerate(loads) if not load.is_of_log]))
        places = as_slice(np.array(fitted.places, dtype=int))
        for own, jacobian in zip(in_blocks(signatures), in_blocks(motions.fit.jacobian), strict=True):
            own[:, :, of_loop] += jacobian[:, :, places] @ amounts
    return [
        Misfit(replace(load, tables={}), signatures[:, :, k].astype(np.float32, order="F"))
        for k, load in enumerate(loads)
    ]


def _answers(motions: FittedMotions, label: str, loads: Array) -> list[Array]:
    """(N, n) of each of loads (K, n, w): what the loop answers to first order, along the whole motion alike; for loads
    that act at reversals, where it is another loop, by a simulation each."""
    if not loads.shape[2]:
        return []
    response, motion = motions.responses[label], motions.motions[label]
    found = list(np.moveaxis(response.at_samples(loads), 2, 0))
    if motions.fit.model.experiments.low_pass is not None:  # which a simulation would apply once more
        return found
    turns = np.abs(motion.dq) < TURNING * np.abs(motion.dq).max(axis=0)
    squares = loads**2
    share = np.sum(squares * turns[:, :, None], axis=(0, 1)) / np.maximum(np.sum(squares, axis=(0, 1)), TINY)
    places = np.flatnonzero(share > AT_REVERSALS)
    tasks = [partial(response.simulated, loads[:, :, k]) for k in places]
    workers = motions.fit.model.allowed_workers(motions.fit.values) if tasks else 1
    with suppress(SimulationError):
        for k, simulated in zip(places, side_by_side(tasks, workers), strict=True):
            found[k] = simulated
    return found


def _columns_of_fit(motions: FittedMotions) -> tuple[dict[str, Array], list[int]]:
    """Label -> loads (K, n, b) by one of each fitted parameter in which the torque of the plant is linear, and the
    places (b,) of these among all; of a plant without inverse model none."""
    fit = motions.fit
    parameters, free = fit.model.parameters, fit.model.free_parameters
    shared = [
        k for k, p in enumerate(free) if p.owner == BASE and not p.is_load and [q.key for q in free].count(p.key) == 1
    ]
    if not isinstance(parameters, RobotParameters):
        return {label: np.zeros((*m.q.shape, 0)) for label, m in motions.motions.items()}, []
    own, theta = [parameters.names.index(free[k].key) for k in shared], fit.model.theta(fit.values)
    columns = {}
    for label, m in motions.motions.items():
        observed = parameters.observed_along(m.time, m.q, m.dq, m.ddq, theta, starts=m.starts)
        columns[label] = parameters.regressor(m.q, m.dq, m.ddq, observed=observed)[0][:, :, own]
    return columns, shared


def _rows(table: Array) -> Array:
    """(K n, w) a table (K, n, w)."""
    return table.reshape(table.shape[0] * table.shape[1], table.shape[2])


def _joined(loads: Sequence[Load], motion: Motion, label: str) -> Array:
    """(K, n, w) those that the loop answers, along the motion of an experiment."""
    own = [load.tables[label] for load in loads if not load.is_of_log]
    return np.stack(own, axis=2) if own else np.zeros((*motion.q.shape, 0))


def _of_unit_size(motions: FittedMotions, load: Load) -> Load:
    """The load of size one in the unit in which it is stated."""
    if not load.stated.is_of_peak:
        return load.over(load.stated.factor)
    largest = max(float(np.abs(table).max()) for table in load.tables.values())
    return load.over(100.0 * max(largest, TINY) / max(motions.peak(load.joint), TINY))


def loads_of_effects(motions: FittedMotions, effects: Mapping[str, Effect]) -> Iterator[Load]:
    """The loads of the effects of a catalogue that the model lacks."""
    for name, effect in effects.items():
        stated = effect.stated
        if stated is None:
            continue
        if stated.joints == "base":
            yield from _tilts(motions, name, effect, stated)
            continue
        for joint in _joints(stated, motions.joint_count):
            if motions.has(effect, joint):
                continue
            by = _by_late_stamps if effect.is_of_log else _by_first_order
            by = _by_columns if isinstance(effect, TorqueEffect) else by
            load = by(motions, Load(name, stated, joint, _place(stated, joint), {}), effect)
            if load is not None:
                yield load


def _joints(stated: StatedSize, count: int) -> Sequence[int]:
    return range(1, count + 1) if stated.joints == "each" else [count if stated.joints == "last" else 1]


def _place(stated: StatedSize, joint: int) -> str:
    return "" if stated.joints == "all" else f"joint {joint}"


def _by_columns(motions: FittedMotions, load: Load, effect: Effect) -> Load | None:
    """The torque of an effect in the torque balance by the amplitudes of the load, if it has some, by amplitudes of
    one, or by what they are shares of; None where those are zero or unknown, or it needs a joint that is not there."""
    assert isinstance(effect, TorqueEffect)
    joint, kinds, stated = load.joint, motions.joint_types, load.stated
    names = [v.name for v in effect.parameters(kinds[joint - 1])]
    amplitudes = dict.fromkeys(names, 1.0)
    if load.amplitudes:
        amplitudes = {name: load.amplitudes.get(name, 0.0) for name in names}
    elif stated.shares:
        amplitudes = {name: motions.values.get(f"{stated.shares[name]}{joint}", 0.0) for name in names}
    if joint + effect.reach > len(kinds) or not any(amplitudes.values()):
        return None
    shapes = {v.name: motions.values.get(f"{v.name}_{joint}", v.start) for v in effect.shapes(kinds[joint - 1])}
    first = next(iter(motions.motions.values())).time
    shapes |= {name: first[0] * (name == BEGIN) + part * float(np.ptp(first)) for name, part in stated.in_log.items()}
    made = TorqueSignature(effect, joint - 1, kinds, tuple(shapes))
    weights = np.array(list(amplitudes.values()))
    tables = {label: made.columns(motion, shapes) @ weights for label, motion in motions.motions.items()}
    if not any(table.any() for table in tables.values()):
        return None
    return replace(load, tables=tables, amplitudes=amplitudes, shapes=shapes)


def _by_first_order(motions: FittedMotions, load: Load, effect: Effect) -> Load | None:
    """What a drive takes from its command by a parameter of one of an effect; None where only simulations tell."""
    first_order, j = effect.first_order, load.joint - 1
    if first_order is None or first_order.changes != "torque":
        return None
    tables = {}
    for label, motion in motions.motions.items():
        tables[label] = np.zeros_like(motion.torque)
        at = JointTorque(motion.torque[:, j], motion.load[:, j], motion.step)
        tables[label][:, j] = first_order.column(at)
    return replace(load, tables=tables, amplitudes=_ones(motions, effect, load.joint))


def _by_late_stamps(motions: FittedMotions, load: Load, effect: Effect) -> Load:
    """What the log shows by one second of a lag of its stamps.

    Its first part is left out: there a late log looks like a start off the reference, which a fit then frees.
    """
    tables = {}
    for label in motions.motions:
        run = motions.fit.simulation(label)
        torque, count = run.logged_torque(run.record(all_ticks=True)), run.experiment.reference.time.size
        late, still = (run.operator.stamped_later(part, count, between=True) for part in (LATE_PART, 0.0))
        change = late.apply(torque[late.ticks]) - still.apply(torque[still.ticks])
        change[run.experiment.time < run.experiment.time[0] + MEMORY_S] = 0.0
        tables[label] = change / (LATE_PART * run.step_size)
    return replace(load, tables=tables, amplitudes=_ones(motions, effect, load.joint), is_of_log=True)


def _ones(motions: FittedMotions, effect: Effect, joint: int) -> dict[str, float]:
    """The parameters of an effect, all one over their neutral values."""
    return dict.fromkeys((v.name for v in effect.parameters(motions.joint_types[joint - 1])), 1.0)


def _tilts(motions: FittedMotions, name: str, effect: Effect, stated: StatedSize) -> Iterator[Load]:
    """The loads of a tilted base, about two horizontal axes."""
    robot = motions.description
    if robot is None or not np.any(robot.gravity):
        return
    gravity = np.array(robot.gravity)
    parameters = effect.parameters(motions.joint_types[0])
    for axis, parameter in zip(horizontal_axes(gravity), parameters, strict=True):
        turned = robot.model_copy(update={"gravity": tuple(gravity + SMALL_STEP * np.cross(axis, gravity))})
        about = ", ".join(f"{v:.3g}" for v in axis + 0.0)
        tables = _change_of_links(motions, turned)
        yield Load(name, stated, 1, f"about the axis ({about})", tables, {parameter.name: 1.0})


def _as_values(fit: Fit) -> Array:
    """(N, n) the part of the torque that the values can make: beside a virtual controller, which takes its own torque
    from the log, another scale of all torques is one of the values, and no size of it shows."""
    table, right = whitened(fit.jacobian, fit.deviation), (fit.torque / fit.deviation).ravel()
    return np.asarray(fit.jacobian @ np.linalg.lstsq(table, right, rcond=None)[0])


def loads_of_case(motions: FittedMotions) -> Iterator[Load]:
    """The loads of what a case says of the machine and data can show in part only: the scale of all torques, the size
    of gravity, the lengths of links, and where each joint is at zero."""
    parts = motions.fit.model.experiments.rows
    torque = _as_values(motions.fit) if motions.fit.model.loop.is_virtual else motions.fit.torque
    scale = {label: torque[parts[label]] for label in motions.motions}
    yield Load("torque_scale", TORQUE_SCALE, 1, "", scale, is_of_log=True)
    if motions.robot is None:
        return
    robot = motions.robot.description
    if np.any(robot.gravity):
        yield Load("gravity", GRAVITY, 1, "", _links(motions, motions.robot, at_rest=True))
    for j, joint in enumerate(robot.joints):
        for key in ("a", "d"):
            length, joints = getattr(joint, key), list(robot.joints)
            if not length:
                continue
            joints[j] = joint.model_copy(update={key: length * (1 + SMALL_STEP)})
            tables = _change_of_links(motions, robot.model_copy(update={"joints": tuple(joints)}))
            if any(np.abs(table).max() > TINY for table in tables.values()):
                yield Load("link_length", LINK_LENGTH, j + 1, f"{key} of joint {j + 1}", tables)
    yield from _zeros(motions, motions.robot)


def _zeros(motions: FittedMotions, robot: RobotModel) -> Iterator[Load]:
    """The loads of joints whose zero is off: reference and sensor have the same one, so that only the links act
    otherwise."""
    for j, joint in enumerate(robot.description.joints):
        stated = ZERO_TURNING if joint.type == "revolute" else ZERO_SLIDING
        found = _links(motions, robot, shifted=SMALL_STEP * np.eye(motions.joint_count)[j])
        tables = {label: (table - motions.motions[label].load) / SMALL_STEP for label, table in found.items()}
        if any(np.abs(t).max() > NO_LOAD * np.abs(motions.motions[k].load).max() for k, t in tables.items()):
            yield Load("position_zero", stated, j + 1, f"joint {j + 1}", tables)


def _change_of_links(motions: FittedMotions, changed: RobotDescription) -> dict[str, Array]:
    """(K, n) change of the torque of the links by another description, over the small step to it."""
    assert motions.robot is not None
    found = _links(motions, motions.robot.like(changed))
    return {label: (table - motions.motions[label].load) / SMALL_STEP for label, table in found.items()}


def _links(
    motions: FittedMotions, robot: RobotModel, *, at_rest: bool = False, shifted: Array | float = 0.0
) -> dict[str, Array]:
    """(K, n) torque of the links of a robot along the motions; ``at_rest``: by gravity alone; ``shifted``: (n,) by
    which it stands elsewhere."""
    still, found = 0.0 if at_rest else 1.0, {}
    for label, m in motions.motions.items():
        values = motions.values_in(label)
        chi = np.array([values.get(v.name, v.start) for v in robot.parameters])
        found[label] = robot.at_points("transmitted", (m.q + shifted).T, still * m.dq.T, still * m.ddq.T, chi)
    return found
