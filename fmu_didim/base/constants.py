"""The numbers on which answers depend, as results record them.

A number that decides is a constant beside its decision: its unit in brackets and its reason stand below it. Results
record those on which an answer depends, so that two answers can be compared.
"""

from __future__ import annotations

from collections.abc import Iterable
from types import ModuleType

Deciding = Iterable[tuple[ModuleType, tuple[str, ...]]]
"""Modules, and the names of constants in each."""


def recorded(constants: Deciding) -> dict[str, float | list[float]]:
    """Name -> value of constants, as they are written into a result.

    The name of ``BIC`` in ``fmu_didim.discovery.selection.decide`` is ``discovery.selection.decide.bic``.
    """
    found: dict[str, float | list[float]] = {}
    for module, names in constants:
        for name in names:
            value = getattr(module, name)
            key = f"{module.__name__.partition('.')[2]}.{name.lower()}"
            found[key] = list(value) if isinstance(value, tuple) else value
    return found
