"""The torque balance of a robot with elastic joints or backlash: motors and links move apart.

With q, dq, ddq the motion on the motors' side (what encoders see) and q_link the links' own motion,

    motor of an elastic joint j:  Im ddq_j + drive_j(q, dq) + tau_s_j = tau_j
    its link:                     G_j(q_link, dq_link, ddq_link) + own_j(q_link, dq_link) = tau_s_j
    gear:                         tau_s_j = K z(x_j) + K_cubic z(x_j)^3 + D z'(x_j) dx_j/dt,    x_j = q_j - q_link_j

where G are the rigid-body torques, own_j the effects that say of themselves that they act on the link, drive_j all
others, z(x) = x or, with backlash, x with a dead zone, and K_cubic is zero but in gears that harden. At rigid joints
q_link = q. Added up, tau = G + Im ddq + drive + own: linear in the standard parameters, with the links' motion as
something observed. A rotor's inertia counts about its own joint only, or where the description says so about the next
one, too (``coupled_inertia``).

Where the teeth of a gear turn its link by e(q_j) more than its motor, x_j = q_j + e - q_link_j, dx_j/dt = (1 + e') dq_j
- dq_link_j, and the motor feels (1 + e') tau_s_j, so that no power is lost.

Source: Spong: Modeling and control of elastic joint robots, ASME JDSMC 109, 1987; Tuttle and Seering: A nonlinear model
of a harmonic drive gear transmission, IEEE Transactions on Robotics and Automation 12, 1996.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import casadi as ca

from fmu_didim.base.errors import InputError
from fmu_didim.base.symbolic import jacobian
from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.effects import NOMINAL_SPEED, UNITS
from fmu_didim.dynamics.robot.description import RobotDescription
from fmu_didim.dynamics.robot.dynamics import NOTHING, FreeGeometry, add_effect, link_columns, own_parameters
from fmu_didim.dynamics.robot.equations import EquationsOfMotion
from fmu_didim.dynamics.robot.implicit import NEWTON_STEPS, Loads, StiffBalance
from fmu_didim.dynamics.robot.rate import EXPLICIT, Method, fastest_rate, load_bound

ROUNDING = 0.05
"""Radius of the rounded corners of backlash, as a fraction of half its gap."""
DRIVEN = 0.2
"""Part of the rate of an error of a gear that counts as one: at h times it of 0.2 a step is a radian of the error, of
which RK4, Simpson's rule where only time matters, misses 1/2880."""
_LINK_SIGNALS = (
    ("q_link", "position", "position of the link"),
    ("dq_link", "velocity", "velocity of the link"),
    ("ddq_link", "acceleration", "acceleration of the link"),
)


