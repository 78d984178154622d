"""The models of a robot as CasADi functions: inverse, regressor, direct, and the plant's equations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Literal

import casadi as ca
import numpy as np

from fmu_didim.base.errors import UnknownNameError
from fmu_didim.base.symbolic import jacobian
from fmu_didim.data.signals import Array, Variable
from fmu_didim.dynamics.block import Block
from fmu_didim.dynamics.effects import UNITS
from fmu_didim.dynamics.linearly_implicit import LinearlyImplicit
from fmu_didim.dynamics.robot.balance import plant_balance
from fmu_didim.dynamics.robot.description import RobotDescription
from fmu_didim.dynamics.robot.dynamics import NOTHING, FreeGeometry, free_geometry
from fmu_didim.dynamics.robot.elastic import ElasticEquations
from fmu_didim.dynamics.robot.equations import EquationsOfMotion
from fmu_didim.dynamics.robot.implicit import implicit_step
from fmu_didim.dynamics.robot.inertia import InertiaColumns, all_positive, scaled_eigenvalues
from fmu_didim.dynamics.robot.rate import EXPLICIT, IMPLICIT, MOTION_RATE, RESOLVING, Method
from fmu_didim.dynamics.robot.vectorised import Vectorised

LONG = 1e9
"""A time in s after, and with the other sign before, all events of a run."""
_SIGNALS: Mapping[str, tuple[str, str, str]] = {
    "tau{}": ("torque", "input", "joint torque"),
    "q{}": ("position", "output", "joint position"),
    "dq{}": ("velocity", "output", "joint velocity"),
    "ddq{}": ("acceleration", "output", "joint acceleration"),
    "x_q{}": ("position", "local", ""),
    "x_dq{}": ("velocity", "local", ""),
    "q_start{}": ("position", "parameter", "initial position"),
    "dq_start{}": ("velocity", "parameter", "initial velocity"),
}
"""Variables of each joint of a plant: what they are, their causality and their description."""


class RobotModel:
    """Models of a robot, linear in its standard parameters chi (ns,).

        tau = inverse(q, dq, ddq, chi, s) = regressor(q, dq, ddq, s) chi = M(q) ddq + N(q, dq)
        ddq = direct(q, dq, tau, chi, s) = M^-1 (tau - N), by LDL^T

    All arguments are column vectors; s are the shape parameters (smoothing velocities and the like). Where effects
    have states or depend on time, ``extra`` names these ne variables, and inverse, bias and direct take them as a last
    argument e (ne,). Where friction depends on the transmitted torque, that is linear in chi only for a given load:
    the last argument of the regressor is ``observed``, e and the loads; ddq then follows by Newton's method.
    Where gears give way, q is the motors' side; the links' own positions and velocities are part of e, their
    accelerations of ``observed``.

    Attributes:
        description: the robot.
        parameters: the ns standard parameters, with values and units.
        shapes: the shape parameters, with values and units.
        links: ``q_link<j>`` and ``dq_link<j>`` of the elastic joints.
        extra: states of the effects, then ``clock`` (time in s), if anything needs them, then ``links``.
        given: place in ``extra`` of a measured state -> the parameter of the plant that is its start.
        observed: ``extra``, then ``load<j>`` (the transmitted torque) of the joints whose effects need it, then
            ``ddq_link<j>`` of the elastic joints.
    """

    def __init__(self, description: RobotDescription, geometry: FreeGeometry = NOTHING) -> None:
        self.description, self._geometry = description, geometry
        self.parameters: tuple[Variable, ...] = description.standard_parameters()
        self.shapes: tuple[Variable, ...] = description.shape_parameters()
        self._equations = equations = (ElasticEquations if description.elastic_joints() else EquationsOfMotion)(
            description, geometry
        )
        clock = (Variable("clock", "s", "local", 0.0, "time of the loop"),) if equations.uses_clock else ()
        loads = (
            Variable(f"load{j + 1}", UNITS[description.joints[j].type].torque, "local", 0.0, "transmitted torque")
            for j in equations.loaded
        )
        self.links: tuple[Variable, ...] = equations.links
        self.extra: tuple[Variable, ...] = (*equations.states, *clock, *self.links)
        self.given: Mapping[int, str] = equations.given
        self.observed: tuple[Variable, ...] = (*self.extra, *loads, *equations.link_accelerations)
        self._q, self._dq, self._ddq, self._tau = equations.q, equations.dq, equations.ddq, equations.tau
        self._chi, self._s = equations.chi, equations.s
        self._e = ca.vertcat(equations.z, equations.clock) if equations.uses_clock else equations.z
        self._e = ca.vertcat(self._e, equations.link)
        self._vectorised: dict[str, Vectorised] = {}
        self._alike: dict[tuple[str, ...], RobotModel] = {}

    def like(self, description: RobotDescription) -> RobotModel:
        """The model of another robot. Where it has other lengths of links, or another gravity, and is the same
        otherwise, its regressor and the torque of its links at many points, and nothing else of it, come by functions
        that are made once for all such robots."""
        geometry = free_geometry(self.description, description)
        if geometry is None:
            return RobotModel(description)
        key = tuple(map(str, geometry.symbols))
        if key not in self._alike:
            self._alike[key] = RobotModel(self.description, geometry)
            _ = self._alike[key].active
        found = copy(self._alike[key])
        found.description, found._alike = description, {}
        return found

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
        """(q, dq, ddq, chi, s[, e]) -> tau, (n,)."""
        return self._function(
            "inverse", [self._q, self._dq, self._ddq, self._chi, self._s, *self._extra], self._equations.inverse
        )

    @property
    def _extra(self) -> list[ca.SX]:
        """The argument e, if there is one."""
        return [self._e] if self.extra else []

    @cached_property
    def regressor(self) -> ca.Function:
        """(q, dq, ddq, s[, observed]) -> W, (n, ns): the derivative of tau by chi, exact because it is linear."""
        loads = [self._equations.load[j] for j in self._equations.loaded]
        given = [ca.vertcat(self._e, *loads, self._equations.link_ddq)] if self.observed else []
        arguments = [self._q, self._dq, self._ddq, self._s, *given, *self._geometry.symbols]
        return self._function("regressor", arguments, self._columns)

    @cached_property
    def _columns(self) -> ca.SX:
        return jacobian(self._equations.torque, self._chi)

    @cached_property
    def transmitted(self) -> ca.Function:
        """(q, dq, ddq, chi) -> load, (n,): the torque of the links alone: gravity, inertia and Coriolis terms."""
        arguments = [self._q, self._dq, self._ddq, self._chi, *self._geometry.symbols]
        return self._function("transmitted", arguments, self._equations.locked(self._equations.rigid))

    @cached_property
    def rates(self) -> ca.Function:
        """(q, dq, e, s) -> de/dt, (ne,); e without ``links``, which are taken to follow their motors."""
        equations = self._equations
        clock = [ca.SX(1)] if equations.uses_clock else []
        own = self._e[: len(self.extra) - len(self.links)]
        rates = equations.locked(ca.vertcat(equations.rates, *clock))
        return self._function("rates", [self._q, self._dq, own, self._s], rates)

    @cached_property
    def _mass_changes(self) -> bool:
        return bool(ca.depends_on(self._equations.mass, ca.vertcat(self._e, self._s)))

    @cached_property
    def mass_matrix(self) -> ca.Function:
        """(q, chi) -> M, (n, n): symmetric, positive definite for a physical robot.

        (q, chi, s, e) -> M where an effect changes the inertia during the run. What depends on the load is left out.
        """
        varying = [self._s, self._e] if self._mass_changes else []
        return self._function("mass_matrix", [self._q, self._chi, *varying], self._equations.mass)

    @cached_property
    def bias(self) -> ca.Function:
        """(q, dq, chi, s[, e]) -> N, (n,): centrifugal, Coriolis, gravity and friction torques."""
        rest = self._equations.at_rest(self._equations.inverse)
        return self._function("bias", [self._q, self._dq, self._chi, self._s, *self._extra], rest)

    @cached_property
    def direct(self) -> ca.Function:
        """(q, dq, tau, chi, s[, e]) -> ddq, (n,)."""
        arguments = [self._q, self._dq, self._tau, self._chi, self._s, *self._extra]
        return self._function("direct", arguments, self._equations.acceleration)

    @cached_property
    def active(self) -> tuple[int, ...]:
        """Indices of the standard parameters that have an effect on some torque."""
        pattern = self._columns.sparsity()
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

    def regressor_rows(
        self, q: Array, dq: Array, ddq: Array, shapes: Array | None = None, observed: Array | None = None
    ) -> Array:
        """W over N samples: (N, n, ns) from (N, n) positions, velocities and accelerations.

        Args:
            observed: (N, no) values of ``self.observed``; zero where not given.
        """
        columns = range(len(self.parameters))
        result = np.empty((*q.shape, len(columns)))
        for part, block in self.regressor_blocks(q, dq, ddq, columns, shapes, observed):
            result[part] = block.transpose(2, 1, 0)  # while it is in the cache of the processor
        return result

    def regressor_blocks(
        self,
        q: Array,
        dq: Array,
        ddq: Array,
        columns: Sequence[int],
        shapes: Array | None = None,
        observed: Array | None = None,
    ) -> Iterator[tuple[slice, Array]]:
        """Some samples at a time, and (c, n, b) their rows of W for some parameters, by their places; arguments as
        above."""
        count, n = q.shape
        s = self.shape_values if shapes is None else shapes
        given = np.zeros((count, len(self.observed))) if observed is None else observed
        arguments = (q.T, dq.T, ddq.T, s, *([given.T] if self.observed else []), *self._lengths)
        elements = [n * k + j for k in columns for j in range(n)]
        for part, block in self._by_points("regressor").blocks(count, arguments, elements):
            yield part, block.reshape(len(columns), n, -1)

    def at_points(
        self, name: Literal["inverse", "regressor", "transmitted", "mass_matrix"], *arguments: Array
    ) -> Array:
        """(N, m) of one of these functions at N points, its columns one after the other.

        Args:
            arguments: (n, N) each, or (n,) of what is the same at all points; the first is of the points.
        """
        return self._by_points(name)(arguments[0].shape[1], (*arguments, *self._lengths))

    @property
    def _lengths(self) -> list[Array]:
        """Values of the free geometry, if there is any."""
        return self._geometry.values(self.description)

    def _by_points(self, name: str) -> Vectorised:
        if name not in self._vectorised:
            self._vectorised[name] = Vectorised(getattr(self, name))
        return self._vectorised[name]

    @cached_property
    def _inertia_columns(self) -> InertiaColumns:
        mass = self._equations.mass
        if self._mass_changes:
            mass = self.mass_matrix(self._q, self._chi, self.shape_values, self._extra_at(-LONG))
        return InertiaColumns(self._q, self._chi, mass)

    def inertia_along(self, q: Array, chi: Array) -> Array:
        """(N,) smallest eigenvalues of D^-1/2 M(q) D^-1/2, D = diag|M|, at positions (N, n): > 0 means positive
        definite. A negative or zero diagonal element gives a value <= 0."""
        return np.asarray(np.min([scaled_eigenvalues(mass) for mass in self._masses(q, chi)], axis=0))

    def inertia_is_positive(self, q: Array, chi: Array, least: float) -> bool:
        """Whether all of these are above a bound, at positions that are asked for again."""
        masses = self._masses(q, chi) if self._mass_changes else [self._inertia_columns.mass(q, chi)]
        return all(all_positive(mass, least) for mass in masses)

    def _masses(self, q: Array, chi: Array) -> list[Array]:
        """M at positions (N, n): (N, n, n), before and after all that changes with time."""
        ends = [(self.shape_values, self._extra_at(time)) for time in (-LONG, LONG)] if self._mass_changes else [()]
        return [self.at_points("mass_matrix", q.T, chi, *own).reshape(-1, *self._square) for own in ends]

    def _extra_at(self, time: float) -> Array:
        """States beyond the motion, at a time."""
        return np.array([time if v.name == "clock" else v.start for v in self.extra])

    @property
    def _square(self) -> tuple[int, int]:
        return self.joint_count, self.joint_count

    def inertia_columns(self, q: Array) -> Array:
        """(K, n, n, ns) derivatives of M at positions (K, n) by the standard parameters, before anything changes."""
        return self._inertia_columns.at(q)

    def block(self, values: Mapping[str, float] | None = None) -> Block:
        """The plant: dx/dt = (dq, direct(...), de/dt), x = (q, dq, e), u = tau, y = (q, dq, ddq, observed).

        Its parameters are the active standard parameters and the shapes (tunable), the start values
        ``q_start<j>``, ``dq_start<j>`` (fixed), those of measured states (fixed) and, where anything depends on time,
        the time ``t_start`` of the start (fixed).

        Args:
            values: parameter values that replace those of the description.
        """
        return self._block.with_parameters(dict(values)) if values else self._block

    @cached_property
    def _block(self) -> Block:
        """The plant with the values of the description."""
        robot, n, states = self.description, self.joint_count, self._equations.states
        standard = [self.parameters[i] for i in self.active]
        starts = list(self._motion_variables("q_start{}", "dq_start{}"))
        timed, given = self._equations.uses_clock, self._equations.given
        measured = {name: i for i, name in given.items()}  # effects of a joint share what is measured there
        starts += [replace(states[i], name=name, causality="parameter") for name, i in measured.items()]
        if timed:
            starts.append(Variable("t_start", "s", "parameter", 0.0, "time at the start"))
        p = ca.SX.sym("p", len(standard) + len(self.shapes) + len(starts))
        chi = ca.SX.zeros(len(self.parameters))
        for k, i in enumerate(self.active):
            chi[i] = p[k]
        shapes = p[len(standard) : len(standard) + len(self.shapes)]
        first = p[len(standard) + len(self.shapes) :]
        acceleration, rates, loads = self._plant(chi, shapes)
        x = ca.vertcat(self._q, self._dq, self._e)
        arguments = [x, self._tau, p]
        places = {name: 2 * n + k for k, name in enumerate(measured)}
        own = [first[places[given[i]]] if i in given else v.start for i, v in enumerate(states)]
        begin = ca.vertcat(first[: 2 * n], *own, *([first[2 * n + len(measured)]] if timed else []))
        elastic = robot.elastic_joints()  # their gears start without twist
        begin = ca.vertcat(begin, *(first[j] for j in elastic), *(first[n + j] for j in elastic))
        return Block(
            name=robot.name,
            description=robot.description,
            inputs=self._motion_variables("tau{}"),
            outputs=(*self._motion_variables("q{}", "dq{}", "ddq{}"), *_with(self.observed, "output")),
            states=(*self._motion_variables("x_q{}", "x_dq{}"), *_with(self.extra, "local", "x_")),
            parameters=(*standard, *self.shapes, *starts),
            update=ca.Function("update", arguments, [ca.densify(ca.vertcat(self._dq, acceleration, rates))]),
            output=ca.Function("output", arguments, [ca.densify(ca.vertcat(x[: 2 * n], acceleration, self._e, loads))]),
            start=ca.Function("start", [self._tau, p], [ca.densify(begin)]),
            rate_bound=ca.Function("rate_bound", [x, p], [ca.densify(self._rate(chi, shapes))]),
            fixed=frozenset(v.name for v in starts),
            balance=None if elastic else plant_balance(self._equations, x, p, chi, shapes),
            implicit=self._implicit(x, p, chi, shapes),
        )

    def _implicit(self, x: ca.SX, p: ca.SX, chi: ca.SX, shapes: ca.SX) -> LinearlyImplicit | None:
        """The linearly implicit step; None where nothing is steep (what damps and springs by constants, RK4 integrates
        better), and where accelerations are solved for in a way that the step does not know."""
        equations = self._equations
        balance = equations.stiff_balance
        if balance is None:
            return None
        n, m, ns = self.joint_count, len(self.links) // 2, len(equations.states)
        velocities = n + m  # places in (v, w), v = (dq, dq_link), w = (q, z, q_link)
        order = [velocities + j for j in range(n)] + list(range(n))
        order += [velocities + n + i for i in range(ns)] + [-1] * equations.uses_clock
        order += [velocities + n + ns + i for i in range(m)] + [n + i for i in range(m)]
        within = ([equations.chi, equations.s], [chi, shapes])
        rates = [ca.fmax(self._rate(chi, shapes, IMPLICIT), MOTION_RATE), self._rate(chi, shapes, RESOLVING)]
        return implicit_step(balance, x, order, equations.tau, p, rates=rates, within=within)

    def _plant(self, chi: ca.SX, shapes: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Acceleration, de/dt, observed loads and accelerations of links, for parameters that are expressions."""
        equations = self._equations
        load = equations.transmitted(equations.acceleration) if equations.loaded else ca.SX(0, 1)
        rates = ca.vertcat(equations.rates, ca.SX(1)) if equations.uses_clock else equations.rates
        count = len(self.links) // 2
        rates = ca.vertcat(rates, equations.link[count:], equations.link_acceleration)
        loads = ca.vertcat(ca.SX(0, 1), *(load[j] for j in equations.loaded), equations.link_acceleration)
        result = ca.substitute([equations.acceleration, rates, loads], [self._chi, self._s], [chi, shapes])
        return result[0], result[1], result[2]

    def _motion_variables(self, *patterns: str) -> tuple[Variable, ...]:
        """Variables of all joints, such as ``q1``, ``q2`` for ``q{}``, with the causality of the block."""
        return tuple(
            Variable(pattern.format(j), getattr(UNITS[joint.type], kind), causality, 0.0, text)
            for pattern in patterns
            for kind, causality, text in [_SIGNALS[pattern]]
            for j, joint in enumerate(self.description.joints, start=1)
        )

    def _rate(self, chi: ca.SX, shapes: ca.SX, method: Method = EXPLICIT) -> ca.SX:
        """Bound of the fastest rate, 1/s, as far as it counts for a method."""
        mass = ca.substitute([self._equations.mass], [self._chi, self._s], [chi, shapes])[0]
        return self._equations.rate(mass, chi, shapes, method)


def _with(variables: Sequence[Variable], causality: str, prefix: str = "") -> list[Variable]:
    return [replace(v, name=prefix + v.name, causality=causality) for v in variables]
