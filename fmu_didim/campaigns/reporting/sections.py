"""The groups of a campaign as sections of a report, for the terminal, notebooks and the page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd

from fmu_didim.campaigns.reporting.status import Status
from fmu_didim.report.numbers import MISSING, significant
from fmu_didim.report.sections import Block, Column, Link, Report, Section, Table, note, words
from fmu_didim.report.verdict import Banner

GROUPS_NOTE = (
    "Bias, σ and coverage count valid and doubtful answers only; “with misses” counts every run without such an answer "
    "as an interval that misses. The interval of a coverage counts as many trials as there are different data."
)


def brief_report(status: Status, sections: Sequence[Section], remarks: Sequence[str], **more: Any) -> Report:
    """Progress of a campaign, sections and remarks; further entries as of ``Report``."""
    failed = any(status.failures.values())
    head = "NOT COMPLETE" if status.open else "COMPLETE, WITH FAILURES" if failed else "COMPLETE"
    banner = Banner("doubtful" if status.open or failed else "good", head, "\n".join(status.lines()))
    return Report(status.name, status.name, banner, sections, what="campaign", remarks=remarks, **more)


def groups_section(
    groups: pd.DataFrame, paths: Sequence[str], runs: Sequence[Sequence[Link]] = (), *, quantity: str = "torque"
) -> Section:
    """The groups by the fields of ``paths``, one a line, with links to their runs; ``quantity``: what is fitted."""
    columns = group_columns(groups, paths, quantity=quantity)
    if runs:
        counts = [str(len(links)) for links in runs]
        links = words("its runs", counts, links=runs, shown="page", page_head="its runs, those without answer first")
        columns.insert(len(paths), links)  # before the many figures, some of which a narrow window hides
    return Section("Groups", [note(GROUPS_NOTE), Table(columns)], anchor="groups", is_brief=True)


def group_columns(groups: pd.DataFrame, paths: Sequence[str], *, quantity: str = "torque") -> list[Column]:
    """The columns of groups by some fields; counts that are zero everywhere are left out."""
    columns = [words(path, [shown(v) for v in groups[path]]) for path in paths]
    columns.append(_counts(groups, "runs"))
    if (groups["data"] != groups["runs"]).any():
        columns.append(_counts(groups, "data", shown="page"))
    columns.append(_counts(groups, "valid"))
    columns += [_counts(groups, "conditional")] if groups["conditional"].any() else []
    columns.append(_counts(groups, "doubtful", shown="both" if groups["doubtful"].any() else "terminal"))
    columns += [_counts(groups, n) for n in ("not_settled", "refused", "failed", "open") if groups[n].any()]
    columns.append(Column(f"{quantity} error %", [_fixed(v, 2) for v in groups["error_percent"]]))
    if "coverage" in groups:
        parts = zip(groups["coverage"], groups["coverage_low"], groups["coverage_high"], strict=True)
        intervals = [MISSING if c != c else f"{c:.3f} ({low:.2f} to {high:.2f})" for c, low, high in parts]
        columns.append(Column("coverage (95 % interval)", intervals))
        columns.append(Column("with misses", [_fixed(v, 3) for v in groups["coverage_least"]]))
        columns.append(Column("largest bias/σ", [_fixed(v, 2) for v in groups["largest_bias_in_sigma"]]))
    columns.append(Column("iterations", [shown(v) for v in groups["iterations"]], shown="page"))
    return [*columns, Column("s", [significant(v, 2) for v in groups["seconds"]], shown="page")]


def _counts(groups: pd.DataFrame, name: str, **options: Any) -> Column:
    return Column(name.replace("_", " "), [str(v) for v in groups[name]], **options)


def _fixed(value: float, digits: int) -> str:
    return MISSING if value != value else f"{value:.{digits}f}"


def confusion_section(counts: pd.DataFrame) -> Section:
    """Of discoveries: runs with each hidden effect by what was named; nothing for identifications."""
    columns = [words("hidden \\ named", [str(name) for name in counts.index])]
    columns += [Column(str(name), [str(n) if n else "" for n in counts[name]]) for name in counts.columns]
    blocks: list[Block] = [] if counts.empty else [Table(columns)]
    return Section("Hidden effects (rows) against named ones, in runs", blocks, anchor="confusion", has_title=True)


def shown(value: Any) -> str:
    """A value of a field that varies."""
    if value is None or value != value:
        return MISSING
    return f"{value:g}" if isinstance(value, float) else str(value)


def duration(seconds: float) -> str:
    """A time for reading."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
