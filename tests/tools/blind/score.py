"""Compares the lines of an evaluation with the truth: confusion matrix, rates, and the bar each must reach."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

CLASSES: tuple[frozenset[str], ...] = tuple(
    frozenset(names.split())
    for names in (
        "torque_offset asymmetric_coulomb",
        "load_dependent_friction directional_efficiency",
        "actuator_lag delay log_time_shift",
        "quadratic_viscous cubic_viscous power_viscous",
        "presliding dahl lugre maxwell_slip",
        "torque_ripple current_ripple cogging encoder_eccentricity",
        "spring cable_stiffness gravity_compensator",
        "unknown_push external_force external_force_window",
        "torque_drift torque_settling",
        "torque_saturation saturation",
        "contact_stop contact_stop_lower",
        "controller_gain controller_gains",
        "gear_hardening gear_steps",
    )
)
"""Effects that data cannot, or need not, tell apart; an effect in none of them is a class of its own. The simulator's
angles run against those of a joint whose axis is turned round: its upper stop is then the lower one."""
PARTS: Mapping[str, tuple[str, ...]] = {"spring": ("torque_offset", "cubic_spring")}
"""What the form of a hidden effect holds beside its class: a spring that hardens, at rest elsewhere than at zero, has a
constant and a cube, k (q - q0) (1 + c (q - q0)^2). Named on its joint beside or instead of it, they are no false names,
but do not count as the effect found."""
CLUTTER = frozenset({"torque_ripple", "cogging", "stribeck", "thermal_friction_drift"})
"""What the cases themselves call no false name, where their truth says that clutter is planted."""
ANY_JOINT = frozenset({"drive_gain", "base_tilt", "payload_change", "log_time_shift"})
"""Effects whose joint is not judged: the gain's is not identifiable, the others belong to the whole robot."""
VISIBLE = 1.0
"""Only effects of at least this gap, in noise deviations, count for the bar."""
SHRINKS_SURELY = "shrinks by 60 % with its interval below 1"
"""The one rate that needs more than the published table holds."""


@dataclass(frozen=True)
class Rate:
    """A share of cases (or a shrink) against its bar.

    Attributes:
        good, count: cases. bar: least share, None where it is only to be seen. most: whether it is an upper limit.
    """

    name: str
    good: int
    count: int
    bar: float | None
    most: bool = False

    @property
    def share(self) -> float:
        """good / count; not a number without cases."""
        return self.good / self.count if self.count else float("nan")

    @property
    def passed(self) -> bool:
        """Whether the bar is reached; without cases there is nothing to fail."""
        if self.count == 0 or self.bar is None:
            return True
        return self.share <= self.bar if self.most else self.share >= self.bar


@dataclass(frozen=True)
class Score:
    """What :func:`score` returns.

    Attributes:
        rates: every criterion with its bar.
        matrix: (hidden, called) -> cases. shrinks: 1 - after / before of the held-out gap, one a named case.
        notes: one line for each case that went wrong.
    """

    rates: tuple[Rate, ...]
    matrix: Mapping[tuple[str, str], int]
    shrinks: tuple[float, ...]
    notes: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether every bar is reached."""
        return all(rate.passed for rate in self.rates)


@dataclass(frozen=True)
class Truth:
    """What a case hides: effects with their joints (None: not judged), the largest gap, whether clutter is planted, and
    the base parameters by name. Of three effects the gap is the least that one of them makes beside the
    others: each must show."""

    effects: tuple[tuple[str, int | None], ...]
    gap: float
    clutter: bool
    rate_hz: float
    parameters: Mapping[str, float] = field(default_factory=dict)


def read_truth(folder: Path) -> Truth:
    """The truth of a case; the only place where ``truth.yaml`` is opened."""
    content = yaml.safe_load((folder / "truth.yaml").read_text(encoding="utf-8"))
    case = yaml.safe_load((folder / "case.yaml").read_text(encoding="utf-8"))
    gaps = content.get("gap_after_refit_sigma_rms_per_joint", content["gap_sigma_rms_per_joint"])
    effects = tuple(
        (e["effect"], None if e["effect"] in ANY_JOINT or e.get("whole_robot") else int(e["joint"]))
        for e in content["truth"]
    )
    size = max((float(g) for g in gaps["train"]), default=0.0)
    if len(effects) > 2:
        size = min(float(e["gap_beside_sigma"]) for e in content["truth"])
    clutter, rate = content.get("clutter", "none") != "none", float(case["measurement"]["rate_hz"])
    return Truth(effects, size, clutter, rate, content.get("parameters", {}))


def same_class(one: str, other: str) -> bool:
    """Whether two effects are one, or members of one class."""
    return one == other or any(one in group and other in group for group in CLASSES)


def catalogued(effect: str) -> bool:
    """Whether an effect can be named at all; the others are to be refused."""
    return not effect.startswith("unknown_")


def members(finding: Mapping[str, Any]) -> set[str]:
    """The effects of a finding's ambiguous set, itself included; entries may be names, 'name@joint' or mappings."""
    found = {str(finding["effect"])}
    for entry in finding.get("ambiguous") or ():
        name = entry.get("effect", "") if isinstance(entry, Mapping) else str(entry)
        match = re.match(r"[A-Za-z_]+", name.strip())
        if match:
            found.add(match[0])
    return found


