"""The limits of a motion that is designed: from a document, the robot, or the reference of the case."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from fmu_didim.base.documents import Angle, NotNegative, Positive, Strict, read_document, validate
from fmu_didim.base.errors import InputError
from fmu_didim.case import Case
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.discovery.excitation.limits import Bounds, Limits, limits_of

OF_REFERENCE = "the reference of the case"
OF_ROBOT = "the robot description"
GIVEN = "given"
NO_LIMIT = "none"


Wall = tuple[float, float]
"""Lowest and highest along an axis, m."""


class LinkCapsule(Strict):
    """A segment with a radius that encloses a link, or a piece of it.

    Attributes:
        link: number of the link, 0 for the base.
        from_: start of the segment, m, in the frame of the link; of link 0 in that of the boxes.
        to: its end.
        radius: m.
    """

    link: NotNegative
    from_: tuple[float, float, float] = Field(alias="from")
    to: tuple[float, float, float]
    radius: float = Field(ge=0)


class MotionLimits(Strict):
    """Limits of a motion, one entry a joint; what is not given is taken from the robot or the reference of the case.

    Attributes:
        position: lowest and highest position, rad or m, an angle also as ``pi/2``.
        velocity: largest speed, rad/s or m/s.
        acceleration: largest acceleration, rad/s2 or m/s2.
        torque: largest torque, N.m or N; none by default.
        start: position at which the motion begins and ends, rad or m; anywhere by default.
        inside: a box that the arm does not leave, lowest and highest x, y and z, m; in the frame of the base, of a URDF
            file in that of its root link.
        boxes: those that the arm keeps out of, such as a table.
        capsules: what encloses the links; by default the collision geometry of a URDF file, and without it the lines
            between the origins of the frames.
        clearance: least distance that is kept, m.
    """

    position: tuple[tuple[Angle, Angle], ...] | None = None
    velocity: tuple[Positive, ...] | None = None
    acceleration: tuple[Positive, ...] | None = None
    torque: tuple[Positive, ...] | None = None
    start: tuple[Angle, ...] | None = None
    inside: tuple[Wall, Wall, Wall] | None = None
    boxes: tuple[tuple[Wall, Wall, Wall], ...] = ()
    capsules: tuple[LinkCapsule, ...] | None = None
    clearance: float = Field(default=0.0, ge=0)

    @model_validator(mode="after")
    def _rising(self) -> MotionLimits:
        for box in (*self.boxes, *([self.inside] if self.inside is not None else [])):
            if any(not low < high for low, high in box):
                raise ValueError("boxes and inside: the first of each pair must be less than the second")
        return self


OF_JOINTS = ("position", "velocity", "acceleration", "torque", "start")
"""Keys with an entry for each joint."""


@dataclass(frozen=True)
class FoundBounds:
    """Bounds, and where each of their kinds comes from."""

    bounds: Bounds
    origin: Mapping[str, str]


def limits_document(given: MotionLimits | Mapping[str, Any] | Path | str | None) -> MotionLimits:
    """The limits as a document; raises InputError."""
    if given is None:
        return MotionLimits()
    if isinstance(given, MotionLimits):
        return given
    if isinstance(given, Mapping):
        return validate(MotionLimits, dict(given), where="limits")
    return read_document(MotionLimits, given)


def bounds_of(case: Case, reference: Trajectory | None, given: MotionLimits) -> FoundBounds:
    """The bounds of a case.

    Args:
        reference: of the case; None where it has none yet.

    Raises:
        InputError: an entry does not have a value for each joint, or leaves no room; or one is not given, and there is
            no reference that uses it.
    """
    n = case.parameters.joint_count
    for name in OF_JOINTS:
        value = getattr(given, name)
        if value is not None and len(value) != n:
            raise InputError(
                "One entry is needed for each joint.", where=f"limits.{name}", got=len(value), valid=str(n),
                next_step="Give a list with an entry for each joint.",
            )  # fmt: skip
    position, of_position = _position(case, reference, given)
    origin = {"position": of_position}
    rates: dict[str, Array] = {}
    for name in ("velocity", "acceleration"):
        own = getattr(given, name)
        origin[name] = OF_REFERENCE if own is None else GIVEN
        rates[name] = getattr(_used(reference, n), SIZES[name]) if own is None else np.array(own)
    origin["torque"] = NO_LIMIT if given.torque is None else GIVEN
    torque = np.full(n, np.inf) if given.torque is None else np.array(given.torque)
    start = None if given.start is None else np.array(given.start, dtype=float)
    limits = Limits(position[:, 0], position[:, 1], rates["velocity"], rates["acceleration"])
    return FoundBounds(Bounds(limits, torque, start), origin)


SIZES = {"velocity": "speed", "acceleration": "acceleration"}
"""Key of a document -> attribute of limits."""


def _position(case: Case, reference: Trajectory | None, given: MotionLimits) -> tuple[Array, str]:
    """(n, 2) range of each joint, and where it comes from."""
    n = case.parameters.joint_count
    if given.position is not None:
        return np.array(given.position, dtype=float), GIVEN
    known = [joint.limits for joint in case.robot.joints] if case.robot is not None else [None]
    if None not in known:
        return np.array(known, dtype=float), OF_ROBOT
    used = _used(reference, n)
    return np.column_stack([used.low, used.high]), OF_REFERENCE


def _used(reference: Trajectory | None, n: int) -> Limits:
    if reference is None:
        raise InputError(
            "The limits of the motion are not given, and the case has no motion yet that uses some.", where="limits",
            next_step="Give limits: position, velocity and acceleration of each joint.",
        )  # fmt: skip
    try:
        return limits_of(reference, n)
    except InputError as error:
        raise InputError(
            "The limits of the motion are not given, and a joint of the case's reference does not move.",
            where="limits", next_step="Give limits: position, velocity and acceleration of each joint.",
        ) from error  # fmt: skip
