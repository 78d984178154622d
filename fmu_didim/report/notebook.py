"""Results as small pieces of HTML for notebooks: self-contained, without scripts."""

from __future__ import annotations

from fmu_didim.report.discovery import words
from fmu_didim.report.discovery.verdict import verdict_of
from fmu_didim.report.experiments import error_rows, experiment_title, parameter_groups, shown_parameter
from fmu_didim.report.html.templates import rendered
from fmu_didim.report.numbers import MISSING, percentage
from fmu_didim.report.verdict import verdict
from fmu_didim.results.findings import FindingsDocument
from fmu_didim.results.result import ResultDocument

TEMPLATE = "notebook.html.j2"
HEADS = ("parameter", "value", "σ", "unit", "95 % from", "to")
WORDS = (0, 3)
"""Columns that hold words, which begin at the left."""


def result_html(document: ResultDocument) -> str:
    """Verdict, parameters and torque errors of an identification."""
    groups = [
        (group.head, [shown_parameter(name, p) for name, p in group.parameters.items()])
        for group in parameter_groups(document)
    ]
    rows = [
        (head, [(f"{t.name} *" if t.insignificant else t.name, t.value, t.std, t.unit or MISSING, *t.interval)
                for t in texts])
        for head, texts in groups
    ]  # fmt: skip
    errors = [(experiment_title(document, label), percentage(values[0])) for label, values in error_rows(document)]
    return rendered(
        TEMPLATE,
        name=document.name,
        verdict=verdict(document),
        heads=HEADS,
        words=WORDS,
        groups=rows,
        notes=["* not significantly different from zero"] * any(t.insignificant for _, g in groups for t in g),
        figures=[(f"torque error, {title}", text) for title, text in errors],
    )


def discovery_html(document: FindingsDocument) -> str:
    """Verdict, findings and gaps of a discovery."""
    groups = []
    for finding in document.findings:
        head = f"{words.named(finding)}; closes {words.share_text(finding.share_of_gap)}"
        texts = [words.value_text(value) for value in finding.parameters]
        groups.append((head, [(t.name, t.value, t.std, t.unit or MISSING, *t.interval) for t in texts]))
    changed = bool(document.findings)
    return rendered(
        TEMPLATE,
        name=document.name,
        verdict=verdict_of(document),
        heads=HEADS,
        words=WORDS,
        groups=groups,
        notes=(),
        figures=[
            (f"gap / noise, {words.experiment_name(document, label)}", words.step_text(pair, changed=changed))
            for label, pair in document.gap.items()
        ],
    )
