"""Computed torque control: the inverse dynamic model in the control law."""

from __future__ import annotations

from pathlib import Path

import casadi as ca

from fmu_didim.base.errors import InputError
from fmu_didim.controllers.base import ControlEquations, ControlLaw, VelocityKind
from fmu_didim.dynamics.effects import UNITS
from fmu_didim.dynamics.robot import RobotModel, read_robot


class ComputedTorque(ControlLaw):
    """command = inverse(q, dq, ddq_ref + Kd (dq_ref - dq) + Kp (q_ref - q)).

    Attributes:
        robot: robot description whose values the controller believes; they become the tunable
            parameters ``model_<name>``.
        Kp: gains of each joint, 1/s^2.
        Kd: gains of each joint, 1/s.
        velocity: ``measured`` (an input) or ``backward_difference`` of q.
    """

    robot: str
    Kp: tuple[float, ...]
    Kd: tuple[float, ...]
    velocity: VelocityKind = "measured"

    def commands(self, equations: ControlEquations, *, folder: Path) -> list[ca.SX]:
        model = RobotModel(read_robot(folder / self.robot))
        types = tuple(joint.type for joint in model.description.joints)
        if types != self.joints:
            raise InputError(
                "The robot of the controller has other joints than the controller.",
                where=f"controller '{self.name}', robot {self.robot}", got=", ".join(types),
                valid=", ".join(self.joints), next_step="Give the controller the joints of its robot, in their order.",
            )  # fmt: skip
        if model.extra:
            raise InputError(
                "A controller cannot know the states of friction or the time of the plant.",
                where=f"controller '{self.name}', robot {self.robot}",
                got=", ".join(v.name for v in model.extra),
                next_step="Give the controller a description without these effects.",
            )
        q, dq, wanted = [], [], []
        for j in range(1, len(self.joints) + 1):
            signals = self.error_signals(equations, j)
            ddq_ref = equations.input(f"ddq_ref{j}", UNITS[self.joints[j - 1]].acceleration)
            velocity = self.velocity_signal(equations, j, self.velocity)
            kp = equations.parameter(f"Kp{j}", self.Kp[j - 1], "proportional gain")
            kd = equations.parameter(f"Kd{j}", self.Kd[j - 1], "derivative gain")
            q.append(signals["q"])
            dq.append(velocity)
            wanted.append(ddq_ref + kd * (signals["dq_ref"] - velocity) + kp * (signals["q_ref"] - signals["q"]))
        chi = ca.SX.zeros(len(model.parameters))
        for i in model.active:
            variable = model.parameters[i]
            chi[i] = equations.parameter(f"model_{variable.name}", variable.start, variable.description)
        shapes = ca.DM(model.shape_values)
        torque = model.inverse(ca.vertcat(*q), ca.vertcat(*dq), ca.vertcat(*wanted), chi, shapes)
        return [torque[j] for j in range(len(self.joints))]
