"""The robot description: geometry, effects and parameter values, as a YAML document."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from fmu_didim.base.documents import FOLDER, Angle, Strict
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.data.signals import Array, Variable
from fmu_didim.dynamics.effects import (
    DEFAULT_EFFECTS,
    EFFECTS,
    LINK_PARAMETERS,
    Effect,
    InsertedEffect,
    JointType,
    Motor,
    TorqueEffect,
    effect_name,
    find_effect,
)
from fmu_didim.dynamics.robot.body import body_of, inverse, parameters_of, right_angle, turn

Frames = Literal["modified", "standard"]


class Joint(Strict):
    """One joint and its link, in modified Denavit-Hartenberg convention (Khalil and Kleinfinger 1986).

    The frame of link j follows from that of link j-1 by Tx(a) Rx(alpha) Ry(beta) Rz(theta) Tz(d), with ``frames:
    standard`` by Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta); the joint's position adds to theta (revolute) or d
    (prismatic).

    Attributes:
        name: for reading only.
        type: ``revolute`` or ``prismatic``.
        alpha, theta: angles in rad; a fraction of pi such as ``-pi/2`` may stand for a number, and 1.5708 is read as
            pi/2.
        beta: a further angle in rad, for axes that are parallel but for what a calibration found: their common normal
            lies metres or kilometres away (Hayati and Mirmirani 1985).
        a, d: lengths in m.
        limits: range of the position of the joint, where it is known.
        motor: the motor and the gear that drive the joint alone, where they are known: ``{gear_ratio: 100, pole_pairs:
            5, slots: 12}``. ``discover`` looks for ripples where such a drive has them; nothing else uses it.
        effects: names of the effects at this joint, or ``module:Name`` (``path/to/file.py:Name``) of further ones,
            looked for beside this file; replaces the default. In Python the class of an effect may stand for its name.
        parameters: values of the link's inertial parameters and of the parameters of its effects, by name without the
            number of the joint (``ZZ``, ``Fv``, ``v0``); 0 where none is given, or what the effect starts with.
    """

    name: str = ""
    type: JointType
    alpha: Angle = 0.0
    a: float = 0.0
    theta: Angle = 0.0
    d: float = 0.0
    beta: Angle = 0.0
    limits: tuple[Angle, Angle] | None = None
    motor: Motor | None = None
    effects: tuple[str, ...] = DEFAULT_EFFECTS
    parameters: Mapping[str, float] = Field(default_factory=dict)

    @field_validator("alpha", "theta", "beta")
    @classmethod
    def _exact(cls, value: float) -> float:
        return right_angle(value)

    @field_validator("effects", mode="before")
    @classmethod
    def _names_of_classes(cls, value: Any) -> Any:
        if not isinstance(value, list | tuple):
            return value
        try:
            return tuple(effect_name(part) if not isinstance(part, str) else part for part in value)
        except InputError as error:
            raise ValueError(str(error)) from error

    @field_validator("effects")
    @classmethod
    def _known_effects(cls, value: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
        problems = []
        value = tuple(effect_name(name, (info.context or {}).get(FOLDER, Path())) for name in value)
        for name in value:
            try:
                found = find_effect(name)
            except InputError as error:
                problems.append(str(error))
                continue
            if found.is_of_log:
                problems.append(f"{name} belongs to the log, not to the robot: use torque: log_shift_s in the case")
            if found.place == "controller":
                problems.append(f"{name} belongs to the controller, not to the robot: use gains: of a run in the case")
        doubled = sorted({name for name in value if value.count(name) > 1})
        problems += [f"effect {name} is listed twice" for name in doubled]
        if problems:
            raise ValueError("; ".join(problems))
        return value

    @model_validator(mode="after")
    def _known_parameters(self) -> Joint:
        names = [v.name for v in (*self.linear_parameters(), *self.shapes(), *self.outside_parameters())]
        doubled = sorted({name for name in names if names.count(name) > 1})
        if doubled:
            raise ValueError(f"several effects have different parameters named {', '.join(doubled)}")
        unknown = [name for name in self.parameters if name not in names]
        if unknown:
            raise ValueError(f"unknown parameters {', '.join(unknown)}; valid: {', '.join(names)}")
        signed = {name for effect in self.all_effects() for name in effect.signed}
        positive = [v for v in self.shapes() if v.name not in signed]
        zero = [v.name for v in positive if not self.parameters.get(v.name, v.start) > 0]
        if zero:
            raise ValueError(f"{', '.join(zero)} must be greater than 0")
        for effect in self.all_effects():
            outside = effect.outside_limits(self.parameters)
            if outside:
                raise ValueError(outside)
            if effect.needs_elastic and not self.is_elastic:
                gears = [name for name, other in EFFECTS.items() if other.elastic]
                raise ValueError(f"{effect.name} acts in a gear that gives way: list {' or '.join(gears)}, too")
        return self

    @field_validator("limits")
    @classmethod
    def _rising(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and not value[0] < value[1]:
            raise ValueError("the first limit must be less than the second")
        return value

    @property
    def before(self) -> Array:
        """(4, 4) Tx(a) Rx(alpha) Ry(beta): what of the way from one frame to the next lies before the axis."""
        pose = np.eye(4)
        pose[:3, :3], pose[0, 3] = turn(0, self.alpha) @ turn(1, self.beta), self.a
        return pose

    def all_effects(self) -> tuple[Effect, ...]:
        """The effects of this joint, wherever they act."""
        return tuple(find_effect(name) for name in self.effects)

    def effect_objects(self) -> tuple[TorqueEffect, ...]:
        """Those of its effects that act in the torque balance."""
        return tuple(effect for effect in self.all_effects() if isinstance(effect, TorqueEffect))

    def outside_effects(self) -> tuple[InsertedEffect, ...]:
        """Those that act outside the plant, in drive or sensor; the plant's equations lack them, the loop has them."""
        return tuple(effect for effect in self.all_effects() if isinstance(effect, InsertedEffect))

    def outside_parameters(self) -> tuple[Variable, ...]:
        """The parameters of these, without the joint number."""
        return tuple(dict.fromkeys(v for e in self.outside_effects() for v in _variables(e, self.type)))

    @property
    def is_elastic(self) -> bool:
        """Whether its gear gives way."""
        return any(effect.elastic for effect in self.all_effects())

    def linear_parameters(self) -> tuple[Variable, ...]:
        """The parameters that are linear in the torque, without the joint number."""
        return (*LINK_PARAMETERS, *(v for effect in self.effect_objects() for v in effect.parameters(self.type)))

    def shapes(self) -> tuple[Variable, ...]:
        """All parameters of the plant not linear in the torque, without the joint number; equal ones are shared.

        The shapes of the effects in the torque balance, and all parameters of those in the structure.
        """
        shapes = [v for effect in self.effect_objects() for v in effect.shapes(self.type)]
        structure = [e for e in self.all_effects() if e.place == "structure"]
        shapes += [v for effect in structure for v in _variables(effect, self.type)]
        superseded = {name for effect in self.all_effects() for name in effect.supersedes(self.parameters)}
        return tuple(dict.fromkeys(v for v in shapes if v.name not in superseded))


