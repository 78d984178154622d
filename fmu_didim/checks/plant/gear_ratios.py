"""Whether the motors that a robot description states are those by which logs are brought to the joints."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic

SAME_RATIO = 1e-3
"""[1] Relative difference up to which two gear ratios are one: data sheets round to three digits or more."""

GEAR_RATIOS_DIFFER = CATALOGUE(
    "gear-ratios-differ", DOUBT, rank=5,
    meaning="The robot description states another motor for a joint (motor:) than the one by which a log of the case "
    "is brought to it (gear_ratio: of a column, or motors: of a file): the torques are scaled by one of them, and "
    "ripples are looked for where the other one has them.",
    next_step="Compare both with the data sheet of the drive, and correct the wrong one. Leave motor: out at joints "
    "that share their motors.",
)  # fmt: skip


@dataclass(frozen=True)
class Brought:
    """A motor by which a log is brought to a joint.

    Attributes:
        where: file and key; joint: from 1; ratio: turns of the motor in one of the joint.
        shares: other joints, from 1, with which the motor turns, or whose motors turn with this joint.
    """

    where: str
    joint: int
    ratio: float
    shares: tuple[int, ...] = ()


def brought_by(where: str, turns: Iterable[Iterable[float]]) -> list[Brought]:
    """The motors of a matrix of turns, a row for each motor and a column for each joint."""
    rows = [list(row) for row in turns]
    found = []
    for i, row in enumerate(rows):
        others = [j + 1 for j in range(len(row)) if j != i and (row[j] or rows[j][i])]
        found.append(Brought(where, i + 1, abs(row[i]), tuple(others)))
    return found


def gear_ratio_diagnostics(stated: Mapping[int, float], brought: Iterable[Brought]) -> list[Diagnostic]:
    """The joints whose motors are stated in two ways.

    Args:
        stated: joint, from 1 -> gear ratio of the description.
    """
    found = []
    for one in dict.fromkeys(brought):
        if one.joint not in stated:
            continue
        own, place = stated[one.joint], f"joint {one.joint}"
        if one.shares:
            others = ", ".join(map(str, one.shares))
            text = (
                f"The description states a motor of its own, and by {one.where} it shares its motors with joint "
                f"{others}: what repeats in a turn of a motor does not repeat in a position then."
            )
            found.append(Diagnostic(GEAR_RATIOS_DIFFER, text, place))
        elif not math.isclose(own, one.ratio, rel_tol=SAME_RATIO):
            text = f"The description states a gear ratio of {own:g}, and {one.where} {one.ratio:g}."
            found.append(Diagnostic(GEAR_RATIOS_DIFFER, text, place, own, one.ratio, "1"))
    return found