class ElasticEquations(EquationsOfMotion):
    """The equations of a robot with elastic joints, in the symbols of :class:`EquationsOfMotion`.

    Attributes:
        elastic: their numbers, from 0.
        gear: (m,) tau_s of these; turn: (m,) 1 + e'; motor: (m,) their Im.
    """

    def __init__(self, robot: RobotDescription, geometry: FreeGeometry = NOTHING) -> None:
        self.elastic = robot.elastic_joints()
        super().__init__(robot, geometry)

    def _make_links(self) -> None:
        m, numbers = len(self.elastic), [j + 1 for j in self.elastic]
        self.link, self.link_ddq = ca.SX.sym("link", 2 * m), ca.SX.sym("ddq_link", m)
        parts = (self.link[:m], self.link[m:], self.link_ddq)
        motion = [ca.SX(v) for v in (self.q, self.dq, self.ddq)]  # copies: rigid joints keep the motor's
        for whole, own in zip(motion, parts, strict=True):
            for i, j in enumerate(self.elastic):
                whole[j] = own[i]
        self.link_motion = (motion[0], motion[1], motion[2])
        variables = [
            tuple(
                Variable(f"{name}{j}", getattr(UNITS[self.robot.joints[j - 1].type], kind), "local", 0.0, text)
                for j in numbers
            )
            for name, kind, text in _LINK_SIGNALS
        ]
        self.links, self.link_accelerations = (*variables[0], *variables[1]), variables[2]

    def _build(self) -> None:
        n = len(self.robot.joints)
        self.error = ca.vertcat(*(self._error(j) for j in self.elastic))
        turns = [1 + jacobian(self.error[i], self.q[j]) for i, j in enumerate(self.elastic)]
        self.turn = ca.vertcat(*turns)
        self.gear = ca.vertcat(*(self._gear_torque(i) for i in range(len(self.elastic))))
        drive, carried = [ca.SX(0)] * n, ca.vertsplit(self.rigid)
        rates: list[ca.SX] = []
        loaded_drive, loaded_carried = list(drive), list(carried)
        steep_drive, steep_carried = list(drive), [ca.SX(0)] * n
        for placed in self.effects:
            on_link = placed.effect.acts_on_link
            amplitudes, shapes = own_parameters(self.robot, placed, self.by_name, self.by_shape)
            links = {}
            if "other joints" in placed.effect.needs:
                links = link_columns(self.rigid, placed.joint, self.by_name)
            motion = self.link_motion if on_link else (self.q, self.dq, self.ddq)
            at = placed.surroundings(self.robot, motion, self.clock, self.z, self.load[placed.joint], links)
            torque = [ca.SX(0)] * n
            add_effect(torque, placed, at, amplitudes, shapes)
            for row, value in enumerate(torque):
                on_motor = row in self.elastic and not on_link
                targets, by_load = [loaded_drive if on_motor else loaded_carried], "load" in placed.effect.needs
                if not by_load:
                    targets.append(drive if on_motor else carried)
                # What a gear transmits has slopes of its own, which stay with the explicit part.
                if placed.effect.is_steep and not (by_load and placed.joint in self.elastic):
                    targets.append(steep_drive if on_motor else steep_carried)
                for target in targets:
                    target[row] = target[row] + value
            rates += placed.effect.rates(at, shapes)
        self._locked = self._added(drive, carried)
        for i, j in enumerate(self.elastic):  # locked gears hide how the inertia is shared
            part = self._motor_part(j)
            for rows in (drive, loaded_drive):
                rows[j] = rows[j] + part * self.ddq[j]
            for rows in (carried, loaded_carried):
                rows[j] = rows[j] - part * self.link_ddq[i]
        self._drive, self._carried = ca.vertcat(*drive), ca.vertcat(*carried)
        self._loaded_rows = ca.vertcat(*loaded_drive), ca.vertcat(*loaded_carried)
        self._steep = [*steep_carried, *(steep_carried[j] for j in self.elastic)]
        for j in self.elastic:
            self._steep[j] = steep_drive[j]
        self.torque, self.rates = self._added(loaded_drive, loaded_carried), ca.vertcat(*rates)
        self.motor = ca.vertcat(*(jacobian(self._drive[j], self.ddq[j]) for j in self.elastic))
        whole = ca.vertcat(self.ddq, self.link_ddq)
        if ca.depends_on(self._inertia, whole) or ca.depends_on(self.rates, ca.vertcat(whole, self.load)):
            raise InputError(
                "An effect is not linear in the accelerations, or its states depend on them.",
                where=f"robot '{self.robot.name}'", next_step="Let it say what it needs: needs = frozenset({'load'}).",
            )  # fmt: skip

    def _motor_part(self, j: int) -> ca.SX:
        """Inertia that the motor takes from its link, where the description gives no Ia."""
        name = f"motor_share_{j + 1}"
        inertia = self.by_name[f"{'ZZ' if self.robot.joints[j].type == 'revolute' else 'M'}{j + 1}"]
        return self.by_shape[name] * inertia if name in self.by_shape else ca.SX(0)

    def _added(self, drive: Sequence[ca.SX], carried: Sequence[ca.SX]) -> ca.SX:
        """(n,) what acts on motors, and what on links as their motors feel it."""
        felt = list(carried)
        for i, j in enumerate(self.elastic):
            felt[j] = self.turn[i] * felt[j]
        return ca.vertcat(*drive) + ca.vertcat(*felt)

    def _error(self, j: int) -> ca.SX:
        """e(q_j), 0 for even teeth."""
        found = [self.by_shape.get(f"{name}_{j + 1}") for name in ("gear_cosine", "gear_sine", "gear_number")]
        cosine, sine, number = found
        if cosine is None or sine is None or number is None:
            return ca.SX(0)
        return cosine * ca.cos(number * self.q[j]) + sine * ca.sin(number * self.q[j])

    def _bound_of_error(self, j: int, by_shape: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX]:
        """Bounds of |1 + e'| and of the rate, 1/s, at which the error of a gear drives its link."""
        if f"gear_number_{j + 1}" not in by_shape:
            return ca.SX(1), ca.SX(0)
        cosine, sine, number = (by_shape[f"{name}_{j + 1}"] for name in ("gear_cosine", "gear_sine", "gear_number"))
        fastest = number * NOMINAL_SPEED[self.robot.joints[j].type]
        return 1 + number * ca.sqrt(cosine**2 + sine**2), DRIVEN * fastest

    def _gear_torque(self, i: int) -> ca.SX:
        j, m = self.elastic[i], len(self.elastic)
        twist = self.q[j] + self.error[i] - self.link[i]
        speed = self.turn[i] * self.dq[j] - self.link[m + i]
        deflection, contact = self._contact(j, twist)
        damped = self.by_shape[f"D_{j + 1}"] * contact * speed
        torque = self.by_shape[f"K_{j + 1}"] * deflection + damped
        hardening = self.by_shape.get(f"K_cubic_{j + 1}")
        return torque if hardening is None else torque + hardening * deflection**3

    def _contact(self, j: int, twist: ca.SX) -> tuple[ca.SX, ca.SX]:
        """z(x) and z'(x)."""
        gap = self.by_shape.get(f"gap_{j + 1}")
        if gap is None:
            return twist, ca.SX(1)
        half = gap / 2
        square = (ROUNDING * half) ** 2 + 1e-24
        upper, lower = ca.sqrt((twist + half) ** 2 + square), ca.sqrt((twist - half) ** 2 + square)
        return twist - (upper - lower) / 2, 1 - ((twist + half) / upper - (twist - half) / lower) / 2

    def _rows(self, drive: ca.SX, carried: ca.SX) -> ca.SX:
        """Imbalance (n + m,): motors and rigid joints, then the links of the elastic joints."""
        rows = [carried[j] - self.tau[j] for j in range(self.q.numel())]
        for i, j in enumerate(self.elastic):
            rows[j] = drive[j] + self.turn[i] * self.gear[i] - self.tau[j]
        return ca.vertcat(*rows, *(carried[j] - self.gear[i] for i, j in enumerate(self.elastic)))

    @cached_property
    def _inertia(self) -> ca.SX:
        """(n + m, n + m), symmetric: of motors and links by (ddq, ddq_link)."""
        return jacobian(self._rows(self._drive, self._carried), ca.vertcat(self.ddq, self.link_ddq))

    @cached_property
    def mass(self) -> ca.SX:
        """M with all gears locked."""
        return jacobian(self.locked(self._locked), self.ddq)

    def locked(self, expression: ca.SX) -> ca.SX:
        """The expression for links that follow their motors, by way of the teeth."""
        q, dq, ddq = (ca.vertcat(*(v[j] for j in self.elastic)) for v in (self.q, self.dq, self.ddq))
        bent = ca.vertcat(*(jacobian(self.turn[i], self.q[j]) for i, j in enumerate(self.elastic)))
        there = ca.vertcat(q + self.error, self.turn * dq, self.turn * ddq + bent * dq**2)
        return ca.substitute(expression, ca.vertcat(self.link, self.link_ddq), there)

    @cached_property
    def _solution(self) -> ca.SX:
        """(ddq, ddq_link): linear, Newton's steps where friction of rigid joints depends on their load."""
        unknown = ca.vertcat(self.ddq, self.link_ddq)
        nothing = ca.SX.zeros(unknown.numel())
        rows = self._gear_as_load(self._rows(*self._loaded_rows))
        plain = self._rows(self._drive, self._carried)
        free = ca.vertcat(ca.SX(0, 1), *(self.load[j] for j in range(self.q.numel()) if j not in self.elastic))
        if free.numel() == 0 or not ca.depends_on(rows, free):
            return ca.ldl_solve(-ca.substitute(rows, unknown, nothing), *ca.ldl(self._inertia))
        solution = ca.ldl_solve(-ca.substitute(plain, unknown, nothing), *ca.ldl(self._inertia))
        loads = ca.vertcat(*(self.rigid[j] for j in range(self.q.numel()) if j not in self.elastic))
        slope = jacobian(rows, unknown) + jacobian(rows, free) @ jacobian(loads, unknown)
        for _ in range(NEWTON_STEPS):
            load = ca.substitute(loads, unknown, solution)
            here, there = [free, unknown], [load, solution]
            wrong, gradient = ca.substitute([rows, slope], here, there)
            solution = solution - ca.solve(gradient, wrong)
        return solution

    @property
    def stiff_balance(self) -> StiffBalance | None:
        rows, unknown = self._gear_as_load(self._rows(*self._loaded_rows)), ca.vertcat(self.ddq, self.link_ddq)
        if ca.depends_on(jacobian(rows, unknown), ca.vertcat(unknown, self.load)):
            return None
        used = [j for j in range(self.q.numel()) if ca.depends_on(rows, self.load[j])]  # rigid joints
        symbols, meant = (ca.vertcat(*(whole[j] for j in used)) for whole in (self.load, self.rigid))
        m = len(self.elastic)
        gears = [ca.SX(0)] * self.q.numel()
        for i, j in enumerate(self.elastic):
            gears[j] = self.turn[i] * self.gear[i]
        return StiffBalance(
            rows=rows,
            unknown=unknown,
            v=ca.vertcat(self.dq, self.link[m:]),
            w=ca.vertcat(self.q, self.z, self.link[:m]),
            rate=ca.vertcat(self.dq, self.rates, self.link[m:]),
            states=range(self.q.numel(), self.q.numel() + self.z.numel()),
            friction=ca.vertcat(*self._steep),
            gears=ca.vertcat(*gears, -self.gear),
            clock=self.clock,
            loads=Loads(symbols, meant) if used else None,
        )

    def _gear_as_load(self, expression: ca.SX) -> ca.SX:
        """The load of an elastic joint is what its gear transmits."""
        return ca.substitute(expression, ca.vertcat(*(self.load[j] for j in self.elastic)), self.gear)

    @cached_property
    def acceleration(self) -> ca.SX:
        """ddq of the motors."""
        return self._solution[: self.q.numel()]

    @property
    def link_acceleration(self) -> ca.SX:
        """ddq_link (m,)."""
        return self._solution[self.q.numel() :]

    def transmitted(self, acceleration: ca.SX) -> ca.SX:
        """The load (n,) for an acceleration; at elastic joints that of the gear."""
        whole = ca.vertcat(self.ddq, self.link_ddq)
        load = ca.vertsplit(ca.substitute(self.rigid, whole, ca.vertcat(acceleration, self.link_acceleration)))
        for i, j in enumerate(self.elastic):
            load[j] = self.gear[i]
        return ca.vertcat(*load)

    @cached_property
    def inverse(self) -> ca.SX:
        """tau, with ddq_link from the balance of the links and the loads from there."""
        m = len(self.elastic)
        links = ca.vertcat(*(self._carried[j] - self.gear[i] for i, j in enumerate(self.elastic)))
        left = jacobian(links, self.link_ddq)
        found = -ca.ldl_solve(ca.substitute(links, self.link_ddq, ca.SX.zeros(m)), *ca.ldl(left))
        torque = ca.substitute(self._gear_as_load(self.torque), self.load, self.rigid)
        return ca.substitute(torque, self.link_ddq, found)

    def rate(self, mass: ca.SX, chi: ca.SX, s: ca.SX, method: Method = EXPLICIT) -> ca.SX:
        """Bound of the fastest rate, 1/s: that of links and motors apart, plus that of the gears between them."""
        by_name = {name: chi[i] for i, name in enumerate(self.by_name)}
        by_shape = {name: s[i] for i, name in enumerate(self.by_shape)}
        n, symbols, values = self.q.numel(), [self.chi, self.s], [chi, s]
        inertia, motor = ca.substitute([self._inertia, self.motor], symbols, values)
        places = [j if j not in self.elastic else n + self.elastic.index(j) for j in range(n)]
        links = ca.vertcat(*(ca.horzcat(*(inertia[a, b] for b in places)) for a in places))
        # where the drives are: the motor's own inertia at elastic joints
        drives = ca.SX(links)
        for i, j in enumerate(self.elastic):
            drives[j, :], drives[:, j] = inertia[j, :n], inertia[:n, j]  # zero but where motors are coupled
            drives[j, j] = motor[i]
        at_motor = [p for p in self.effects if p.joint in self.elastic and not p.effect.acts_on_link]
        at_link = [p for p in self.effects if p not in at_motor]
        total = ca.fmax(
            fastest_rate(self.robot, at_motor, drives, by_name, by_shape, method=method),
            fastest_rate(self.robot, at_link, links, by_name, by_shape, method=method),
        )
        inverse, gears, driven = ca.ldl_solve(ca.SX.eye(n), *ca.ldl(links)), ca.SX(0), ca.SX(0)
        yielding = self._of_motors(drives, motor)
        steepest = [self._steepest(j, links, by_name, by_shape) for j in self.elastic]
        for i, j in enumerate(self.elastic):
            turn, rate = self._bound_of_error(j, by_shape)
            driven = ca.fmax(driven, rate)
            both = ca.fabs(inverse[j, j]) + turn**2 / ca.fabs(motor[i])
            damping, stiffness = by_shape[f"D_{j + 1}"] * both, steepest[i] * both
            for k, more in yielding[i].items():  # torques of all gears whose motors move this one
                other = self._bound_of_error(k, by_shape)[0]
                damping = damping + turn * other * more * by_shape[f"D_{k + 1}"]
                stiffness = stiffness + turn * other * more * steepest[self.elastic.index(k)]
            damping = damping * method.damped
            # fastest root of s^2 + damping s + stiffness = 0, or its magnitude
            gears = ca.fmax(gears, damping / 2 + ca.sqrt(damping**2 / 4 + stiffness))
        return ca.fmax(total + gears * method.oscillating, driven * method.oscillating)

    def _steepest(self, j: int, links: ca.SX, by_name: Mapping[str, ca.SX], by_shape: Mapping[str, ca.SX]) -> ca.SX:
        """Stiffness of a gear, K + 3 K_cubic z^2, at the twist of the largest load L that is likely:

            K z + K_cubic z^3 = L:    K_cubic z^2 = 4/3 K sinh(u/3)^2,    sinh(u) = 3/2 L/K sqrt(3 K_cubic/K)

        Args:
            links: (n, n) inertia of the links.
        """
        stiffness, hardening = by_shape[f"K_{j + 1}"], by_shape.get(f"K_cubic_{j + 1}")
        if hardening is None:
            return stiffness
        load = load_bound(self.robot, j, links, by_name)
        angle = ca.asinh(1.5 * load / stiffness * ca.sqrt(3 * ca.fmax(hardening, 0) / stiffness))
        return stiffness * (1 + 4 * ca.sinh(angle / 3) ** 2)

    def _of_motors(self, drives: ca.SX, motor: ca.SX) -> list[dict[int, ca.SX]]:
        """Of each elastic joint i, by elastic joint k: bound of the acceleration of motor i by a torque of one at motor
        k, less that of motor i alone; nothing where motors are not coupled.

        Args:
            drives: (n, n) inertia where the drives are; motor: (m,) diagonal elements of the motors.
        """
        joined = [j for j in self.elastic if any(not drives[j, k].is_zero() for k in range(drives.shape[0]) if k != j)]
        if not joined:
            return [{} for _ in self.elastic]
        inverse = ca.ldl_solve(ca.SX.eye(drives.shape[0]), *ca.ldl(drives))
        found = []
        for i, j in enumerate(self.elastic):
            alone = {k: 1 / ca.fabs(motor[i]) if k == j else ca.SX(0) for k in joined}
            found.append({k: ca.fabs(inverse[j, k]) - alone[k] for k in joined if j in joined})
        return found
