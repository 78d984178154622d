"""Effects of the torque balance of a black-box plant, as a component before its input.

A plant of which only an FMU is known cannot get a term in its equations. Where an effect depends on the motion of its
own joint and on time alone, the same is reached from outside:

    y = u - tau_e(q, dq, t, z; parameters),    dz/dt = rates(q, dq, t, z)

with the command u and the outputs q and dq of the plant; without a position output, q is the integral of the velocity.
The torque is held over a communication step, so that steep friction needs shorter steps than the control period: the
tick of such a loop is a part of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import casadi as ca
import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.components.inserted import inserted_component
from fmu_didim.cosim import Connection, System
from fmu_didim.data.signals import Array, Variable
from fmu_didim.dynamics.block import Block
from fmu_didim.dynamics.effects import (
    NOMINAL_ACCELERATION,
    NOMINAL_SPEED,
    PAYLOAD,
    UNITS,
    JointType,
    OperatingRange,
    Search,
    Surroundings,
    TorqueEffect,
)
from fmu_didim.dynamics.effects.inserted import InsertedEffect
from fmu_didim.dynamics.effects.joint import JointUnits
from fmu_didim.dynamics.robot.rate import EXPLICIT
from fmu_didim.model.loop_model import LoopModel

SUBDIVISIONS = (4, 16)
"""[ticks] In a control period that are tried: with one, the torque comes half a period late."""
SETTLED = 1e-3
"""[1] RMS change of the torque of a joint, as a fraction of its RMS, below which four times shorter steps are not
needed: little beside the noise of any drive."""

START_TIME, START_POSITION = "t_start", "q_start"


class TorquePart(InsertedEffect):
    """A torque effect as a component with inputs ``u``, ``q``, ``dq`` and output ``y``; nearest to the plant.

    Args:
        effect: one that :func:`acts_on_own_joint`.
        integrates: whether it has no input ``q`` and takes the integral of ``dq`` for it.
    """

    place = "drive"
    rank = 1000

    def __init__(self, effect: TorqueEffect, *, integrates: bool = False) -> None:
        self.effect, self.integrates = effect, integrates
        for name in ("name", "title", "equation", "class_name", "confounded_with", "signature", "experiment", "source"):
            setattr(self, name, getattr(effect, name))
        setattr(self, "neutral", {v.name: 0.0 for v in effect.parameters("revolute")})  # noqa: B010 - a class variable

    def parameters(self, joint_type: JointType) -> tuple[Variable, ...]:
        return self.effect.parameters(joint_type)

    def shapes(self, joint_type: JointType) -> tuple[Variable, ...]:
        return self.effect.shapes(joint_type)

    def search(self, joint_type: JointType) -> Mapping[str, Search]:
        return self.effect.search(joint_type)

    def output(self, u: ca.SX, x: ca.SX, values: Mapping[str, ca.SX], step: float) -> ca.SX:
        raise NotImplementedError("the torque depends on q and dq as well; see block")

    def block(self, joint_type: JointType, step: float) -> Block:
        """The component's equations; continuous where the effect has states or looks at the time."""
        effect, units = self.effect, UNITS[joint_type]
        amplitudes, shapes = effect.parameters(joint_type), effect.shapes(joint_type)
        states = effect.states(joint_type)
        has_time = "time" in effect.needs
        own_motion = ("position", "clock") if has_time else ("position",)
        added = [name for name in own_motion if name == "clock" or self.integrates]
        signals = ("u", "dq") if self.integrates else ("u", "q", "dq")
        inputs = dict(zip(signals, ca.vertsplit(u := ca.SX.sym("u", len(signals))), strict=True))
        z = ca.SX.sym("z", len(states) + len(added))
        p = ca.SX.sym("p", len(amplitudes + shapes))
        begin = ca.SX.sym("begin", len(added))
        further = {name: z[len(states) + i] for i, name in enumerate(added)}
        parameters = ca.vertcat(p, begin)
        values = {v.name: p[i] for i, v in enumerate((*amplitudes, *shapes))}
        at = Surroundings(
            joint=0, joint_type=joint_type, all_q=further.get("position", inputs.get("q")), all_dq=inputs["dq"],
            all_ddq=ca.SX(0), time=further.get("clock", ca.SX(0)), state=tuple(z[i] for i in range(len(states))),
        )  # fmt: skip
        own = {v.name: values[v.name] for v in shapes}
        torque = ca.SX(0)
        for v, column in zip(amplitudes, effect.columns(at, own), strict=True):
            torque += values[v.name] * (column[0] if isinstance(column, Mapping) else column)
        slopes = {"position": inputs["dq"], "clock": ca.SX(1)}
        rates = [*effect.rates(at, own), *(slopes[name] for name in added)]
        first = [*(ca.SX(v.start) for v in states), *(ca.vertsplit(begin) if added else ())]
        within = OperatingRange(NOMINAL_SPEED[joint_type], NOMINAL_ACCELERATION[joint_type], ca.SX(0))
        settled = EXPLICIT.relaxing * effect.relaxation(own, within)
        rate = ca.fmax(effect.own_rate(own, within), settled) if states else ca.SX(0)
        return Block(
            name=effect.name,
            description=f"{effect.title}: u - ({effect.equation})",
            inputs=tuple(_INPUTS[name](units) for name in signals),
            outputs=(Variable("y", units.torque, "output", 0.0, "torque that is left for the plant"),),
            states=(*states, *(Variable(name, _begin(name, units).unit, "local") for name in added)),
            parameters=(
                *(replace(v, causality="parameter", start=0.0) for v in amplitudes),
                *(replace(v, causality="parameter") for v in shapes),
                *(_begin(name, units) for name in added),
            ),
            update=ca.Function("update", [z, u, parameters], [_column(rates)]),
            output=ca.Function("output", [z, u, parameters], [ca.densify(inputs["u"] - torque)]),
            start=ca.Function("start", [u, parameters], [_column(first)]),
            rate_bound=ca.Function("rate", [z, parameters], [ca.densify(rate)]),
        )


