"""Effects between the components of the loop: in the drive of a joint, or in its encoder.

A :class:`InsertedEffect` is a sampled or static system with one input u and one output y that is inserted into the
wiring, so that it also acts on a plant that is known as a black box only:

    y[k] = output(u[k], x[k], p),    x[k+1] = following(u[k], x[k], p),    x[0] = start(u[0], p)

In a drive, u is the torque that the command asks for and y the torque that acts over the same control period; in
a sensor, u is the position of the joint and y what the controller gets. Each joint has its signals in the order

    controller -> effects logged "after" -> torque log -> effects logged "before" -> plant -> sensor -> controller
"""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Literal

import casadi as ca

from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.block import Block
from fmu_didim.dynamics.effects.base import NonlinearEffect, Place
from fmu_didim.dynamics.effects.joint import UNITS, JointType, Values

SAME_DEPTH = 100
"""[operations] To which two equations are compared."""
NO_LIMIT = 1e9
"""A torque, N.m or N, that no drive reaches."""


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
            u: input; x: (nx,) states; values: parameters and shapes by name; step: control period, s.
        """

    def state_count(self) -> int:
        """Number nx of its sampled states; 0: it has no memory."""
        return 0

    def following(self, u: ca.SX, x: ca.SX, values: Values, step: float) -> ca.SX:
        """x[k+1], (nx,)."""
        return x

    def start(self, u: ca.SX, values: Values) -> ca.SX:
        """x[0], (nx,): as after an input that has always been u."""
        return ca.repmat(u, self.state_count(), 1)

    def depends_on_period(self, joint_type: JointType) -> bool:
        """Whether its equations hold for control periods of one length, as those of a lag that is sampled do."""
        variables = (*self.parameters(joint_type), *self.shapes(joint_type))
        u, x, p = ca.SX.sym("u"), ca.SX.sym("x", self.state_count()), ca.SX.sym("p", len(variables))
        values = {v.name: p[i] for i, v in enumerate(variables)}
        one, other = (
            ca.vertcat(ca.SX(self.output(u, x, values, h)), self.following(u, x, values, h)) for h in (1.0, 2.0)
        )
        return not all(ca.is_equal(one[i], other[i], SAME_DEPTH) for i in range(one.numel()))

    def signal_unit(self, joint_type: JointType) -> str:
        """Unit of u and y."""
        return UNITS[joint_type].torque if self.place == "drive" else UNITS[joint_type].position

    def block(self, joint_type: JointType, step: float) -> Block:
        """The effect as a block with input ``u``, output ``y`` and its parameters by their plain names, all neutral.

        The same for every joint of a type and for every value of the parameters, so that it is compiled once; it
        has a sample time only if it has memory.

        Args:
            joint_type: type of its joint; step: control period, s.
        """
        variables = (*self.parameters(joint_type), *self.shapes(joint_type))
        count, unit = self.state_count(), self.signal_unit(joint_type)
        u, x, p = ca.SX.sym("u"), ca.SX.sym("x", count), ca.SX.sym("p", len(variables))
        values = {v.name: p[i] for i, v in enumerate(variables)}
        update = self.following(u, x, values, step) if count else ca.SX(0, 1)
        start = self.start(u, values) if count else ca.SX(0, 1)
        return Block(
            name=self.name,
            description=f"{self.title}: {self.equation}",
            inputs=(Variable("u", unit, "input", 0.0, "signal before"),),
            outputs=(Variable("y", unit, "output", 0.0, "signal after"),),
            states=tuple(Variable(f"x{i + 1}", unit, "local") for i in range(count)),
            parameters=tuple(
                Variable(v.name, v.unit, "parameter", self.neutral.get(v.name, v.start), v.description)
                for v in variables
            ),
            update=ca.Function("update", [x, u, p], [ca.densify(update)]),
            output=ca.Function("output", [x, u, p], [ca.densify(self.output(u, x, values, step))]),
            start=ca.Function("start", [u, p], [ca.densify(start)]),
            sample_time=step if count else None,
        )
