"""The equations of one dynamic system, as CasADi functions.

A :class:`Block` is what plants and controllers are written as before they become something that
runs: a component of the loop, a python-control system or the C code of an FMU. With state x,
input u, parameters p (all column vectors):

    continuous (``sample_time`` is None):  dx/dt  = update(x, u, p),  y = output(x, u, p)
    discrete   (sampled every T s):        x[k+1] = update(x, u, p),  y = output(x, u, p)

The initial state is ``start(u, p)``, evaluated once with the first inputs.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.base.symbolic import serialised
from fmu_didim.data.signals import Array, Variable, altered
from fmu_didim.dynamics.linearly_implicit import LinearlyImplicit


@dataclass(frozen=True)
class Balance:
    """How a continuous block computes its accelerations a, for users of derivatives: by solving

        residual(x, a, u, p) = 0  for  a = solution(x, u, p);  dx/dt = update(x, a, u, p),  y = output(x, a, u, p).

    Differentiating the balance takes far fewer operations than differentiating its solution.

    Attributes:
        residual, update, output: (x, a, u, p) -> (na,), (nx,), (ny,); solution: (x, u, p) -> (na,).
        symmetric: whether d residual / d a is symmetric.
    """

    residual: ca.Function
    update: ca.Function
    output: ca.Function
    solution: ca.Function
    symmetric: bool

    @property
    def count(self) -> int:
        """Number of accelerations na."""
        return int(self.residual.numel_out(0))


@dataclass(frozen=True)
class Block:
    """Equations and variables of one dynamic system.

    Attributes:
        name: identifier (a legal C name).
        description: one sentence for the user.
        inputs, outputs, states, parameters: their variables; ``start`` of a parameter is its value.
        update: (x, u, p) -> dx/dt or x[k+1], shape (nx,).
        output: (x, u, p) -> y, shape (ny,).
        start: (u, p) -> x at the first instant, shape (nx,).
        rate_bound: (x, p) -> an upper bound of the fastest rate in 1/s, from which the number of explicit
            integration substeps follows; None for discrete systems.
        sample_time: period in s of a discrete system, None for a continuous one.
        fixed: names of the parameters that may only change before initialisation.
        balance: how its accelerations are computed, if they are solved for; it says the same as update and output.
        implicit: its linearly implicit step, if its stiff part is known; without it RK4 integrates it.
    """

    name: str
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    states: tuple[Variable, ...]
    parameters: tuple[Variable, ...]
    update: ca.Function
    output: ca.Function
    start: ca.Function
    rate_bound: ca.Function | None = None
    sample_time: float | None = None
    description: str = ""
    fixed: frozenset[str] = frozenset()
    balance: Balance | None = None
    implicit: LinearlyImplicit | None = None

    def __post_init__(self) -> None:
        nx, nu, ny, p = len(self.states), len(self.inputs), len(self.outputs), len(self.parameters)
        checks = [(self.update, (nx, nu, p), nx), (self.output, (nx, nu, p), ny), (self.start, (nu, p), nx)]
        if self.rate_bound is not None:
            checks.append((self.rate_bound, (nx, p), 1))
        for function, sizes, result in checks:
            got = tuple(function.numel_in(i) for i in range(function.n_in()))
            if got != sizes or function.numel_out(0) != result:
                raise InputError(
                    f"Function '{function.name()}' does not fit the variables of block '{self.name}'.",
                    got=f"inputs {got}, output {function.numel_out(0)}", valid=f"inputs {sizes}, output {result}",
                    next_step="Give the function these arguments in this order.",
                )  # fmt: skip
        self._check_names()

    def _check_names(self) -> None:
        names = [v.name for v in (*self.inputs, *self.outputs, *self.states, *self.parameters)]
        if len(set(names)) < len(names):
            doubled = sorted({name for name in names if names.count(name) > 1})
            raise InputError(
                f"Block '{self.name}' has variables of the same name.", got=", ".join(doubled),
                next_step="Give each variable a name of its own.",
            )  # fmt: skip

    @property
    def step_rate(self) -> ca.Function | None:
        """(x, p) -> rate in 1/s of the method by which a stated number of substeps is made."""
        return self.rate_bound if self.implicit is None else self.implicit.rate

    @cached_property
    def rates(self) -> ca.Function | None:
        """(x, p) -> rates in 1/s for :func:`choose_steps`, (1,) or (2,)."""
        if self.rate_bound is None or self.implicit is None:
            return self.rate_bound
        x, p = ca.SX.sym("x", len(self.states)), ca.SX.sym("p", len(self.parameters))
        return ca.Function("rates", [x, p], [ca.densify(ca.vertcat(self.rate_bound(x, p), self.implicit.rate(x, p)))])

    def automatic_substeps(self, step: float) -> int:
        """The substeps in a communication step (s) of the method by which a stated number is made, from the start of
        the block."""
        assert self.step_rate is not None
        fewest = FEWEST_EXPLICIT if self.implicit is None else FEWEST_IMPLICIT
        return choose_substeps(self.at_start(self.step_rate), step, minimum=fewest)

    def automatic_steps(self, step: float) -> Steps:
        """How a communication step (s) is integrated where no number of substeps is stated, from the start of the
        block."""
        assert self.rates is not None
        p = self.parameter_values
        return choose_steps(self.rates(self.start(np.zeros(len(self.inputs)), p), p).full().ravel(), step)

    def at_start(self, rate: ca.Function) -> float:
        """A rate (x, p) -> 1/s at the start of the block, with inputs of zero."""
        p = self.parameter_values
        return float(rate(self.start(np.zeros(len(self.inputs)), p), p))

    @property
    def parameter_values(self) -> Array:
        """Start values of the parameters, (np,)."""
        return np.array([v.start for v in self.parameters], dtype=float)

    def with_parameters(self, values: dict[str, float]) -> Block:
        """The same block with other start values of the named parameters; raises UnknownNameError."""
        names = [v.name for v in self.parameters]
        for name in values:
            if name not in names:
                raise UnknownNameError("parameter", name, names, where=f"block '{self.name}'")
        parameters = tuple(v.starting_at(float(values.get(v.name, v.start))) for v in self.parameters)
        return self.with_variables(self.inputs, self.outputs, parameters)

    def with_variables(
        self, inputs: tuple[Variable, ...], outputs: tuple[Variable, ...], parameters: tuple[Variable, ...]
    ) -> Block:
        """The same equations of other variables, as many in the same places; raises InputError for doubled names."""
        assert (len(inputs), len(outputs), len(parameters)) == tuple(
            map(len, (self.inputs, self.outputs, self.parameters))
        )
        changed = altered(
            self, inputs=inputs, outputs=outputs, parameters=parameters
        )  # its functions have been checked
        changed._check_names()
        return changed

    def digest(self) -> str:
        """SHA-256 of the equations and the variables (start values included)."""
        state = hashlib.sha256(repr((self.name, self.sample_time, sorted(self.fixed))).encode())
        for group in (self.inputs, self.outputs, self.states, self.parameters):
            state.update(repr(group).encode())
        implicit = () if self.implicit is None else (self.implicit.solution, self.implicit.following)
        for function in (self.update, self.output, self.start, self.rates, *implicit):
            if function is not None:
                state.update(serialised(function))
        return state.hexdigest()


SUBSTEP_RATE = 0.2
"""Largest product of substep and fastest rate, h_sub * rate; RK4 is stable to 2.78 and at 0.2 its
error per unit of time is of the order 0.2**4 / 120 = 1e-5 of the fastest mode, which is a small part
of the motion."""
SUBSTEP_TOLERANCE = 1e-5
"""Error of the motion, relative to its size, that this rule stays below: 3e-8 to 6e-7 in the loops of the examples.
Who asks an FMU for less gets twice the substeps as often as the order of the method asks for it."""
FINEST_TOLERANCE = 1e-12
"""The least tolerance that can be asked for: below, rounding in thousands of substeps would be larger."""
REFINEMENT_EXPLICIT, REFINEMENT_IMPLICIT = 2**4, 2**2
"""By how much twice the substeps divide the error: 2 to the power of the order."""
EXPLICIT_COST = 2.0
"""Time of a substep of RK4, over that of a linearly implicit one: 1.8 for a SCARA, 2.0 for a TX40."""
FEWEST_EXPLICIT = 4
"""Substeps of RK4 in a communication step at least: what no rate bounds, the motion itself, is resolved by them."""
FEWEST_IMPLICIT = 16
"""Substeps of the linearly implicit method, of second order, in a communication step at least."""
MAXIMUM_SUBSTEPS = 1024
"""More substeps in a control period than this mean equations too stiff to be a robot: simulating them is
refused instead of taking for ever."""


def choose_substeps(rate: float, step: float, *, minimum: int = FEWEST_EXPLICIT) -> int:
    """Substeps in a communication step: the power of two >= step * rate / SUBSTEP_RATE.

    Powers of two, so that a small change of a parameter seldom changes the discretisation; a result above
    MAXIMUM_SUBSTEPS means too many.

    Args:
        rate: bound of the fastest rate, 1/s.
        step: communication step, s.
        minimum: never fewer than this.
    """
    wanted = step * rate / SUBSTEP_RATE
    count = minimum
    while count < wanted and count <= MAXIMUM_SUBSTEPS:
        count *= 2
    return count


@dataclass(frozen=True)
class Steps:
    """How a communication step is integrated: the number of equal substeps, and whether they are of RK4 (explicit) or
    linearly implicit."""

    count: int
    explicit: bool


def choose_steps(rates: Sequence[float] | Array, step: float) -> Steps:
    """The method that needs less for the accuracy of :func:`choose_substeps`, and its substeps.

    RK4 where nothing is steep, the linearly implicit method where friction, gears or bristles would ask for many small
    steps. The rates alone decide, not the step: a run does not change its method from one step to the next.

    Args:
        rates: 1/s, of RK4, and of the linearly implicit method where there is one.
        step: communication step, s.
    """
    if len(rates) == 1 or EXPLICIT_COST * rates[0] <= rates[1]:
        return Steps(choose_substeps(float(rates[0]), step, minimum=FEWEST_EXPLICIT), True)
    return Steps(choose_substeps(float(rates[1]), step, minimum=FEWEST_IMPLICIT), False)


def runge_kutta_step(rate: Callable[[float, Any], Any], time: float, x: Any, h: Any) -> Any:
    """x(t + h) of dx/dt = rate(t, x) by one step of the classical Runge-Kutta method, x a number, array or expression.

    x + h/6 (k1 + 2 k2 + 2 k3 + k4),  k1 = rate(t, x),  k2 = rate(t + h/2, x + h/2 k1),
    k3 = rate(t + h/2, x + h/2 k2),  k4 = rate(t + h, x + h k3)
    """
    k1 = rate(time, x)
    k2 = rate(time + h / 2, x + h / 2 * k1)
    k3 = rate(time + h / 2, x + h / 2 * k2)
    k4 = rate(time + h, x + h * k3)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
