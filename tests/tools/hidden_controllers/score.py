"""What the verb said of a machine, and whether it is right.

right law   the law, whatever its extras and its way to a velocity; a law that is the same in effect counts
right set   the whole of it, extras and velocity, is named or in the set that the data do not exclude
gains       those of the true law in the set, each within three standard deviations
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fmu_didim.workflow.naming.catalogue import EQUAL_EFFECT
from fmu_didim.workflow.naming.named import Gain, Member, NamedController
from tests.figures import table
from tests.tools.hidden_controllers.draw import SCALE, TITLES

LAW: Mapping[str, str] = {"cascade": "P-PI+ff", "pid": "PID", "pd": "PD"}
"""Hidden law -> its name in the catalogue; EXTRA: and its extras."""
EXTRA: Mapping[str, tuple[str, ...]] = {"cascade": (), "pid": ("filter",), "pd": ("lag",)}
SIGMAS = 3.0
"""[standard deviations] Within which a gain is right: 0.3 % of right ones are not."""
Row = dict[str, Any]


def judged(hidden: str, truth: Mapping[str, Any], found: NamedController) -> Row:
    """One row: what was named, and what of it is right."""
    codes = [diagnostic.code.name for diagnostic in found.diagnostics]
    row: Row = {
        "verdict": found.verdict, "named": found.candidate.words, "set": list(found.tied), "codes": codes,
        "velocity": truth["velocity"], "law": truth["law"],
    }  # fmt: skip
    if hidden not in LAW:
        return row
    law = LAW[hidden]
    row["right_law"] = found.ok and found.candidate.law.name in (
        {law} | (EQUAL_EFFECT if law in EQUAL_EFFECT else set())
    )
    own = [m for m in found.members if _is(m, law, EXTRA[hidden], truth["velocity"])] if found.ok else []
    row["right_set"] = bool(own)
    row["gains"] = {f"{g.name}{g.joint}": _off(g, truth) for m in own[:1] for g in m.gains}
    row["scale"] = [d.value for d in found.diagnostics if d.code.name == "law-scaled"]
    return row


def _is(member: Member, law: str, extras: Sequence[str], velocity: str) -> bool:
    one = member.candidate
    return (one.law.name, tuple(one.extras), one.rate) == (law, tuple(extras), velocity)


def _off(gain: Gain, truth: Mapping[str, Any]) -> float:
    """From the true value, in standard deviations."""
    return float((gain.value - truth[gain.name][gain.joint - 1]) / gain.deviation)


def is_misled(row: Row) -> bool:
    """Whether a wrong answer is called valid: another law, a set without the right one, or any law where none is."""
    right = row.get("right_law", False) and row.get("right_set", False)
    return row["verdict"] == "valid" and not right


def share(good: int, count: int) -> str:
    """Of cases, in words."""
    return f"{100 * good / count:.0f} % ({good} of {count})" if count else "–"


HEADS = (
    "robot, log", "controller", "law named", "right set", "gains within 3 σ", "refused", "doubtful", "wrong and valid",
)  # fmt: skip


def lines(rows: Sequence[Row]) -> list[str]:
    """The table of all cases, a line for each robot, rate and law."""
    groups: dict[tuple[str, float, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["robot"], row["log_hz"], row["hidden"]), []).append(row)
    return table(HEADS, [
        (f"{robot.upper()}, {hz:g} Hz", TITLES[hidden], *_cells(hidden, groups[robot, hz, hidden]))
        for robot, hz, hidden in sorted(groups, key=lambda key: (key[0], -key[1], list(TITLES).index(key[2])))
    ])  # fmt: skip


def _cells(hidden: str, rows: Sequence[Row]) -> tuple[str, ...]:
    count = len(rows)
    verdicts = [share(sum(row["verdict"] == one for row in rows), count) for one in ("refused", "doubtful")]
    misled = share(sum(map(is_misled, rows)), count)
    if hidden not in LAW:
        return ("–", "–", "–", *verdicts, misled)
    named, of_set = (share(sum(row[key] for row in rows), count) for key in ("right_law", "right_set"))
    off = [abs(value) for row in rows for value in row["gains"].values()]
    return (named, of_set, share(sum(value <= SIGMAS for value in off), len(off)), *verdicts, misled)


def totals(rows: Sequence[Row]) -> dict[str, str]:
    """The criteria over all cases."""
    known = [row for row in rows if row["hidden"] in LAW]
    outside = [row for row in rows if row["hidden"] not in LAW]
    off = [abs(value) for row in known for value in row["gains"].values()]
    return {
        "cases": str(len(rows)),
        "law": share(sum(row["right_law"] for row in known), len(known)),
        "set": share(sum(row["right_set"] for row in known), len(known)),
        "gains": share(sum(value <= SIGMAS for value in off), len(off)),
        "refused": share(sum(row["verdict"] == "refused" for row in outside), len(outside)),
        "misled": share(sum(map(is_misled, rows)), len(rows)),
        "scaled": share(sum(bool(row["scale"]) for row in known if row["hidden"] == "pd"),
                        sum(row["hidden"] == "pd" for row in known)),
        "scale": f"{SCALE:g}",
    }  # fmt: skip
