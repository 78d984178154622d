"""Numbers that decide: each with its unit and the reason for its value, in one table for each package.

A package writes its numbers down in a module ``thresholds``, where the table hands each of them back as it is:

    _decides = Table("selection")
    SHORTLIST = _decides("SHORTLIST", 6, "candidates", "Largest number of ...")

so that code uses plain numbers, and a result can say by which of them it was decided.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TypeVar

Value = TypeVar("Value", bound=float | tuple[float, ...])


@dataclass(frozen=True)
class Threshold:
    """A number that decides something, or several that belong together.

    Attributes:
        name: table and own name, such as ``selection.shortlist``.
        unit: ``1`` for a plain ratio; reason: what it decides, and why it is as large as it is.
    """

    name: str
    value: float | tuple[float, ...]
    unit: str
    reason: str


class Table:
    """The thresholds of one package, in the order in which they are written down.

    Args:
        name: stands before the name of each of them.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._rows: dict[str, Threshold] = {}

    def __call__(self, name: str, value: Value, unit: str, reason: str) -> Value:
        """Write a threshold down; returns its value.

        Args:
            name: of the constant in the module.
        """
        assert name not in self._rows, f"{self.name}.{name} is written down twice"
        self._rows[name] = Threshold(f"{self.name}.{name.lower()}", value, unit, reason)
        return value

    def __iter__(self) -> Iterator[Threshold]:
        return iter(self._rows.values())


def recorded(tables: Iterable[Table]) -> dict[str, float | list[float]]:
    """Name -> value of all thresholds of some tables, as they are written into a result."""
    return {
        row.name: list(row.value) if isinstance(row.value, tuple) else row.value for table in tables for row in table
    }
