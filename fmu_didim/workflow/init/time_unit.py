"""The unit of stamps of which a file says none, as its motion tells it: positions are integrals of velocities.

With the stamps s in an unknown unit of u seconds, q(t) = c + u * integral of dq ds: the slope of the positions over
that integral is u.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.data.units import known_unit
from fmu_didim.workflow.init.roles import Guess

UNITS = ("ms", "us", "ns")
"""Of stamps that are not in s."""
SAME_UNIT = 0.1
"""[1] By which a slope may differ from a unit: velocities that are filtered or late are off by less."""
IS_INTEGRAL = 0.9
"""[1] Correlation of positions with integrals of velocities, from which the one is the other; joints that stand still
show noise alone."""
FASTEST_S = 1e-4
"""[s] Between rows of a log, at least: in a unit that brings them nearer, it is velocities that have another one, such
as mrad/s."""


def unit_by_motion(stamps: Array, columns: Mapping[str, Array], found: Sequence[Guess]) -> str:
    """The unit of stamps (N,), such as ms, if all joints that move say the same; empty for s or where none says it.

    Args:
        columns: name -> (N,) numbers; found: what they are taken for.
    """
    pairs = ([columns[one.name] * _factor(one.unit) for one in pair] for pair in _pairs(found))
    slopes = [slope for q, dq in pairs if (slope := _slope(stamps, q, dq))]
    for unit in UNITS if slopes else ():
        seconds = _factor(unit)
        if all(abs(slope / seconds - 1) <= SAME_UNIT for slope in slopes):
            return unit if float(np.median(np.diff(stamps))) * seconds >= FASTEST_S else ""
    return ""


def _pairs(found: Sequence[Guess]) -> list[tuple[Guess, Guess]]:
    """Position and velocity of one joint, both measured or both set points, or neither by its name."""
    velocities = [one for one in found if one.role == "dq"]
    return [
        (q, dq)
        for q in found
        if q.role == "q"
        for dq in velocities
        if (dq.joint, dq.side) in ((q.joint, q.side), (q.joint, ""))
    ]


def _factor(unit: str) -> float:
    """To SI; 1 of a unit that is not stated or not known."""
    known = known_unit(unit) if unit else None
    return 1.0 if known is None else known.factor


def _slope(stamps: Array, q: Array, dq: Array) -> float | None:
    """[s] Of positions over integrals of velocities; None where the one is not the other."""
    if not stamps.size == q.size == dq.size or stamps.size < 3:
        return None
    if not (np.isfinite(stamps).all() and np.isfinite(q).all() and np.isfinite(dq).all()):
        return None
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (dq[1:] + dq[:-1]) * np.diff(stamps))])
    reach, turns = float(np.ptp(q)), float(np.ptp(turned))
    if not (0 < reach < np.inf and 0 < turns < np.inf):
        return None
    a, b = (turned - turned.mean()) / turns, (q - q.mean()) / reach
    if float(a @ b) < IS_INTEGRAL * float(np.linalg.norm(a) * np.linalg.norm(b)):
        return None
    return float(a @ b) / float(a @ a) * reach / turns
