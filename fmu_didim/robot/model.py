"""The models of a robot as CasADi functions: inverse, regressor, direct, and the plant's equations."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import casadi as ca
import numpy as np

from fmu_didim.block import Block
from fmu_didim.effects import UNITS
from fmu_didim.errors import UnknownNameError
from fmu_didim.robot.description import RobotDescription
from fmu_didim.robot.dynamics import inverse_dynamics
from fmu_didim.signals import Array, Variable


class RobotModel:
    """Models of a robot, linear in its standard parameters chi (ns,).

        tau = inverse(q, dq, ddq, chi, s) = regressor(q, dq, ddq, s) chi = M(q) ddq + N(q, dq)
        ddq = direct(q, dq, tau, chi, s) = M^-1 (tau - N), by LDL^T

    All arguments are column vectors; s are the shape parameters (smoothing velocities and the like).

    Attributes:
        description: the robot.
        parameters: the ns standard parameters, with values and units.
        shapes: the shape parameters, with values and units.
    """

    def __init__(self, description: RobotDescription) -> None:
        self.description = description
        self.parameters: tuple[Variable, ...] = description.standard_parameters()
        self.shapes: tuple[Variable, ...] = description.shape_parameters()
        n = len(description.joints)
        self._q, self._dq, self._ddq = (ca.SX.sym(name, n) for name in ("q", "dq", "ddq"))
        self._tau = ca.SX.sym("tau", n)
        self._chi = ca.SX.sym("chi", len(self.parameters))
        self._s = ca.SX.sym("s", len(self.shapes))
        by_name = {v.name: self._chi[i] for i, v in enumerate(self.parameters)}
        by_shape = {v.name: self._s[i] for i, v in enumerate(self.shapes)}
        self._torque = inverse_dynamics(description, self._q, self._dq, self._ddq, by_name, by_shape)

    @property
    def joint_count(self) -> int:
        """Number of joints n."""
        return len(self.description.joints)

    @property
    def parameter_values(self) -> Array:
        """Values of the standard parameters in the description, (ns,)."""
        return np.array([v.start for v in self.parameters])

    @property
    def shape_values(self) -> Array:
        """Values of the shape parameters in the description."""
        return np.array([v.start for v in self.shapes])

    def parameter_index(self, name: str) -> int:
        """Position of a standard parameter in chi; raises UnknownNameError."""
        names = [v.name for v in self.parameters]
        if name not in names:
            raise UnknownNameError("standard parameter", name, names, where=f"robot '{self.description.name}'")
        return names.index(name)

    @cached_property
    def inverse(self) -> ca.Function:
        """(q, dq, ddq, chi, s) -> tau, (n,)."""
        return self._function("inverse", [self._q, self._dq, self._ddq, self._chi, self._s], self._torque)

    @cached_property
    def regressor(self) -> ca.Function:
        """(q, dq, ddq, s) -> W, (n, ns): the derivative of tau by chi, exact because tau is linear in chi."""
        return self._function(
            "regressor", [self._q, self._dq, self._ddq, self._s], ca.jacobian(self._torque, self._chi)
        )

    @cached_property
    def _mass_expression(self) -> ca.SX:
        return ca.jacobian(self._torque, self._ddq)

    @cached_property
    def mass_matrix(self) -> ca.Function:
        """(q, chi) -> M, (n, n): symmetric, positive definite for a physical robot."""
        return self._function("mass_matrix", [self._q, self._chi], self._mass_expression)

    @cached_property
    def bias(self) -> ca.Function:
        """(q, dq, chi, s) -> N, (n,): centrifugal, Coriolis, gravity and friction torques."""
        return self._function("bias", [self._q, self._dq, self._chi, self._s], self._bias_expression)

    @cached_property
    def _bias_expression(self) -> ca.SX:
        return ca.substitute(self._torque, self._ddq, ca.SX.zeros(self.joint_count))

    @cached_property
    def _acceleration(self) -> ca.SX:
        factors = ca.ldl(self._mass_expression)
        return ca.ldl_solve(self._tau - self._bias_expression, *factors)

    @cached_property
    def direct(self) -> ca.Function:
        """(q, dq, tau, chi, s) -> ddq, (n,)."""
        return self._function("direct", [self._q, self._dq, self._tau, self._chi, self._s], self._acceleration)

    @cached_property
    def active(self) -> tuple[int, ...]:
        """Indices of the standard parameters that have an effect on some torque."""
        pattern = ca.jacobian(self._torque, self._chi).sparsity()
        columns = np.array(ca.DM(pattern, 1).full()).sum(axis=0)
        return tuple(int(i) for i in np.flatnonzero(columns))

    def _function(self, name: str, arguments: list[ca.SX], result: ca.SX) -> ca.Function:
        return ca.Function(name, arguments, [ca.densify(result)])

    def c_code(self) -> str:
        """C source, without main, of inverse, regressor, mass_matrix, bias and direct, for use elsewhere."""
        generator = ca.CodeGenerator(f"{self.description.name}.c", {"with_header": False})
        for function in (self.inverse, self.regressor, self.mass_matrix, self.bias, self.direct):
            generator.add(function)
        return str(generator.dump())

    def regressor_rows(self, q: Array, dq: Array, ddq: Array, shapes: Array | None = None) -> Array:
        """W over N samples: (N, n, ns) from (N, n) positions, velocities and accelerations."""
        count, n = q.shape
        s = self.shape_values if shapes is None else shapes
        flat = self.regressor(q.T, dq.T, ddq.T, np.repeat(s[:, None], count, axis=1)).full()
        return np.ascontiguousarray(flat.reshape(n, count, len(self.parameters)).transpose(1, 0, 2))

    def minimum_inertia(self, q: Array, chi: Array) -> float:
        """Smallest eigenvalue of D^-1/2 M(q) D^-1/2, D = diag|M|, over positions (N, n): > 0 means
        positive definite. Negative or zero diagonal elements give a value <= 0."""
        count, n = q.shape
        flat = self.mass_matrix(q.T, np.repeat(chi[:, None], count, axis=1)).full()
        mass = flat.reshape(n, count, n).transpose(1, 0, 2)
        diagonal = np.einsum("kii->ki", mass)
        if not np.isfinite(mass).all() or (diagonal <= 0).any():
            return float(min(0.0, diagonal.min())) if np.isfinite(mass).all() else -1.0
        scale = 1.0 / np.sqrt(diagonal)
        return float(np.linalg.eigvalsh(mass * scale[:, :, None] * scale[:, None, :]).min())

    def block(self, values: Mapping[str, float] | None = None) -> Block:
        """The plant: dx/dt = (dq, direct(...)), x = (q, dq), u = tau, y = (q, dq, ddq).

        Its parameters are the active standard parameters and the shapes (tunable) and the start
        values ``q_start<j>``, ``dq_start<j>`` (fixed).

        Args:
            values: parameter values that replace those of the description.
        """
        robot, n = self.description, self.joint_count
        units = [UNITS[joint.type] for joint in robot.joints]
        numbers = range(1, n + 1)
        standard = [self.parameters[i] for i in self.active]
        starts = [Variable(f"q_start{j}", units[j - 1].position, "parameter", 0.0, "initial position") for j in numbers]
        starts += [
            Variable(f"dq_start{j}", units[j - 1].velocity, "parameter", 0.0, "initial velocity") for j in numbers
        ]
        p = ca.SX.sym("p", len(standard) + len(self.shapes) + 2 * n)
        chi = ca.SX.zeros(len(self.parameters))
        for k, i in enumerate(self.active):
            chi[i] = p[k]
        shapes = p[len(standard) : len(standard) + len(self.shapes)]
        acceleration = ca.substitute([self._acceleration], [self._chi, self._s], [chi, shapes])[0]
        x = ca.vertcat(self._q, self._dq)
        arguments = [x, self._tau, p]
        block = Block(
            name=robot.name,
            description=robot.description,
            inputs=tuple(Variable(f"tau{j}", units[j - 1].torque, "input", 0.0, "joint torque") for j in numbers),
            outputs=(
                *(Variable(f"q{j}", units[j - 1].position, "output", 0.0, "joint position") for j in numbers),
                *(Variable(f"dq{j}", units[j - 1].velocity, "output", 0.0, "joint velocity") for j in numbers),
                *(Variable(f"ddq{j}", units[j - 1].acceleration, "output", 0.0, "joint acceleration") for j in numbers),
            ),
            states=(
                *(Variable(f"x_q{j}", units[j - 1].position, "local") for j in numbers),
                *(Variable(f"x_dq{j}", units[j - 1].velocity, "local") for j in numbers),
            ),
            parameters=(*standard, *self.shapes, *starts),
            update=ca.Function("update", arguments, [ca.densify(ca.vertcat(self._dq, acceleration))]),
            output=ca.Function("output", arguments, [ca.densify(ca.vertcat(x, acceleration))]),
            start=ca.Function("start", [self._tau, p], [ca.densify(p[-2 * n :])]),
            rate_bound=ca.Function("rate_bound", [x, p], [ca.densify(self._rate(chi, shapes))]),
            fixed=frozenset(v.name for v in starts),
        )
        return block.with_parameters(dict(values or {}))

    def _rate(self, chi: ca.SX, shapes: ca.SX) -> ca.SX:
        """Bound of the fastest rate: the infinity norm of |M^-1| diag(damping at rest), in 1/s."""
        by_name = {v.name: chi[i] for i, v in enumerate(self.parameters)}
        by_shape = {v.name: shapes[i] for i, v in enumerate(self.shapes)}
        mass = ca.substitute([self._mass_expression], [self._chi], [chi])[0]
        inverse = ca.fabs(ca.ldl_solve(ca.SX.eye(self.joint_count), *ca.ldl(mass)))
        total = ca.SX(0)
        damping = []
        for j, joint in enumerate(self.description.joints, start=1):
            value = ca.SX(0)
            for effect in joint.effect_objects():
                own = {v.name: by_name[f"{v.name}{j}"] for v in effect.parameters(joint.type)}
                own_shapes = {v.name: by_shape[f"{v.name}_{j}"] for v in effect.shapes(joint.type)}
                value = value + effect.damping(own, own_shapes)
            damping.append(value)
        for i in range(self.joint_count):
            row = ca.SX(0)
            for j in range(self.joint_count):
                row = row + inverse[i, j] * damping[j]
            total = ca.fmax(total, row)
        return total