def _column(values: Sequence[ca.SX]) -> ca.SX:
    return ca.densify(ca.vertcat(*values)) if values else ca.SX(0, 1)


_INPUTS: Mapping[str, Callable[[JointUnits], Variable]] = {
    "u": lambda units: Variable("u", units.torque, "input", 0.0, "torque of the drive"),
    "q": lambda units: Variable("q", units.position, "input", 0.0, "position of the joint"),
    "dq": lambda units: Variable("dq", units.velocity, "input", 0.0, "velocity of the joint"),
}


def _begin(state: str, units: JointUnits) -> Variable:
    """The parameter with which the position or the clock starts."""
    if state == "clock":
        return Variable(START_TIME, "s", "parameter", 0.0, "time at the start")
    return Variable(START_POSITION, units.position, "parameter", 0.0, "position at the start")


@lru_cache(maxsize=128)
def torque_part(effect: TorqueEffect, *, integrates: bool = False) -> TorquePart:
    """The component of an effect, one for all joints."""
    return TorquePart(effect, integrates=integrates)


@lru_cache(maxsize=256)
def acts_on_own_joint(effect: TorqueEffect, joint_type: JointType) -> bool:
    """Whether an effect depends on position, velocity and states of its own joint and on time alone."""
    if effect.reach or effect.needs - {"time"} or effect.given_states:
        return False
    ddq, load, link = ca.SX.sym("ddq"), ca.SX.sym("load"), ca.SX.sym("link", len(PAYLOAD))
    z = ca.SX.sym("z", len(effect.states(joint_type)))
    at = Surroundings(
        joint=0, joint_type=joint_type, all_q=ca.SX.sym("q"), all_dq=ca.SX.sym("dq"), all_ddq=ddq, load=load,
        time=ca.SX.sym("t"), state=tuple(z[i] for i in range(z.numel())),
        link={name: link[i] for i, name in enumerate(PAYLOAD)},
    )  # fmt: skip
    shapes = {v.name: ca.SX.sym(v.name) for v in effect.shapes(joint_type)}
    columns = effect.columns(at, shapes)
    if any(isinstance(c, Mapping) and set(c) != {0} for c in columns):
        return False
    full = ca.vertcat(*(c[0] if isinstance(c, Mapping) else c for c in columns))
    return not ca.depends_on(full, ca.vertcat(ddq, load, link))


def insert_part(
    system: System, part: TorquePart, joint: int, joint_type: JointType, *, starts: Mapping[str, float], plant: str
) -> System:
    """The system with the component of an effect right before the plant, named ``<effect><joint>``.

    Args:
        starts: time and position of the joint at the start, by the names of the parameters for them.
    """
    name, at = f"{part.name}{joint}", f"{plant}.tau{joint}"
    component = inserted_component(part, joint_type, system.step_size)
    offered = {v.name for v in component.parameters}
    component = component.with_parameters({key: value for key, value in starts.items() if key in offered})
    place = system.order.index(plant)
    own = (
        *(replace(c, target=f"{name}.u") if c.target == at else c for c in system.connections),
        Connection(f"{name}.y", at),
        *(Connection(f"{plant}.{v.name}{joint}", f"{name}.{v.name}") for v in component.inputs if v.name != "u"),
    )
    return replace(
        system,
        components={**system.components, name: component},
        connections=own,
        order=(*system.order[:place], name, *system.order[place:]),
    )


def subdivision(model: LoopModel) -> int:
    """Ticks in a control period that a loop with such components needs: shorter ones change the torque no more."""
    chosen, before = SUBDIVISIONS[-1], None
    for count in SUBDIVISIONS:
        try:
            torque = model.with_loop(subdivision=count).torque(model.start)
        except SimulationError:
            before = None
            continue
        if before is not None and (_rms(torque - before) <= SETTLED * _rms(torque)).all():
            return chosen
        chosen, before = count, torque
    return chosen


def _rms(values: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))
