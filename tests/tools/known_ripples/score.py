"""What discovery named on the plants of :mod:`tests.tools.known_ripples.cases`."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.tools.known_ripples.cases import STATED

RIPPLES = ("torque_ripple", "current_ripple", "encoder_eccentricity")
CLUTTER = {1: 17.0, 2: 23.0}
"""Joint -> ripples in its turn that the cases plant themselves; naming these is no false name."""
SAME = 1.0
"""[1] Periods in a turn by which a ripple that is named may differ from the one that is hidden."""


@dataclass(frozen=True)
class Result:
    """The answer on one plant: how the motor is stated; what was named of the ripple; other ripples that were named;
    whether it is told that the motor has no such harmonic."""

    name: str
    level: float
    rate: int
    how: str
    named: bool
    origin: str
    false: tuple[str, ...]
    told: bool


def result_of(name: str, how: str, hidden: Sequence[dict[str, Any]], found: dict[str, Any], *, clutter: bool) -> Result:
    """One answer, from ``findings.json``."""
    _, level, rate = name.split("_")
    ripples = [f for f in found["findings"] if f["effect"] in RIPPLES]
    right, false = list[dict[str, Any]](), list[str]()
    for f in ripples:
        count = _count(f)
        if any(f["joint"] == h["joint"] and abs(count - h["count"]) < SAME for h in hidden):
            right.append(f)
        elif not (clutter and abs(count - CLUTTER[f["joint"]]) < SAME):
            false.append(f"{f['effect']} {count:.4g} on joint {f['joint']}: {f.get('origin', '')}")
    told = any(reason["code"] == "ripple-not-of-motor" for reason in found["reasons"])
    origin = right[0].get("origin", "") if right else ""
    return Result(name, float(level) / 100, int(rate[:-2]), how, bool(right), origin, tuple(false), told)


def _count(finding: dict[str, Any]) -> float:
    """Periods in a turn of the joint of a ripple."""
    names = ("nr_", "eccentricity_number_")
    return next(float(p["value"]) for p in finding["parameters"] if p["name"].startswith(names))


def read(folder: Path) -> list[Result]:
    """All answers of a folder."""
    found = []
    for case in sorted(path.parent for path in folder.glob("*/motor.json")):
        hidden, clutter = json.loads((case / "motor.json").read_text())["hidden"], int(case.name[1:4]) % 2 == 1
        for how in STATED:
            path = case / how / "result" / "findings.json"
            if path.is_file():
                found.append(result_of(case.name, how, hidden, json.loads(path.read_text()), clutter=clutter))
    return found


def text(found: Sequence[Result]) -> str:
    """All answers, then a table of shares."""
    lines = [
        f"{r.name} {r.how}: {'named' if r.named else 'not named'}{f' ({r.origin})' if r.origin else ''}"
        f"{'; told' if r.told else ''}{'; false: ' + ', '.join(r.false) if r.false else ''}"
        for r in found
    ]
    return "\n".join([*lines, "", *(f"{name}: {value}" for name, value in figures_of(found).items())])


def figures_of(found: Sequence[Result]) -> dict[str, str]:
    """Shares by level, rate and what is stated, as pages show them."""
    figures = {}
    for level in sorted({r.level for r in found}):
        for rate in (100, 20):
            for how in STATED:
                own = [r for r in found if (r.level, r.rate, r.how) == (level, rate, how) and r.name[0] == "r"]
                if not own:
                    continue
                key = f"{how}_{100 * level:.0f}_{rate}hz"
                if level:
                    figures[f"{key}_named"] = _share(r.named for r in own)
                if how == "right" and level:
                    figures[f"{key}_origin"] = _share(bool(r.origin) for r in own if r.named)
                if how == "wrong":
                    figures[f"{key}_told"] = _share(r.told for r in own if r.named)
                figures[f"{key}_false"] = _share(bool(r.false) for r in own)
    for rate in (100, 20):
        for how in STATED:
            if own := [r for r in found if (r.name[0], r.rate, r.how) == ("o", rate, how)]:
                figures[f"{how}_other_{rate}hz_false"] = _share(bool(r.false) for r in own)
    return figures


def _share(those: Iterable[bool]) -> str:
    listed = list(those)
    return f"{sum(listed)} of {len(listed)}"