def _variables(effect: Effect, joint_type: JointType) -> tuple[Variable, ...]:
    return (*effect.parameters(joint_type), *effect.shapes(joint_type))


class RobotDescription(Strict):
    """A serial robot.

    Attributes:
        name: identifier of the robot (a legal C name).
        description: what it is; source: where geometry and values come from.
        gravity: acceleration of gravity in m/s2, in the frame of the base.
        frames: ``modified`` Denavit-Hartenberg (Khalil and Kleinfinger), or ``standard``, the classical one of Denavit
            and Hartenberg: then joint j moves about z of frame j-1, and the parameters of a link are those in the
            classical frame j. Such a description is brought to modified frames as it is read, inertial parameters and
            all, and everything afterwards is in these.
        original_frames: the convention that it was read in; written by the program, for reading only.
        joints: from the base to the tip, each with its link.
        identified: the base parameters: ``computed`` (rank-revealing QR), or a mapping from the name of each base
            parameter to the standard parameter that carries it. All other parameters keep the values given at their
            joint, 0 by default.
        known: parameters that a computation of the base parameters must leave alone.
    """

    schema_version: Literal[1] = Field(default=1, alias="schema")
    name: str = Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$")
    description: str = ""
    source: str = ""
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    frames: Frames = "modified"
    original_frames: Frames = "modified"
    joints: tuple[Joint, ...] = Field(min_length=1)
    identified: Literal["computed"] | Mapping[str, str] = "computed"
    known: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _brought_to_modified_frames(self) -> RobotDescription:
        if self.frames == "modified":
            return self
        named = {*self.known, *(() if isinstance(self.identified, str) else self.identified.values())}
        turned = {
            f"{v.name}{j}" for j, joint in enumerate(self.joints, start=1) if joint.a or joint.alpha or joint.beta
            for v in LINK_PARAMETERS if v.name != "M"
        }  # fmt: skip
        if named & turned:
            raise ValueError(
                f"{', '.join(sorted(named & turned))} in known: or identified: would be meant in a classical frame, "
                "and parameters are identified in modified ones. Write the description in these first "
                "(fmu-didim robot FILE --out robot.yaml), and name them there"
            )
        # The model is frozen; a validator may still complete it.
        self.__dict__.update(joints=modified_joints(self.joints), frames="modified", original_frames="standard")
        return self

    @model_validator(mode="after")
    def _joints_in_reach(self) -> RobotDescription:
        problems = [
            f"effect {effect.name} at joint {j} needs {effect.reach} more joint(s) after it"
            for j, joint in enumerate(self.joints, start=1)
            for effect in joint.effect_objects()
            if j + effect.reach > len(self.joints)
        ]
        if problems:
            raise ValueError("; ".join(problems))
        of_base = [effect.name for joint in self.joints[1:] for effect in joint.all_effects() if effect.acts_on_base]
        if of_base:
            raise ValueError(f"{of_base[0]} belongs to joint 1")
        return self

    @model_validator(mode="after")
    def _known_names(self) -> RobotDescription:
        names = [v.name for v in self.standard_parameters()]
        used = list(self.known)
        if not isinstance(self.identified, str):
            used += list(self.identified.values())
            doubled = {n for n in self.identified.values() if list(self.identified.values()).count(n) > 1}
            if doubled:
                raise ValueError(f"identified names {', '.join(sorted(doubled))} twice")
        unknown = [name for name in used if name not in names]
        if unknown:
            raise ValueError(f"unknown standard parameters {', '.join(unknown)}; valid: {', '.join(names)}")
        return self

    def coupled_joints(self) -> frozenset[int]:
        """Joints, from 0, that share a motor with a neighbour, as those of a wrist, by their effects."""
        return frozenset(
            j + k for j, joint in enumerate(self.joints) for effect in joint.effect_objects()
            if effect.couples_motors for k in range(effect.reach + 1)
        )  # fmt: skip

    def elastic_joints(self) -> tuple[int, ...]:
        """Joints whose gears give way, from 0."""
        return tuple(j for j, joint in enumerate(self.joints) if joint.is_elastic)

    def standard_parameters(self) -> tuple[Variable, ...]:
        """All parameters that are linear in the torque, named with the joint number, with their values."""
        return tuple(
            Variable(f"{v.name}{j}", v.unit, "parameter", joint.parameters.get(v.name, v.start), v.description)
            for j, joint in enumerate(self.joints, start=1)
            for v in joint.linear_parameters()
        )

    def shape_parameters(self) -> tuple[Variable, ...]:
        """All shape parameters, named with the joint number, with their values."""
        return tuple(
            Variable(f"{v.name}_{j}", v.unit, "parameter", joint.parameters.get(v.name, v.start), v.description)
            for j, joint in enumerate(self.joints, start=1)
            for v in joint.shapes()
        )

    def with_values(self, values: Mapping[str, float]) -> RobotDescription:
        """The same robot with other values of standard or shape parameters; raises UnknownNameError.

        Args:
            values: by name with the joint number (``ZZ1``, ``v0_2``; ``T_2`` of a lag in the drive).
        """
        places = {
            name: (j, own)
            for j, joint in enumerate(self.joints)
            for name, own in (
                *((f"{v.name}{j + 1}", v.name) for v in joint.linear_parameters()),
                *((f"{v.name}_{j + 1}", v.name) for v in (*joint.shapes(), *joint.outside_parameters())),
            )
        }
        changed: list[dict[str, float]] = [dict(joint.parameters) for joint in self.joints]
        for name, value in values.items():
            if name not in places:
                raise UnknownNameError("parameter", name, places, where=f"robot '{self.name}'")
            j, own = places[name]
            changed[j][own] = float(value)
        joints = tuple(
            joint.model_copy(update={"parameters": p}) for joint, p in zip(self.joints, changed, strict=True)
        )
        return self.model_copy(update={"joints": joints})