def matches(finding: Mapping[str, Any], effect: str, joint: int | None) -> bool:
    """Whether a finding names the class of an effect, on its joint unless that is None."""
    right = same_class(str(finding["effect"]), effect)
    return right and (joint is None or finding.get("joint") == joint)


def belongs(finding: Mapping[str, Any], effect: str, joint: int | None) -> bool:
    """Whether a finding names the class of an effect or a part of it, on its joint unless that is None."""
    return any(matches(finding, one, joint) for one in (effect, *PARTS.get(effect, ())))


def holds(finding: Mapping[str, Any], effect: str, joint: int | None) -> bool:
    """Whether the set of a finding holds the class of an effect, on its joint unless that is None."""
    return any(matches({**finding, "effect": name}, effect, joint) for name in members(finding))


def without_clutter(findings: Iterable[Mapping[str, Any]], truth: Truth) -> list[Mapping[str, Any]]:
    """Findings apart from planted clutter that is not what is hidden: those that are judged."""
    return [
        f
        for f in findings
        if not (truth.clutter and f["effect"] in CLUTTER)
        or any(
            same_class(str(f["effect"]), effect) and (j is None or f.get("joint") == j) for effect, j in truth.effects
        )
    ]


def in_set(line: Mapping[str, Any], truth: Truth) -> bool:
    """Whether the first serious finding, or its set, holds the class of the one effect that is hidden; of several,
    whether each is held by a finding on its joint."""
    serious = without_clutter(line["findings"], truth)
    if not serious or not truth.effects:
        return False
    if len(truth.effects) > 1:
        return all(any(holds(f, effect, joint) for f in serious) for effect, joint in truth.effects)
    return any(same_class(name, truth.effects[0][0]) for name in members(serious[0]))


def score(lines: Sequence[Mapping[str, Any]], truths: Mapping[str, Truth]) -> Score:
    """Every criterion of the method over these cases.

    Single effects count for class, set and joint by the first serious finding; several count as found when each is
    among the findings, with its joint. Of three, a finding that is none of them, nor a part of one,
    is a false name.

    Args:
        lines: of an evaluation. truths: by case.
    """
    tally: Counter[str] = Counter()
    matrix: Counter[tuple[str, str]] = Counter()
    shrinks, notes = [], []
    for line in lines:
        truth, verdict = truths[line["case"]], line["verdict"]
        serious = without_clutter(line["findings"], truth)
        refused = verdict in ("unknown", "disagreement") or (verdict == "nothing" and not line["findings"])
        called = str(serious[0]["effect"]) if serious else ("unknown" if verdict == "unknown" else verdict)
        called = "clutter only" if not serious and verdict.startswith("named") else called
        hidden = " + ".join(effect for effect, _ in truth.effects) or "nothing"
        matrix[hidden, called] += 1
        good = True
        if not truth.effects:
            good = not serious and verdict != "error"
            tally.update({"clean": 1, "clean false": int(not good), "clean not nothing": int(verdict != "nothing")})
        elif truth.gap >= VISIBLE:
            good = _judge(truth, line, serious, tally)
            _gaps(line, refused, tally, shrinks)
        if not good:
            notes.append(
                f"{line['case']}: hidden {hidden} ({truth.gap:.2f} sigma, {truth.rate_hz:g} Hz), called {called}"
            )
    return Score(_rates(tally, shrinks), dict(matrix), tuple(shrinks), tuple(notes))


