"""The verdict of a discovery: what the model lacks, and how much adding it improves the model."""

from __future__ import annotations

from math import inf

from fmu_didim.report.discovery.curves import curve_words
from fmu_didim.report.discovery.regions import strongest_regions
from fmu_didim.report.discovery.texts import gap_text, location, value_line
from fmu_didim.report.numbers import capitalised
from fmu_didim.report.verdict import Banner, acknowledged_text, conditions_text
from fmu_didim.results.findings import FindingResult, FindingsDocument, GapPair

HEADS = {
    "nothing": ("good", "NOTHING MISSING"),
    "named": ("good", "NAMED"),
    "undecided": ("doubtful", "NOT DECIDED"),
    "named_with_remainder": ("doubtful", "NAMED IN PART"),
    "unknown": ("refused", "UNKNOWN"),
    "disagreement": ("doubtful", "THE EXPERIMENTS DO NOT AGREE"),
    "unfinished": ("doubtful", "NOT FINISHED"),
}
DOUBTED = {"nothing": "NOTHING FOUND", "named": "NAMED, WITH DOUBTS"}
"""Heads of good answers that the verdict doubts."""


def verdict_of(document: FindingsDocument) -> Banner:
    """The verdict in sentences."""
    grade, head = HEADS[document.answer]
    if document.verdict != "valid" and document.answer in DOUBTED:
        grade, head = "doubtful", DOUBTED[document.answer]
    sentences = [capitalised(document.text)]
    if document.unfinished is not None:
        sentences += [f"{document.unfinished.text} {document.unfinished.next_step}".rstrip(".")]
    if document.findings:
        sentences.append("; ".join(_named(f, first=k == 0) for k, f in enumerate(document.findings)))
    judged = _experiments(document, "validation") or _experiments(document, "estimation")
    if judged:
        label = max(judged, key=lambda label: _size(document.gap[label].after))
        of = (", ".join(document.outputs) or "the torque") if document.channels else ""
        sentences.append(_change(document.gap[label], _data(document, label), bool(document.findings), of=of))
        of_channels = [
            f"of {name} {gap_text(pair.before)}" + (f" → {gap_text(pair.after)}" if document.findings else "")
            for name, channel in document.channels.items() if (pair := channel.gap.get(label)) is not None
        ]  # fmt: skip
        if of_channels:
            sentences[-1] += f"; {', '.join(of_channels)}"
    if document.answer == "named_with_remainder":
        sentences += _remainder(document)
    if document.answer == "unknown" and not document.outputs:
        worst = strongest_regions(document, count=1)
        sentences += [f"Most of it: {worst[0]}" if worst else "It shows in no region of its own"][
            : not document.outputs
        ]
    if without_name := [
        curve_words(c) for c in document.curves if document.answer in ("unknown", "named_with_remainder")
    ]:
        sentences.append(f"Its form: {'; '.join(without_name)}")
    sentences += map(capitalised, acknowledged_text(document.acknowledged))
    lines = [". ".join(sentences) + ".", *conditions_text(document.conditions, listed="Notes")]
    return Banner(grade, head, "\n".join(lines), document.reasons)


def _named(finding: FindingResult, *, first: bool) -> str:
    if not finding.joint:
        found = ", ".join(f"{p.name} = {value_line(p)}" for p in finding.parameters)
        either = "; or ".join(rival.title for rival in finding.ambiguous)
        text = f"{finding.title}: {either or found}"
        return capitalised(text) if first else text
    where = location(finding.effect, finding.joint)
    text = f"{capitalised(where) if first else where}: {finding.title}"
    if count := len(finding.ambiguous):
        others = "another one" if count == 1 else f"one of {count} others"
        text += f" (or {others} that these data cannot tell from it)"
    return text


def _experiments(document: FindingsDocument, role: str) -> list[str]:
    """Labels of the experiments that have this role."""
    return [label for label in document.gap if document.roles.get(label) == role]


def _data(document: FindingsDocument, label: str) -> str:
    """The name of the data of an experiment, with its label if there are several of the role."""
    role = document.roles[label]
    data = "held-out data" if role == "validation" else "estimation data"
    several = _experiments(document, role)
    return data if len(several) == 1 else f"the {data} that fit worst, {label},"


def _size(gap: float | None) -> float:
    return inf if gap is None else gap


def _change(pair: GapPair, data: str, changed: bool, *, of: str) -> str:
    """How a gap changes; ``of``: whose it is, where there are others beside it."""
    on = f"of {of} on {data}" if of else f"on {data}"
    if not changed:
        return f"The gap {on} is {gap_text(pair.before)} times the noise"
    if pair.before is None or pair.after is None:
        which = "base" if pair.before is None else "final"
        return f"The {which} model cannot be simulated {on}"
    before, after = gap_text(pair.before), gap_text(pair.after)
    if of and before == after:
        return f"The gap {on} stays at {after} times the noise"
    how = "falls" if pair.after < pair.before else "does not fall: it goes"
    return f"The gap {on} {how} from {before} to {after} times the noise"


def _remainder(document: FindingsDocument) -> list[str]:
    """The joint with the largest remaining gap."""
    fitted = _experiments(document, "estimation")
    left = {
        (label, j): v
        for label in fitted
        for j, v in enumerate(document.gap[label].after_per_joint, start=1)
        if v is not None
    }
    if len({j for _, j in left}) < 2:
        return []
    label, worst = max(left, key=lambda place: left[place])
    on = "on estimation data" if len(fitted) == 1 else f"in the experiment {label}"
    where = document.outputs[worst - 1] if document.outputs else f"joint {worst}"
    return [f"Most of what remains is on {where}: {gap_text(left[label, worst])} times the noise {on}"]
