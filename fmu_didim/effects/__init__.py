"""Physical effects, one per file, and the table of their names."""

from collections.abc import Mapping

from fmu_didim.effects.base import UNITS, JointMotion, JointType, JointUnits, TorqueEffect
from fmu_didim.effects.coulomb import Coulomb
from fmu_didim.effects.motor_inertia import MotorInertia
from fmu_didim.effects.torque_offset import TorqueOffset
from fmu_didim.effects.viscous import Viscous

EFFECTS: Mapping[str, TorqueEffect] = {
    effect.name: effect for effect in (MotorInertia(), Viscous(), Coulomb(), TorqueOffset())
}
DEFAULT_EFFECTS: tuple[str, ...] = ("motor_inertia", "viscous", "coulomb", "torque_offset")

__all__ = [
    "DEFAULT_EFFECTS",
    "EFFECTS",
    "UNITS",
    "JointMotion",
    "JointType",
    "JointUnits",
    "TorqueEffect",
]
