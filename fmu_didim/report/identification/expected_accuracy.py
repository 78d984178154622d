"""Predicted accuracy of the parameters before an identification, as a table for the terminal."""

from __future__ import annotations

from fmu_didim.checks.data.expected_accuracy import ExpectedAccuracy
from fmu_didim.report.numbers import percent_std, pretty_unit, significant
from fmu_didim.report.sections import Table, numbers, words
from fmu_didim.report.terminal import table_lines


def expected_accuracy_lines(found: ExpectedAccuracy) -> list[str]:
    """A line a parameter: value at the start, predicted standard deviation, and what it is hard to tell from."""
    insignificant = set(found.insignificant)
    percent = [100 * d / abs(v) if v else None for v, d in zip(found.values, found.deviation, strict=True)]
    columns = [
        words("parameter", found.names, marks=[" *" if name in insignificant else "" for name in found.names]),
        numbers("start", [significant(value) for value in found.values]),
        numbers("σ", [significant(deviation, 2) for deviation in found.deviation]),
        numbers("%σ", [percent_std(value) for value in percent]),
        words("unit", [pretty_unit(unit) for unit in found.units]),
    ]
    if any(name for name, _ in found.partner):
        partners = [f"{name} ({size:.3f})" if name else "" for name, size in found.partner]
        columns.append(words("correlated with", partners))
    last = ["* not expected to differ significantly from zero"] if insignificant else []
    return [*table_lines(Table(columns), width=None), *last]
