"""The texts of a discovery."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.report.experiments import with_role
from fmu_didim.report.numbers import (
    MISSING,
    ParameterText,
    joint_unit,
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
    NoiseResult,
    Rival,
    ValueFound,
    WindowResult,
)

FILES = {
    "robot": "robot description with the effects",
    "plant_fmu": "plant with the effects, FMU",
    "reference_next": "proposed next experiment",
}


SIGNALS, SIMULATED = "signals_", "simulated_"
"""Prefixes of the keys of files, before the label of an experiment: torques at its samples, and simulated ones at every
control period."""


def file_title(key: str) -> str:
    """The description of a file by its key."""
    for begin, title in ((SIGNALS, "torques"), (SIMULATED, "simulated torques, every control period")):
        if key.startswith(begin):
            return f"{title}, {key.removeprefix(begin)}"
    return FILES.get(key, key)


def experiment_name(document: FindingsDocument, label: str) -> str:
    """An experiment with its role, if its label does not say it."""
    return with_role(label, document.roles.get(label))


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


def value_text(found: ValueFound) -> ParameterText:
    """The texts of a parameter; dashes if the data do not bound it."""
    std = math.nan if found.std is None else found.std
    digits = rounding(found.value, std)
    low, high = found.interval
    bounded = low is not None and high is not None
    return ParameterText(
        name=found.name,
        value=digits.text(found.value),
        std=digits.deviation(std) if math.isfinite(std) else MISSING,
        percent=percent_std(100 * std / abs(found.value) if found.value else None),
        unit=pretty_unit(found.unit),
        interval=(MISSING if low is None else digits.text(low), MISSING if high is None else digits.text(high)),
        insignificant=found.std != 0 and (not bounded or (low or 0.0) <= 0.0 <= (high or 0.0)),
    )


def value_line(found: ValueFound) -> str:
    """A parameter with its standard deviation and interval, without its name."""
    shown = value_text(found)
    low, high = shown.interval
    if found.std == 0:
        return f"{shown.value} {shown.unit}".rstrip() + ", held at a screened value"
    if low == high == MISSING:
        return f"({shown.value} ± {shown.std}) {shown.unit}".rstrip() + ", not bounded by the data"
    return f"({shown.value} ± {shown.std}) {shown.unit}".rstrip() + f", 95 % interval {low} to {high}"


def rival_text(rival: Rival) -> str:
    """An effect that may explain the same part of the gap."""
    why = "same class" if rival.bic_behind is None else f"BIC {significant(rival.bic_behind, 2)} behind"
    return f"{rival.title}, {location(rival.effect, rival.joint)} ({why})"


def location(effect: str, joint: int) -> str:
    """The location of an effect: its joint, or the whole log."""
    return "whole log" if effect in EFFECTS and EFFECTS[effect].is_of_log else f"joint {joint}"


def finding_title(finding: FindingResult) -> str:
    """Title and location of an effect that was found."""
    return f"{finding.title}, {location(finding.effect, finding.joint)}"


def experiment_head(finding: FindingResult) -> str:
    """The purpose of the proposed experiment."""
    return "to split them" if finding.ambiguous else "to confirm it"


def window_line(window: WindowResult, units: Sequence[str]) -> str:
    """An interval of time with an additional torque."""
    size = f"{significant(window.torque, 2)} {joint_unit(units, window.joint - 1)}"
    times = f"{window.begin_s:.6g} s to {window.end_s:.6g} s"
    score = significant(window.score, 2)
    return f"joint {window.joint}: {times}, {size} ({score} standard deviations), {window.experiment}"


def noise_source(noise: NoiseResult) -> str:
    """How the noise was estimated."""
    if noise.source == "periods" and noise.period_s is not None:
        return f"difference of {noise.periods} periods of {significant(noise.period_s)} s"
    return {"residual": "residual above the frequencies of the motion"}.get(noise.source, noise.source)


def refused_line(refused: tuple[str, int, str]) -> str:
    """A candidate that was not accepted, and why."""
    effect, joint, why = refused
    return f"{candidate_title(effect, joint)}: {why}"


def candidate_title(effect: str, joint: int) -> str:
    """Name and location of a candidate."""
    return f"{effect.replace('_', ' ')}, {location(effect, joint)}"


def error_text(before: float | None, after: float | None, *, changed: bool = True) -> str:
    """Relative torque error before and after; only one if the model was not changed."""
    return f"{percentage(before)} → {percentage(after)}" if changed else percentage(before)
