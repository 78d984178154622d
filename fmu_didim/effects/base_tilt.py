"""Tilt of the base."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from fmu_didim.effects.base import JointType, Search
from fmu_didim.effects.structure import StructureEffect
from fmu_didim.signals import Variable


class BaseTilt(StructureEffect):
    """Gravity in the frame of the base is R(h_x, tilt_x) R(h_y, tilt_y) g, with the angles in rad about two horizontal
    axes: x and y of the base where gravity acts along z, else the axis of the base closest to horizontal, and the
    one perpendicular to it. Listed at joint 1."""

    name = "base_tilt"
    title = "Tilt of the base"
    equation = "g -> R(h_x, tilt_x)*R(h_y, tilt_y)*g"
    class_name = "base_tilt"
    confounded_with = ("torque_offset", "spring")
    signature = "Residual like gravity on all joints; that of a first vertical joint is taken for its MX and MY."
    experiment = "A wide range of all joints, or a spirit level on the base."
    source = "rotation of the gravity vector; Khalil and Dombre, Modeling, Identification and Control of Robots, ch. 9"
    acts_on_base = True
    signed = frozenset({"tilt_x", "tilt_y"})
    neutral: ClassVar[Mapping[str, float]] = {"tilt_x": 0.0, "tilt_y": 0.0}
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {"tilt_x": (-3.2, 3.2), "tilt_y": (-3.2, 3.2)}

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return (
            Variable("tilt_x", "rad", "parameter", 0.0, "rotation of gravity about the first horizontal axis"),
            Variable("tilt_y", "rad", "parameter", 0.0, "rotation of gravity about the second one"),
        )

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        return {name: Search(-0.1, 0.1, 3, logarithmic=False) for name in ("tilt_x", "tilt_y")}
