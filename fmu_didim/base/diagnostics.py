"""Diagnostics: problems of data, a model or an answer, each kind under a stable code.

A module lists its codes once, and the catalogue returns each of them:

    CLOCK_LATE = CATALOGUE(
        "clock-late", DOUBT, rank=20, meaning="The clock of the log runs behind ...", next_step="Free log_delay ..."
    )

From a code and the figures of a case it makes a :class:`Diagnostic`. Scripts decide by codes, so that a code never
changes its meaning.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

from fmu_didim.base.errors import InputError


class Severity(Enum):
    """The meaning of a diagnostic for an answer."""

    PROBLEM = "problem"
    """Nothing can be identified before it is fixed."""
    DOUBT = "doubt"
    """The answer may be wrong, or less certain than it says."""
    REMARK = "remark"
    """Good to know; the answer stands."""


PROBLEM, DOUBT, REMARK = Severity.PROBLEM, Severity.DOUBT, Severity.REMARK


@dataclass(frozen=True)
class Code:
    """A kind of diagnostic.

    Attributes:
        name: stable, words joined by hyphens; severity: what it means for an answer.
        rank: the smaller, the earlier it is named: causes (below 50) come before what follows from them.
        meaning: one sentence or more for the page of codes; next_step: what a user does about it.
        at_once: whether one look settles all that is found of it, so that it is one reason.
    """

    name: str
    severity: Severity
    rank: int
    meaning: str
    next_step: str
    at_once: bool = False

    def __reduce__(self) -> tuple[Callable[..., Code], tuple[Any, ...]]:
        """In another process it is the code that is known there by this name."""
        own = (self.name, self.severity, self.rank, self.meaning, self.next_step, self.at_once)
        return _known_here, own


def _known_here(name: str, *own: Any) -> Code:
    """The code of this name, or one like it where its module has not been imported."""
    return CATALOGUE.named(name) or Code(name, *own)


@dataclass(frozen=True)
class Diagnostic:
    """Something that was found.

    Attributes:
        code: its kind.
        text: a sentence with the figures.
        place: experiment, joint, parameter or file; empty where it is about all of them.
        value, bound: the figure that was found and its limit, in ``unit``; None if there is no figure.
        next_step: what to do about it, the next command where there is one.
        weight: what it explains, by which causes of the same rank are ordered, the largest first.
        condition: of a remark on which a valid verdict rests: a clause after "provided that", without full stop.
    """

    code: Code
    text: str
    place: str = ""
    value: float | None = None
    bound: float | None = None
    unit: str = ""
    next_step: str = ""
    weight: float = 0.0
    condition: str = ""

    @property
    def advice(self) -> str:
        """The next step: its own, or that of its code."""
        return self.next_step or self.code.next_step

    @property
    def figures(self) -> str:
        """Value and bound with their unit; empty if there is no value."""
        if self.value is None:
            return ""
        unit = "" if self.unit in ("", "1") else f" {self.unit}"
        return f"{self.value:.3g}{unit}" + (f" (bound {self.bound:.3g}{unit})" if self.bound is not None else "")

    @property
    def excess(self) -> float:
        """How far the figure lies beyond its bound, as a ratio; 1 if there is no bound."""
        if self.value is None or not self.bound:
            return 1.0
        ratio = abs(self.value / self.bound)
        return max(ratio, 1 / ratio) if ratio > 0 else 1.0

    def __str__(self) -> str:
        return f"{self.place}: {self.text}" if self.place else self.text


class DiagnosedError(InputError):
    """Input that diagnostics refuse, named by the most important of them.

    Attributes:
        found: all of them, in order of weight.
    """

    def __init__(self, found: Iterable[Diagnostic]) -> None:
        self.found = by_weight(found)
        first, *others = self.found
        got = [first.figures, *(f"also {d.code.name} ({d.place})" for d in others)]
        super().__init__(
            first.text, where=first.place, got="; ".join(part for part in got if part) or None, next_step=first.advice
        )

    def _text(self) -> str:
        what, *lines = super()._text().splitlines()
        return "\n".join([what, f"  code:  {self.found[0].code.name}", *lines])


def refuse_problems(found: Iterable[Diagnostic]) -> list[Diagnostic]:
    """The diagnostics in order of weight; raises DiagnosedError where a problem is among them."""
    ordered = by_weight(found)
    if any(d.code.severity is PROBLEM for d in ordered):
        raise DiagnosedError(d for d in ordered if d.code.severity is PROBLEM)
    return ordered


def by_weight(found: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Problems, doubts, remarks; causes before what follows from them, what explains most first, then what lies
    farthest beyond its bound."""
    order = list(Severity)
    return sorted(found, key=lambda d: (order.index(d.code.severity), d.code.rank, -d.weight, -d.excess))


class Catalogue:
    """The codes that exist, by name."""

    def __init__(self) -> None:
        self._codes: dict[str, Code] = {}

    def __call__(
        self, name: str, severity: Severity, *, rank: int, meaning: str, next_step: str, at_once: bool = False
    ) -> Code:
        """Add a code and return it."""
        assert name not in self._codes, f"the code {name} is there twice"
        self._codes[name] = Code(name, severity, rank, meaning, next_step, at_once)
        return self._codes[name]

    def __iter__(self) -> Iterator[Code]:
        return iter(self._codes.values())

    def named(self, name: str) -> Code | None:
        """The code of a name, None where there is none."""
        return self._codes.get(name)


CATALOGUE = Catalogue()
"""All codes of the modules that have been imported."""
