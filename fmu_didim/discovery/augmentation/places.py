"""Where an effect acts in a loop, decided once, with its free parameters and its change of the loop.

    torque balance, structure    the equations of the plant, which is built anew
    controller                   factors of parameters that a controller has
    drive, sensor                a component in the wiring
    measurement                  the log; the loop stays as it is

The equations of a black-box plant cannot be changed. There an effect of the torque balance is a parameter of the plant,
or a component right before the plant, or it cannot be added.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from fmu_didim.cosim import System, insert_effect
from fmu_didim.data.signals import Variable
from fmu_didim.discovery.augmentation.black_box import (
    START_POSITION,
    START_TIME,
    TorquePart,
    acts_on_own_joint,
    insert_part,
    torque_part,
)
from fmu_didim.discovery.augmentation.ranges import Range, travelled
from fmu_didim.dynamics.effects import (
    ControllerEffect,
    Effect,
    Harmonic,
    InsertedEffect,
    JointType,
    Place,
    Search,
    TorqueEffect,
    start_name,
)
from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.model.free_parameter import LOG, PLANT, FreeParameter, joint_parameter
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from fmu_didim.model.motion import joint_reference

SMALLEST_SCALE = 1e-3
"""[SI] Noticeable change of a parameter that is proposed as zero."""
BEYOND_GRID = 3.0
"""[1] By which factor a fit may take a shape beyond its logarithmic grid,"""
BEYOND_RANGE = 0.5
"""[1] and by which fraction of its range beyond another one,"""
BELOW_RANGE = 0.8
"""[1] or down to which fraction of its lowest value where it has one sign, and as far above one that is known."""


@dataclass(frozen=True)
class Proposal:
    """An effect with the values from which it is fitted.

    Attributes:
        effect_at: effect and joint.
        values: start value of each of its free parameters, by the plain name (``Fs``, ``vs``).
        scales: size of a noticeable change of them; the value itself where absent.
    """

    effect_at: EffectAtJoint
    values: Mapping[str, float]
    scales: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class BaseLoop:
    """The loop to which effects are added.

    Attributes:
        model: without them; description: the robot, None for a black-box plant.
    """

    model: LoopModel
    description: RobotDescription | None

    @cached_property
    def ranges(self) -> tuple[Range, ...]:
        """(n,) where the reference of each joint goes."""
        return tuple(travelled(self.model, j) for j in range(1, self.model.joint_count + 1))

    @cached_property
    def plant_parameters(self) -> frozenset[str]:
        """Names of all parameters of the plant."""
        return frozenset(v.name for v in self.model.loop.plant.parameters)

    def joint_type(self, joint: int) -> JointType:
        """Type of a joint, counted from 1."""
        if self.description is not None:
            return self.description.joints[joint - 1].type
        unit = self.model.parameters.torque_units[joint - 1]
        return "prismatic" if unit == "N" else "revolute"


@dataclass(frozen=True)
class LoopEffect(ABC):
    """An effect at a joint of a loop, in the place where it acts.

    Class attributes:
        changes_equations: whether the plant is built anew with it.
        needs_short_steps: whether the loop must run at more than one tick in a control period.
    """

    effect_at: EffectAtJoint
    effect: Effect
    loop: BaseLoop

    changes_equations: ClassVar[bool] = False
    needs_short_steps: ClassVar[bool] = False

    @property
    @abstractmethod
    def owner(self) -> str:
        """The part of the loop that has its parameters; see :class:`~fmu_didim.model.free_parameter.FreeParameter`."""

    @property
    def can_be_added(self) -> bool:
        """Whether this loop can get it."""
        return True

    @property
    def is_present(self) -> bool:
        """Whether the base model has it; of a black box: whether its parameters are identified already."""
        robot, joint = self.loop.description, self.effect_at.joint
        if robot is not None:
            return self.effect_at.effect in robot.joints[joint - 1].effects
        names = amplitude_names(self.effect, joint, self.joint_type)
        return bool(names) and names <= set(self.loop.model.parameters.plant_names)

    @property
    def joint_type(self) -> JointType:
        """Type of its joint."""
        return self.loop.joint_type(self.effect_at.joint)

    @cached_property
    def search(self) -> Mapping[str, Search]:
        """The searched parameters, with grids adapted to the range of the reference, and the harmonics of the motor."""
        kind = self.joint_type
        units = {v.name: v.unit for v in (*self.effect.parameters(kind), *self.effect.shapes(kind))}
        within = self.loop.ranges[self.effect_at.joint - 1]
        found = {name: within.adapted(s, units[name]) for name, s in self.effect.search(kind).items()}
        tried = {name: tuple(h.frequency for h in own if self.shows(name, h)) for name, own in self.harmonics.items()}
        return {name: replace(s, known=tried.get(name, ())) for name, s in found.items()}

    @cached_property
    def harmonics(self) -> Mapping[str, tuple[Harmonic, ...]]:
        """Shape -> the spatial frequencies that the motor of the joint has by the description; nothing where it states
        none, or where the joint shares its motors."""
        robot, joint = self.loop.description, self.effect_at.joint - 1
        motor = None if robot is None or joint in robot.coupled_joints() else robot.joints[joint].motor
        return {} if motor is None else self.effect.harmonics(motor)

    def shows(self, shape: str, harmonic: Harmonic) -> bool:
        """Whether the data can show a harmonic: no slower than what the grid begins with, which looks like gravity, nor
        too fast for the control period."""
        slowest = self.effect.search(self.joint_type)[shape].lowest
        return harmonic.frequency >= slowest and self.loop.ranges[self.effect_at.joint - 1].shows(harmonic.frequency)

    @property
    def can_stand_idle(self) -> bool:
        """Whether a plant that has it, with its parameters as they stand, is the plant without it: amplitudes of zero,
        no states, and nothing that sets the steps of the integration."""
        return False

    @property
    def amplitudes(self) -> tuple[Variable, ...]:
        """Its amplitudes, by their plain names."""
        found = self.effect.parameters(self.joint_type)
        return found if self.effect.is_linear else tuple(v for v in found if v.name in self.search)

    @property
    def shapes(self) -> tuple[Variable, ...]:
        """Its searched shapes, by their plain names."""
        return tuple(v for v in self.effect.shapes(self.joint_type) if v.name in self.search)

    @cached_property
    def cost(self) -> float:
        """Parameters that it counts as when models are compared."""
        return parameter_cost([v.name for v in self.amplitudes], self.search)

    def cost_with(self, shapes: Mapping[str, float], deviations: Mapping[str, float] = MappingProxyType({})) -> float:
        """The same with these values of its shapes: a harmonic of the motor counts as less than any other frequency.

        Args:
            deviations: standard deviations of values that were fitted.
        """
        if not any(s.known for s in self.search.values()):
            return self.cost
        samples = float(self.loop.model.measured.size)
        prices = {n: s.price(shapes[n], samples, deviation=deviations.get(n, 0.0))
                  for n, s in self.search.items() if n in shapes}  # fmt: skip
        return self.cost + sum(price - self.search[name].cost for name, price in prices.items())

    def free_parameters(self, proposal: Proposal, index: int) -> list[FreeParameter]:
        """Its free parameters as effect ``index`` of a model; of a nonlinear effect those with proposed values only."""
        amplitudes = [v for v in self.amplitudes if self.effect.is_linear or v.name in proposal.values]
        return [
            *(self._free(v, proposal, index, is_shape=False) for v in amplitudes),
            *(self._free(v, proposal, index, is_shape=True) for v in self.shapes),
        ]

    def described(self, robot: RobotDescription) -> RobotDescription:
        """A robot description with this effect in the list of its joint."""
        joints = list(robot.joints)
        joint = joints[self.effect_at.joint - 1]
        if self.effect_at.effect in joint.effects:
            return robot
        joints[self.effect_at.joint - 1] = joint.model_copy(update={"effects": (*joint.effects, self.effect_at.effect)})
        return robot.model_copy(update={"joints": tuple(joints)})

    def _free(self, variable: Variable, proposal: Proposal, index: int, *, is_shape: bool) -> FreeParameter:
        name, key = self._name_and_key(variable.name, is_shape)
        value = proposal.values.get(variable.name, variable.start)
        lowest, highest = self._limits(variable.name, is_shape)
        scale = float(abs(proposal.scales.get(variable.name, value)) or SMALLEST_SCALE)
        return FreeParameter(
            name, variable.unit, self.owner, key, float(value), scale, float(lowest), float(highest), effect=index,
            is_shape=is_shape,
        )  # fmt: skip

    def _name_and_key(self, name: str, is_shape: bool) -> tuple[str, str]:
        """Name shown to the user, and name in the owner, of a parameter."""
        numbered = joint_parameter(name, self.effect_at.joint, is_shape=is_shape or not self.effect.is_linear)
        return numbered, numbered

    def _limits(self, name: str, is_shape: bool) -> tuple[float, float]:
        if not self.effect.is_linear:
            return self.effect.limits.get(name, (-np.inf, np.inf))
        return shape_limits(self.search[name], name in self.effect.signed) if is_shape else (-np.inf, np.inf)


class InEquations(LoopEffect):
    """A term in the torque balance of the plant, or another structure of it."""

    owner = PLANT
    changes_equations = True

    @property
    def can_be_added(self) -> bool:
        return self.loop.description is not None and all(
            start_name(state, self.effect_at.joint) in experiment.measured_starts
            for state in self.effect.given_states
            for experiment in self.loop.model.experiments.values()
        )

    @property
    def can_stand_idle(self) -> bool:
        effect, kind = self.effect, self.joint_type
        if not isinstance(effect, TorqueEffect) or effect.is_form or effect.sets_rate:
            return False
        if effect.states(kind) or "time" in effect.needs:  # time is a state
            return False
        return all(v.start == 0 for v in effect.parameters(kind))


class InBlackBox(LoopEffect):
    """A term that a black-box plant has already, with parameters of the same names, none of which is identified."""

    owner = PLANT

    @cached_property
    def search(self) -> Mapping[str, Search]:
        """The grids of the shapes that are parameters of the plant."""
        joint, offered = self.effect_at.joint, self.loop.plant_parameters
        return {n: s for n, s in super().search.items() if joint_parameter(n, joint, is_shape=True) in offered}


class InLog(LoopEffect):
    """A change of the torque log as a whole; the loop stays as it is."""

    owner = LOG

    def described(self, robot: RobotDescription) -> RobotDescription:
        return robot

    def _name_and_key(self, name: str, is_shape: bool) -> tuple[str, str]:
        return name, name


class InController(LoopEffect):
    """Factors of gains of the controller of a joint, whichever component has them; they are no part of the robot."""

    @property
    def owner(self) -> str:
        """What stands in the place of a component: the factors of this joint."""
        return f"{self.effect.name}{self.effect_at.joint}"

    @property
    def can_be_added(self) -> bool:
        """One factor alone would be that of the whole command, which needs no look into the controller."""
        return len(self.gains) > 1

    @cached_property
    def gains(self) -> Mapping[str, tuple[str, str]]:
        """Each factor with the component and the parameter that it multiplies: not one that is zero in all experiments,
        nor one that the case frees itself."""
        assert isinstance(self.effect, ControllerEffect)
        loop, found = self.loop.model.loop, dict[str, tuple[str, str]]()
        free = {(p.owner, p.key) for p in self.loop.model.free_parameters}
        for name, component in loop.beside_the_plant.items():
            for factor, gain in self.effect.gains(component.parameters, self.effect_at.joint).items():
                values = [system.components[name].parameter_values()[gain] for system in loop.systems.values()]
                if factor not in found and any(values) and (name, gain) not in free:
                    found[factor] = (name, gain)
        return found

    @property
    def amplitudes(self) -> tuple[Variable, ...]:
        return tuple(v for v in super().amplitudes if v.name in self.gains)

    @cached_property
    def search(self) -> Mapping[str, Search]:
        return {name: search for name, search in super().search.items() if name in self.gains}

    def described(self, robot: RobotDescription) -> RobotDescription:
        return robot

    def _name_and_key(self, name: str, is_shape: bool) -> tuple[str, str]:
        return super()._name_and_key(name, is_shape)[0], name


class InWiring(LoopEffect):
    """A component between the others: in the drive of a joint or in its encoder."""

    @property
    def owner(self) -> str:
        """The name of the component."""
        return f"{self.effect.name}{self.effect_at.joint}"

    @property
    def can_be_added(self) -> bool:
        """An effect of an encoder shows where the controller gets the position of the plant; one of a drive may need a
        velocity that the plant gives."""
        position, model = f"{self.loop.model.loop.plant_name}.q{self.effect_at.joint}", self.loop.model
        if self._fed is None:
            return False
        return (self._knows_period and self.effect.place != "sensor") or any(
            c.source == position for c in model.loop.systems[model.first].connections
        )

    @property
    def _knows_period(self) -> bool:
        """Whether it can be computed: where the control period changes, not if that counts in its equations."""
        changes = any(system.at_instants for system in self.loop.model.loop.systems.values())
        return not (changes and self.part.depends_on_period(self.joint_type))

    @property
    def _fed(self) -> InsertedEffect | None:
        """The effect with the inputs that the plant has for it; None where it lacks what the effect needs."""
        assert isinstance(self.effect, InsertedEffect)
        given = {v.name: v.unit for v in self.loop.model.loop.plant.outputs}
        return self.effect.fed_by(given, self.effect_at.joint)

    @property
    def part(self) -> InsertedEffect:
        """The effect as a component."""
        assert self._fed is not None
        return self._fed

    def _limits(self, name: str, is_shape: bool) -> tuple[float, float]:
        """A limit of the torque that falls less with the speed than data could tell is a constant one."""
        low, high = super()._limits(name, is_shape)
        check = self.effect.pre_check
        if check is not None and name == check.speed:
            high = min(high, check.flattest * self.loop.ranges[self.effect_at.joint - 1].speed)
        return low, high

    def wired(self, system: System, label: str) -> System:
        """The loop of an experiment with its component."""
        joint, plant = self.effect_at.joint, self.loop.model.loop.plant_name
        return insert_effect(system, self.part, joint, self.joint_type, plant=plant)

    def _name_and_key(self, name: str, is_shape: bool) -> tuple[str, str]:
        return super()._name_and_key(name, is_shape)[0], name


class BeforePlant(InWiring):
    """A torque of a black-box plant, as a component right before the plant."""

    needs_short_steps = True

    @property
    def can_be_added(self) -> bool:
        return self._knows_period

    @property
    def part(self) -> TorquePart:
        """The effect as a component, which integrates the velocity where the plant gives no position."""
        assert isinstance(self.effect, TorqueEffect)
        given = {v.name for v in self.loop.model.loop.plant.outputs}
        return torque_part(self.effect, integrates=f"q{self.effect_at.joint}" not in given)

    def wired(self, system: System, label: str) -> System:
        joint, model = self.effect_at.joint, self.loop.model
        reference = model.experiments[label].reference
        position, _ = joint_reference(reference, joint)
        starts = {START_TIME: float(reference.time[0]), START_POSITION: float(position[0])}
        return insert_part(system, self.part, joint, self.joint_type, starts=starts, plant=model.loop.plant_name)


PLACES: Mapping[Place, type[LoopEffect]] = {
    "torque balance": InEquations,
    "structure": InEquations,
    "controller": InController,
    "drive": InWiring,
    "sensor": InWiring,
    "measurement": InLog,
}


def placed(effect_at: EffectAtJoint, effect: Effect, loop: BaseLoop) -> LoopEffect:
    """An effect in the place where it acts in a loop."""
    kind = PLACES[effect.place]
    if loop.description is None and isinstance(effect, TorqueEffect):
        joint, joint_type = effect_at.joint, loop.joint_type(effect_at.joint)
        names = amplitude_names(effect, joint, joint_type)
        if names and names <= loop.plant_parameters - set(loop.model.parameters.plant_names):
            kind = InBlackBox
        elif f"dq{joint}" in {v.name for v in loop.model.loop.plant.outputs} and acts_on_own_joint(effect, joint_type):
            kind = BeforePlant
    return kind(effect_at, effect, loop)


def amplitude_names(effect: Effect, joint: int, joint_type: JointType) -> set[str]:
    """Names of the amplitudes of a torque effect in a plant, such as ``Fc1``; nothing for other effects."""
    if not isinstance(effect, TorqueEffect):
        return set()
    return {joint_parameter(v.name, joint, is_shape=False) for v in effect.parameters(joint_type)}


def parameter_cost(amplitudes: Sequence[str], search: Mapping[str, Search]) -> float:
    """Parameters that amplitudes and searched shapes count as when models are compared."""
    return sum(1.0 for name in amplitudes if name not in search) + sum(s.cost for s in search.values())


def shape_limits(search: Search, signed: bool) -> tuple[float, float]:
    """How far a fit may take a shape beyond the grid on which it was found."""
    if search.logarithmic and not signed:
        return search.lowest / BEYOND_GRID, search.highest * BEYOND_GRID
    room = BEYOND_RANGE * (search.highest - search.lowest)
    highest = max(search.highest + room, max(search.known, default=0.0) / BELOW_RANGE)
    return (search.lowest - room if signed else BELOW_RANGE * search.lowest), highest
