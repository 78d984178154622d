"""The closed loop of the TX40 as one writes it in Python with Pinocchio: articulated-body algorithm, RK4, NumPy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

try:
    import pinocchio
except ImportError:
    pinocchio = None  # the benchmarks say so

from fmu_didim.data.signals import Trajectory
from fmu_didim.dynamics.robot import RobotDescription


def rigid_model(robot: RobotDescription) -> pinocchio.Model:
    """Links and rotor inertias of a robot of revolute joints, frame by frame."""
    model = pinocchio.Model()
    model.gravity = pinocchio.Motion(np.array(robot.gravity), np.zeros(3))
    parent = 0
    for j, joint in enumerate(robot.joints, start=1):
        about_x = pinocchio.SE3(pinocchio.utils.rotate("x", joint.alpha), np.array([joint.a, 0, 0]))
        about_z = pinocchio.SE3(pinocchio.utils.rotate("z", joint.theta), np.array([0, 0, joint.d]))
        parent = model.addJoint(parent, pinocchio.JointModelRZ(), about_x * about_z, f"joint{j}")
        p = {v.name: joint.parameters.get(v.name, v.start) for v in joint.linear_parameters()}
        com = np.array([p["MX"], p["MY"], p["MZ"]]) / p["M"]
        inertia = np.array([[p["XX"], p["XY"], p["XZ"]], [p["XY"], p["YY"], p["YZ"]], [p["XZ"], p["YZ"], p["ZZ"]]])
        about_com = inertia - p["M"] * (com @ com * np.eye(3) - np.outer(com, com))
        model.appendBodyToJoint(parent, pinocchio.Inertia(p["M"], com, about_com), pinocchio.SE3.Identity())
    model.armature = np.array([joint.parameters["Ia"] for joint in robot.joints])
    return model


class PinocchioLoop:
    """A robot under PD control with the velocity by backward difference.

    Args:
        robot: revolute joints with the effects motor_inertia, viscous and coulomb.
        gains: (3, n) Kp, Kd and drive gains; period: of the control, s; substeps: of RK4 in it.
    """

    def __init__(self, robot: RobotDescription, gains: Sequence[Sequence[float]], period: float, substeps: int) -> None:
        self.model = rigid_model(robot)
        self.data = self.model.createData()
        self.kp, self.kd, self.drive = (np.array(g) for g in gains)
        self.viscous, self.dry, self.smooth = (
            np.array([joint.parameters[name] for joint in robot.joints]) for name in ("Fv", "Fc", "v0")
        )
        self.period, self.substeps = period, substeps

    def friction(self, dq: np.ndarray) -> np.ndarray:
        """Viscous and smoothed dry friction, N.m."""
        return self.viscous * dq + self.dry * np.tanh(dq / self.smooth)

    def acceleration(self, q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Direct model."""
        return pinocchio.aba(self.model, self.data, q, dq, tau - self.friction(dq))

    def torque(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Inverse model."""
        return pinocchio.rnea(self.model, self.data, q, dq, ddq) + self.friction(dq)

    def regressor(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Regressor (n, 13 n) of the links, rotors and friction."""
        rigid = pinocchio.computeJointTorqueRegressor(self.model, self.data, q, dq, ddq)
        return np.hstack([rigid, np.diag(ddq), np.diag(dq), np.diag(np.tanh(dq / self.smooth))])

    def variation(
        self, q: np.ndarray, dq: np.ndarray, tau: np.ndarray, x: np.ndarray, u: np.ndarray, columns: np.ndarray
    ) -> np.ndarray:
        """Time derivative of x (2 n, p), the derivatives of the states by the parameters of these regressor columns.

        u (n, p) are those of the torque. All but the slope of the friction is Pinocchio's.
        """
        n = self.model.nq
        slope = self.viscous + self.dry / self.smooth / np.cosh(dq / self.smooth) ** 2
        by_q, by_dq, inverse = pinocchio.computeABADerivatives(self.model, self.data, q, dq, tau - self.friction(dq))
        rows = self.regressor(q, dq, self.data.ddq)[:, columns]
        return np.vstack([x[n:], by_q @ x[:n] + by_dq @ x[n:] + inverse @ (u - slope[:, None] * x[n:] - rows)])

    def run(self, reference: Trajectory, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Torque (count, n) and (q, dq, ddq) (count, 3 n) at the first ticks."""
        n, h = self.model.nq, self.period / self.substeps
        q_ref, dq_ref = (reference.select([f"{s}{j}" for j in range(1, n + 1)]) for s in ("q", "dq"))
        q, dq = q_ref[0].copy(), dq_ref[0].copy()
        before = q - self.period * dq
        torques, motion = np.zeros((count, n)), np.zeros((count, 3 * n))
        for k in range(count):
            velocity, before = (q - before) / self.period, q
            tau = self.drive * (self.kp * (q_ref[k] - q) + self.kd * (dq_ref[k] - velocity))
            torques[k] = tau
            motion[k] = np.concatenate([q, dq, self.acceleration(q, dq, tau)])
            for _ in range(self.substeps):
                a1 = self.acceleration(q, dq, tau)
                v2 = dq + h / 2 * a1
                a2 = self.acceleration(q + h / 2 * dq, v2, tau)
                v3 = dq + h / 2 * a2
                a3 = self.acceleration(q + h / 2 * v2, v3, tau)
                v4 = dq + h * a3
                a4 = self.acceleration(q + h * v3, v4, tau)
                q = q + h / 6 * (dq + 2 * v2 + 2 * v3 + v4)
                dq = dq + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        return torques, motion
