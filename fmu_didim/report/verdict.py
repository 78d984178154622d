"""The validity of a result, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fmu_didim.checks.judgement import AcknowledgedResult, DiagnosticResult
from fmu_didim.report.experiments import experiment_title
from fmu_didim.report.numbers import iteration_count, percentage
from fmu_didim.results.result import ResultDocument

HEADS: dict[str, tuple[str, str]] = {
    "valid": ("good", "VALID"),
    "doubtful": ("doubtful", "DOUBTFUL"),
    "not_settled": ("doubtful", "NOT SETTLED"),
    "refused": ("refused", "REFUSED"),
}
"""Grade and head of each verdict."""
CONDITIONS = 2
"""[clauses] Of what a valid verdict rests on, that it names; the remarks have all."""


@dataclass(frozen=True)
class Banner:
    """The verdict, as the page and the terminal show it.

    Attributes:
        grade: ``good``, ``doubtful`` or ``refused``; head: the verdict in a word or two; text: its explanation.
        reasons: why it is not valid, the most important first.
    """

    grade: str
    head: str
    text: str
    reasons: Sequence[DiagnosticResult] = ()

    @property
    def advised(self) -> list[tuple[DiagnosticResult, str]]:
        """The reasons, each with what to do about it; what several of them ask for only below the last of these."""
        steps = [reason.next_step for reason in self.reasons]
        return [(reason, "" if reason.next_step in steps[k:] else reason.next_step)
                for k, reason in enumerate(self.reasons, start=1)]  # fmt: skip


def verdict(document: ResultDocument) -> Banner:
    """The verdict on an identification."""
    grade, head = HEADS[document.verdict]
    if document.status != "converged":
        return Banner(grade, head, document.advice, document.reasons)
    parts = [f"converged in {iteration_count(document)} iterations", *document.checks]
    known = [f"{percentage(v)} {'off ' if i == 0 else ''}on {name}" for i, (name, v) in enumerate(_errors(document))]
    if known:
        several = "s" if len(document.outputs) > 1 else ""
        parts.append(f"simulated {document.quantity}{several} " + ", ".join(known))
    parts += acknowledged_text(document.acknowledged)
    lines = ["; ".join(parts), *conditions_text(document.conditions)]
    return Banner(grade, head, "\n".join(lines), document.reasons)


def conditions_text(found: Sequence[str], *, listed: str = "Remarks") -> list[str]:
    """What a valid verdict rests on: no line of it, or one; ``listed``: the section that has all of it."""
    clauses = [
        *found[:CONDITIONS],
        *([f"{len(found) - CONDITIONS} more hold ({listed})"] if found[CONDITIONS:] else []),
    ]
    return [f"Provided that {'; and that '.join(clauses)}."] if clauses else []


def acknowledged_text(found: Sequence[AcknowledgedResult]) -> list[str]:
    """What a verdict says of doubts that the user has checked: no part of it, or one."""
    codes = list(dict.fromkeys(each.code for each in found))
    return [f"acknowledged in the case: {', '.join(codes)}"] if codes else []


def reason_text(reason: DiagnosticResult) -> str:
    """A reason as a sentence, with its place and its code."""
    place = f"{reason.place}: " if reason.place else ""
    return f"{place}{reason.text} [{reason.code}]"


def _errors(document: ResultDocument) -> list[tuple[str, float]]:
    """Experiments with their relative torque errors; several fitted experiments count as one."""
    errors = {label: error.total for label, error in document.relative_error_percent.items()}
    experiments = document.experiments
    fitted = [label for label in errors if label in experiments and experiments[label].role == "estimation"]
    whole = document.fitted_error_percent
    if len(fitted) < 2 or whole is None:
        named = {experiment_title(document, label): error for label, error in errors.items()}
    else:
        named = {f"the {len(fitted)} fitted experiments": whole.total}
        named |= {experiment_title(document, label): e for label, e in errors.items() if label not in fitted}
    return [(name, error) for name, error in named.items() if error is not None]
