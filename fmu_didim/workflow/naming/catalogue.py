"""The catalogue of control laws that may be named: laws x ways to a velocity x extras, and what each gives.

    parallel  u = Kp e + Ki I(e) + Kd F(rate of e)                          e = q_ref - q
    cascade   u = Kp v + Ki I(v),  v = Kv e + feedforward dq_ref - F(dq)
    then      u + Ka ddq_ref -> lag -> delay -> limit

F is a first-order filter, I[k+1] = I[k] + T (.)[k] from a start that is free. The laws are those of
``fmu_didim.controllers``, sample by sample, so that whatever is named is one of their descriptions. A factor on all
gains is no candidate: it is one with the gains.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fmu_didim.data.signals import Array

Complex = NDArray[np.complex128]
Rate = Literal["measured", "backward_difference", "error_difference"]
Extra = Literal["acceleration", "filter", "lag", "delay", "limit"]

SHORTEST = 1e-9
"""[s] Below it a time constant is none."""


@dataclass(frozen=True, eq=False)
class Law:
    """A row of the catalogue.

    Attributes:
        name: in the catalogue; words: for people; kind: of the controller's description.
        gains: that are free; fixed: gains that are not, and their values.
        rates: ways to a velocity that make a difference.
    """

    name: str
    words: str
    kind: str
    gains: tuple[str, ...]
    fixed: Mapping[str, float]
    rates: tuple[Rate, ...]

    @property
    def integrates(self) -> bool:
        """Whether it has an integrator, whose start is free, too."""
        return "Ki" in self.gains

    @property
    def is_cascade(self) -> bool:
        """Whether a velocity loop is inside a position loop."""
        return self.kind == "cascade_ppi"


_PARALLEL: tuple[Rate, ...] = ("measured", "backward_difference", "error_difference")
_CASCADE: tuple[Rate, ...] = ("measured", "backward_difference")

LAWS: tuple[Law, ...] = (
    Law("P", "P", "pd", ("Kp",), {"Kd": 0.0}, ("measured",)),
    Law("PD", "PD", "pd", ("Kp", "Kd"), {}, _PARALLEL),
    Law("PID", "PID", "pid", ("Kp", "Ki", "Kd"), {}, _PARALLEL),
    Law("P-P", "P-P cascade without feed-forward", "cascade_ppi", ("Kv", "Kp"), {"Ki": 0.0, "feedforward": 0.0},
        _CASCADE),
    Law("P-P+ff", "P-P cascade with feed-forward", "cascade_ppi", ("Kv", "Kp", "feedforward"), {"Ki": 0.0}, _CASCADE),
    Law("P-PI", "P-PI cascade without feed-forward", "cascade_ppi", ("Kv", "Kp", "Ki"), {"feedforward": 0.0},
        _CASCADE),
    Law("P-PI+1", "P-PI cascade with whole feed-forward", "cascade_ppi", ("Kv", "Kp", "Ki"), {"feedforward": 1.0},
        _CASCADE),
    Law("P-PI+ff", "P-PI cascade with feed-forward", "cascade_ppi", ("Kv", "Kp", "Ki", "feedforward"), {}, _CASCADE),
)  # fmt: skip
"""From the simplest on."""
SPECIAL_OF: Mapping[str, frozenset[str]] = {
    "P": frozenset({"PD", "PID", "P-P", "P-P+ff", "P-PI", "P-PI+1", "P-PI+ff"}),
    "PD": frozenset({"PID", "P-P+ff", "P-PI+1", "P-PI+ff"}),
    "PID": frozenset({"P-PI+ff"}),
    "P-P": frozenset({"P-P+ff", "P-PI", "P-PI+ff"}),
    "P-P+ff": frozenset({"P-PI+ff"}),
    "P-PI": frozenset({"P-PI+ff"}),
    "P-PI+1": frozenset({"P-PI+ff"}),
    "P-PI+ff": frozenset(),
}
"""Law -> laws of which it is a special case, for some gains."""
EQUAL_EFFECT = frozenset({"PID", "P-PI+1"})
"""Laws that are the same in effect: a PI loop of the velocity with whole feed-forward is a PID law of the position."""
EXTRAS: Mapping[Extra, tuple[str, str]] = {
    "acceleration": ("Ka", "feed-forward of the acceleration"),
    "filter": ("filter_s", "filter of the velocity"),
    "lag": ("lag_s", "lag of the command"),
    "delay": ("delay", "delay"),
    "limit": ("limit", "limit of the command"),
}
"""Extra -> its parameter, and its words."""
TIMES = ("filter_s", "lag_s", "delay")
"""Parameters in s that cannot be negative."""


@dataclass(frozen=True)
class JointSignals:
    """What one joint of a run shows, at all ticks (K,).

    Attributes:
        q_ref, dq_ref, ddq_ref: reference; q: measured position; step: control period T, s.
        rows: (N,) ticks of the torque samples; torque: (N,) N.m or N.
    """

    q_ref: Array
    dq_ref: Array
    ddq_ref: Array
    q: Array
    dq: Array
    step: float
    rows: NDArray[np.int64]
    torque: Array

    @property
    def sample_s(self) -> float:
        """From one torque sample to the next, s."""
        return float(self.rows[-1] - self.rows[0]) / (self.rows.size - 1) * self.step


@dataclass(frozen=True)
class Candidate:
    """A law with a way to the velocity and extras."""

    law: Law
    rate: Rate
    extras: tuple[Extra, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Of the free values of a joint, without the start of an integrator."""
        return (*self.law.gains, *(EXTRAS[extra][0] for extra in self.extras))

    @property
    def words(self) -> str:
        """For people."""
        how = {"measured": "measured velocity", "backward_difference": "velocity by difference",
               "error_difference": "difference of the error"}[self.rate]  # fmt: skip
        parts = [self.law.words, *(EXTRAS[extra][1] for extra in self.extras)]
        return ", ".join(parts if self.law.name == "P" else [*parts, how])

    def with_extra(self, extra: Extra) -> Candidate:
        """The same with one more extra, in the order of the catalogue."""
        found = {*self.extras, extra}
        return replace(self, extras=tuple(name for name in EXTRAS if name in found))

    def without(self, extra: Extra) -> Candidate:
        """The same with an extra less."""
        return replace(self, extras=tuple(name for name in self.extras if name != extra))

    @property
    def times(self) -> tuple[str, ...]:
        """Of its parameters those in which it is not linear: time constants and the delay, s."""
        return tuple(name for name in self.names if name in TIMES)

    def columns(self, s: JointSignals, values: Mapping[str, float]) -> Array:
        """(K, m) signals of which the command without limit is a sum, at all ticks; ``coefficients`` are their
        factors. The integrals begin at zero."""
        error = s.q_ref - s.q
        if self.law.is_cascade:
            velocity = self._filtered(self._velocity(s), values, s.step)
            found = [error, s.dq_ref, -velocity]
            found += [_integral(column, s.step) for column in found] if self.law.integrates else []
        else:
            found = [error, self._filtered(self._rate(s, error), values, s.step)]
            found += [_integral(error, s.step)] if self.law.integrates else []
        found += [s.ddq_ref] if "acceleration" in self.extras else []
        table = np.column_stack(found)
        if "lag" in self.extras:
            table = _low_passed(table, values["lag_s"], s.step)
        if "delay" in self.extras:
            table = _delayed(table, values["delay"] / s.step)
        return table

    def responses(self, omega: Array, step: float, values: Mapping[str, float]) -> Complex:
        """(W, m) each column per position, to frequencies (W,) in rad/s: what noise of the positions does."""
        z = np.exp(1j * omega * step)
        if self.rate == "measured":
            rate = 3j * np.sin(omega * step) / (step * (2 + np.cos(omega * step)))  # of a cubic spline through all
        else:
            rate = (1 - 1 / z) / step
        if "filter" in self.extras:
            rate = rate * _low_pass_response(z, values["filter_s"], step)
        one, none, integral = np.ones_like(z), np.zeros_like(z), step / (z - 1)
        if self.law.is_cascade:
            found = [-one, none, -rate]
            found += [column * integral for column in found] if self.law.integrates else []
        else:
            found = [-one, -rate]
            found += [-integral] if self.law.integrates else []
        found += [none] if "acceleration" in self.extras else []
        table = np.column_stack(found)
        if "lag" in self.extras:
            table = table * _low_pass_response(z, values["lag_s"], step)[:, None]
        if "delay" in self.extras:
            whole, share = divmod(values["delay"] / step, 1.0)
            table = table * (z**-whole * (1 - share + share / z))[:, None]
        return table

    def coefficients(self, values: Mapping[str, float]) -> Array:
        """(m,) factors of the columns."""
        value = {**self.law.fixed, **values}
        if self.law.is_cascade:
            found = [value["Kv"], value["feedforward"], 1.0]
            outer = [value["Kp"], value["Ki"]] if self.law.integrates else [value["Kp"]]
            found = [gain * inner for gain in outer for inner in found]
        else:
            found = [value["Kp"], value["Kd"]]
            found += [value["Ki"]] if self.law.integrates else []
        found += [value["Ka"]] if "acceleration" in self.extras else []
        return np.array(found)

    def command(self, s: JointSignals, values: Mapping[str, float], start: float = 0.0) -> Array:
        """(K,) command at all ticks; ``start``: of the integral."""
        u = self.columns(s, values) @ self.coefficients(values) + start * values.get("Ki", 0.0)
        bound = abs(values["limit"]) if "limit" in self.extras else np.inf
        return np.asarray(np.clip(u, -bound, bound))

    def description(
        self, values: Sequence[Mapping[str, float]], *, name: str, joints: Sequence[str], rate_hz: float, unit: str
    ) -> dict[str, Any]:
        """The controller with these values, one mapping a joint, as ``fmu_didim.controllers`` reads it; a delay is of
        the loop, and not in it."""
        found: dict[str, Any] = {
            "schema": 1, "law": self.law.kind, "name": name, "description": self.words, "joints": list(joints),
            "rate_hz": float(rate_hz), "command_unit": unit, "velocity": self.rate,
        }  # fmt: skip
        entries = {**dict.fromkeys(self.law.gains, ""), **dict.fromkeys(self.law.fixed, "")}
        for key in entries:
            found[key] = [float({**self.law.fixed, **joint}[key]) for joint in values]
        keys = {"acceleration": "acceleration", "filter": "filter_s", "lag": "lag_s", "limit": "saturation"}
        for extra in self.extras:
            if extra in keys:
                found[keys[extra]] = [float(joint[EXTRAS[extra][0]]) for joint in values]
        return found

    def _velocity(self, s: JointSignals) -> Array:
        if self.rate == "measured":
            return s.dq
        return np.diff(s.q, prepend=s.q[0] - s.step * s.dq_ref[0]) / s.step

    def _rate(self, s: JointSignals, error: Array) -> Array:
        if self.rate == "error_difference":
            return np.diff(error, prepend=error[0]) / s.step
        return s.dq_ref - self._velocity(s)

    def _filtered(self, signal: Array, value: Mapping[str, float], step: float) -> Array:
        return _low_passed(signal, value["filter_s"], step) if "filter" in self.extras else signal


