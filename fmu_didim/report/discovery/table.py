"""A discovery as plain text for the terminal: at most 100 columns, no colours, the verdict first."""

from __future__ import annotations

from collections.abc import Sequence

from fmu_didim.report.discovery import words
from fmu_didim.report.discovery.regions import regions_by_joint
from fmu_didim.report.discovery.verdict import verdict_of
from fmu_didim.report.identification.table import clipped, column, entries, joined, listing, reason_lines, wrapped
from fmu_didim.report.numbers import at, noise_text, significant
from fmu_didim.results.findings import FindingResult, FindingsDocument, GapPair

BAR = 14
"""Characters of the longest bar."""
NAME_WIDTH = 36
SIDE_BY_SIDE = 2
"""Experiments whose gaps stand beside each other; further ones come below."""
SHOWN_REFUSED = 6
SHOWN_WINDOWS = 6


def discovery_table(document: FindingsDocument) -> str:
    """The text shown after a discovery; begins with what is missing in the model."""
    end = verdict_of(document)
    sections = [
        [*wrapped(f"{end.head}: {end.text}", "", "  "), *reason_lines(end), *wrapped(document.name)],
        *(_finding(number, finding) for number, finding in enumerate(document.findings, start=1)),
        _gaps(document),
        listing("Where the base model disagrees", regions_by_joint(document)),
        listing("Windows of time with a torque of their own", _windows(document)),
        _facts(document),
        listing("Not accepted", _refused(document)),
        listing("Not tried", _untried(document)),
        listing("Notes", document.notes),
        listing("Files", [f"{words.file_title(key)}: {name}" for key, name in document.files.items()]),
    ]
    return "\n\n".join("\n".join(section) for section in sections if section) + "\n"


def _finding(number: int, finding: FindingResult) -> list[str]:
    """One named effect: values, what it is worth, what it cannot be told from."""
    head = f"{number}  {words.named(finding)} ({finding.place})"
    rows = [(p.name, words.value_line(p)) for p in finding.parameters]
    rows.append(("share of the gap", words.share_text(finding.share_of_gap)))
    if finding.ratio_interval is not None:
        rows.append(("held-out RMS", f"{words.interval_text(finding.ratio_interval)} of what it was, 95 % interval"))
    rivals = "; ".join(words.rival_text(r) for r in finding.ambiguous) or "nothing in the catalogue"
    rows += [("cannot be told from", rivals), (words.experiment_head(finding), finding.experiment)]
    return [*wrapped(head, "", "   "), *entries(rows, "     ")]


def _gaps(document: FindingsDocument) -> list[str]:
    """Round by round, then base against final model: over all joints and of each one."""
    labels = list(document.gap)
    rows = [
        (f"{number}  {words.named(f)}", [f.gap.get(label) for label in labels])
        for number, f in enumerate(document.findings, start=1)
    ]
    final = [document.gap[label] for label in labels]
    changed = bool(document.findings)
    rows.append(("base → final model" if changed else "base model", list(final)))
    joints = len(document.torque_unit)
    if joints > 1:
        rows += [(f"   joint {j + 1}", [_of_joint(pair, j) for pair in final]) for j in range(joints)]
    longest = max(
        (v for _, pairs in rows for p in pairs if p for v in (p.before, p.after) if v is not None), default=0.0
    )
    lines = []
    for first in range(0, len(labels), SIDE_BY_SIDE):
        chosen = slice(first, first + SIDE_BY_SIDE)
        part = [(name, pairs[chosen]) for name, pairs in rows]
        lines += [*([""] if first else []), *_gap_block(labels[chosen], part, longest, changed=changed)]
    return [*lines, *(["█ what remains, ░ what was closed"] if changed else [])] if labels else []


def _gap_block(
    labels: Sequence[str], rows: Sequence[tuple[str, Sequence[GapPair | None]]], longest: float, *, changed: bool
) -> list[str]:
    """The gaps of a few experiments beside each other."""
    names = [clipped(name, NAME_WIDTH) for name, _ in rows]
    columns = [column("Gap, in times the noise".ljust(NAME_WIDTH), names, left=True)]
    for label, pairs in zip(labels, zip(*(pairs for _, pairs in rows), strict=True), strict=True):
        _, *steps = column("", [words.step_text(pair, changed=changed) for pair in pairs])
        texts = [f"{step}  {_bar(pair, longest)}" for step, pair in zip(steps, pairs, strict=True)]
        columns.append(column(clipped(label, len(texts[0])), texts, left=True))
    return joined(columns)


def _of_joint(pair: GapPair, index: int) -> GapPair:
    before, after = at(pair.before_per_joint, index), at(pair.after_per_joint, index)
    return GapPair(before=before, after=after, before_per_joint=[before], after_per_joint=[after])


def _bar(pair: GapPair | None, longest: float) -> str:
    """What remains, and up to what it was."""
    if pair is None or pair.after is None or longest <= 0:
        return " " * BAR
    remains = round(BAR * pair.after / longest)
    was = round(BAR * pair.before / longest) if pair.before is not None else remains
    return ("█" * remains + "░" * max(was - remains, 0)).ljust(BAR)


def _windows(document: FindingsDocument) -> list[str]:
    lines = [words.window_line(w, document.torque_unit) for w in document.windows[:SHOWN_WINDOWS]]
    return [*lines, *_hidden(len(document.windows) - SHOWN_WINDOWS)]


def _facts(document: FindingsDocument) -> list[str]:
    noise = document.noise
    stds = noise_text(noise.std, document.torque_unit)
    rows = [("Noise σ", f"{stds} ({words.noise_source(noise)})")] if noise.std else []
    changed = bool(document.findings)
    errors = ", ".join(
        f"{words.experiment_name(document, k)} {words.error_text(*pair, changed=changed)}"
        for k, pair in document.error_percent.items()
    )
    if errors:
        rows.append(("Torque error", errors))
    if document.ratio_interval is not None:
        rows.append(
            ("Held-out RMS", f"{words.interval_text(document.ratio_interval)} of the base model's, 95 % interval")
        )
    rows.append(("Time taken", f"{significant(document.seconds)} s"))
    return entries(rows)


def _refused(document: FindingsDocument) -> list[str]:
    lines = [words.refused_line(r) for r in document.refused[:SHOWN_REFUSED]]
    return [*lines, *_hidden(len(document.refused) - SHOWN_REFUSED)]


def _untried(document: FindingsDocument) -> list[str]:
    untried = document.unfinished.untried if document.unfinished is not None else []
    lines = [words.placed(*place) for place in untried[:SHOWN_REFUSED]]
    return [*lines, *_hidden(len(untried) - SHOWN_REFUSED)]


def _hidden(count: int) -> list[str]:
    return [f"{count} more in the report"] if count > 0 else []
