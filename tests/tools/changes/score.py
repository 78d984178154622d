"""What a comparison said beside what is true."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scipy.stats import binomtest

from tests.figures import table
from tests.tools.changes.draw import REFERENCE, STILL

Named = frozenset[tuple[str, int]]
KINDS: Mapping[str, tuple[str, ...]] = {
    "payload": ("payload",), "temperature": ("friction_everywhere",), "friction": ("friction",),
    "backlash": ("backlash",), "belt": ("joint_elasticity",), "torque constant": ("joint_torque_scale", "drive_gain"),
    "controller gain": ("controller_gain", "controller_gains"), "clock": ("log_time_shift",),
}  # fmt: skip
"""Kinds of a cause, by what has happened: what a drive gives over its command is one thing under two names."""
SAME = {kind: cause for cause, kinds in KINDS.items() for kind in kinds}
WHOLE = ("payload", "temperature", "clock")
"""Of no joint."""
BARS: Mapping[str, tuple[str, float]] = {"alarm": ("≤", 0.01), "right": ("≥", 0.90), "in_set": ("≥", 0.97)}


@dataclass(frozen=True)
class Judged:
    """One pair.

    Attributes:
        truth: causes and joints; alarm: nothing has changed, and something was said to have.
        right: the best answer is the truth; in_set: one of the answers is; wrong: another one was named alone, and
            called valid.
    """

    truth: Named
    alarm: bool
    right: bool
    in_set: bool
    wrong: bool


def judged(line: Mapping[str, Any], truth: Mapping[str, Any]) -> Judged:
    """A line beside the truth of its pair."""
    hidden = frozenset((c["cause"], c["joint"]) for c in truth["changes"])
    gone = "new" if truth["repaired"] else "gone"
    said = [frozenset(_named(part, gone) for part in cause) for cause in line["causes"]]
    changed = line["answer"] != "unchanged"
    wrong = line["verdict"] == "valid" and (
        changed if not hidden else line["answer"] == "named" and said[:1] != [hidden]
    )
    return Judged(
        hidden, changed and not hidden, bool(hidden) and said[:1] == [hidden], bool(hidden) and hidden in said, wrong
    )


def _named(part: Sequence[Any], other: str) -> tuple[str, int]:
    """What has happened, and where; an effect that is said to have gone, not come, is another answer."""
    kind, joint, title = part
    cause = SAME.get(kind, kind)
    return (f"{cause}, {other}" if title.endswith(f", {other}") else cause), 0 if cause in WHOLE else joint


TITLED: Mapping[str, tuple[str, ...]] = {
    "payload": ("payload on the last link",), "temperature": ("friction of all joints",),
    "friction": ("friction of joint {j}",), "backlash": ("backlash on joint {j}, {when}",),
    "belt": ("joint elasticity on joint {j}, {when}",),
    "torque constant": ("torque scale of joint {j}", "gain of the drive on joint {j}, {when}"),
    "controller gain": ("gain of the controller on joint {j}, {when}", "gains of the controller on joint {j}, {when}"),
    "clock": ("time shift of the torque log, {when}",),
}  # fmt: skip
"""Titles of a cause on a line of a history."""


def histories(lines: Sequence[Mapping[str, Any]], truths: Sequence[Mapping[str, Any]]) -> dict[str, tuple[int, int]]:
    """Criterion -> how many of how many, of histories of one cause each."""
    false = seen = right = onset = still = later = 0
    for line, truth in zip(lines, truths, strict=True):
        (change,), when = truth["changes"], "gone" if truth["repaired"] else "new"
        titles = [title.format(j=change["joint"], when=when) for title in TITLED[change["cause"]]]
        before, after = line["states"][:STILL], line["states"][STILL:]
        still, later = still + len(before), later + len(after)
        false += before.count("changed")
        seen += after.count("changed")
        right += sum(causes[:1] == [title] for causes in line["causes"][STILL:] for title in titles)
        onset += line["onset"] is not None and abs(line["onset"] - REFERENCE - STILL) <= 1
    return {
        "history_alarm": (false, still), "history_seen": (seen, later), "history_right": (right, later),
        "onset": (onset, len(lines)),
    }  # fmt: skip


def truth_of(folder: Path) -> dict[str, Any]:
    """What is true of a pair."""
    return dict(json.loads((folder / "truth.json").read_text(encoding="utf-8")))


def shares(rows: Sequence[Judged]) -> dict[str, tuple[int, int]]:
    """Criterion -> how many of how many."""
    still, moved = [r for r in rows if not r.truth], [r for r in rows if r.truth]
    one, two = ([r for r in moved if len(r.truth) == n] for n in (1, 2))
    return {
        "alarm": (sum(r.alarm for r in still), len(still)),
        "right": (sum(r.right for r in moved), len(moved)), "in_set": (sum(r.in_set for r in moved), len(moved)),
        "right_one": (sum(r.right for r in one), len(one)), "right_two": (sum(r.right for r in two), len(two)),
        "wrong": (sum(r.wrong for r in rows), len(rows)),
    }  # fmt: skip


TITLES = {
    "alarm": "nothing changed, a change was told", "right": "the cause, or both, first",
    "in_set": "the cause, or both, in the set", "right_one": "one cause, first", "right_two": "two causes, both first",
    "wrong": "wrong, and called valid",
}  # fmt: skip


def criteria(rows: Sequence[Judged]) -> list[str]:
    """A table of the criteria with their bars."""
    lines = []
    for key, (good, count) in shares(rows).items():
        sign, bar = BARS.get(key, ("", 0.0))
        low, high = binomtest(good, count).proportion_ci() if count else (0.0, 1.0)
        lines.append((
            TITLES[key], f"{100 * good / max(count, 1):.1f} %", f"{good} of {count}",
            f"{100 * low:.1f} to {100 * high:.1f} %", f"{sign} {100 * bar:g} %" if sign else "",
        ))  # fmt: skip
    return table(("criterion", "reached", "pairs", "95 % interval", "bar"), lines)


def by_cause(rows: Sequence[Judged]) -> list[str]:
    """A table of what has happened: pairs, right, in the set, wrong and valid."""
    kinds: dict[str, list[Judged]] = {}
    for row in rows:
        names = sorted(cause for cause, _ in row.truth)
        kinds.setdefault(names[0] if len(names) == 1 else "two causes" if names else "nothing", []).append(row)
    lines = [
        (name, str(len(own)), *(
            [str(sum(not r.alarm for r in own)), "", str(sum(r.wrong for r in own))] if name == "nothing" else
            [str(sum(getattr(r, key) for r in own)) for key in ("right", "in_set", "wrong")]
        )) for name, own in sorted(kinds.items())
    ]  # fmt: skip
    return table(("what has happened", "pairs", "right", "in the set", "wrong and valid"), lines)
