"""What is predicted of the parameters before an identification, as a table for the terminal."""

from __future__ import annotations

from fmu_didim.checks.data.expected_accuracy import ExpectedAccuracy
from fmu_didim.report.identification.table import column, joined
from fmu_didim.report.numbers import decimal_aligned, percent_std, pretty_unit, significant


def prospect_lines(found: ExpectedAccuracy) -> list[str]:
    """A line a parameter: value at the start, predicted standard deviation, and what it is hard to tell from."""
    insignificant = set(found.insignificant)
    percent = [100 * d / abs(v) if v else None for v, d in zip(found.values, found.deviation, strict=True)]
    columns = [
        column("parameter", [f"{name} *" if name in insignificant else name for name in found.names], left=True),
        column("start", decimal_aligned([significant(value) for value in found.values])),
        column("σ", decimal_aligned([significant(deviation, 2) for deviation in found.deviation])),
        column("%σ", decimal_aligned([percent_std(value) for value in percent])),
        column("unit", [pretty_unit(unit) for unit in found.units], left=True),
    ]
    if any(name for name, _ in found.partner):
        words = [f"{name} ({size:.3f})" if name else "" for name, size in found.partner]
        columns.append(column("correlated with", words, left=True))
    return [*joined(columns), *(["* will not be told from zero"] if insignificant else [])]