def modified_joints(joints: tuple[Joint, ...]) -> tuple[Joint, ...]:
    """Joints of a description in the classical convention, in the modified one.

    Classical frame j follows from frame j-1 by Rz(theta_j) Tz(d_j) Tx(a_j) Rx(alpha_j) Ry(beta_j), and joint j moves
    about z_j-1. Modified frame j lies after the first two of these movements, so that the others belong to the row of
    joint j+1:

        modified frame j = classical frame j * (Tx(a_j) Rx(alpha_j) Ry(beta_j))^-1

    Both have the same base. Of the last row these place a frame behind which nothing moves; what its link weighs
    is brought to the modified frame, like that of all others.
    """
    before = [{"alpha": 0.0, "a": 0.0, "beta": 0.0}, *(before_axis(joint) for joint in joints[:-1])]
    return tuple(
        joint.model_copy(update={**placed, "parameters": _in_modified_frame(joint)})
        for joint, placed in zip(joints, before, strict=True)
    )


def before_axis(joint: Joint) -> dict[str, float]:
    """What of a joint places its axis in a frame, by name."""
    return {"alpha": joint.alpha, "a": joint.a, "beta": joint.beta}


def _in_modified_frame(joint: Joint) -> dict[str, float]:
    """The parameters of a joint and its link that are stated in the classical frame, in the modified one."""
    own = [{v.name: v.name for v in LINK_PARAMETERS}, *(effect.added_to_link for effect in joint.effect_objects())]
    found = dict(joint.parameters)
    for names in own:
        stated = {of_link: found.pop(name) for name, of_link in names.items() if name in found}
        there = parameters_of(body_of(stated).seen_from(inverse(joint.before)))
        found |= {name: there[of_link] for name, of_link in names.items() if of_link in there}
    return found


def looks_standard(robot: RobotDescription) -> bool:
    """Whether a table of modified frames looks like one in the classical convention.

    The first frame of a modified table, and the last one of a classical table, can be chosen freely, and nearly always
    are so that alpha = a = 0 there. It is a hint, no more: an arm whose base is turned may have a first row with alpha.
    """
    first, last = robot.joints[0], robot.joints[-1]
    is_read_as_given = robot.original_frames == "modified" and len(robot.joints) > 1
    return is_read_as_given and bool(first.alpha or first.a) and not (last.alpha or last.a)
