"""Tables of results for pandas."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from fmu_didim.base.errors import InputError
from fmu_didim.results.findings import FindingsDocument
from fmu_didim.results.result import ResultDocument

if TYPE_CHECKING:
    from pandas import DataFrame


def parameter_frame(document: ResultDocument) -> DataFrame:
    """One row a parameter, by name; see :meth:`fmu_didim.Result.to_frame`."""
    rows = [
        {
            "parameter": name,
            "value": p.value,
            "std": p.std,
            "rel_std_percent": p.rel_std_percent,
            "low": p.interval[0],
            "high": p.interval[1],
            "unit": p.unit,
            "of": p.of,
            "experiment": p.experiment or "",
        }
        for name, p in document.parameters.items()
    ]
    heads = ("parameter", "value", "std", "rel_std_percent", "low", "high", "unit", "of", "experiment")
    return _frame(rows, heads, numbers=heads[1:6]).set_index("parameter")


def matrix_frame(document: ResultDocument) -> DataFrame:
    """The covariance of the values; see :attr:`fmu_didim.Result.covariance`."""
    import pandas

    names = list(document.parameters)
    if len(document.covariance) != len(names):
        raise InputError(
            "The result holds no covariance: it was saved by an earlier version.", where=document.name,
            next_step="Identify again.",
        )  # fmt: skip
    return pandas.DataFrame(document.covariance, index=names, columns=names, dtype=float)


def findings_frame(document: FindingsDocument) -> DataFrame:
    """One row a parameter of each effect found; see :meth:`fmu_didim.Discovered.to_frame`."""
    rows = [
        {
            "effect": finding.effect,
            "joint": finding.joint,
            "parameter": value.name,
            "value": value.value,
            "std": value.std,
            "low": value.interval[0],
            "high": value.interval[1],
            "unit": value.unit,
            "share_of_gap": finding.share_of_gap,
            "delta_bic": finding.delta_bic,
            "ambiguous": ", ".join(f"{rival.effect} {rival.joint}" for rival in finding.ambiguous),
        }
        for finding in document.findings
        for value in finding.parameters
    ]
    numbers = ("value", "std", "low", "high", "share_of_gap", "delta_bic")
    heads = ("effect", "joint", "parameter", "value", "std", "low", "high", "unit", "share_of_gap", "delta_bic")
    return _frame(rows, (*heads, "ambiguous"), numbers=numbers)


def _frame(rows: Sequence[dict[str, Any]], heads: Sequence[str], *, numbers: Sequence[str]) -> DataFrame:
    """A table with these columns, also where it has no rows."""
    import pandas  # takes a third of a second, which most uses of this package do not need

    return pandas.DataFrame(list(rows), columns=list(heads)).astype(dict.fromkeys(numbers, float))
