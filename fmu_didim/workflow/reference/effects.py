"""The catalogue of effects for a reader: equation, signature, parameters, and a small plot of what each does."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import casadi as ca
import numpy as np

from fmu_didim.base.documents import Number, Strict
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.effects import (
    EFFECTS,
    Effect,
    InsertedEffect,
    JointType,
    Surroundings,
    TorqueEffect,
    find_effect,
)
from fmu_didim.dynamics.effects.inserted import NO_LIMIT, VELOCITY_UNITS
from fmu_didim.dynamics.robot.observed_states import states_along
from fmu_didim.report.drawing.plot import text_plot
from fmu_didim.report.terminal import wrapped

AMPLITUDE, FREQUENCY_HZ, POINTS, STEP = 0.5, 0.5, 800, 0.005
"""Motion along which effects are drawn: rad or m, Hz; samples of two periods and their distance in s."""


class EffectParameter(Strict):
    """A parameter of an effect.

    Attributes:
        name: without the joint number; unit: at a revolute joint; prismatic_unit: at a prismatic one.
        default: value where a robot description gives none, null where that is no limit.
        limits: lowest and highest sensible value.
        shape: whether it shapes the effect, or is its amplitude; description: what it is.
    """

    name: str
    unit: str | None
    prismatic_unit: str | None
    default: Number
    limits: tuple[float, float] | None
    shape: bool
    description: str


class EffectEntry(Strict):
    """An effect of the catalogue.

    Attributes:
        name: as listed in ``effects:`` of a joint; title: in words; equation: what it does.
        place: where it acts; signature: where the residual of a model without it shows.
        experiment: what tells it from its rivals; confounded_with: these; source: of the equation.
        parameters: amplitudes and shapes.
    """

    name: str
    title: str
    equation: str
    place: Literal["torque balance", "controller", "drive", "sensor", "structure", "measurement"]
    signature: str
    experiment: str
    confounded_with: tuple[str, ...]
    source: str
    parameters: tuple[EffectParameter, ...]


def effect_entry(name: str) -> EffectEntry:
    """The entry of an effect of the tree, or of ``package.module:Name``; raises UnknownNameError."""
    effect = find_effect(name)
    return EffectEntry(
        name=name, title=effect.title, equation=effect.equation, place=effect.place, signature=effect.signature,
        experiment=effect.experiment, confounded_with=tuple(effect.confounded_with), source=effect.source,
        parameters=tuple(_parameters(effect)),
    )  # fmt: skip


def effect_entries() -> list[EffectEntry]:
    """All effects of the tree."""
    return [effect_entry(name) for name in EFFECTS]


def _parameters(effect: Effect) -> Iterator[EffectParameter]:
    for declared, shape in ((effect.own_parameters, False), (effect.own_shapes, True)):
        for p in declared:
            kinds: tuple[JointType, JointType] = ("revolute", "prismatic")
            made = {kind: p(kind) for kind in kinds if p.exists(kind)}
            units = [made[kind].unit if kind in made else None for kind in kinds]
            start = next(iter(made.values())).start
            default = start if p.neutral is None or shape else p.neutral
            yield EffectParameter(
                name=p.name, unit=units[0], prismatic_unit=units[1], default=default, limits=p.limits, shape=shape,
                description=p.description,
            )  # fmt: skip


def effects_text() -> str:
    """All effects, one a line, by the place where they act."""
    lines: list[str] = []
    entries = effect_entries()
    for place in dict.fromkeys(entry.place for entry in entries):
        lines += ["", f"{place}:"]
        lines += [f"  {entry.name:28} {entry.title}" for entry in entries if entry.place == place]
    return "\n".join([*lines[1:], "", "What one of them is: fmu-didim effects NAME"]) + "\n"


def effect_text(name: str) -> str:
    """An effect: equation, signature, how it is written at a joint, and a plot along a motion."""
    entry = effect_entry(name)
    lines = [f"{entry.name}: {entry.title} ({entry.place})", "", f"  {entry.equation}", ""]
    for p in entry.parameters:
        default = "none" if p.default is None else f"{p.default:g}"
        units = " or ".join(dict.fromkeys(u for u in (p.unit, p.prismatic_unit) if u not in (None, "")))
        lines += wrapped(f"{p.description}{f', {units}' if units else ''}; {default}", f"  {p.name:8} ", " " * 11)
    texts = {"Signature": entry.signature, "Confounded": ", ".join(entry.confounded_with) or "with none"}
    texts |= {"Told by": entry.experiment, "Source": entry.source, "Written": _written(entry)}
    lines += ["", *(line for head, text in texts.items() for line in wrapped(text, f"{head:11}", " " * 11))]
    picture = effect_plot(find_effect(name))
    return "\n".join([*lines, *(["", *picture] if picture else [])]) + "\n"


def _written(entry: EffectEntry) -> str:
    if entry.place == "measurement":
        return "torque: {log_shift_s: ...} in the case"
    own = ", ".join(f"{p.name}: ..." for p in entry.parameters)
    joint = "joint 1" if find_effect(entry.name).acts_on_base else "a joint"
    return f"at {joint} of the robot: effects: [..., {entry.name}], parameters: {{{own}}}"


def effect_plot(effect: Effect) -> list[str]:
    """A plot of an effect along a sine, as lines of text; empty where one joint alone does not show it."""
    time = np.arange(POINTS, dtype=np.float64) * STEP
    w = 2 * np.pi * FREQUENCY_HZ
    q, dq, ddq = (AMPLITUDE * w**k * np.sin(w * time + k * np.pi / 2) for k in (0, 1, 2))
    if isinstance(effect, InsertedEffect):
        u = np.sin(w * time)
        return text_plot(
            time, {"u": u, "y": _output(effect, u, q, dq)}, x_name="time in s", y_name="signal before (u), after (y)"
        )
    if not isinstance(effect, TorqueEffect) or effect.needs & {"load", "other joints"} or effect.reach:
        return []
    torque = _torque(effect, time, q, dq, ddq)
    if torque is None or not np.ptp(torque) > 0:
        return []
    later = slice(POINTS // 2, None)  # the second period: states have settled
    along = {"velocity": dq, "position": q, "acceleration": ddq, "time in s": time}

    def variation(name: str) -> float:
        """How much the torque varies between neighbours: small where it is a function of this quantity."""
        return float(np.abs(np.diff(torque[later][np.argsort(along[name][later], kind="stable")])).sum())

    name = min(along, key=variation)
    return text_plot(along[name][later], {"*": torque[later]}, x_name=name, y_name="torque, all amplitudes 1")


def _torque(effect: TorqueEffect, time: Array, q: Array, dq: Array, ddq: Array) -> Array | None:
    """Torque of an effect along the motion of one joint, all its amplitudes one; None where that does not say it."""
    x, z = ca.SX.sym("x", 4), ca.SX.sym("z", len(effect.states("revolute")))
    shapes = {v.name: ca.SX(v.start) for v in effect.shapes("revolute")}

    def at(state: ca.SX, row: ca.SX) -> Surroundings:
        parts = tuple(state[i] for i in range(state.numel()))
        return Surroundings(0, "revolute", row[0], row[1], row[2], time=row[3], state=parts)

    motion = np.column_stack([q, dq, ddq, time])
    try:
        columns = effect.columns(at(z, x), shapes)
    except (KeyError, IndexError):  # it looks at more than its joint
        return None
    total = sum((c for c in columns if isinstance(c, ca.SX)), ca.SX(0))
    states = np.zeros((time.size, z.numel()))
    if z.numel():
        start = np.array([v.start for v in effect.states("revolute")])
        states = states_along(lambda s, row: ca.vertcat(*effect.rates(at(s, row), shapes)), start, time, motion)
    return np.asarray(ca.Function("torque", [x, z], [total]).map(time.size)(motion.T, states.T)).ravel()


def _output(effect: InsertedEffect, u: Array, q: Array, dq: Array) -> Array:
    """The output of a drive or sensor effect, with each parameter in the middle of its search range, and limits that
    act on this signal and motion."""
    block = effect.block("revolute", STEP)
    grids = effect.search("revolute")
    middle = {
        name: (g.lowest * g.highest) ** 0.5 if g.logarithmic else (g.lowest + g.highest) / 2
        for name, g in grids.items()
    }
    limits = {v.name: 0.7 if v.unit not in VELOCITY_UNITS else 2 * np.abs(dq).max() for v in block.parameters}
    values = np.array([
        limits[v.name] if v.start >= NO_LIMIT else middle.get(v.name, v.start) for v in block.parameters
    ])  # fmt: skip
    assert block.output is not None
    signals = {"u": u, "q": q, "dq": dq}
    rows = np.column_stack([signals[v.name] for v in block.inputs])
    x = np.asarray(block.start(rows[0], values)).ravel() if block.states else np.zeros(0)
    found = []
    for row in rows:
        found.append(float(block.output(x, row, values)))
        x = np.asarray(block.update(x, row, values)).ravel() if block.states else x
    return np.array(found)
