"""A result as plain text for the terminal: at most 100 columns, no colours, validity last."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from fmu_didim.report import experiments
from fmu_didim.report.numbers import (
    MISSING,
    ParameterText,
    aligned_parameters,
    at,
    consistency_line,
    decimal_aligned,
    iteration_count,
    noise_text,
    percentage,
    pretty_unit,
    significant,
)
from fmu_didim.report.verdict import Banner, reason_text, verdict
from fmu_didim.results.result import ResultDocument

WIDTH = 100
SHOWN_CORRELATIONS = 5
GAP = "  "
LABEL = 24
"""Characters of the name of an experiment that are shown."""


def result_table(document: ResultDocument) -> str:
    """The text shown after an identification; ends with the line that says whether it is valid."""
    count = len(document.parameters)
    title = document.name + (f" ({document.estimator}, {count} parameters)" if count else f" ({document.estimator})")
    sections = [
        [*wrapped(title), *wrapped(document.description)],
        _parameters(document),
        _experiments(document),
        _torque(document) if experiments.is_short_form(document) else _errors_by_experiment(document),
        _figures(document),
        listing("Regrouping", document.regrouping),
        listing("Notes of the iterations", _notes(document)),
        listing("Remarks", document.remarks),
        _validity(document),
    ]
    return "\n\n".join("\n".join(section) for section in sections if section) + "\n"


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


def _parameters(document: ResultDocument) -> list[str]:
    """The table; parameters of one experiment alone and those of the loop follow below rules of their own."""
    if not document.parameters:
        return []
    groups = experiments.parameter_groups(document)
    rows = [experiments.shown_parameter(name, p) for group in groups for name, p in group.parameters.items()]
    head, *body = joined(_columns(rows))
    width = max(len(head), *(len(line) for line in body))
    lines = [head]
    for group in groups:
        lines.append(f"-- {group.head} ".ljust(width, "-") if group.head else "-" * width)
        lines += body[: len(group.parameters)]
        body = body[len(group.parameters) :]
    if any(row.insignificant for row in rows):
        lines.append("* not significantly different from zero")
    return lines + [line for text in experiments.delay_lines(document) for line in wrapped(text)]


def _columns(rows: Sequence[ParameterText]) -> list[list[str]]:
    shown = aligned_parameters(rows)
    columns = [
        column("value", [row.value for row in shown]),
        column("σ", [row.std for row in shown]),
        column("%σ", [row.percent for row in shown]),
        column("unit", [row.unit or MISSING for row in rows], left=True),
        column("95 % interval", ["  ".join(row.interval) for row in shown]),
    ]
    room = WIDTH - sum(len(GAP) + len(column[0]) for column in columns)
    names = [clipped(row.name, room - 2) + (" *" if row.insignificant else "") for row in rows]
    return [column("parameter", names, left=True), *columns]


def column(head: str, texts: Sequence[str], *, left: bool = False) -> list[str]:
    """A head and texts, filled to one width."""
    width = max(len(head), *(len(text) for text in texts))
    return [text.ljust(width) if left else text.rjust(width) for text in (head, *texts)]


def joined(columns: Sequence[Sequence[str]]) -> list[str]:
    """The lines of columns beside each other."""
    return [GAP.join(cells).rstrip() for cells in zip(*columns, strict=True)]


def clipped(text: str, width: int) -> str:
    """A text, its end cut off where it is longer than this."""
    return text if len(text) <= width else text[: max(width - 1, 1)] + "…"


def _torque(document: ResultDocument) -> list[str]:
    """Relative error of each experiment and noise, a line a joint."""
    errors = experiments.error_rows(document)
    if not errors and not document.noise_std:
        return []
    joints = range(len(document.torque_unit))
    columns = [column("Torque", ["total", *(f"joint {j + 1}" for j in joints)], left=True)]
    for label, values in errors:
        columns.append(column(f"{label} %", decimal_aligned([significant(v) for v in values])))
    if document.noise_std:
        texts = decimal_aligned(["", *(significant(at(document.noise_std, j), 2) for j in joints)])
        units = column("", ["", *(pretty_unit(unit) for unit in document.torque_unit)], left=True)[1:]
        columns.append(column("noise σ", [f"{t} {u}" for t, u in zip(texts, units, strict=True)]))
    return joined(columns)


def _experiments(document: ResultDocument) -> list[str]:
    """What each experiment is and how it agrees with the others; nothing where the torque says it all."""
    found = document.experiments
    if experiments.is_short_form(document):
        return []
    columns = [
        column("Experiment", [clipped(label, LABEL) for label in found], left=True),
        column("role", [e.role for e in found.values()], left=True),
        column("samples", [str(e.samples) for e in found.values()]),
        column("Hz", decimal_aligned([f"{e.rate_hz:.6g}" for e in found.values()])),
    ]
    if any(e.agreement is not None for e in found.values()):
        marks = ["" if e.agreement is None or e.agreement.agrees else " !" for e in found.values()]
        texts = decimal_aligned([experiments.agreement_text(e.agreement) for e in found.values()])
        columns.append(column("agreement p", [f"{t}{m:2}" for t, m in zip(texts, marks, strict=True)]))
    own = [", ".join(experiments.own_names(label, e)) for label, e in found.items()]
    if any(own):
        room = WIDTH - sum(len(column[0]) + len(GAP) for column in columns)
        columns.append(column("own", [clipped(text, room) for text in own], left=True))
    return joined(columns)


def _errors_by_experiment(document: ResultDocument) -> list[str]:
    """Relative errors, a line an experiment, and the noise."""
    errors = experiments.error_rows(document)
    if not errors:
        return []
    heads = ["total %", *(f"joint {j + 1} %" for j in range(len(document.torque_unit)))]
    columns = [column("Torque", [clipped(label, LABEL) for label, _ in errors], left=True)]
    for j, head in enumerate(heads):
        columns.append(column(head, decimal_aligned([significant(values[j]) for _, values in errors])))
    noise = noise_text(document.noise_std, document.torque_unit)
    return [*_blocks(columns), *(wrapped(f"noise σ: {noise}") if noise else [])]


def _blocks(columns: Sequence[Sequence[str]]) -> list[str]:
    """Columns beside each other as far as there is room, the others below, each time behind the first column."""
    first, *others = columns
    lines, chosen = [], [first]
    for column in others:
        if len(GAP.join(part[0] for part in (*chosen, column))) > WIDTH:
            lines += joined(chosen)
            chosen = [first]
        chosen.append(column)
    return lines + joined(chosen)


def _figures(document: ResultDocument) -> list[str]:
    if document.status == "refused":
        return []
    strong = document.correlations[:SHOWN_CORRELATIONS]
    pairs = ", ".join(f"{a}-{b} {value:+.3f}" for a, b, value in strong)
    hidden = len(document.correlations) - len(strong)
    lines = [
        ("Condition number", significant(document.condition_number)),
        ("Iterations", iteration_count(document) + (" (main + finish)" if document.finish_iterations else "")),
        ("Correlations > 0.9", (pairs or "none") + (f", {hidden} more in the report" if hidden else "")),
    ]
    if document.integration_error is not None:
        text = percentage(100 * document.integration_error) + " of the torque"
        if document.integration_shift is not None:
            text += f", {significant(document.integration_shift)} σ of a value"
        if document.integration is not None:
            text += f" ({document.integration.substeps} steps a tick)"
        lines.append(("Integration error", text))
    if document.consistency is not None:
        lines.append(("Plant's equations", consistency_line(document)))
    return entries(lines)


def _notes(document: ResultDocument) -> list[str]:
    """What was caught on the way; of interest when the way did not end well."""
    if document.status == "converged":
        return []
    return [f"{it.stage} {it.number}: {it.note}" for it in document.history if it.note]


def _validity(document: ResultDocument) -> list[str]:
    end = verdict(document)
    first, *others = end.text.splitlines() or [""]
    lines = wrapped(f"{end.head}: {first}", "", "  ")
    lines += [line for other in others for line in wrapped(other.strip(), "  ", "    ")]
    return lines + reason_lines(end)


def reason_lines(banner: Banner) -> list[str]:
    """The reasons of a verdict, numbered, each with what to do about it; the same advice only once."""
    lines = []
    for number, reason in enumerate(banner.reasons, start=1):
        lines += wrapped(reason_text(reason), f"{number:3}. ", "     ")
        others = banner.reasons[number:]
        if reason.next_step and not any(other.next_step == reason.next_step for other in others):
            lines += wrapped(f"Next: {reason.next_step}", "     ")
    return lines
