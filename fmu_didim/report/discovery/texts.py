"""The texts of a discovery."""

from __future__ import annotations

import math

from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.report.experiments import with_role
from fmu_didim.report.numbers import (
    MISSING,
    ParameterText,
    percent_std,
    percentage,
    pretty_unit,
    rounding,
    significant,
)
from fmu_didim.results.findings import (
    FindingResult,
    FindingsDocument,
    GapPair,
    Rival,
    RungResult,
    ValueFound,
)

SIGNALS, SIMULATED = "signals_", "simulated_"
"""Prefixes of the keys of files, before the label of an experiment: torques at its samples, and simulated ones at every
control period."""

OUTPUT_WINDOWS = (
    " What is measured beyond it may have acted on the machine or on the sensor, or the model is wrong there: what "
    "comes back at the same place of the same motion is the model's. Begin and end: half of the largest value, with "
    "95 % intervals by what the model leaves elsewhere."
)


def experiment_name(document: FindingsDocument, label: str) -> str:
    """An experiment with its role, if its label does not say it."""
    return with_role(label, document.roles.get(label))


def edge(at_s: float, interval: tuple[float, float] | None) -> str:
    """When a window begins or ends, with its interval where it has one."""
    if interval is None:
        return f"{at_s:.6g} s"
    return f"{at_s:.6g} s ({interval[0]:.6g} to {interval[1]:.6g})"


def gap_text(gap: float | None) -> str:
    """A gap with at most two decimals."""
    if gap is None or not math.isfinite(gap):
        return MISSING
    return f"{gap:.2f}" if gap < 99.5 else significant(gap)


def step_text(pair: GapPair | None, *, changed: bool = True) -> str:
    """Gap before and after; only one if the model was not changed."""
    if pair is None:
        return MISSING
    return f"{gap_text(pair.before)} → {gap_text(pair.after)}" if changed else gap_text(pair.before)


def share_text(share: float | None) -> str:
    """A fraction, in percent."""
    return MISSING if share is None or not math.isfinite(share) else f"{significant(100 * share, 2)} %"


def interval_text(interval: tuple[float | None, float | None] | None) -> str:
    """An interval of a ratio."""
    return MISSING if interval is None else f"{significant(interval[0], 2)} to {significant(interval[1], 2)}"


RUNGS: dict[str, str] = {
    "fit": "seen in the fit", "held_out": "another motion", "load": "other load", "gain": "other gains",
    "speed": "other speed", "unit": "other unit", "day": "other day",
}  # fmt: skip
"""Rung of the evidence ladder -> what it is called."""
STATES: dict[str, str] = {"climbed": "yes", "contradicted": "NO", "open": "open"}


def rung_title(rung: RungResult) -> str:
    """A rung with its height."""
    return f"{rung.level} {RUNGS[rung.rung]}"


def value_text(found: ValueFound) -> ParameterText:
    """The texts of a parameter; dashes if the data do not bound it."""
    std = math.nan if found.std is None else found.std
    digits = rounding(found.value, std)
    low, high = found.interval
    bounded = low is not None and high is not None
    return ParameterText(
        name=found.name, value=digits.text(found.value), unit=pretty_unit(found.unit),
        std=digits.deviation(std) if math.isfinite(std) else MISSING,
        percent=percent_std(100 * std / abs(found.value) if found.value else None),
        interval=(MISSING if low is None else digits.text(low), MISSING if high is None else digits.text(high)),
        insignificant=found.std != 0 and (not bounded or (low or 0.0) <= 0.0 <= (high or 0.0)),
    )  # fmt: skip


def value_line(found: ValueFound) -> str:
    """A parameter with its standard deviation and interval, without its name."""
    shown = value_text(found)
    low, high = shown.interval
    if found.std == 0:
        return f"{shown.value} {shown.unit}".rstrip() + ", held at a screened value"
    if low == high == MISSING:
        return f"({shown.value} ± {shown.std}) {shown.unit}".rstrip() + ", not bounded by the data"
    return f"({shown.value} ± {shown.std}) {shown.unit}".rstrip() + f", 95 % interval {low} to {high}"


def location(effect: str, joint: int) -> str:
    """The location of an effect: its joint, or the whole log."""
    return "whole log" if effect in EFFECTS and EFFECTS[effect].is_of_log else f"joint {joint}"


def finding_title(finding: FindingResult | Rival) -> str:
    """Title and location of an effect that was found; on a model alone its title says where."""
    return f"{finding.title}, {location(finding.effect, finding.joint)}" if finding.joint else finding.title


def behind_text(rival: Rival, finding: FindingResult) -> str:
    """How far a rival is behind the best, and of how much the best gains: no form is exact, and nine tenths of a large
    gain are as good."""
    if rival.bic_behind is None:
        return "same class"
    # The first of a set that is undecided is the one that was added; it may itself be behind another.
    added = finding.ambiguous[0].bic_behind if finding.effect == "undecided" else 0.0
    best = finding.delta_bic + (added or 0.0)
    return f"BIC {significant(rival.bic_behind, 2)} behind, of {significant(best)}"


def candidate_title(effect: str, joint: int, signal: str = "") -> str:
    """Name and location of a candidate; on a model alone its signal, where its name does not say it."""
    if not joint:
        return f"{effect} of {signal}" if signal else effect
    return f"{effect.replace('_', ' ')}, {location(effect, joint)}"


def output_title(document: FindingsDocument, j: int) -> str:
    """What column ``j``, from 0, is: a joint, or an output of a model."""
    return document.outputs[j] if document.outputs else f"joint {j + 1}"


def error_text(before: float | None, after: float | None, *, changed: bool = True) -> str:
    """Relative torque error before and after; only one if the model was not changed."""
    return f"{percentage(before)} → {percentage(after)}" if changed else percentage(before)
