"""From a contest of laws to what is said of its winner: ties, gains with deviations, doubts, refusal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.distributions import f_sf
from fmu_didim.data.signals import Array
from fmu_didim.workflow.naming.catalogue import EQUAL_EFFECT, SPECIAL_OF, Candidate, same_in_effect
from fmu_didim.workflow.naming.contest import Contest, Entry
from fmu_didim.workflow.naming.findings import (
    CLOCK_REBUILT,
    CLOCKS_APART,
    DELAY_OR_CLOCK,
    INTEGRATOR_UNSEEN,
    LIMITED,
    NOT_DETERMINED,
    RATE_ASSUMED,
    SAME_IN_EFFECT,
    SCALED,
    TIED,
    UNEXPLAINED,
)
from fmu_didim.workflow.naming.in_loop import LoopEntry
from fmu_didim.workflow.naming.logs import Logs
from fmu_didim.workflow.naming.named import INTERVAL, Gain, Member
from fmu_didim.workflow.naming.regression import JointFit, JointProblem

NEAR = 6.0
"""[1] J + 2 (free values), or BIC, above the least within which a law is not excluded: odds of 20 to 1. By the second a
simpler law stays beside one that chance, which has many laws to choose from, lets look a little better."""
BY_CHANCE = 1e-4
"""[1] Chance with which a right law would be refused at a joint."""
LEAST_EXCESS = 1.12
"""[1] Variance over that of the noise, below which what a law leaves is none of its business: small differences between
a spline and the velocity that a controller measures."""
WIDE = 1.0
"""[1] Half of the 95 % interval of a gain over the gain, from which it is not determined."""
SHIFTS = (-2, -1, 1, 2)
"""[control periods] By which the torque is moved where no law fits."""
ALIKE = 3.0
"""[standard deviations] Within which gains are those of the case times one factor."""


def excess(problem: JointProblem, fit: JointFit) -> tuple[float, float]:
    """Variance that a law leaves at the frequencies of the motion over that of the noise, and the chance of as much.

    The noise is that of the contest, or what is left above the frequencies of the motion, whichever is larger: both are
    estimates.
    """
    freedom = max(fit.samples - fit.count, 1)
    ratio = fit.cost / freedom
    if fit.beyond_samples:
        ratio /= max(fit.beyond / fit.beyond_samples, 1.0)
    return ratio, float(f_sf(ratio, freedom, max(fit.beyond_samples, freedom)))


class Contestant(Protocol):
    """What was fitted: a candidate, and how well."""

    @property
    def candidate(self) -> Candidate: ...

    @property
    def akaike(self) -> float: ...

    @property
    def bic(self) -> float: ...


Fitted = TypeVar("Fitted", bound=Contestant)


def near_best(entries: Sequence[Fitted]) -> list[Fitted]:
    """What the data do not exclude: by -2 log likelihood + 2 (free values), or by BIC, within ``NEAR`` of the least."""
    akaike, bic = min(entry.akaike for entry in entries), min(entry.bic for entry in entries)
    return [entry for entry in entries if entry.akaike - akaike <= NEAR or entry.bic - bic <= NEAR]


def tied(entries: Sequence[Fitted]) -> list[Fitted]:
    """The winner, and the laws that the data do not exclude. Left out is what only adds an extra or a gain to one that
    is in.
    """
    near = [entries[0], *(entry for entry in near_best(entries) if entry is not entries[0])]
    known = [entry.candidate for entry in near]
    others = [entry for entry in near[1:] if not any(_adds(entry.candidate, other) for other in known)]
    return [near[0], *sorted(others, key=lambda one: one.akaike)]


def _adds(candidate: Candidate, other: Candidate) -> bool:
    """Whether a candidate is another one with more extras, or with gains that the other holds."""
    same = candidate.rate == other.rate and set(other.extras) <= set(candidate.extras)
    more = candidate.law is other.law and candidate.extras != other.extras
    return same and (more or candidate.law.name in SPECIAL_OF[other.law.name])


def deviations(problem: JointProblem, fit: JointFit) -> dict[str, float]:
    """Standard deviation of each value."""
    return dict(zip(fit.values, map(float, problem.deviations(fit)), strict=True))


def of_gains(gains: Sequence[Gain]) -> Iterator[Diagnostic]:
    """Gains that the log does not determine."""
    for gain in gains:
        half = INTERVAL * gain.deviation
        if half >= WIDE * abs(gain.value):
            low, high = gain.interval
            yield Diagnostic(
                NOT_DETERMINED, f"{gain.name} is {gain.value:.3g}, anything from {low:.3g} to {high:.3g}.",
                f"joint {gain.joint}", half / max(abs(gain.value), 1e-300), WIDE,
            )  # fmt: skip


def of_the_law(logs: Logs, members: Sequence[Member]) -> Iterator[Diagnostic]:
    """What is to be known of a law that fits; ``members``: those that the data do not exclude, the winner first."""
    tied_with = [member.candidate for member in members]
    best = tied_with[0]
    different = [other.words for other in tied_with[1:] if not same_in_effect(other, best)]
    if different:
        text = f"As good as {best.words}: {'; '.join(different)}."
        yield Diagnostic(TIED, text, value=len(different) + 1.0)
    if {candidate.law.name for candidate in tied_with} >= EQUAL_EFFECT:
        text = (
            "A PID law is the same in effect as a P-PI cascade with whole feed-forward, whose gains Kv, Kp', Ki' give "
        )
        yield Diagnostic(SAME_IN_EFFECT, f"{text}Kp = Kv Kp' + Ki', Ki = Kv Ki', Kd = Kp'.")
    if best.law.name == "P-PI+1":
        for j, own in enumerate(members[0].values, start=1):
            kv, kp, ki = (own[name] for name in ("Kv", "Kp", "Ki"))
            text = f"Kv = {ki / kp:.4g}, Ki = {kv * kp:.4g} is the same in effect as Kv = {kv:.4g}, Ki = {ki:.4g}: "
            text += "with whole feed-forward Kv and Ki/Kp may be exchanged."
            yield Diagnostic(SAME_IN_EFFECT, text, f"joint {j}")
    if "delay" in best.extras:
        yield Diagnostic(DELAY_OR_CLOCK, "The law has a delay, which a late clock of the torque log would look like.")
    if "limit" in best.extras:
        yield Diagnostic(LIMITED, "The command is limited for some of the time.")
    if not logs.rate_is_known:
        yield Diagnostic(
            RATE_ASSUMED, f"The control rate is taken to be {1 / logs.step:.6g} Hz, that of the log.",
            value=1 / logs.step, unit="Hz",
        )  # fmt: skip
    if logs.is_rebuilt:
        yield Diagnostic(CLOCK_REBUILT, "The stamps of the log jitter, and were put right but for a constant.")
    yield from of_gains(members[0].gains)


def of_integrator(contest: Contest, best: Entry) -> Iterator[Diagnostic]:
    """How large an integral gain may be that would not have shown."""
    stronger = {"P": "PID", "PD": "PID", "P-P": "P-PI", "P-P+ff": "P-PI+ff"}.get(best.candidate.law.name)
    entry = next((e for e in contest.ranked if e.candidate.law.name == stronger), None)
    if stronger is None or entry is None:
        return
    for j, (problem, fit) in enumerate(zip(contest.problems, entry.joints, strict=True), start=1):
        most = abs(fit.values["Ki"]) + INTERVAL * deviations(problem, fit)["Ki"]
        outer = fit.values["Kp"]
        if np.isfinite(most) and outer:
            yield Diagnostic(
                INTEGRATOR_UNSEEN, f"An integral gain Ki up to {most:.3g} would not have shown, which acts within "
                f"{abs(outer) / most:.3g} s and more.", f"joint {j}", most,
            )  # fmt: skip


def refusal(contest: Contest, best: Entry, excesses: Sequence[tuple[float, float]]) -> list[Diagnostic]:
    """Why no law is named; empty where the best one leaves noise alone."""
    bad = [
        (j, ratio) for j, (ratio, chance) in enumerate(excesses, start=1) if chance < BY_CHANCE and ratio > LEAST_EXCESS
    ]
    if not bad:
        return []
    found = [
        Diagnostic(
            UNEXPLAINED, f"The best law ({best.candidate.words}) leaves {np.sqrt(ratio):.3g} times the noise.",
            f"joint {j}", float(np.sqrt(ratio)), float(np.sqrt(LEAST_EXCESS)),
        )
        for j, ratio in bad
    ]  # fmt: skip
    shift, left = _shifted(contest, best, bad[0][0] - 1)
    if left < 0.5 * bad[0][1]:
        step = contest.problems[0].runs[0].step
        found.append(Diagnostic(
            CLOCKS_APART, f"With the torque {abs(shift)} control periods ({1000 * abs(shift) * step:.3g} ms) "
            f"{'earlier' if shift > 0 else 'later'}, the law leaves {np.sqrt(left):.3g} times the noise.",
            value=shift * step, unit="s",
        ))  # fmt: skip
    return found


def refusal_in_loop(entry: LoopEntry) -> list[Diagnostic]:
    """Why no law is named by a contest in the loop; empty where the best one leaves white noise."""
    model = entry.fit.model
    names = [*(f"torque of joint {j}" for j in range(1, model.joint_count + 1)), *model.experiments.channels]
    chances = entry.whiteness * len(names)
    text = f"The best law ({entry.candidate.words}), in the loop with the robot of the case, leaves no white noise."
    step = "Check the robot description, too (fmu-didim identify with controller.yaml, fmu-didim discover), or log "
    step += "positions at the control rate: then the law is named whatever the robot is."
    return [
        Diagnostic(UNEXPLAINED, text, name, float(chance), BY_CHANCE, next_step=step)
        for name, chance in zip(names, chances, strict=True)
        if chance < BY_CHANCE
    ]


def _shifted(contest: Contest, best: Entry, j: int) -> tuple[int, float]:
    """By how many ticks the torque of a joint fits best if it is moved, and what the law then leaves."""
    problem, found = contest.problems[j], []
    for shift in SHIFTS:
        moved = replace(problem, runs=tuple(replace(run, rows=run.rows - shift) for run in problem.runs))
        fit = moved.fit(best.candidate, [best.joints[j].values])
        found.append((excess(moved, fit)[0], shift))
    left, shift = min(found)
    return shift, left


def scale_of(gains: Sequence[Gain], guessed: Mapping[str, float]) -> Iterator[Diagnostic]:
    """One factor between the gains that were found and those of the case's own controller of the same law."""
    for j in sorted({gain.joint for gain in gains}):
        own = [gain for gain in gains if gain.joint == j and gain.unit != "s"]
        pairs = [(g.value / guessed[f"{g.name}{j}"], g.deviation / abs(guessed[f"{g.name}{j}"]))
                 for g in own if guessed.get(f"{g.name}{j}")]  # fmt: skip
        if len(pairs) < 2:
            continue
        ratio, deviation = (np.array(column) for column in zip(*pairs, strict=True))
        factor = _weighted(ratio, deviation)
        if np.all(np.abs(ratio - factor) < ALIKE * deviation) and abs(factor - 1) > ALIKE * np.min(deviation):
            yield Diagnostic(
                SCALED, f"All gains are {factor:.4g} times those of the case's controller.", f"joint {j}", factor
            )  # fmt: skip


def _weighted(values: Array, deviation: Array) -> float:
    weight = 1 / deviation**2
    return float(np.sum(weight * values) / np.sum(weight))
