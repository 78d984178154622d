"""The validity of a result, in words."""

from __future__ import annotations

from dataclasses import dataclass

from fmu_didim.identification.result import ResultDocument
from fmu_didim.report.experiments import disagreeing, experiment_title
from fmu_didim.report.numbers import iteration_count, percentage


@dataclass(frozen=True)
class Verdict:
    """Whether the values may be used: grade ``good``, ``doubtful`` or ``refused``, a head and its text."""

    grade: str
    head: str
    text: str


def verdict(document: ResultDocument) -> Verdict:
    """The verdict on an identification."""
    if document.status == "refused":
        return Verdict("refused", "REFUSED", document.advice)
    if document.status == "maximum_iterations":
        return Verdict("doubtful", "NOT SETTLED", document.advice)
    parts = [f"converged in {iteration_count(document)} iterations", *document.checks]
    known = [f"{percentage(v)} {'off ' if i == 0 else ''}on {name}" for i, (name, v) in enumerate(_errors(document))]
    if known:
        parts.append("simulated torque " + ", ".join(known))
    failed = [label for label, error in document.relative_error_percent.items() if error.total is None]
    if failed:
        parts.append(f"the simulation failed on {', '.join(failed)}")
        return Verdict("doubtful", "NOT VALIDATED", "; ".join(parts))
    doubts = []
    if unlike := disagreeing(document):
        do, warning = ("does", "warning") if len(unlike) == 1 else ("do", "warnings")
        doubts.append(f"{' and '.join(unlike)} {do} not agree with the other experiments: see the {warning}")
    if document.consistency is not None and document.consistency.points and not document.consistency.agrees:
        doubts.append("the plant differs from the robot description: see the warning")
    if doubts:
        return Verdict("doubtful", "DOUBTFUL", "; ".join([*parts, "but " + ", and ".join(doubts)]))
    return Verdict("good", "Valid", "; ".join(parts))


def _errors(document: ResultDocument) -> list[tuple[str, float]]:
    """Where the torque was compared, and the relative errors: several fitted experiments count as one."""
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
