"""Physical effects, one per file, and the table of their names.

An effect says where it acts (``place``), what its parameters are, what it is confounded with, what would split it
from those and what discovery has to know of it, so that no other folder names an effect. Effects in the torque
balance (:class:`TorqueEffect`) are listed at a joint of a robot description,
``effects: [motor_inertia, viscous, coulomb, stribeck]``, and become columns of the regressor and terms of the direct
model, with their own states in the plant where they have any. A description also takes effects from outside the
tree, ``package.module:Name``.

Where a new one goes: one file here with one final class; the base class asks for what is missing. Its parameters
are declared in ``own_parameters`` and ``own_shapes``, its equation stands in ``columns`` (``rates`` for states), the
step of the integration follows from ``damping``, ``stiffness``, ``own_rate`` and ``relaxation``; an effect that says
how steep it is, is integrated implicitly with the slopes of its columns. Then a row in EFFECTS below. Names of its
parameters must differ from those of all other effects that may be listed at the same joint; shape parameters that
mean the same are shared (see ``steps.smoothing_velocity``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import count, islice
from pathlib import Path
from typing import Any

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.base.imports import check_allowed, import_object, located, run_code
from fmu_didim.dynamics.effects.actuator_lag import ActuatorLag
from fmu_didim.dynamics.effects.asymmetric_coulomb import AsymmetricCoulomb
from fmu_didim.dynamics.effects.asymmetric_viscous import AsymmetricViscous
from fmu_didim.dynamics.effects.backlash import Backlash
from fmu_didim.dynamics.effects.base import (
    ControllerEffect,
    Effect,
    MeasurementEffect,
    NonlinearEffect,
    Place,
    PreCheck,
    TorqueEffect,
    start_name,
)
from fmu_didim.dynamics.effects.base_tilt import BaseTilt
from fmu_didim.dynamics.effects.contact_stop import ContactStop
from fmu_didim.dynamics.effects.contact_stop_lower import ContactStopLower
from fmu_didim.dynamics.effects.controller_gain import ControllerGain
from fmu_didim.dynamics.effects.controller_gains import ControllerGains
from fmu_didim.dynamics.effects.coulomb import Coulomb
from fmu_didim.dynamics.effects.coupled_inertia import CoupledInertia
from fmu_didim.dynamics.effects.coupling_friction import CouplingFriction
from fmu_didim.dynamics.effects.cubic_spring import CubicSpring
from fmu_didim.dynamics.effects.cubic_viscous import CubicViscous
from fmu_didim.dynamics.effects.current_ripple import CurrentRipple
from fmu_didim.dynamics.effects.curve import Curve
from fmu_didim.dynamics.effects.curve_of_load import CurveOfLoad
from fmu_didim.dynamics.effects.curve_of_neighbour import CurveOfNeighbour
from fmu_didim.dynamics.effects.curve_of_position import CurveOfPosition
from fmu_didim.dynamics.effects.curve_of_reversal import CurveOfReversal
from fmu_didim.dynamics.effects.curve_of_time import CurveOfTime
from fmu_didim.dynamics.effects.curve_of_velocity import CurveOfVelocity
from fmu_didim.dynamics.effects.dead_zone import DeadZone
from fmu_didim.dynamics.effects.delay import Delay
from fmu_didim.dynamics.effects.directional_efficiency import DirectionalEfficiency
from fmu_didim.dynamics.effects.drive_gain import DriveGain
from fmu_didim.dynamics.effects.encoder_eccentricity import EncoderEccentricity
from fmu_didim.dynamics.effects.external_force import ExternalForce
from fmu_didim.dynamics.effects.first_order import JointTorque
from fmu_didim.dynamics.effects.gear_hardening import GearHardening
from fmu_didim.dynamics.effects.gravity_compensator import GravityCompensator
from fmu_didim.dynamics.effects.inserted import InsertedEffect, VelocityEffect
from fmu_didim.dynamics.effects.joint import (
    LINK_PARAMETERS,
    NOMINAL_ACCELERATION,
    NOMINAL_SPEED,
    PAYLOAD,
    UNITS,
    Column,
    JointType,
    JointUnits,
    OperatingRange,
    Parameter,
    Search,
    Surroundings,
    Values,
)
from fmu_didim.dynamics.effects.joint_elasticity import JointElasticity
from fmu_didim.dynamics.effects.load_dependent_friction import LoadDependentFriction
from fmu_didim.dynamics.effects.log_time_shift import LogTimeShift
from fmu_didim.dynamics.effects.lugre import LuGre
from fmu_didim.dynamics.effects.motor import Harmonic, Motor
from fmu_didim.dynamics.effects.motor_inertia import MotorInertia
from fmu_didim.dynamics.effects.payload_change import PayloadChange
from fmu_didim.dynamics.effects.position_dependent_friction import PositionDependentFriction
from fmu_didim.dynamics.effects.power_viscous import PowerViscous
from fmu_didim.dynamics.effects.presliding import Presliding
from fmu_didim.dynamics.effects.quadratic_viscous import QuadraticViscous
from fmu_didim.dynamics.effects.spring import Spring
from fmu_didim.dynamics.effects.stated_size import StatedSize
from fmu_didim.dynamics.effects.stribeck import Stribeck
from fmu_didim.dynamics.effects.structure import StructureEffect
from fmu_didim.dynamics.effects.temperature_dependent_friction import TemperatureDependentFriction
from fmu_didim.dynamics.effects.thermal_friction_drift import ThermalFrictionDrift
from fmu_didim.dynamics.effects.torque_drift import TorqueDrift
from fmu_didim.dynamics.effects.torque_offset import TorqueOffset
from fmu_didim.dynamics.effects.torque_ripple import TorqueRipple
from fmu_didim.dynamics.effects.torque_saturation import TorqueSaturation
from fmu_didim.dynamics.effects.torque_settling import TorqueSettling
from fmu_didim.dynamics.effects.transmission_error import TransmissionError
from fmu_didim.dynamics.effects.viscous import Viscous
from fmu_didim.dynamics.effects.voltage_limit import VoltageLimit
from fmu_didim.dynamics.effects.wrist_friction import WristFriction

_ALL: tuple[Effect, ...] = (
    # torque balance
    MotorInertia(), Viscous(), Coulomb(), TorqueOffset(), AsymmetricCoulomb(), AsymmetricViscous(), QuadraticViscous(),
    CubicViscous(), PowerViscous(), Stribeck(), Presliding(), LuGre(), LoadDependentFriction(),
    DirectionalEfficiency(), PositionDependentFriction(), CouplingFriction(), WristFriction(), CoupledInertia(),
    Spring(), CubicSpring(), GravityCompensator(), TorqueRipple(), CurrentRipple(), ContactStop(), ContactStopLower(),
    ThermalFrictionDrift(), TemperatureDependentFriction(), TorqueDrift(), TorqueSettling(), ExternalForce(),
    PayloadChange(), CurveOfPosition(), CurveOfVelocity(), CurveOfLoad(), CurveOfTime(), CurveOfNeighbour(),
    CurveOfReversal(),
    # controller
    ControllerGains(),
    # drive and sensor
    ControllerGain(), TorqueSaturation(), VoltageLimit(), DriveGain(), DeadZone(), Delay(), ActuatorLag(),
    EncoderEccentricity(),
    # structure
    JointElasticity(), Backlash(), TransmissionError(), GearHardening(), BaseTilt(),
    # measurement
    LogTimeShift(),
)  # fmt: skip
EFFECTS: Mapping[str, Effect] = {effect.name: effect for effect in _ALL}
DEFAULT_EFFECTS: tuple[str, ...] = ("motor_inertia", "viscous", "coulomb", "torque_offset")


_CLASSES: dict[str, type[Effect]] = {}
"""Classes that were handed over themselves in this session, by the names under which documents list them."""


def effect_name(effect: str | type[Effect] | Effect, *folders: Path) -> str:
    """The name under which a description lists an effect, which is found by it in this session.

    Args:
        effect: its name, ``module:Name``, or its class. A class has the name ``module:Name``, too; one that was defined
            anew is another one, ``module:Name_2``, so that what was made with the former one keeps its meaning.
        folders: of what names it, where a name means a file.

    Raises:
        InputError: it is neither a name nor the class of an effect.
    """
    if isinstance(effect, str):
        return effect if effect in _CLASSES else located(effect, *folders)
    if not (isinstance(effect, type) and issubclass(effect, Effect)):
        got = repr(effect) if isinstance(effect, type) else f"an object of the type {type(effect).__name__}"
        raise InputError(
            "This is no effect.", where=_WHERE, got=got,
            valid="a name, 'module:Name', or a class derived from TorqueEffect, InsertedEffect or StructureEffect",
            next_step=f"Give the {'class, not an object of it' if isinstance(effect, Effect) else 'name or class'}.",
        )  # fmt: skip
    for name, known in _CLASSES.items():
        if known is effect:
            return name
    plain = f"{effect.__module__}:{effect.__name__}"
    further = (f"{plain}_{number}" for number in count(2))
    name = next(name for name in (plain, *islice(further, len(_CLASSES) + 1)) if name not in _CLASSES)
    _CLASSES[name] = effect
    return name


def find_effect(name: str) -> Effect:
    """The effect of this name, or ``module:Name`` (``file.py:Name``) for one outside the tree.

    Raises:
        UnknownNameError: there is no such effect; InputError: it is no effect.
    """
    if ":" not in name or name in _CLASSES:
        return _found(name)
    check_allowed(name, where=_WHERE)
    return _found(located(name))


_WHERE = "effects of a joint"


@cache
def _found(name: str) -> Effect:
    found: Any = EFFECTS.get(name)
    if ":" in name:
        found = _CLASSES[name] if name in _CLASSES else import_object(name, where=_WHERE)
        if isinstance(found, type) and issubclass(found, Effect):
            found = run_code(found, what="effect", where=_WHERE, got=name)
    elif found is None:
        raise UnknownNameError("effect", name, EFFECTS)
    if not isinstance(found, TorqueEffect | NonlinearEffect):
        raise InputError(
            f"'{name}' cannot be listed at a joint: it is not an effect.", where=_WHERE,
            next_step="List a class of an effect; fmu-didim discover --help and docs/reference name those that ship.",
        )  # fmt: skip
    return found


def effect_catalogue(further: Sequence[str]) -> Mapping[str, Effect]:
    """All effects of the tree by their names, and further ones, each by the name that is given.

    Raises:
        InputError, UnknownNameError: as :func:`find_effect`; InputError: a further one has a parameter with the name of
            another's.
    """
    found = {**EFFECTS, **{name: find_effect(name) for name in further}}
    for name in further:
        for other in found:
            if other != name and (clashing := clashing_names(found[name], found[other])):
                raise InputError(
                    f"The effect '{name}' has a parameter of the same name as '{other}', which a joint may have, too.",
                    where=_WHERE, got=", ".join(clashing), next_step="Give its parameters names of their own.",
                )  # fmt: skip
    return found


def clashing_names(one: Effect, other: Effect) -> list[str]:
    """Names of parameters that two effects have and that do not mean the same: amplitudes, and shapes that differ."""
    found = set[str]()
    for of in ("revolute", "prismatic"):
        (own, shapes), (theirs, their_shapes) = (
            ({v.name: v for v in e.parameters(of)}, {v.name: v for v in e.shapes(of)}) for e in (one, other)
        )
        found |= own.keys() & (theirs.keys() | their_shapes.keys()) | shapes.keys() & theirs.keys()
        found |= {name for name in shapes.keys() & their_shapes.keys() if shapes[name] != their_shapes[name]}
    return sorted(found)


def torque_effect(name: str) -> TorqueEffect:
    """Like :func:`find_effect`, for effects in the torque balance; raises InputError if it acts elsewhere."""
    found = find_effect(name)
    if not isinstance(found, TorqueEffect):
        valid = [n for n, e in EFFECTS.items() if isinstance(e, TorqueEffect)]
        raise InputError(
            f"The effect '{name}' acts in the place '{found.place}'.", got=name, valid=valid,
            next_step="Take one of these.",
        )  # fmt: skip
    return found


__all__ = [
    "DEFAULT_EFFECTS", "EFFECTS", "LINK_PARAMETERS", "NOMINAL_ACCELERATION", "NOMINAL_SPEED", "PAYLOAD", "UNITS",
    "Column", "ControllerEffect", "Curve", "Effect", "Harmonic", "InsertedEffect", "JointTorque", "JointType",
    "JointUnits", "MeasurementEffect", "Motor", "NonlinearEffect", "OperatingRange", "Parameter", "Place", "PreCheck",
    "Search", "StatedSize", "StructureEffect", "Surroundings", "TorqueEffect", "Values", "VelocityEffect",
    "clashing_names", "effect_catalogue", "effect_name", "find_effect", "start_name", "torque_effect",
]  # fmt: skip
