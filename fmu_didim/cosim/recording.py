"""The signals recorded in a run of the loop."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import UnknownNameError
from fmu_didim.data.signals import Array


@dataclass(frozen=True)
class Columns(Mapping[str, Array]):
    """Columns of a table by name; a view of one is made when it is asked for.

    Attributes:
        places: name -> place of its column; table: (K, m).
    """

    places: Mapping[str, int]
    table: Array

    def __getitem__(self, name: str) -> Array:
        return self.table[:, self.places[name]]

    def __iter__(self) -> Iterator[str]:
        return iter(self.places)

    def __len__(self) -> int:
        return len(self.places)


@dataclass(frozen=True)
class Recording:
    """Signals recorded at some ticks.

    Attributes:
        ticks: (K,) tick numbers; start: instant of tick 0 in s; step_size: of a tick, s.
        applied: name -> (K,) values; those of a component whose inputs are delayed are taken when the
            input computed at the tick acts, so that torque and motion of a row belong together.
        inputs: name -> (K,) values of the inputs of the components, when they begin to act.
        sampled: the same as ``applied`` at the instant of the tick itself, just before anything that is due then acts.
        compiled: whether compiled code ran the loop.
        instants: (K,) of the ticks where these are not equally spaced, s; else None.
    """

    ticks: NDArray[np.int64]
    start: float
    step_size: float
    applied: Columns
    inputs: Columns
    sampled: Columns
    compiled: bool = False
    instants: Array | None = None

    def at(self, ticks: NDArray[np.int64]) -> Recording:
        """These of its ticks, with the spacing that it has."""
        rows = np.searchsorted(self.ticks, ticks)
        known = (self.applied, self.inputs, self.sampled)
        tables = {id(columns.table): columns.table[rows] for columns in known}  # mostly one and the same
        applied, inputs, sampled = (Columns(columns.places, tables[id(columns.table)]) for columns in known)
        return replace(
            self, ticks=self.ticks[rows], instants=None if self.instants is None else self.instants[rows],
            applied=applied, inputs=inputs, sampled=sampled,
        )  # fmt: skip

    @property
    def spacing(self) -> float | Array:
        """Of the rows at all ticks, for ``numpy.gradient``: the step, or the instants where it changes, s."""
        return self.step_size if self.instants is None else self.instants

    def elapsed(self, first: NDArray[np.signedinteger[Any]], last: NDArray[np.signedinteger[Any]]) -> float | Array:
        """Time between rows of one tick (K,) and of the next, s: the step, or where it changes (K, 1)."""
        return self.step_size if self.instants is None else (self.instants[last] - self.instants[first])[:, None]

    @cached_property
    def time(self) -> Array:
        """(K,) instants of the ticks, t0 + k h unless they are given, s."""
        if self.instants is not None:
            return self.instants
        return np.asarray(self.ticks * self.step_size + self.start, dtype=float)

    def table(self, names: list[str], *, sampled: bool = False) -> Array:
        """(K, len(names)) of the named signals ``component.variable``."""
        source = self.sampled if sampled else self.applied
        for name in names:
            if name not in source:
                raise UnknownNameError("recorded signal", name, source)
        return source.table.take([source.places[name] for name in names], axis=1)
