"""The tables of the page of a result."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from fmu_didim.report.experiments import agreement_text, difference_text, error_rows, own_names, shown_unit
from fmu_didim.report.numbers import MISSING, Rounding, at, decimal_aligned, pretty_unit, rounding, significant
from fmu_didim.results.result import ResultDocument

FORMULAS = {"paper": "σ, paper's formula", "cramer_rao": "Cramér-Rao bound"}
MAIN_SIGMA = {"didim": "σ, corrected formula"}


@dataclass(frozen=True)
class MatrixCell:
    """A value of a matrix: its text, its sign, and its colour in percent of the strongest."""

    text: str
    sign: int
    size: int


@dataclass(frozen=True)
class Matrix:
    """Values over two lists of names as a map of colours, two hues for two signs.

    Attributes:
        shows_values: whether there is room for the texts; else they show where the pointer is.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[MatrixCell, ...]], ...]
    shows_values: bool


MOST_VALUES = 14
"""Columns of a matrix whose values still have room."""
STRONGEST = 60
"""Percent of its hue that the largest value gets: text on it stays legible."""


def matrix(
    title: str, columns: Sequence[str], rows: Mapping[str, Sequence[float | None]], *, largest: float, digits: int = 2
) -> Matrix:
    """A matrix whose colours reach their full strength at a magnitude ``largest``."""

    def cell(value: float | None) -> MatrixCell:
        if value is None or not math.isfinite(value):
            return MatrixCell(MISSING, 1, 0)
        size = min(round(STRONGEST * abs(value) / largest), STRONGEST)
        text = f"{value:.{digits}f}"
        return MatrixCell(text if float(text) else text.removeprefix("-"), 1 if value >= 0 else -1, size)

    filled = tuple((name, tuple(cell(value) for value in values)) for name, values in rows.items())
    return Matrix(title, tuple(columns), filled, len(columns) <= MOST_VALUES)


@dataclass(frozen=True)
class Table:
    """Heads and rows of texts; the first column is a name, ``text_columns`` hold words, the others numbers."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    text_columns: tuple[int, ...] = (0,)


def table(
    heads: Sequence[str],
    rows: Iterable[Sequence[str]],
    text_columns: tuple[int, ...] = (0,),
    *,
    is_aligned: bool = True,
) -> Table | None:
    """A table, in the columns of numbers with decimal points below each other; None without rows."""
    columns = list(zip(*rows, strict=True))
    if is_aligned:
        columns = [c if k in text_columns else tuple(decimal_aligned(c)) for k, c in enumerate(columns)]
    return Table(tuple(heads), tuple(zip(*columns, strict=True)), text_columns) if columns else None


def experiment_table(document: ResultDocument) -> Table | None:
    """What each experiment is, how it agrees with the others, and why it could not be simulated."""
    found = document.experiments
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
    return table(tuple(columns), zip(*columns.values(), strict=True), places)


def error_table(document: ResultDocument) -> Table | None:
    """Relative error of each experiment and of all fitted ones, a row each."""
    heads = ("", "total", *(f"joint {j + 1}" for j in range(len(document.torque_unit))))
    return table(heads, [(label, *(significant(v) for v in values)) for label, values in error_rows(document)])


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
    return table(heads, zip(document.parameters, *columns, strict=True), (0, len(heads) - 1))


def _deviation(digits: Rounding | None, std: float | None) -> str:
    return MISSING if digits is None or std is None else digits.deviation(std)


def history_table(document: ResultDocument) -> Table | None:
    """Errors, changes and notes of the iterations."""
    rows = [
        (
            f"{it.stage} {it.number}", significant(it.relative_error_percent, 5), significant(it.change, 2),
            significant(it.condition_number), it.note,
        )
        for it in document.history
    ]  # fmt: skip
    heads = ("iteration", "torque error (%)", "relative change", "condition number", "note")
    return table(heads, rows, (0, 4))


def history_values(document: ResultDocument) -> Table | None:
    """The parameters simulated in each iteration, one column an iteration."""
    names = dict.fromkeys(name for it in document.history for name in it.parameters)
    heads = ("parameter", *(f"{it.stage} {it.number}" for it in document.history))
    values = {name: [it.parameters.get(name) for it in document.history] for name in names}
    rows = [(name, *(MISSING if v is None else f"{v:.6g}" for v in row)) for name, row in values.items()]
    return table(heads, rows, is_aligned=False)


def correlation_table(document: ResultDocument) -> Table | None:
    """Pairs of parameters that are correlated, with their correlation."""
    rows = [(f"{a} – {b}", f"{value:+.3f}") for a, b, value in document.correlations]
    return table(("pair", "correlation"), rows, is_aligned=False)


def correlation_matrix(document: ResultDocument) -> Matrix | None:
    """The correlations of all parameters; None without any."""
    names = list(document.parameters)
    if len(document.correlation) != len(names) or len(names) < 2:
        return None
    return matrix("Correlations", names, dict(zip(names, document.correlation, strict=True)), largest=1.0)


def column_table(document: ResultDocument) -> Table | None:
    """The columns of the regressor, from the plant against from the robot description."""
    columns = {} if document.consistency is None else document.consistency.columns
    rows = [
        (name, significant(c.difference, 2), significant(c.cosine, 6), significant(c.size, 4), str(c.joint))
        for name, c in columns.items()
    ]
    return table(("parameter", "difference", "cosine", "size in the plant", "joint"), rows, is_aligned=False)
