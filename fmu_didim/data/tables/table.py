"""The columns of a file as they are there, before names and units of a case are applied."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.data.signals import Array
from fmu_didim.data.units import known_unit

_WITH_UNIT = re.compile(r"^(?P<name>.*?\S)\s*(?:\[(?P<square>[^\[\]]+)\]|\((?P<round>[^()]+)\))$")


def split_unit(title: str) -> tuple[str, str]:
    """Name and unit of a title such as ``Achse1 [°]``; the unit is empty if the title has no known unit."""
    match = _WITH_UNIT.match(title.strip())
    unit = (match["square"] or match["round"]).strip() if match else ""
    if match is None or unit.isdigit() or known_unit(unit) is None:
        return title.strip(), ""
    return match["name"], unit


@dataclass(frozen=True)
class SignalTable:
    """Columns of numbers in a file.

    Attributes:
        columns: name in the file -> (N,) numbers as they stand there; lengths may differ.
        units: name -> unit that the file states for it.
        notes: how it was read, where that is not plain.
        times: name -> column of its instants, where the file says which.
        source: the file.
        has_header: whether its columns have names; they are numbered from 1 otherwise.
        calendar: columns whose numbers were dates or times of day, now seconds from a midnight.
    """

    columns: Mapping[str, Array]
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    times: Mapping[str, str] = field(default_factory=dict)
    source: str = ""
    has_header: bool = True
    calendar: tuple[str, ...] = ()

    @cached_property
    def _bare(self) -> dict[str, list[str]]:
        """Name without the unit behind it -> names in the file."""
        found: dict[str, list[str]] = {}
        for name in self.columns:
            found.setdefault(split_unit(name)[0], []).append(name)
        return found

    def unit(self, name: str) -> str:
        """The unit that the file states for a column, empty where it states none."""
        return self.units.get(name) or (split_unit(name)[1] if self.has_header else "")

    def find(self, name: str) -> str | None:
        """The column of that name, with or without the unit behind it; None if there is no such column.

        Raises:
            InputError: several columns have that name before their units.
        """
        if name in self.columns:
            return name
        alike = self._bare.get(name, [])
        if len(alike) > 1:
            raise InputError(
                "Several columns have this name.", where=self.source, got=name, valid=alike,
                next_step="Name the column with its unit.",
            )  # fmt: skip
        return alike[0] if alike else None

    def column(self, name: str) -> str:
        """As :meth:`find`; raises UnknownNameError that names the file."""
        found = self.find(name)
        if found is None:
            where = self.source
            if not self.has_header:
                where += " (it has no header line: its columns are numbered from 1)"
            raise UnknownNameError("column", name, self.columns, where=where)
        return found
