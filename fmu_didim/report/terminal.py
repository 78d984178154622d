"""A report as plain text: at most 100 columns, no colours."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from fmu_didim.report.sections import Bar, Block, Column, Facts, Items, Report, Section, Table, Text
from fmu_didim.report.verdict import Banner, reason_text

WIDTH = 100
GAP = "  "
BAR = 14
"""[characters] The longest bar."""


def report_text(report: Report) -> str:
    """The sections of a report below each other, with the verdict first or last."""
    verdict, title = verdict_lines(report.banner), wrapped(report.title)
    remarks = listing("Remarks", report.remarks)
    found = [section_lines(section) for section in report.on("terminal")]
    if report.verdict_first:
        parts = [[*verdict, *title], *found, remarks]
    else:
        parts = [[*title, *wrapped(report.description)], *found, remarks, verdict]
    return "\n\n".join("\n".join(part) for part in parts if part) + "\n"


def wrapped(text: str, indent: str = "", hanging: str | None = None) -> list[str]:
    """A text in lines of at most :data:`WIDTH`; all but the first are indented by ``hanging``."""
    further = indent if hanging is None else hanging
    return textwrap.wrap(text, WIDTH, initial_indent=indent, subsequent_indent=further, break_on_hyphens=False)


def entries(rows: Sequence[tuple[str, str]], indent: str = "") -> list[str]:
    """Heads and texts in two columns, wrapped."""
    width = max((len(head) for head, _ in rows), default=0)
    space = indent + " " * (width + len(GAP))
    return [line for head, text in rows for line in wrapped(text, f"{indent}{head.ljust(width)}{GAP}", space)]


def listing(head: str, items: Iterable[str]) -> list[str]:
    """A head and the items below it, wrapped; nothing without items."""
    lines = [line for item in items for line in wrapped(item, "  ", "    ")]
    return [head, *lines] if lines else []


def verdict_lines(banner: Banner) -> list[str]:
    """The verdict and its numbered reasons, each with its next step; the same advice only once."""
    first, *others = banner.text.splitlines() or [""]
    lines = wrapped(f"{banner.head}: {first}", "", "  ")
    lines += [line for other in others for line in wrapped(other.strip(), "  ", "    ")]
    for number, (reason, step) in enumerate(banner.advised, start=1):
        lines += wrapped(reason_text(reason), f"{number:3}. ", "     ")
        if step:
            lines += wrapped(f"Next: {step}", "     ")
    return lines


def section_lines(section: Section) -> list[str]:
    """The blocks of a section, below its heading where the terminal prints it."""
    lines = [line for block in section.on("terminal") for line in _block(block, is_below_title=section.has_title)]
    return [*wrapped(section.heading, "", "   "), *lines] if section.has_title and lines else lines


def _block(block: Block, *, is_below_title: bool) -> list[str]:
    if isinstance(block, Table):
        return table_lines(block)
    if isinstance(block, Facts):
        return entries([(fact.head, fact.text) for fact in block.on("terminal")], "     " if is_below_title else "")
    if not isinstance(block, Items):
        return wrapped(block.text) if isinstance(block, Text) else []
    files = [link.text for link in block.links] or [""] * len(block.items)
    texts = [f"{item}: {file}" if file else item for item, file in zip(block.items, files, strict=True)]
    hidden = 0 if block.limit is None else len(texts) - block.limit
    shown = [*texts[: block.limit], f"{hidden} more in the report"] if hidden > 0 else texts
    return [line for text in shown for line in wrapped(text, "  ", "    ")]


def table_lines(table: Table, width: int | None = WIDTH) -> list[str]:
    """The columns beside each other; those for which there is no room follow below, after the first column again.

    Args:
        width: most characters of a line; None for no limit.
    """
    columns = table.on("terminal")
    drawn = [_cells(column) for column in columns]
    if width is not None:
        for k, column in enumerate(columns):
            if column.shrinks:
                others = sum(len(GAP) + len(cells[0]) for i, cells in enumerate(drawn) if i != k)
                drawn[k] = _cells(column, width - others)
    first, *rest = drawn
    lines: list[str] = []
    chosen = [first]
    for cells in rest:
        if width is not None and len(GAP.join(part[0] for part in (*chosen, cells))) > width:
            lines += _joined(chosen)
            chosen = [first]
        chosen.append(cells)
    return lines + _grouped(_joined(chosen), table.groups)


def _grouped(lines: list[str], groups: Sequence[tuple[str, int]]) -> list[str]:
    """Lines of a table with a rule above each group of its rows."""
    if not groups:
        return lines
    head, *body = lines
    width = max(len(line) for line in lines)
    found = [head]
    for name, count in groups:
        found.append(f"-- {name} ".ljust(width, "-") if name else "-" * width)
        found, body = found + body[:count], body[count:]
    return found


def _joined(columns: Sequence[Sequence[str]]) -> list[str]:
    return [GAP.join(cells).rstrip() for cells in zip(*columns, strict=True)]


def _cells(column: Column, room: int | None = None) -> list[str]:
    """Head and texts of a column, filled to one width; bars follow the texts."""
    marks = column.marks or [""] * len(column.texts)
    spare = max((len(mark) for mark in marks), default=0)
    limit = column.limit if room is None else room - spare
    texts = [clipped(text, limit) for text in column.texts]
    if column.is_text:
        texts = [text + mark for text, mark in zip(texts, marks, strict=True)]
    else:
        texts = [text + (f"{mark:2}" if column.marks else "") for text, mark in zip(texts, marks, strict=True)]
    if column.bars:
        width = max(len(text) for text in texts)
        texts = [f"{text:>{width}}{GAP}{_bar(bar)}" for text, bar in zip(texts, column.bars, strict=True)]
        return [clipped(column.head, len(texts[0])).ljust(len(texts[0])), *texts]
    width = max(len(column.head), *(len(text) for text in texts))
    return [text.ljust(width) if column.is_text else text.rjust(width) for text in (column.head, *texts)]


def clipped(text: str, width: int | None) -> str:
    """A text, cut off at this width."""
    return text if width is None or len(text) <= width else text[: max(width - 1, 1)] + "…"


def _bar(bar: Bar | None) -> str:
    """Full blocks for what remains, light ones up to the former length."""
    if bar is None:
        return " " * BAR
    remains, former = round(BAR * bar.length / 100), round(BAR * bar.former / 100)
    return ("█" * remains + "░" * max(former - remains, 0)).ljust(BAR)
