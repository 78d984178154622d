"""A saved comparison as a report: what moved, which causes explain it, and what would have been seen."""

from __future__ import annotations

from pathlib import Path

from fmu_didim.report.drawing.forest_chart import Expectation, forest_chart
from fmu_didim.report.numbers import capitalised, pretty_unit, rounding, significant
from fmu_didim.report.page import notebook_html, write_page
from fmu_didim.report.sections import (
    Block,
    Charts,
    Column,
    Fact,
    Facts,
    Items,
    Report,
    Section,
    Table,
    Text,
    note,
    numbers,
    words,
)
from fmu_didim.report.terminal import report_text
from fmu_didim.report.verdict import Banner
from fmu_didim.results.comparison import CausePart, ChangedParameter, ComparisonDocument

COMPARISON_PAGE = "compare.html"
HEADS = {"unchanged": "UNCHANGED", "named": "CHANGED", "ambiguous": "CHANGED", "unknown": "CHANGED, CAUSE UNKNOWN"}
OTHERS = 8
"""[rows] Of causes that do not explain the change."""
MOST_AMOUNTS = 4
"""[values] Of a cause, in a table."""


def comparison_table(document: ComparisonDocument) -> str:
    """The text shown after a comparison."""
    return report_text(comparison_report(document))


def comparison_html(document: ComparisonDocument) -> str:
    """Verdict, parameters and causes, for notebooks."""
    return notebook_html(comparison_report(document))


def write_comparison(document: ComparisonDocument, folder: Path) -> Path:
    """Write the page of a comparison and return its path."""
    return write_page(comparison_report(document), folder / COMPARISON_PAGE)


def verdict_of(document: ComparisonDocument) -> Banner:
    """The verdict in sentences."""
    grade = "good" if document.answer == "unchanged" else "doubtful"
    head = HEADS[document.answer]
    if document.answer == "unchanged" and any(r.changed for r in document.residual):
        head = "VALUES UNCHANGED, BUT NOT THE RESIDUAL"
    if document.verdict != "valid":
        grade, head = "doubtful", f"{head}, WITH DOUBTS"
    lines = [f"{capitalised(document.text)}."]
    if document.conditions:
        lines.append(f"Provided that {'; and that '.join(document.conditions)}.")
    return Banner(grade, head, "\n".join(lines), document.reasons)


def comparison_report(document: ComparisonDocument) -> Report:
    """All that is shown of a comparison."""
    sections = [_parameters(document), *_causes(document), *_sets(document), _residual(document), _results(document)]
    cards = [
        ("p value, all together", f"{document.p_value:.1e}"),
        ("parameters compared", str(document.freedom)),
        ("moved", str(sum(p.moved for p in document.parameters.values()))),
    ]
    return Report(
        document.name, f"{document.name} (comparison, {document.freedom} parameters)", verdict_of(document), sections,
        what="comparison", cards=cards, remarks=document.remarks, provenance=document.provenance,
    )  # fmt: skip


def _parameters(document: ComparisonDocument) -> Section:
    found = document.parameters
    rows = [_row(p) for p in found.values()]
    columns = [
        words("parameter", list(found), marks=[" *" if p.moved else "" for p in found.values()], shrinks=True),
        *(numbers(head, [row[k] for row in rows]) for k, head in enumerate(("before", "after", "change"))),
        words("unit", [pretty_unit(p.unit) for p in found.values()]),
        Column("joint 95 % interval", [row[3] for row in rows]),
        numbers("p", [f"{p.p_value:.2g}" for p in found.values()]),
        numbers("seen from", [row[4] for row in rows]),
    ]
    chosen = [k for k, p in enumerate(found.values()) if p.moved]
    blocks: list[Block] = [Table(columns, chosen=chosen)]
    if chosen:
        blocks.append(Text("* moved beyond the joint intervals"))
    blocks.append(note(
        "Joint intervals hold all changes at once with 95 %; p is adjusted for the number of parameters. Seen from: "
        "the change of this parameter alone that the test of all would have seen with 95 %."
    ))  # fmt: skip
    expected = {name: Expectation(p.after, p.std, p.before) for name, p in found.items()}
    forest = forest_chart(
        "forest", "Values after beside those before", "the value before", {"after": expected}, in_deviations=True
    )
    if forest is not None:
        blocks += [
            note("Change of each value in its standard deviations, with its own 95 % interval."),
            Charts([forest]),
        ]
    return Section("Parameters", blocks, anchor="parameters", is_brief=True)


