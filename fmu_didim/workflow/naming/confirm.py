"""The second way after the first: laws that a regression named run in the loop with the robot of the case.

The robot may be wrong, which the regression does not depend on. So the loop may only take away: where the best law
leaves white noise there, the robot is right, and laws that tie in the regression and do not in the loop are out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.workflow.naming.catalogue import Candidate, same_in_effect
from fmu_didim.workflow.naming.contest import Entry
from fmu_didim.workflow.naming.in_loop import LoopContest, LoopEntry
from fmu_didim.workflow.naming.logs import Logs
from fmu_didim.workflow.naming.named import Gain, Member
from fmu_didim.workflow.naming.verdict import near_best

WHITE = 1e-4
"""[1] Chance of residuals as alike as these by white noise, from which the robot, or the law, lacks nothing."""
APART = 4.0
"""[standard deviations] Of the difference of two estimates, from which they disagree: one gain of many is seldom so."""
MOST = 6
"""[candidates] That are tried in the loop."""

NOT_CONFIRMED = CATALOGUE(
    "law-not-confirmed", DOUBT, rank=34,
    meaning="The law explains the measured torque by the measured positions. In the closed loop with the robot of the "
    "case it leaves more than white noise, so that this loop could not confirm the gains: the robot description lacks "
    "something, or the noise has a colour.",
    next_step="Identify the robot with this controller, and ask fmu-didim discover what it lacks. Until then a delay "
    "or another way to the velocity may pass for a part of the gains.",
)  # fmt: skip
WAYS_APART = CATALOGUE(
    "law-ways-apart", DOUBT, rank=33,
    meaning="A gain is another one in the closed loop with the robot of the case than from the positions alone.",
    next_step="Check the noise, the clocks and the filters of the logs: something acts on torque and positions that "
    "the law does not have.",
)  # fmt: skip


@dataclass(frozen=True)
class Confirmed:
    """What the loop says of laws that tie.

    Attributes:
        members: the laws that are left, the best first, with gains of the loop where it is fitted.
        in_loop: whether the best leaves white noise there; told: what is to be known.
    """

    members: tuple[Member, ...]
    in_loop: bool
    told: tuple[Diagnostic, ...] = ()


def confirmed(logs: Logs, tied: Sequence[Entry], known: Sequence[Member], progress: Callable[[str], None]) -> Confirmed:
    """Laws that a regression could not tell apart, in the loop; ``known``: with the gains that they have there."""
    contest = LoopContest(logs, progress=progress)
    found: list[LoopEntry] = []
    for entry in tied[:MOST]:
        progress(f"in the loop: {entry.candidate.words}")
        fitted = contest.fit_from(entry.candidate, [fit.values for fit in entry.joints])
        if fitted is not None:
            found.append(fitted)
    white = [entry for entry in found if np.min(entry.whiteness) > WHITE / entry.whiteness.size]
    if not white:
        text = "In the loop with the robot of the case the law leaves more than white noise."
        return Confirmed(tuple(known), False, (Diagnostic(NOT_CONFIRMED, text),))
    out = {entry.candidate for entry in found if entry not in near_best([*white, entry])}
    best = min(white, key=lambda entry: entry.bic)
    try:
        first = contest.member(best)
    except FmuDidimError as error:
        text = f"The loop could not be fitted: {error.what}"
        return Confirmed(tuple(known), False, (Diagnostic(NOT_CONFIRMED, text),))
    kept = (m for m in known if m.candidate not in out or same_in_effect(m.candidate, best.candidate))
    fitted_in_loop = {entry.candidate: entry for entry in white}
    left = [_settled(contest, member, fitted_in_loop) for member in kept if member.candidate != best.candidate]
    told = _apart(known[0].gains, first.gains) if best.candidate == known[0].candidate else ()
    return Confirmed((first, *left), True, tuple(told))


def _settled(contest: LoopContest, member: Member, entries: Mapping[Candidate, LoopEntry]) -> Member:
    """The same law with gains of the loop, where it can be fitted there."""
    try:
        return contest.member(entries[member.candidate]) if member.candidate in entries else member
    except FmuDidimError:
        return member


def _apart(gains: Sequence[Gain], own: Sequence[Gain]) -> Iterator[Diagnostic]:
    for one, other in zip(gains, own, strict=True):
        distance = abs(one.value - other.value) / max(float(np.hypot(one.deviation, other.deviation)), 1e-300)
        if distance > APART:
            text = f"{one.name} is {one.value:.4g} by positions and {other.value:.4g} in the loop."
            yield Diagnostic(WAYS_APART, text, f"joint {one.joint}", distance, APART, "1")
