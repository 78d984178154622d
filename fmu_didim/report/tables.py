"""The tables of the page of a result."""

from __future__ import annotations

from dataclasses import dataclass

from fmu_didim.identification.result import ResultDocument
from fmu_didim.report.experiments import agreement_text, at, difference_text, error_rows, own_names, shown_unit
from fmu_didim.report.numbers import MISSING, Rounding, decimal_aligned, pretty_unit, rounding, significant

FORMULAS = {"paper": "σ, paper's formula", "cramer_rao": "Cramér-Rao bound"}
MAIN_SIGMA = {"didim": "σ, corrected formula"}


@dataclass(frozen=True)
class Table:
    """Heads and rows of texts; the first column is a name, ``text_columns`` hold words, the others numbers."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    text_columns: tuple[int, ...] = (0,)


def experiment_table(document: ResultDocument) -> Table | None:
    """What each experiment is, how it agrees with the others, and why it could not be simulated."""
    found = document.experiments
    if not found:
        return None
    columns = {"experiment": list(found), "role": [e.role for e in found.values()]}
    columns["samples"] = [str(e.samples) for e in found.values()]
    columns["rate (Hz)"] = [f"{e.rate_hz:.6g}" for e in found.values()]
    for j, unit in enumerate(document.torque_unit):
        head = f"RMS residual, joint {j + 1} ({pretty_unit(unit)})"
        columns[head] = [significant(at(e.noise_std, j), 2) for e in found.values()]
    words = ["experiment", "role"]
    if any(e.agreement is not None for e in found.values()):
        columns["p-value of its agreement"] = [agreement_text(e.agreement) for e in found.values()]
        columns["would differ most"] = [difference_text(e.agreement) for e in found.values()]
        words.append("would differ most")
    if any(e.own for e in found.values()):
        columns["own parameters"] = [", ".join(own_names(label, e)) or MISSING for label, e in found.items()]
        words.append("own parameters")
    if any(e.failure for e in found.values()):
        columns["failure"] = [e.failure or MISSING for e in found.values()]
        words.append("failure")
    places = tuple(k for k, head in enumerate(columns) if head in words)
    return aligned(Table(tuple(columns), tuple(zip(*columns.values(), strict=True)), places))


def error_table(document: ResultDocument) -> Table | None:
    """Relative error of each experiment and of all fitted ones, a row each."""
    errors = error_rows(document)
    if not errors:
        return None
    heads = ("", "total", *(f"joint {j + 1}" for j in range(len(document.torque_unit))))
    rows = tuple((label, *(significant(v) for v in values)) for label, values in errors)
    return aligned(Table(heads, rows, (0,)))


def stage_table(document: ResultDocument) -> Table | None:
    """Value and standard deviations at the end of each stage."""
    if not document.stages:
        return None
    heads = ["parameter"]
    columns: list[list[str]] = []
    for stage, content in document.stages.items():
        digits = {name: rounding(v, content.std.get(name, 0.0)) for name, v in content.value.items()}
        heads += [f"{stage}: value", f"{stage}: {MAIN_SIGMA.get(stage, 'σ')}"]
        columns.append([digits[n].text(content.value[n]) if n in digits else MISSING for n in document.parameters])
        for head, deviations in (("", content.std), *content.formulas.items()):
            if head:
                heads.append(f"{stage}: {FORMULAS.get(head, head)}")
            columns.append([_deviation(digits.get(n), deviations.get(n)) for n in document.parameters])
    heads.append("unit")
    columns.append([shown_unit(p) or MISSING for p in document.parameters.values()])
    rows = tuple(zip(document.parameters, *columns, strict=True))
    return aligned(Table(tuple(heads), rows, (0, len(heads) - 1)))


def _deviation(digits: Rounding | None, std: float | None) -> str:
    return MISSING if digits is None or std is None else digits.deviation(std)


def history_table(document: ResultDocument) -> Table:
    """Errors, changes and notes of the iterations."""
    rows = tuple(
        (
            f"{it.stage} {it.number}",
            significant(it.relative_error_percent, 5),
            significant(it.change, 2),
            significant(it.condition_number),
            it.note,
        )
        for it in document.history
    )
    heads = ("iteration", "torque error (%)", "relative change", "condition number", "note")
    return aligned(Table(heads, rows, (0, 4)))


def history_values(document: ResultDocument) -> Table:
    """The parameters simulated in each iteration, one column an iteration."""
    names = list(dict.fromkeys(name for it in document.history for name in it.parameters))
    heads = ("parameter", *(f"{it.stage} {it.number}" for it in document.history))
    rows = tuple((name, *(_six(it.parameters.get(name)) for it in document.history)) for name in names)
    return Table(heads, rows)


def _six(value: float | None) -> str:
    return MISSING if value is None else f"{value:.6g}"


def correlation_table(document: ResultDocument) -> Table | None:
    """Pairs of parameters that are correlated, with their correlation."""
    rows = tuple((f"{a} – {b}", f"{value:+.3f}") for a, b, value in document.correlations)
    return Table(("pair", "correlation"), rows) if rows else None


def column_table(document: ResultDocument) -> Table | None:
    """The columns of the regressor, from the plant against from the robot description."""
    found = document.consistency
    if found is None or not found.columns:
        return None
    rows = tuple(
        (name, significant(c.difference, 2), significant(c.cosine, 6), significant(c.size, 4), str(c.joint))
        for name, c in found.columns.items()
    )
    heads = ("parameter", "difference", "cosine", "size in the plant", "joint")
    return Table(heads, rows)


def aligned(table: Table) -> Table:
    """Decimal points below each other in the columns of numbers."""
    columns = [
        column if k in table.text_columns else decimal_aligned(column)
        for k, column in enumerate(zip(*table.rows, strict=True))
    ]
    return Table(table.heads, tuple(zip(*columns, strict=True)), table.text_columns)