def _row(p: ChangedParameter) -> tuple[str, str, str, str, str]:
    digits = rounding(p.change, p.std)
    low, high = p.interval
    return (
        digits.text(p.before), digits.text(p.after), digits.text(p.change),
        f"{digits.text(low)}  {digits.text(high)}", significant(p.least_seen, 2),
    )  # fmt: skip


def _causes(document: ComparisonDocument) -> list[Section]:
    shown = [*document.causes, *document.others[:OTHERS]]
    if not shown:
        return []
    columns = [
        words("cause", [" and ".join(part.title for part in c.parts) for c in shown], shrinks=True,
              marks=[" *" if c in document.causes else "" for c in shown]),
        words("how much", ["; ".join(_amounts(part) for part in c.parts) for c in shown], limit=28),
        numbers("explains %", [f"{100 * c.share:.1f}" for c in shown]),
        numbers("p of the rest", [f"{c.p_value:.1e}" for c in shown]),
        numbers("BIC", [f"{c.bic:.1f}" for c in shown]),
    ]  # fmt: skip
    told = "* explains the change" if document.causes else "none explains the change"
    if len(document.causes) > 1:
        told += ", and the data cannot tell it from the best"
    blocks: list[Block] = [
        Table(columns, chosen=list(range(len(document.causes)))), Text(told),
        note("A cause explains the change where its rest is noise, or a small part of it. BIC: above the best."),
    ]  # fmt: skip
    return [Section("Causes", blocks, anchor="causes", has_title=True, is_brief=True)]


def _amounts(part: CausePart) -> str:
    if any(a.name.startswith("direction") for a in part.amounts):
        return "a body of any shape"
    texts = []
    for a in part.amounts[:MOST_AMOUNTS]:
        if a.unit == "1":
            texts.append(f"{a.name} {100 * a.value:+.3g} %")
        else:
            texts.append(f"{a.name} {a.value:+.3g} {pretty_unit(a.unit)}".rstrip())
    return ", ".join(texts) + (", ..." if len(part.amounts) > MOST_AMOUNTS else "")


def _sets(document: ComparisonDocument) -> list[Section]:
    if not document.sets:
        return []
    items = [f"{', '.join(s.names)} (p of the rest {s.p_value:.2g})" for s in document.sets]
    return [Section("Smallest sets of parameters whose change alone explains it", [Items(items, limit=6)],
                    anchor="sets", has_title=True)]  # fmt: skip


def _residual(document: ComparisonDocument) -> Section:
    found = document.residual
    columns = [
        words("residual of", [r.label for r in found], marks=[" *" if r.changed else "" for r in found]),
        numbers("σ before", [significant(r.before, 2) for r in found]),
        numbers("σ after", [significant(r.after, 2) for r in found]),
        words("unit", [pretty_unit(r.unit) for r in found]),
        numbers("p", [f"{r.p_value:.2g}" for r in found]),
    ]
    return Section("Residual", [Table(columns)], anchor="residual")


def _results(document: ComparisonDocument) -> Section:
    facts = [
        Fact(head, ", ".join(part for part in (side.name, side.source, side.verdict, side.made) if part))
        for head, side in (("before", document.before), ("after", document.after))
    ]
    return Section("Results", [Facts(facts)], anchor="results", has_title=True)
