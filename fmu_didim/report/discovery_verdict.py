"""The verdict of a discovery: what the model lacks, and what adding it is worth."""

from __future__ import annotations

from fmu_didim.discovery.findings import FindingResult, FindingsDocument, GapPair
from fmu_didim.report.discovery_regions import strongest_regions
from fmu_didim.report.discovery_words import gap_text, located
from fmu_didim.report.verdict import Verdict

HEADS = {
    "nothing": ("good", "NOTHING MISSING"),
    "named": ("good", "NAMED"),
    "named_with_remainder": ("doubtful", "NAMED IN PART"),
    "unknown": ("refused", "UNKNOWN"),
}


def verdict_of(document: FindingsDocument) -> Verdict:
    """The verdict as a sentence for the one who runs the drive."""
    grade, head = HEADS[document.verdict]
    sentences = [document.text[:1].upper() + document.text[1:]]
    if document.findings:
        sentences.append("; ".join(_named(f, first=k == 0) for k, f in enumerate(document.findings)))
    held_out = [label for label, role in document.roles.items() if role == "validation"]
    label = next(iter(held_out or document.gap), "")
    if label:
        sentences.append(_change(document.gap[label], label, bool(document.findings)))
    if document.verdict == "named_with_remainder":
        sentences += _remainder(document)
    if document.verdict == "unknown":
        worst = strongest_regions(document, count=1)
        sentences += [f"Most of it: {worst[0]}" if worst else "It shows in no region of its own"]
    return Verdict(grade, head, ". ".join(sentences) + ".")


def _named(finding: FindingResult, *, first: bool) -> str:
    others = len(finding.ambiguous)
    where = located(finding.effect, finding.joint)
    text = f"{where[:1].upper() + where[1:] if first else where}: {finding.title}"
    if others:
        text += (
            f" (or {'another one' if others == 1 else f'one of {others} others'} that these data cannot tell from it)"
        )
    return text


def _change(pair: GapPair, experiment: str, changed: bool) -> str:
    on = f"on {experiment} data"
    if not changed:
        return f"The gap {on} is {gap_text(pair.before)} times the noise"
    if pair.before is None or pair.after is None:
        which = "base" if pair.before is None else "final"
        return f"The {which} model cannot be simulated {on}"
    how = "falls" if pair.after < pair.before else "does not fall: it goes"
    return f"The gap {on} {how} from {gap_text(pair.before)} to {gap_text(pair.after)} times the noise"


def _remainder(document: FindingsDocument) -> list[str]:
    """Where most of what is left lies."""
    pair = document.gap.get(next(iter(document.gap), ""))
    left = {j: v for j, v in enumerate(pair.after_per_joint if pair else [], start=1) if v is not None}
    if len(left) < 2:
        return []
    worst = max(left, key=lambda j: left[j])
    return [f"Most of what remains is on joint {worst}: {gap_text(left[worst])} times the noise on estimation data"]
