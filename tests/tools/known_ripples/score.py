"""What discovery named on the plants of :mod:`tests.tools.known_ripples.cases`."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.figures import table
from tests.tools.known_ripples.cases import STATED

RIPPLES = ("torque_ripple", "current_ripple", "encoder_eccentricity")
CLUTTER = {1: 17.0, 2: 23.0}
"""Joint -> ripples in its turn that the cases plant themselves; naming these is no false name."""
HEADS = ("gap of the ripple", "log", "named, no motor stated", "named, motor stated", "as the right harmonic",
         "a wrong ripple, motor stated")  # fmt: skip
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
    figures = figures_of(found)
    return "\n".join([*lines, "", *figures.pop("levels"), "", *(f"{name}: {value}" for name, value in figures.items())])


def figures_of(found: Sequence[Result]) -> dict[str, str | list[str]]:
    """Shares by size, rate and what is stated, as pages show them."""
    ripples = [r for r in found if r.level]
    levels = sorted({(r.level, r.rate) for r in ripples}, key=lambda each: (each[0], -each[1]))
    rows = [_row(level, rate, [r for r in ripples if (r.level, r.rate) == (level, rate)]) for level, rate in levels]
    figures: dict[str, str | list[str]] = {"levels": table(HEADS, rows)}
    figures["wrong_told"] = _share(r.told for r in ripples if r.how == "wrong" and r.named)
    for name, kind in (("clean", "r"), ("other", "o")):
        for how in STATED:
            own = [r for r in found if r.level == 0 and (r.name[0], r.how) == (kind, how)]
            if own:
                figures |= {f"{name}_{how}": str(len(own)), f"{name}_{how}_false": _share(bool(r.false) for r in own)}
    return figures


def _row(level: float, rate: int, own: Sequence[Result]) -> list[str]:
    """A row of the table of sizes."""
    by = {how: [r for r in own if r.how == how] for how in STATED}
    right = [r for r in by["right"] if r.named]
    named = [_share(r.named for r in by[how]) for how in ("nothing", "right")]
    return [f"{level:g} σ", f"{rate} Hz", *named, _share(bool(r.origin) for r in right),
            _share(bool(r.false) for r in by["right"])]  # fmt: skip


def _share(those: Iterable[bool]) -> str:
    listed = list(those)
    return f"{sum(listed)} of {len(listed)}"
