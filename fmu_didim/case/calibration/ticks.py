"""The instants between which a model is simulated.

    t_k in  {start} + {instants of samples} + {rows of the inputs},     or, where these have a common step h,
    t_k = start + k h

so that each sample falls on a tick, and no straight line of an input has a corner inside a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array

SAME_INSTANT = 1e-6
"""[1] Of a step by which two instants may differ and be one: decimals of a file are rounded."""
MOST_TICKS = 2_000_000
"""[ticks] Of an experiment at most; an FMU takes some seconds for a million."""
FINEST = 4
"""[1] The most ticks of an even grid for each instant that is needed; else the instants themselves are the ticks."""


@dataclass(frozen=True, eq=False)
class Ticks:
    """Instants (T,) of the ticks of an experiment, s, and their common step; None where they have none."""

    time: Array
    step: float | None


def ticks_of(start: float, instants: Array, *, step: float | None = None) -> Ticks:
    """The ticks that a simulation from ``start`` to the last one of these instants needs.

    Args:
        instants: (N,) increasing, s, none before the start; step: h, where it is given.

    Raises:
        InputError: there would be too many.
    """
    last = float(instants[-1])
    needed = _distinct(np.concatenate([[start], instants]))
    common = step if step is not None else _common_step(needed)
    if common is None:
        return Ticks(needed, None)
    count = int(np.ceil((last - start) / common - SAME_INSTANT)) + 1
    if count > MOST_TICKS:
        raise InputError(
            "The simulation would take too many steps.", where="loop.rate_hz", got=f"{count} steps of {common:g} s",
            valid=f"at most {MOST_TICKS}", next_step="Give a lower rate: loop: {rate_hz: ...}, or leave it out.",
        )  # fmt: skip
    return Ticks(start + common * np.arange(max(count, 2), dtype=np.float64), common)


def together(found: Sequence[Ticks]) -> tuple[list[Ticks], float]:
    """The ticks of several experiments, with a step only where all have the same one, and their nominal step, s."""
    steps = {one.step for one in found}
    if len(steps) == 1 and None not in steps:
        return list(found), float(next(iter(steps)) or 0.0)
    nominal = float(np.median(np.concatenate([np.diff(one.time) for one in found])))
    return [Ticks(one.time, None) for one in found], nominal


def _distinct(instants: Array) -> Array:
    """Instants in order without those that are another one but for rounding."""
    ordered = np.unique(instants)
    if ordered.size < 2:
        return ordered
    least = SAME_INSTANT * float(np.median(np.diff(ordered)))
    kept: NDArray[np.bool_] = np.concatenate([[True], np.diff(ordered) > least])
    return ordered[kept]


def _common_step(instants: Array) -> float | None:
    """The step of the grid on which all instants lie; None where there is none, or one that is far finer than they."""
    steps = np.diff(instants)
    if not steps.size:
        return None
    places = np.rint((instants - instants[0]) / float(steps.min()))
    if places[-1] > FINEST * instants.size:
        return None
    common = float(instants[-1] - instants[0]) / float(places[-1])
    off = np.abs(instants - instants[0] - places * common).max()
    return common if off <= SAME_INSTANT * common else None
