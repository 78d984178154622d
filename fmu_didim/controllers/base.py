"""The base class of control laws: options as a document, and the sampled block built from them.

A new law is one file with one class derived from :class:`ControlLaw`, and one row in
``fmu_didim.controllers.LAWS``. Inputs are named ``q_ref<j>``, ``dq_ref<j>``, ``ddq_ref<j>``, ``q<j>``
and ``dq<j>``; outputs ``command<j>``, in the unit ``command_unit``, before the drive gain.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import casadi as ca
from pydantic import Field, model_validator

from fmu_didim.base.documents import Positive, Strict
from fmu_didim.data.signals import Variable
from fmu_didim.dynamics.block import Block
from fmu_didim.dynamics.effects import UNITS, JointType

NotNegative = Annotated[float, Field(ge=0)]
VelocityKind = Literal["measured", "backward_difference"]
RateKind = Literal["measured", "backward_difference", "error_difference"]
SHORTEST = 1e-12
"""[s] A time constant below which its exponential is zero in any case."""


@dataclass
class ControlEquations:
    """The equations of a control law, in CasADi SX: the law fills them in, ``ControlLaw.block`` makes them a block."""

    inputs: dict[str, ca.SX] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    parameters: dict[str, tuple[ca.SX, float, str]] = field(default_factory=dict)
    states: dict[str, tuple[ca.SX, ca.SX, ca.SX, str]] = field(default_factory=dict)
    fixed: set[str] = field(default_factory=set)

    def input(self, name: str, unit: str) -> ca.SX:
        """The input of that name, made at its first use."""
        if name not in self.inputs:
            self.inputs[name] = ca.SX.sym(name)
            self.units[name] = unit
        return self.inputs[name]

    def parameter(self, name: str, value: float, description: str = "") -> ca.SX:
        """A tunable parameter."""
        symbol = ca.SX.sym(name)
        self.parameters[name] = (symbol, value, description)
        return symbol

    def state(self, name: str, unit: str, symbol: ca.SX, following: ca.SX, start: ca.SX) -> None:
        """A state with its next value and its start value (in inputs and parameters only)."""
        self.states[name] = (symbol, following, start, unit)

    def integral(self, j: int, integrand: ca.SX, period: float) -> ca.SX:
        """I[k] of joint j, I[k+1] = I[k] + T integrand[k], whose start I[0] is the fixed parameter
        ``integral_start<j>``, 0 by default."""
        integral = ca.SX.sym(f"integral{j}")
        start = self.parameter(f"integral_start{j}", 0.0, "integral at the start")
        self.fixed.add(f"integral_start{j}")
        self.state(f"integral{j}", "", integral, integral + period * integrand, start)
        return integral

    def low_passed(self, name: str, unit: str, signal: ca.SX, time_constant: ca.SX, period: float) -> ca.SX:
        """y[k] = a y[k-1] + (1 - a) u[k] of a signal u, a = exp(-T_f / T), settled before the start: y[-1] = u[0].

        Args:
            name: of the state y[k-1]; time_constant: T_f, s; 0 leaves the signal as it is; period: T, s.
        """
        before = ca.SX.sym(name)
        decay = ca.exp(-period / ca.fmax(time_constant, SHORTEST))
        result = decay * before + (1 - decay) * signal
        start = signal
        if self.states:
            symbols, starts = ([entry[i] for entry in self.states.values()] for i in (0, 2))
            start = ca.substitute(ca.vertcat(signal), ca.vertcat(*symbols), ca.vertcat(*starts))[0]
        self.state(name, unit, before, result, start)
        return result


class ControlLaw(Strict):
    """Options shared by all laws.

    Attributes:
        law: name of the law.
        name: identifier of the controller (a legal C name).
        description: what it is; source: where law and gains come from.
        joints: the type of each joint.
        rate_hz: sample rate; the command is held over one period (zero-order hold).
        command_unit: unit of the command (N.m, N, V, A).
        saturation: symmetric limit of each command, or nothing.
        acceleration: gains Ka of the reference acceleration, Ka ddq_ref being added to each command; or nothing.
        filter_s: time constants of the filter of each velocity that is fed back, or nothing: a first-order low-pass of
            the rate of the error in ``pd`` and ``pid``, of the velocity of the joint in ``cascade_ppi``; other laws
            take none.
        lag_s: time constants of a first-order lag of each command, before its limit; or nothing.
    """

    schema_version: Literal[1] = Field(default=1, alias="schema")
    law: str
    name: str = Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$")
    description: str = ""
    source: str = ""
    joints: tuple[JointType, ...] = Field(min_length=1)
    rate_hz: Positive
    command_unit: str = "N.m"
    saturation: tuple[Positive, ...] | None = None
    acceleration: tuple[float, ...] | None = None
    filter_s: tuple[NotNegative, ...] | None = None
    lag_s: tuple[NotNegative, ...] | None = None

    filters_velocity: ClassVar[bool] = False
    """Whether the law takes ``filter_s``."""

    @model_validator(mode="after")
    def _one_value_per_joint(self) -> ControlLaw:
        for key in type(self).model_fields:
            value = getattr(self, key)
            if key != "joints" and isinstance(value, tuple) and len(value) != len(self.joints):
                raise ValueError(f"{key} has {len(value)} values for {len(self.joints)} joints")
        if self.filter_s is not None and not self.filters_velocity:
            raise ValueError(f"filter_s: {self.law} filters no velocity")
        return self

    @property
    def period(self) -> float:
        """Sample period in s."""
        return 1.0 / self.rate_hz

    @abstractmethod
    def commands(self, equations: ControlEquations, *, folder: Path) -> list[ca.SX]:
        """One expression a joint for the command; declares inputs, parameters and states on the way."""

    def block(self, *, folder: Path = Path()) -> Block:
        """The law as a sampled block; ``folder`` is where files named in the options are looked for."""
        equations = ControlEquations()
        commands = self.commands(equations, folder=folder)
        for j, gain in enumerate(self.acceleration or (), start=1):
            wanted = equations.input(f"ddq_ref{j}", UNITS[self.joints[j - 1]].acceleration)
            commands[j - 1] += equations.parameter(f"Ka{j}", gain, "gain of the reference acceleration") * wanted
        for j, lag in enumerate(self.lag_s or (), start=1):
            constant = equations.parameter(f"lag_s{j}", lag, "time constant of the lag of the command, s")
            commands[j - 1] = equations.low_passed(
                f"lagged{j}", self.command_unit, commands[j - 1], constant, self.period
            )  # fmt: skip
        for j, limit in enumerate(self.saturation or (), start=1):
            bound = equations.parameter(f"limit{j}", limit, "symmetric limit of the command")
            commands[j - 1] = ca.fmin(ca.fmax(commands[j - 1], -bound), bound)
        x = ca.vertcat(ca.SX(0, 1), *(entry[0] for entry in equations.states.values()))
        u = ca.vertcat(*equations.inputs.values())
        p = ca.vertcat(ca.SX(0, 1), *(entry[0] for entry in equations.parameters.values()))
        following = ca.vertcat(ca.SX(0, 1), *(entry[1] for entry in equations.states.values()))
        start = ca.vertcat(ca.SX(0, 1), *(entry[2] for entry in equations.states.values()))
        return Block(
            name=self.name,
            description=self.description,
            inputs=tuple(Variable(name, equations.units[name], "input") for name in equations.inputs),
            outputs=tuple(
                Variable(f"command{j}", self.command_unit, "output", 0.0, "motor command")
                for j in range(1, len(commands) + 1)
            ),
            states=tuple(Variable(name, entry[3], "local") for name, entry in equations.states.items()),
            parameters=tuple(
                Variable(name, "", "parameter", value, text) for name, (_, value, text) in equations.parameters.items()
            ),
            update=ca.Function("update", [x, u, p], [ca.densify(following)]),
            output=ca.Function("output", [x, u, p], [ca.densify(ca.vertcat(*commands))]),
            start=ca.Function("start", [u, p], [ca.densify(start)]),
            sample_time=self.period,
            fixed=frozenset(equations.fixed),
        )

    def error_signals(self, equations: ControlEquations, j: int) -> Mapping[str, ca.SX]:
        """The inputs q_ref, dq_ref and q of joint j."""
        units = UNITS[self.joints[j - 1]]
        return {
            "q_ref": equations.input(f"q_ref{j}", units.position),
            "dq_ref": equations.input(f"dq_ref{j}", units.velocity),
            "q": equations.input(f"q{j}", units.position),
        }

    def error_and_rate(self, equations: ControlEquations, j: int, kind: RateKind) -> tuple[ca.SX, ca.SX]:
        """Error e = q_ref - q of joint j and its rate: dq_ref - dq, or (e[k] - e[k-1]) / T with e[-1] = e[0]."""
        if kind != "error_difference":
            signals = self.error_signals(equations, j)
            dq = self.velocity_signal(equations, j, kind)
            return signals["q_ref"] - signals["q"], signals["dq_ref"] - dq
        unit = UNITS[self.joints[j - 1]].position
        error = equations.input(f"q_ref{j}", unit) - equations.input(f"q{j}", unit)
        previous = ca.SX.sym(f"e_previous{j}")
        equations.state(f"e_previous{j}", unit, previous, error, error)
        return error, (error - previous) / self.period

    def filtered(self, equations: ControlEquations, j: int, velocity: ca.SX) -> ca.SX:
        """A velocity of joint j behind the filter of ``filter_s``; itself where there is none."""
        if self.filter_s is None:
            return velocity
        constant = equations.parameter(f"filter_s{j}", self.filter_s[j - 1], "time constant of the filter, s")
        unit = UNITS[self.joints[j - 1]].velocity
        return equations.low_passed(f"filtered{j}", unit, velocity, constant, self.period)

    def velocity_signal(self, equations: ControlEquations, j: int, kind: VelocityKind) -> ca.SX:
        """Velocity of joint j: the input ``dq<j>``, or (q[k] - q[k-1]) / T.

        The first difference is exact when the joint starts with the velocity of the reference:
        q[-1] = q[0] - T dq_ref[0].
        """
        units = UNITS[self.joints[j - 1]]
        if kind == "measured":
            return equations.input(f"dq{j}", units.velocity)
        q = equations.input(f"q{j}", units.position)
        dq_ref = equations.input(f"dq_ref{j}", units.velocity)
        previous = ca.SX.sym(f"q_previous{j}")
        equations.state(f"q_previous{j}", units.position, previous, q, q - self.period * dq_ref)
        return (q - previous) / self.period
