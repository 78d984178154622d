"""The torque balance of a robot with its effects, as CasADi expressions, and its solution for the acceleration."""

from __future__ import annotations

from functools import cached_property

import casadi as ca

from fmu_didim.base.errors import InputError
from fmu_didim.base.symbolic import jacobian
from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.robot.description import RobotDescription
from fmu_didim.dynamics.robot.dynamics import (
    NOTHING,
    FreeGeometry,
    PlacedEffect,
    add_effect,
    given_starts,
    link_columns,
    own_parameters,
    placed_effects,
    rigid_body_torque,
)
from fmu_didim.dynamics.robot.implicit import Loads, StiffBalance, with_loads
from fmu_didim.dynamics.robot.rate import EXPLICIT, Method, fastest_rate
from fmu_didim.dynamics.robot.tilt import gravity_vector


class EquationsOfMotion:
    """tau = G(q, dq, ddq) + sum of the effects, G the rigid-body torque, in symbols.

    Args:
        geometry: what of the robot is a symbol, too.

    Attributes:
        q, dq, ddq, tau: (n,) symbols; chi (ns,), s: parameters and shapes; z: states of the effects; clock: time;
        load: (n,) symbols for the transmitted torque G.
        rigid: G; torque: tau with ``load`` still a symbol; rates: dz/dt.
        links, link: the links' own motion where gears give way, (2 m,); link_accelerations, link_ddq: (m,) likewise.
        states: variables of z; given: place in z -> name of the parameter that is its measured start;
        uses_clock: whether anything depends on time; loaded: joints whose load matters.
    """

    def __init__(self, robot: RobotDescription, geometry: FreeGeometry = NOTHING) -> None:
        self.robot = robot
        n = len(robot.joints)
        parameters, shapes = robot.standard_parameters(), robot.shape_parameters()
        self.q, self.dq, self.ddq, self.tau = (ca.SX.sym(name, n) for name in ("q", "dq", "ddq", "tau"))
        self.chi, self.s = ca.SX.sym("chi", len(parameters)), ca.SX.sym("s", len(shapes))
        self.by_name = {v.name: self.chi[i] for i, v in enumerate(parameters)}
        self.by_shape = {v.name: self.s[i] for i, v in enumerate(shapes)}
        self.effects = placed_effects(robot)
        self.states = tuple(v for placed in self.effects for v in self._states(placed))
        self.given = {i: name for placed in self.effects for i, name in given_starts(robot, placed)}
        self.z, self.clock, self.load = ca.SX.sym("z", len(self.states)), ca.SX.sym("clock"), ca.SX.sym("load", n)
        self._make_links()
        gravity = gravity_vector(robot, self.by_shape) if geometry.gravity is None else geometry.gravity
        q, dq, ddq = self.link_motion
        self.rigid = rigid_body_torque(
            robot, q, dq, ddq, self.by_name, gravity=gravity, geometry=geometry
        )  # fmt: skip
        self._build()
        whole = ca.vertcat(self.torque, self.rates)
        self.uses_clock = bool(ca.depends_on(whole, self.clock))
        self.loaded = tuple(j for j in range(n) if ca.depends_on(self.torque, self.load[j]))

    def _states(self, placed: PlacedEffect) -> list[Variable]:
        name, joint = placed.effect.name, self.robot.joints[placed.joint]
        return [
            Variable(f"{v.name}_{name}{placed.joint + 1}", v.unit, "local", v.start, v.description)
            for v in placed.effect.states(joint.type)
        ]

    def _make_links(self) -> None:
        """Symbols for the motion of the links where it is not that of the motors; here it is."""
        self.links: tuple[Variable, ...] = ()
        self.link_accelerations: tuple[Variable, ...] = ()
        self.link, self.link_ddq = ca.SX(0, 1), ca.SX(0, 1)
        self.link_motion = (self.q, self.dq, self.ddq)

    def locked(self, expression: ca.SX) -> ca.SX:
        """The expression for links that follow their motors."""
        return expression

    @property
    def link_acceleration(self) -> ca.SX:
        """ddq_link (m,) by states, torque and parameters."""
        return ca.SX(0, 1)

    def rate(self, mass: ca.SX, chi: ca.SX, s: ca.SX, method: Method = EXPLICIT) -> ca.SX:
        """Bound of the fastest rate, 1/s, for values of the parameters and shapes and M (n, n) with them, as far as it
        counts for a method."""
        by_name = {name: chi[i] for i, name in enumerate(self.by_name)}
        by_shape = {name: s[i] for i, name in enumerate(self.by_shape)}
        return fastest_rate(self.robot, self.effects, mass, by_name, by_shape, method=method)

    def _build(self) -> None:
        """Rows without and with the effects of the load, and the rates of the states."""
        motion = (self.q, self.dq, self.ddq)
        plain, loaded, rates = ca.vertsplit(self.rigid), [ca.SX(0)] * len(self.robot.joints), [ca.SX(0, 1)]
        steep = [ca.SX(0)] * len(self.robot.joints)
        for placed in self.effects:
            amplitudes, shapes = own_parameters(self.robot, placed, self.by_name, self.by_shape)
            links = {}
            if "other joints" in placed.effect.needs:
                links = link_columns(self.rigid, placed.joint, self.by_name)
            at = placed.surroundings(self.robot, motion, self.clock, self.z, self.load[placed.joint], links)
            add_effect(loaded if "load" in placed.effect.needs else plain, placed, at, amplitudes, shapes)
            if placed.effect.is_steep:
                add_effect(steep, placed, at, amplitudes, shapes)
            rates += placed.effect.rates(at, shapes)
        self._plain, self._by_load, self.rates = ca.vertcat(*plain), ca.vertcat(*loaded), ca.vertcat(*rates)
        self._steep = ca.vertcat(*steep)
        self.torque = self._plain if self._by_load.is_zero() else self._plain + self._by_load
        if ca.depends_on(self._plain, self.load) or ca.depends_on(self.mass, self.ddq):
            raise InputError(
                "The torque of an effect is not linear in the accelerations.", where=f"robot '{self.robot.name}'",
                next_step="Let the effects that depend on the load say so: needs = frozenset({'load'}).",
            )  # fmt: skip
        if ca.depends_on(self.rates, ca.vertcat(self.ddq, self.load)):
            raise InputError(
                "The states of an effect depend on acceleration or load.", where=f"robot '{self.robot.name}'",
                next_step="Let rates depend on position, velocity, time and states only.",
            )  # fmt: skip

    @property
    def stiff_balance(self) -> StiffBalance | None:
        """The parts of a linearly implicit step; None where what depends on the load also depends on accelerations."""
        if ca.depends_on(self._by_load, self.ddq):
            return None
        return StiffBalance(
            rows=self.torque - self.tau,
            unknown=self.ddq,
            v=self.dq,
            w=ca.vertcat(self.q, self.z),
            rate=ca.vertcat(self.dq, self.rates),
            states=range(self.q.numel(), self.q.numel() + self.z.numel()),
            friction=self._steep,
            gears=ca.SX(self.ddq.numel(), 1),
            clock=self.clock,
            loads=self._loads if self.loaded else None,
        )

    @cached_property
    def _loads(self) -> Loads:
        """The loads, and the accelerations that torques depend on beside them."""
        used = [i for i in range(self.ddq.numel()) if ca.depends_on(self._by_load, self.ddq[i])]
        own = [self.ddq[i] for i in used]
        symbols = ca.vertcat(*(self.load[j] for j in self.loaded), *own)
        return Loads(symbols, ca.vertcat(*(self.rigid[j] for j in self.loaded), *own))

    @cached_property
    def mass(self) -> ca.SX:
        """M: inertia of links and rotors, effects of the load left out."""
        return jacobian(self._plain, self.ddq)

    def at_rest(self, expression: ca.SX) -> ca.SX:
        """The expression for ddq = 0."""
        return ca.substitute(expression, self.ddq, ca.SX.zeros(self.ddq.numel()))

    @cached_property
    def inverse(self) -> ca.SX:
        """tau, the load being the rigid-body torque."""
        return ca.substitute(self.torque, self.load, self.rigid) if self.loaded else self.torque

    @cached_property
    def acceleration(self) -> ca.SX:
        """ddq = M^-1 (tau - N) by LDL^T; Newton's steps from there where effects depend on the load."""
        factors = ca.ldl(self.mass)
        free = ca.ldl_solve(self.tau - self.at_rest(self._plain), *factors)
        return with_loads(free, factors, self._by_load, self._loads, self.ddq) if self.loaded else free

    def transmitted(self, acceleration: ca.SX) -> ca.SX:
        """The load (n,) for an acceleration."""
        return jacobian(self.rigid, self.ddq) @ acceleration + self.at_rest(self.rigid)
