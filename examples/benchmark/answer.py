"""What a method says of a case, and how it is asked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Name:
    """An effect that a method names.

    Attributes:
        effect: by its name in ``fmu-didim effects``; joint: from 1. ambiguous: what it does not tell from it.
    """

    effect: str
    joint: int | None
    ambiguous: tuple[str, ...] = ()


@dataclass(frozen=True)
class Answer:
    """The answer of a method.

    Attributes:
        verdict: ``named``, ``unknown`` (something is missing, its name is not known), or ``nothing`` (is missing).
        names: what is named, the most important first.
        parameters: base parameter -> value and standard deviation, where the method gives both.
    """

    verdict: str
    names: tuple[Name, ...] = ()
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def line(self) -> dict[str, Any]:
        """As it is kept: the fields that ``tests.tools.blind.score`` reads are called as there."""
        return {
            "verdict": self.verdict,
            "findings": [asdict(name) for name in self.names],
            "parameters": {name: list(pair) for name, pair in self.parameters.items()},
        }


def named(names: Sequence[Name], parameters: Mapping[str, tuple[float, float]] | None = None) -> Answer:
    """``named`` where there are names, else ``nothing``."""
    return Answer("named" if names else "nothing", tuple(names), parameters or {})