def same_in_effect(one: Candidate, other: Candidate) -> bool:
    """Whether two candidates are the same to any log."""
    return {one.law.name, other.law.name} == EQUAL_EFFECT and one.rate == other.rate and one.extras == other.extras


def simpler(candidate: Candidate) -> list[Candidate]:
    """What a candidate is for some of its gains: simpler laws with the same velocity and extras."""
    laws = [law for law in LAWS if candidate.law.name in SPECIAL_OF[law.name] and candidate.rate in law.rates]
    found = [Candidate(law, candidate.rate, candidate.extras) for law in laws]
    return [one for one in found if law_takes(one)]


def law_takes(candidate: Candidate) -> bool:
    """Whether all extras of a candidate do something to its law."""
    return not ("filter" in candidate.extras and candidate.law.name == "P")


def candidates(extras: Sequence[Extra] = ()) -> list[Candidate]:
    """All laws with all ways to a velocity, each with these extras where they make sense."""
    found = [Candidate(law, rate) for law in LAWS for rate in law.rates]
    for extra in extras:
        found = [candidate.with_extra(extra) for candidate in found if takes(candidate, extra)]
    return found


def takes(candidate: Candidate, extra: Extra) -> bool:
    """Whether an extra does something to a law: there is no velocity to be filtered in P."""
    return extra not in candidate.extras and not (extra == "filter" and candidate.law.name == "P")


def _integral(signal: Array, step: float) -> Array:
    return step * np.concatenate([[0.0], np.cumsum(signal[:-1])])


def _low_passed(signal: Array, constant: float, step: float) -> Array:
    from scipy.signal import lfilter  # few cases need it

    decay = np.exp(-step / max(abs(constant), SHORTEST))
    start = decay * np.atleast_2d(signal[:1]) if signal.ndim > 1 else decay * signal[:1]
    return np.asarray(lfilter([1 - decay], [1, -decay], signal, axis=0, zi=start)[0])


def _delayed(table: Array, periods: float) -> Array:
    whole = int(np.floor(periods))
    rows = np.arange(table.shape[0])
    late, later = (table[np.clip(rows - ticks, 0, rows[-1])] for ticks in (whole, whole + 1))
    share = periods - whole
    return np.asarray((1 - share) * late + share * later)


def _low_pass_response(z: Complex, constant: float, step: float) -> Complex:
    decay = np.exp(-step / max(abs(constant), SHORTEST))
    return np.asarray((1 - decay) / (1 - decay / z))