def _judge(truth: Truth, line: Mapping[str, Any], serious: Sequence[Mapping[str, Any]], tally: Counter[str]) -> bool:
    """Counts one case with something hidden; returns whether it is right."""
    verdict = line["verdict"]
    if len(truth.effects) > 1:
        good = all(any(matches(f, effect, joint) for f in serious) for effect, joint in truth.effects)
        count = "two" if len(truth.effects) == 2 else "three"
        right = all(any(belongs(f, effect, joint) for effect, joint in truth.effects) for f in serious)
        held = in_set(line, truth)
        tally.update({count: 1, f"{count} good": int(good), f"{count} right": int(right), f"{count} set": int(held)})
        return good if count == "two" else good and right
    effect, joint = truth.effects[0]
    if not catalogued(effect):
        # An external force that is called one is no false name.
        good = (verdict == "unknown" and not serious) or bool(
            serious and all(matches(f, effect, joint) for f in serious)
        )
        tally.update({"outside": 1, "outside good": int(good), "outside unknown": int(verdict == "unknown")})
        return good
    speed = "fast" if truth.rate_hz >= 50 else "slow"
    right = bool(serious) and same_class(str(serious[0]["effect"]), effect)
    tally.update({speed: 1, f"{speed} good": int(right), "set": 1, "set good": int(in_set(line, truth))})
    tally["exact"] += int(bool(serious) and serious[0]["effect"] == effect)
    tally["refused"] += int(not serious)
    if right and joint is not None:
        tally.update({"joint": 1, "joint good": int(serious[0].get("joint") == joint)})
    return right and (joint is None or serious[0].get("joint") == joint)


def _gaps(line: Mapping[str, Any], refused: bool, tally: Counter[str], shrinks: list[float]) -> None:
    test, interval = line["gap"].get("test"), line["gap"].get("ratio_interval")
    if refused or line["verdict"] == "error" or not test:
        return
    before, after = (rms(x) for x in test)
    shrink = 1 - after / before if before > 0 else 0.0
    shrinks.append(shrink)
    below = bool(interval) and float(np.max(interval)) < 1
    tally.update({"gap": 1, "gap good": int(shrink >= 0.6 and below)})


def rms(values: Any) -> float:
    """Root of the mean square of a gap: one number, or one a joint."""
    return float(np.sqrt(np.mean(np.square(np.atleast_1d(values)))))


def _rates(tally: Counter[str], shrinks: Sequence[float]) -> tuple[Rate, ...]:
    median = bool(shrinks) and float(np.median(shrinks)) >= 0.6
    rows = (
        ("right class, 50 Hz and more", "fast good", "fast", 0.95, False),
        ("right class, below 50 Hz", "slow good", "slow", 0.85, False),
        ("right class within the reported set", "set good", "set", 0.98, False),
        ("right joint of a right class", "joint good", "joint", 0.95, False),
        ("effect outside the catalogue refused", "outside good", "outside", 0.95, False),
        ("a name on a clean plant", "clean false", "clean", 0.01, True),
        ("both of two effects found", "two good", "two", 0.90, False),
        ("all of three effects found", "three good", "three", 0.80, False),
        ("no false name beside three effects", "three right", "three", 0.97, False),
    )
    rates = [Rate(name, tally[good], tally[count], bar, most) for name, good, count, bar, most in rows]
    rates.append(Rate("median held-out gap shrinks by 60 %", int(median), int(bool(shrinks)), 1.0))
    # Without a bar of their own: printed to be seen.
    seen = (
        (SHRINKS_SURELY, "gap good", "gap"),
        ("all of three effects found or in a set", "three set", "three"),
        ("exactly the hidden effect", "exact", "set"),
        ("effect outside the catalogue answered *unknown*", "outside unknown", "outside"),
        ("nothing named though an effect was there", "refused", "set"),
        ("clean plants with another answer than *nothing*", "clean not nothing", "clean"),
    )
    return (*rates, *(Rate(name, tally[good], tally[count], None) for name, good, count in seen))


def text(found: Score) -> str:
    """The rates, the matrix and the cases that went wrong, for the terminal."""
    rows = []
    for rate in found.rates:
        bar = "" if rate.bar is None else f"{'<=' if rate.most else '>='} {100 * rate.bar:3.0f} %"
        share = f"{100 * rate.share:5.1f} %" if rate.count else "      -"
        mark = "      " if rate.bar is None else ("  ok  " if rate.passed else " FAIL ")
        rows.append(f"{mark} {rate.name:<50} {share}  {rate.good:4d} of {rate.count:<4d} {bar}")
    if found.shrinks:
        rows.append(f"       held-out gap shrinks by {100 * float(np.median(found.shrinks)):.0f} % (median)")
    rows += ["", f"{'hidden':<44} called (cases)"]
    for hidden in sorted({key[0] for key in found.matrix}):
        called = sorted(((n, name) for (h, name), n in found.matrix.items() if h == hidden), reverse=True)
        rows.append(f"{hidden:<44} " + ", ".join(f"{name} {n}" for n, name in called))
    rows += ["", "Not right:", *(found.notes or ("none",))]
    return "\n".join(row.rstrip() for row in rows)
