"""A saved history of a machine as a report: a line a log, when the change began, and each value against the date."""

from __future__ import annotations

from pathlib import Path

from fmu_didim.report.drawing.history_chart import history_chart
from fmu_didim.report.numbers import MISSING, capitalised, pretty_unit, rounding, significant
from fmu_didim.report.page import notebook_html, write_page
from fmu_didim.report.sections import (
    Block,
    Charts,
    Column,
    Fact,
    Facts,
    Items,
    Link,
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
from fmu_didim.results.result import RESULT_FILE
from fmu_didim.results.watch import WatchDocument, WatchedLog

WATCH_PAGE = "watch.html"
REPORT = "report.html"
"""Page of an identification, in its folder."""


def watch_table(document: WatchDocument) -> str:
    """The text shown after a watch."""
    return report_text(watch_report(document))


def watch_html(document: WatchDocument) -> str:
    """Verdict and logs, for notebooks."""
    return notebook_html(watch_report(document))


def write_watch(document: WatchDocument, folder: Path) -> Path:
    """Write the page of a history and return its path."""
    return write_page(watch_report(document), folder / WATCH_PAGE)


def verdict_of(document: WatchDocument) -> Banner:
    """The verdict in sentences."""
    grade, head = ("good", "UNCHANGED") if document.answer == "unchanged" else ("doubtful", "CHANGED")
    if document.verdict != "valid":
        grade, head = "doubtful", f"{head}, WITH DOUBTS"
    lines = [f"{capitalised(document.text)}."]
    if document.conditions:
        lines.append(f"Provided that {'; and that '.join(document.conditions)}.")
    return Banner(grade, head, "\n".join(lines), document.reasons)


def watch_report(document: WatchDocument) -> Report:
    """All that is shown of a history."""
    sections = [_logs(document), *_texts(document), *_history(document), _reference(document), _facts(document)]
    later = [log for log in document.logs if log.name not in document.reference]
    cards = [
        ("logs judged", str(sum(log.p_value is not None for log in later))),
        ("changed", str(sum(log.state == "changed" for log in later))),
        ("in the reference", str(len(document.reference))),
    ]
    return Report(
        document.name, f"{document.name} (history of {len(document.logs)} logs)", verdict_of(document), sections,
        what="history", cards=cards, remarks=document.remarks, provenance=document.provenance,
    )  # fmt: skip


def _p(log: WatchedLog) -> str:
    return MISSING if log.p_value is None else f"{log.p_value:.2g}"


def _logs(document: WatchDocument) -> Section:
    shown = document.logs
    pages = [f"{log.result}/{REPORT}" if log.result else "" for log in shown]
    columns = [
        words("date", [log.date.removesuffix("T00:00:00") for log in shown]),
        words("log", [log.name for log in shown], limit=26,
              links=[[Link(log.name, page)] for log, page in zip(shown, pages, strict=True)]),
        words("state", [log.state.replace("_", " ") for log in shown],
              marks=[" *" if log.state == "changed" else "" for log in shown]),
        numbers("p", [_p(log) for log in shown]),
        words("moved", [", ".join(log.moved) for log in shown], limit=18),
        words("cause", ["; or ".join(log.causes) for log in shown], shrinks=True),
    ]  # fmt: skip
    chosen = [k for k, log in enumerate(shown) if log.state == "changed"]
    blocks: list[Block] = [Table(columns, chosen=chosen)]
    blocks.append(note(
        f"p: of as large a distance from the reference, of all values together, by noise and the spread between logs. "
        f"Below {document.false_alarms:g} a log is called changed. Of several causes the data cannot tell which."
    ))  # fmt: skip
    return Section("Logs", blocks, anchor="logs", is_brief=True)


def _texts(document: WatchDocument) -> list[Section]:
    """What the lines of the logs have no room for."""
    items = [
        f"{log.name}: {'; '.join([log.text, *log.notes])}" for log in document.logs
        if log.state in ("changed", "doubtful", "not_judged") or log.notes
    ]  # fmt: skip
    return [Section("What the logs say", [Items(items, limit=12)], anchor="texts", has_title=True)] if items else []


def _history(document: WatchDocument) -> list[Section]:
    chart = history_chart(document)
    if chart is None:
        return []
    text = "Each value by each log, with its own interval of 95 %. Grey: where 95 % of logs of the reference state lie."
    return [Section("History", [note(text), Charts([chart])], anchor="history")]


def _reference(document: WatchDocument) -> Section:
    found = document.values
    rows = [rounding(v.mean, v.std) for v in found.values()]
    columns = [
        words("reference", list(found), shrinks=True),
        numbers("value", [r.text(v.mean) for r, v in zip(rows, found.values(), strict=True)]),
        numbers("σ", [significant(v.std, 2) for v in found.values()]),
        words("unit", [pretty_unit(v.unit) for v in found.values()]),
        numbers("between logs", [MISSING if v.between is None else significant(v.between, 2) for v in found.values()]),
        Column(
            "95 % of logs",
            [f"{r.text(v.band[0])}  {r.text(v.band[1])}" for r, v in zip(rows, found.values(), strict=True)],
        ),
        numbers("half seen", [significant(v.half_seen, 2) for v in found.values()]),
    ]
    blocks: list[Block] = [Table(columns), note(
        "Between logs: standard deviation beyond the noise of a log, the median of what it may be. Half seen: the "
        "change of this value alone that one more log shows half of the time."
    )]  # fmt: skip
    return Section("Reference", blocks, anchor="reference")


def _facts(document: WatchDocument) -> Section:
    facts = [
        Fact("reference", ", ".join(document.reference)),
        Fact("order", f"by {document.order}"),
        Fact("results", f"of each log in its folder ({RESULT_FILE})"),
    ]
    blocks: list[Block] = [Facts(facts)]
    if document.onset is not None:
        blocks.append(Text(f"Onset: {document.onset.text}."))
    return Section("How it was judged", blocks, anchor="how", has_title=True)
