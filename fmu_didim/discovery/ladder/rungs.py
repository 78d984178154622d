"""The evidence ladder of an effect: which rungs it has climbed, which contradict it, and which these data leave open.

    1 seen in the fit   2 on another motion, held out   3 with another load, gain or speed   4 on another unit or day

A rung counts the runs that differ from the first fitted one in what it asks for
(:mod:`fmu_didim.discovery.ladder.facts`). It is *climbed* where one of them shows the effect and none shows that it is
absent, *contradicted* where one does, else *open*: there is no such run, or those that there are do not excite the
effect or do not decide.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fmu_didim.discovery.ladder.evidence import Evidence
from fmu_didim.discovery.ladder.facts import OTHER_GAIN, OTHER_LOAD, OTHER_SPEED, RunFacts
from fmu_didim.discovery.ladder.motions import MOSTLY_NEW
from fmu_didim.discovery.selection.decide import SMALLEST_GAIN
from fmu_didim.results.findings import LEVELS, Rung, RungEvidence, RungResult, RungState

CHOSEN = "{0} candidates had to pass this test, so that it is no blind one"
COPY = "the log of {0} is that of a fitted run, or a part of it, and says nothing"
DIFFERS = "Look at what differs in {0}, and whether another effect explains all runs."
NOT_EXCITED = f"at least {SMALLEST_GAIN:g} of the noise of what only the effect can make"


def ladder_of(
    seen: str,
    facts: Mapping[str, RunFacts],
    evidence: Mapping[str, Evidence],
    *,
    joint: int | None,
    candidates: int = 0,
) -> list[RungResult]:
    """The rungs of an effect, the lowest first.

    Args:
        seen: what the fit says of it; facts, evidence: of each run, by label.
        joint: of the effect, from 1; None where it concerns the whole log.
        candidates: number of those that were fitted, of which the held-out runs have chosen.
    """
    fitted = [label for label, one in facts.items() if one.role == "estimation"]
    several = [label for label in fitted if label in evidence] if len(fitted) > 1 else []
    parts = [f"{label}: {evidence[label].text}" for label in several]
    against = [label for label in several if evidence[label].says == "no"]
    state: RungState = "contradicted" if against else "climbed"
    found = [_rung("fit", state, "; ".join([seen, *parts]), fitted, evidence, DIFFERS.format(", ".join(against)))]
    evidence = {label: one for label, one in evidence.items() if not facts[label].is_copied}
    found.append(_held_out(facts, evidence, candidates))
    for rung, (differing, why, next_step) in _conditions(facts, fitted[0], joint).items():
        found.append(_judged(rung, differing, evidence, facts, why, next_step))
    return found


def _rung(
    rung: Rung, state: RungState, text: str, labels: Sequence[str], evidence: Mapping[str, Evidence],
    next_step: str = "",
) -> RungResult:  # fmt: skip
    own = [_saved(label, evidence[label]) for label in labels if label in evidence]
    return RungResult(
        level=LEVELS[rung], rung=rung, state=state, text=text, next_step="" if state == "climbed" else next_step,
        evidence=own,
    )  # fmt: skip


def _saved(label: str, one: Evidence) -> RungEvidence:
    size, ratio = one.amplitude, one.ratio
    return RungEvidence(
        experiment=label, says=one.says, differs=one.differs,
        excited=None if size is None else size.size, size=None if size is None else size.value,
        interval=None if size is None else (size.low, size.high), ratio=None if ratio is None else ratio.value,
        ratio_interval=None if ratio is None else (ratio.low, ratio.high),
    )  # fmt: skip


def state_of(evidence: Sequence[Evidence]) -> RungState:
    """The state of a rung by the runs that count for it."""
    says = {one.says for one in evidence}
    if "no" in says:
        return "contradicted"
    return "climbed" if "yes" in says else "open"


def _judged(
    rung: Rung, labels: Sequence[str], evidence: Mapping[str, Evidence], facts: Mapping[str, RunFacts], why: str,
    next_step: str,
) -> RungResult:  # fmt: skip
    """A rung by the runs that differ in what it asks for; ``why``: what is said where there are none."""
    own = [label for label in labels if label in evidence]
    if not own:
        return _rung(rung, "open", why, (), evidence, next_step)
    state = state_of([evidence[label] for label in own])
    role = {"estimation": "fitted", "validation": "held out"}
    text = "; ".join(f"{label} ({role[facts[label].role]}): {evidence[label].text}" for label in own)
    if state == "open":
        next_step = f"Excite it there: {NOT_EXCITED}, for longer. {next_step}"
    if state == "contradicted":
        next_step = DIFFERS.format(", ".join(label for label in own if evidence[label].says == "no"))
    return _rung(rung, state, text, own, evidence, next_step)


def _held_out(facts: Mapping[str, RunFacts], evidence: Mapping[str, Evidence], candidates: int) -> RungResult:
    """The rung of another motion that was held out."""
    held = [label for label, one in facts.items() if one.role == "validation" and label in evidence]
    new = [label for label in held if facts[label].new >= MOSTLY_NEW]
    repeated = [label for label in held if label not in new]
    next_step = "Hold out a run with another motion (role: validation) that excites the effect."
    copies = [label for label, one in facts.items() if one.role == "validation" and one.is_copied]
    why = COPY.format(", ".join(copies)) if copies else "" if held else "no run is held out"
    found = _judged("held_out", new, evidence, facts, why, next_step)
    told = [found.text, *(_repeat(label, facts[label], evidence[label]) for label in repeated)]
    if any(evidence[label].says == "no" for label in repeated):
        found = _judged("held_out", held, evidence, facts, "", next_step)
    elif not new:
        found = _rung("held_out", "open", why, repeated, evidence, next_step)
    if candidates and any(evidence[label].says == "yes" for label in held):
        told.append(CHOSEN.format(candidates))
    return found.model_copy(update={"text": ". ".join(part for part in told if part)})


def _repeat(label: str, facts: RunFacts, evidence: Evidence) -> str:
    """What is said of a held-out run with the motion of a fitted one."""
    beside = f", with {', '.join(facts.injected)} added," if facts.injected else ""
    return (
        f"{label} repeats the motion of a fitted run{beside} in {100 * (1 - facts.new):.0f} % of its time, so that it "
        f"tells noise from an effect, but not whether that holds on another motion; there {evidence.text}"
    )


def _conditions(facts: Mapping[str, RunFacts], first: str, joint: int | None) -> dict[Rung, tuple[list[str], str, str]]:
    """Rung -> the runs that differ in what it asks for, why there are none, and what would climb it."""
    others = {label: one for label, one in facts.items() if label != first}
    where = "the joints" if joint is None else f"joint {joint}"
    loads = {label: one.load_of(joint) for label, one in others.items()}
    speeds = {label: one.speed_of(joint) for label, one in others.items()}
    heaviest = max(loads.values(), default=0.0)
    load = (
        f"a load changes the torque of {where} by {100 * heaviest:.2g} % at most, less than {100 * OTHER_LOAD:.0f} %"
        if heaviest > 0 else "no run carries another load"
    )  # fmt: skip
    known = [ratio for ratio in speeds.values() if ratio == ratio]
    furthest = max(known, key=lambda ratio: abs(np.log(ratio)), default=1.0)
    speed = (
        f"no run moves {where} {OTHER_SPEED:g} times as fast or as slow as {first} ({furthest:.2g} times at most)"
        if known else f"there is no other run that moves {where}"
    )  # fmt: skip
    return {
        "load": (
            [label for label, size in loads.items() if size >= OTHER_LOAD], load,
            "Repeat the motion with another load (load: {} in that experiment, or what is known of it).",
        ),
        "gain": (
            [label for label, one in others.items() if one.gains],
            f"all runs have the same controller, to {100 * OTHER_GAIN:.0f} %",
            "Repeat the motion with other gains (gains: {...} in that experiment).",
        ),
        "speed": (
            [k for k, ratio in speeds.items() if ratio >= OTHER_SPEED or ratio <= 1 / OTHER_SPEED], speed,
            f"Move {where} {OTHER_SPEED:g} times as fast or as slow.",
        ),
        "unit": _specimen("unit", {label: one.unit for label, one in facts.items()}, first),
        "day": _specimen("day", {label: one.day.isoformat() if one.day else "" for label, one in facts.items()}, first),
    }  # fmt: skip


def _specimen(what: str, known: Mapping[str, str], first: str) -> tuple[list[str], str, str]:
    """The runs of another unit or day than the first one: unknown is not another."""
    key, where = {"unit": ("unit", "another unit"), "day": ("date", "another day")}[what]
    other = [label for label, own in known.items() if own and known[first] and own != known[first]]
    unknown = [label for label, own in known.items() if not own]
    if unknown:
        be = "is" if len(unknown) == 1 else "are"
        why = f"the case does not say of which {what} {', '.join(unknown)} {be} ({key}:)"
    else:
        why = f"all runs are of {known[first]}"
    return other, why, f"Repeat a run on {where}, and state {key}: of each."
