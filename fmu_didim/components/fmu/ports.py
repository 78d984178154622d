"""Inputs and outputs that are not all of the type double: numbers of the loop to values in C and back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.components.fmu.binding import Binding
from fmu_didim.components.fmu.description import FLOAT_TYPES, FmuVariable
from fmu_didim.data.signals import Array

INTEGER_TOLERANCE = 1e-9
"""[1] A number farther than this from an integer is not an integer."""


@dataclass(frozen=True)
class _Group:
    """Variables of one type that have a value at the same instants.

    Attributes:
        names, places: of the elements in the buffer; own: their values in C; clocks: empty if they always have one.
    """

    kind: str
    names: tuple[str, ...]
    places: Any
    own: Any
    clocks: tuple[int, ...]
    function: Callable[..., int]
    arguments: tuple[Any, ...]


class MixedCall:
    """Sets or gets variables of several types; called without arguments, it returns the worst status.

    Integers are passed if they are integers to 1e-9 and fit their type, Booleans as 0 and 1. Variables of clocks that
    do not tick now are left out; the buffer keeps their last values.

    Args:
        verb: ``Set`` or ``Get``; values: the buffer; ticks: whether a clock ticks now, by its reference.
    """

    def __init__(
        self,
        binding: Binding,
        verb: str,
        variables: Sequence[FmuVariable],
        values: Array,
        ticks: Callable[[int], bool],
    ) -> None:
        self._values, self._ticks, self._sets = values, ticks, verb == "Set"
        self._where = binding.description.path.name
        self._groups: list[_Group] = []
        ends = np.cumsum([v.size for v in variables])
        for kind, clocks in dict.fromkeys((v.type, v.clocks) for v in variables):
            members = [i for i, v in enumerate(variables) if (v.type, v.clocks) == (kind, clocks)]
            places = np.concatenate([np.arange(ends[i] - variables[i].size, ends[i]) for i in members])
            own = np.zeros(places.size, binding.array_types[kind])
            call = binding.typed_call(verb, kind, [variables[i].reference for i in members], own)
            names = tuple(name for i in members for name in variables[i].element_names())
            self._groups.append(_Group(kind, names, places, own, clocks, *call))

    def __call__(self) -> int:
        worst = 0
        for group in self._groups:
            if group.clocks and not any(self._ticks(c) for c in group.clocks):
                continue
            if self._sets:
                group.own[:] = self._converted(group)
            worst = max(worst, group.function(*group.arguments))
            if not self._sets:
                self._values[group.places] = group.own
        return worst

    def _converted(self, group: _Group) -> Array:
        given: Array = self._values[group.places]
        if group.kind in FLOAT_TYPES:
            return given
        low, high = 0.0, 1.0
        if group.kind != "Boolean":
            limits = np.iinfo(group.own.dtype)
            low, high = float(limits.min), np.nextafter(float(limits.max) + 1, 0)
        rounded: Array = np.rint(given)
        inside = (rounded >= low) & (rounded <= high)  # so is no infinity and no NaN
        distance = np.abs(np.where(inside, rounded, 1.0) - np.where(inside, given, 0.0))
        fits = distance <= INTEGER_TOLERANCE
        if not fits.all():
            bad = int(np.flatnonzero(~fits)[0])
            takes = "0 and 1" if group.kind == "Boolean" else "integers"
            raise SimulationError(
                f"The input '{group.names[bad]}' of the FMU takes {takes} only.",
                where=self._where,
                got=f"{given[bad]!r}, for the type {group.kind}",
                next_step="Round what is connected to it, or connect something else.",
            )
        return rounded
