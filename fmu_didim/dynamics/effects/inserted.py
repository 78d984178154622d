"""Effects between the components of the loop: in the drive of a joint, or in its encoder.

A :class:`InsertedEffect` is a sampled or static system with one input u and one output y that is inserted into the
wiring, so that it also acts on a plant that is known as a black box only:

    y[k] = output(u[k], x[k], p),    x[k+1] = following(u[k], x[k], p),    x[0] = start(u[0], p)

In a drive, u is the torque that the command asks for and y the torque that acts over the same control period; in
a sensor, u is the position of the joint and y what the controller gets. Each joint has its signals in the order

    controller -> effects logged "after" -> torque log -> effects logged "before" -> plant -> sensor -> controller

A :class:`VelocityEffect` of a drive has a second input, which the plant feeds: the velocity of its joint at the same
instant, or its position, of which it takes the difference over a control period. What the plant gives is the motion
itself, before any error of the encoder:

    plant (dq, or q) ------------+
                                 v
    controller -> ... -> u -> effect -> y -> ... -> plant
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from functools import cached_property
from typing import ClassVar, Literal

import casadi as ca

from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.block import Block
from fmu_didim.dynamics.effects.base import NonlinearEffect, Place
from fmu_didim.dynamics.effects.joint import UNITS, JointType, Values

SAME_DEPTH = 100
"""[operations] To which two equations are compared."""
NO_LIMIT = 1e9
"""A torque, N.m or N, or a speed, that no drive reaches."""
VELOCITY_UNITS = frozenset(units.velocity for units in UNITS.values())


class InsertedEffect(NonlinearEffect):
    """One effect of a drive or a sensor; its neutral values give y = u.

    Class attributes:
        place: ``drive`` unless stated otherwise.
        logged: of an effect in a drive: whether the torque log shows the signal before it (usual: the command), or
            after it (it changes the command itself).
        rank: place in the drive; effects of lower rank come earlier. Those logged after have negative ranks.
    """

    place: ClassVar[Place] = "drive"
    logged: ClassVar[Literal["before", "after"]] = "before"
    rank: ClassVar[int] = 0

    @abstractmethod
    def output(self, u: ca.SX, x: ca.SX, values: Values, step: float) -> ca.SX:
        """y of one control period.

        Args:
            u: (nu,) inputs; x: (nx,) states; values: parameters and shapes by name; step: control period, s.
        """

    def inputs(self, joint_type: JointType) -> tuple[Variable, ...]:
        """Its nu inputs: the signal before it, and what else it takes from the plant by the plain name (``dq``)."""
        return (Variable("u", self.signal_unit(joint_type), "input", 0.0, "signal before"),)

    def fed_by(self, outputs: Mapping[str, str], joint: int) -> InsertedEffect | None:
        """The effect with the inputs that a plant has for it; None where the plant lacks what it needs.

        Args:
            outputs: name -> unit of the outputs of the plant; joint: counted from 1.
        """
        return self

    def state_count(self) -> int:
        """Number nx of its sampled states; 0: it has no memory."""
        return 0

    def state_unit(self, joint_type: JointType) -> str:
        """Unit of its states: that of the signal unless stated otherwise."""
        return self.signal_unit(joint_type)

    def following(self, u: ca.SX, x: ca.SX, values: Values, step: float) -> ca.SX:
        """x[k+1], (nx,)."""
        return x

    def start(self, u: ca.SX, values: Values) -> ca.SX:
        """x[0], (nx,): as after an input that has always been u."""
        return ca.repmat(u, self.state_count(), 1)

    def depends_on_period(self, joint_type: JointType) -> bool:
        """Whether its equations hold for control periods of one length, as those of a lag that is sampled do."""
        variables = (*self.parameters(joint_type), *self.shapes(joint_type))
        u = ca.SX.sym("u", len(self.inputs(joint_type)))
        x, p = ca.SX.sym("x", self.state_count()), ca.SX.sym("p", len(variables))
        values = {v.name: p[i] for i, v in enumerate(variables)}
        one, other = (
            ca.vertcat(ca.SX(self.output(u, x, values, h)), self.following(u, x, values, h)) for h in (1.0, 2.0)
        )
        return not all(ca.is_equal(one[i], other[i], SAME_DEPTH) for i in range(one.numel()))

    def signal_unit(self, joint_type: JointType) -> str:
        """Unit of u and y."""
        return UNITS[joint_type].torque if self.place == "drive" else UNITS[joint_type].position

    def block(self, joint_type: JointType, step: float) -> Block:
        """The effect as a block with its inputs, the output ``y`` and its parameters by their plain names, all neutral.

        The same for every joint of a type and for every value of the parameters, so that it is compiled once; it
        has a sample time only if it has memory.

        Args:
            joint_type: type of its joint; step: control period, s.
        """
        variables = (*self.parameters(joint_type), *self.shapes(joint_type))
        count, unit, inputs = self.state_count(), self.signal_unit(joint_type), self.inputs(joint_type)
        u, x, p = ca.SX.sym("u", len(inputs)), ca.SX.sym("x", count), ca.SX.sym("p", len(variables))
        values = {v.name: p[i] for i, v in enumerate(variables)}
        update = self.following(u, x, values, step) if count else ca.SX(0, 1)
        start = self.start(u, values) if count else ca.SX(0, 1)
        return Block(
            name=self.name,
            description=f"{self.title}: {self.equation}",
            inputs=inputs,
            outputs=(Variable("y", unit, "output", 0.0, "signal after"),),
            states=tuple(Variable(f"x{i + 1}", self.state_unit(joint_type), "local") for i in range(count)),
            parameters=tuple(
                Variable(v.name, v.unit, "parameter", self.neutral.get(v.name, v.start), v.description)
                for v in variables
            ),
            update=ca.Function("update", [x, u, p], [ca.densify(update)]),
            output=ca.Function("output", [x, u, p], [ca.densify(self.output(u, x, values, step))]),
            start=ca.Function("start", [u, p], [ca.densify(start)]),
            sample_time=step if count else None,
        )


class VelocityEffect(InsertedEffect):
    """One effect of a drive that has no memory of its own and depends on the velocity of its joint:

        y[k] = changed(u[k], dq[k], p)

    dq[k] is the velocity that the plant gives at the instant of the command; of a plant that gives positions only it is
    their difference, dq[k] = (q[k] - q[k-1]) / h with dq[0] = 0, which is that of half a period before and asks for
    control periods of one length.

    Args:
        differs: whether it takes the difference of positions.
    """

    def __init__(self, *, differs: bool = False) -> None:
        self.differs = differs

    @abstractmethod
    def changed(self, u: ca.SX, dq: ca.SX, values: Values) -> ca.SX:
        """y of one control period from the command u and the velocity dq of the joint."""

    @cached_property
    def _of_positions(self) -> VelocityEffect:
        """The same effect, fed with positions: one object, so that it is compiled once."""
        return type(self)(differs=True)

    def fed_by(self, outputs: Mapping[str, str], joint: int) -> VelocityEffect | None:
        if f"dq{joint}" in outputs:
            return self
        position = outputs.get(f"q{joint}")
        return None if position is None or position in VELOCITY_UNITS else self._of_positions

    def inputs(self, joint_type: JointType) -> tuple[Variable, ...]:
        units = UNITS[joint_type]
        own = (
            Variable("q", units.position, "input", 0.0, "position of the joint")
            if self.differs
            else Variable("dq", units.velocity, "input", 0.0, "velocity of the joint")
        )
        return (*super().inputs(joint_type), own)

    def state_count(self) -> int:
        return int(self.differs)

    def state_unit(self, joint_type: JointType) -> str:
        return UNITS[joint_type].position

    def following(self, u: ca.SX, x: ca.SX, values: Values, step: float) -> ca.SX:
        return u[1] if self.differs else x

    def start(self, u: ca.SX, values: Values) -> ca.SX:
        return u[1] if self.differs else ca.SX(0, 1)

    def output(self, u: ca.SX, x: ca.SX, values: Values, step: float) -> ca.SX:
        return self.changed(u[0], (u[1] - x[0]) / step if self.differs else u[1], values)
