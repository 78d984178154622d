"""Guesses for the columns of a file, from their names, English and German, and their units.

Nothing is taken for granted: what was guessed is written into the case, where it can be seen and changed, and where
two columns may be meant, none is taken.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from fmu_didim.base.errors import InputError
from fmu_didim.data.tables import SignalTable, TimeColumn
from fmu_didim.data.tables.clock import clock_column
from fmu_didim.data.tables.table import split_unit
from fmu_didim.data.units import known_unit

Role = Literal["q", "dq", "ddq", "tau", "current", "command", "temperature", "other"]
Side = Literal["reference", "measured", ""]
_BY_POWERS: tuple[tuple[dict[str, int], Role], ...] = (
    ({"rad": 1}, "q"), ({"m": 1}, "q"), ({"rad": 1, "s": -1}, "dq"), ({"m": 1, "s": -1}, "dq"), ({"s": -1}, "dq"),
    ({"rad": 1, "s": -2}, "ddq"), ({"m": 1, "s": -2}, "ddq"), ({"kg": 1, "m": 2, "s": -2}, "tau"),
    ({"kg": 1, "m": 1, "s": -2}, "tau"), ({"A": 1}, "current"), ({"kg": 1, "m": 2, "s": -3, "A": -1}, "command"),
    ({"K": 1}, "temperature"),
)  # fmt: skip
_BY_NAME: tuple[tuple[str, Role], ...] = (
    (r"temp(eratur(es?|en)?|s)?(?![a-z])", "temperature"),
    (r"ddq|qdd|acc|beschl", "ddq"),
    (r"dq|qd|vel|speed|drehzahl|geschw|rpm", "dq"),
    (r"tau|torq|moment|drehm|kraft|force|effort", "tau"),
    (r"strom|curr|\biq|amp(ere)?\b", "current"),
    (r"volt|spannung|command|stellgr", "command"),
    (r"^q|\bq\d|pos|lage|winkel|angle|achs|axis|joint|gelenk|weg|theta|phi", "q"),
)
_REFERENCE = r"soll|ref|set|cmd|des(ired)?|target|plan|fuehr|führ"
_MEASURED = r"(?<!wr)ist|joint_?states|act|meas|mess|enc|feedback|fbk|^qm\b|^q_?mes"


@dataclass(frozen=True)
class Guess:
    """The meaning of a column, by its unit and its name.

    Attributes:
        name, unit: of the column in the file; role: what it is; joint: counted from 1, None if its name has no number.
        side: whether its name says that it is a set point or a measurement; why: what else says so than its name.
    """

    name: str
    unit: str
    role: Role
    joint: int | None
    side: Side
    why: str = ""

    @property
    def list_name(self) -> str:
        """The list that it is an element of, such as ``/joint_states.position``, whose name says what its elements are;
        empty where it is none: ``log.q1`` and ``log.tau1`` stand in a struct."""
        prefix = self.name.rpartition(".")[0]
        return prefix if self.role == _role_of(prefix.lower()) != "other" else ""


def guesses(table: SignalTable, joints: Sequence[str] = ()) -> list[Guess]:
    """The guess for each column but the time.

    Args:
        joints: names of those of the robot, in its order; a column ``....elbow`` is that of the joint ``elbow``.
    """
    clock = time_column(table)
    names = [n for n in table.columns if n != clock and n not in table.times.values()]
    found = [guess(n, table.unit(n), bare=split_unit(n)[0] if table.has_header else "") for n in names]
    return _numbered(found, [name.lower() for name in joints])


def _numbered(found: Sequence[Guess], joints: Sequence[str]) -> list[Guess]:
    """The same with the joints that the robot calls so; without numbers in a list of which not each name has its own:
    ``wrist_1`` beside ``elbow`` is not the first joint."""
    last = [one.name.rpartition(".")[2].lower() for one in found]
    named = [
        replace(one, joint=joints.index(name) + 1) if name in joints else one
        for one, name in zip(found, last, strict=True)
    ]
    taken = Counter((one.list_name, one.joint) for one in named)
    unclear = {name for (name, joint), count in taken.items() if joint is None or count > 1} - {""}
    return [replace(one, joint=None) if one.list_name in unclear else one for one in named]


def time_column(table: SignalTable, names: Sequence[str] = ()) -> str | None:
    """The time column of these columns, None where none is found."""
    try:
        return clock_column(table, TimeColumn(), names)
    except InputError:
        return None


def guess(name: str, unit: str, *, bare: str | None = None) -> Guess:
    """The guess for a signal.

    Args:
        bare: its name without the unit; the name itself by default.
    """
    bare = (name if bare is None else bare).lower()
    known = known_unit(unit) if unit else None
    by_unit = next((role for powers, role in _BY_POWERS if known is not None and known.powers == powers), None)
    last = re.findall(r"\d+", bare)
    side: Side = "reference" if re.search(_REFERENCE, bare) else "measured" if re.search(_MEASURED, bare) else ""
    return Guess(name, unit, by_unit or _role_of(bare), int(last[-1]) if last else None, side)


def _role_of(bare: str) -> Role:
    """By a name in small letters."""
    return next((role for pattern, role in _BY_NAME if re.search(pattern, bare)), "other")


def chosen(found: Sequence[Guess], roles: Sequence[Role], joint: int, *, single: bool, prefer: Side) -> list[Guess]:
    """The columns that may be meant by a signal of a joint: one if it is clear, several or none if not.

    Args:
        roles: that will do, the best first; single: whether the robot has one joint, so that no number is needed.
        prefer: the side that is meant where names tell.
    """
    for role in roles:
        alike = [g for g in found if g.role == role and (g.joint == joint or (single and g.joint is None))]
        for side in (prefer, ""):
            if of_side := [g for g in alike if g.side == side]:
                return of_side
        if alike and prefer == "measured":
            return alike
    return []
