"""Tables of results for pandas."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from fmu_didim.base.errors import InputError
from fmu_didim.results.result import ResultDocument

if TYPE_CHECKING:
    from pandas import DataFrame

    from fmu_didim.results.findings import FindingsDocument


def parameter_frame(document: ResultDocument) -> DataFrame:
    """One row a parameter, by name; see :meth:`fmu_didim.Result.to_frame`."""
    heads = ("parameter", "value", "std", "rel_std_percent", "low", "high", "unit", "of", "experiment")
    rows = [
        (name, p.value, p.std, p.rel_std_percent, *p.interval, p.unit, p.of, p.experiment or "")
        for name, p in document.parameters.items()
    ]
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
    """One row a parameter of each effect found, and of each that is undecided; see
    :meth:`fmu_didim.Discovered.to_frame`."""
    heads = ("effect", "joint", "parameter", "value", "std", "low", "high", "unit", "share_of_gap", "delta_bic")
    rows = []
    for f in document.findings:
        for one in f.ambiguous if f.effect == "undecided" else (f,):
            others = [f"{r.effect} {r.signal or r.joint}" for r in f.ambiguous if r is not one]
            rows += [
                (one.effect, one.joint, v.name, v.value, v.std, *v.interval, v.unit, f.share_of_gap, f.delta_bic,
                 ", ".join(others))
                for v in one.parameters
            ]  # fmt: skip
    return _frame(rows, (*heads, "ambiguous"), numbers=(*heads[3:7], *heads[8:]))


def _frame(rows: Sequence[tuple[Any, ...]], heads: Sequence[str], *, numbers: Sequence[str]) -> DataFrame:
    """A table with these columns, also where it has no rows."""
    import pandas  # takes a third of a second, which most uses of this package do not need

    return pandas.DataFrame(list(rows), columns=list(heads)).astype(dict.fromkeys(numbers, float))
