"""How good the answers of a group are, from tables of runs and parameters.

    bias      mean(value - true)                         sigma     standard deviation of the values of a group
    stated    sqrt(mean(std^2))                          coverage  part of the 95 % intervals that hold the true value

Only valid and doubtful answers count. Beside these figures are the number of the other runs, and the coverage with each
of them as a miss. The interval of a coverage is that of Clopper and Pearson (Biometrika 26, 1934) for as many trials as
there are different data: runs on the same data are no further evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import betaincinv

from fmu_didim.data.signals import Array
from fmu_didim.fit.statistics import CONFIDENCE

USABLE = ("valid", "doubtful")
"""Verdicts of answers that may be used; only these count for bias, sigma and coverage."""


def by_parameter(runs: pd.DataFrame, parameters: pd.DataFrame, names: list[str]) -> pd.DataFrame:
    """One row a group and parameter; ``names``: the columns that make a group."""
    used = parameters[parameters["verdict"].isin(USABLE)]
    if used.empty:
        return pd.DataFrame()
    inside = ((used["low"] <= used["true"]) & (used["true"] <= used["high"])).where(used["true"].notna(), False)
    error = used["value"] - used["true"]
    used = used.assign(error=error, variance=used["std"] ** 2, inside=inside.astype(int))
    found = used.groupby([*names, "parameter", "unit"], dropna=False, sort=False).agg(
        used=("id", "size"), data=("data", "nunique"), true=("true", "mean"), known=("true", "count"),
        value=("value", "mean"), bias=("error", "mean"), sigma=("error", "std"), scatter=("value", "std"),
        variance=("variance", "mean"), inside=("inside", "sum"),
    ).reset_index()  # fmt: skip
    hits, known, scatter = found.pop("inside"), found.pop("known"), found.pop("scatter")
    found["sigma"] = found["sigma"].where(known == found["used"], scatter)
    found["stated"] = np.sqrt(found.pop("variance"))
    found["bias_in_sigma"] = found["bias"] / found["stated"]
    ran = runs[runs["status"] != "open"]
    if names:
        counts = ran.groupby(names, dropna=False).size().rename("ran").reset_index()
        found = found.merge(counts, on=names, how="left")
    else:
        found = found.assign(ran=len(ran))
    found["coverage"] = hits / known.replace(0, np.nan)
    found["coverage_least"] = (hits / found["ran"]).where(known > 0)
    found["coverage_low"], found["coverage_high"] = proportion_interval(found["coverage"], found["data"])
    return found


def of_all_parameters(table: pd.DataFrame, names: list[str]) -> dict[tuple[object, ...], dict[str, float]]:
    """Group -> coverage of all parameters together, its interval, it with misses, and the largest bias.

    Args:
        table: of :func:`by_parameter`.
    """
    if table.empty or table["coverage"].isna().all():
        return {}
    table = table[table["coverage"].notna()]
    found: dict[tuple[object, ...], dict[str, float]] = {}
    for key, group in table.groupby(names, dropna=False, sort=False) if names else [((), table)]:
        share, data = float(group["coverage"].mean()), int(group["data"].min())
        low, high = proportion_interval(share, data)
        found[plain(key)] = {
            "coverage": share, "coverage_low": float(low), "coverage_high": float(high),
            "coverage_least": float(group["coverage_least"].mean()),
            "largest_bias_in_sigma": float(group["bias_in_sigma"].abs().max()),
        }  # fmt: skip
    return found


def proportion_interval(share: Any, count: Any) -> tuple[Array, Array]:
    """95 % interval of probabilities, when ``share`` of ``count`` trials succeed (Clopper and Pearson 1934).

    For k of n its ends are the quantiles 0.025 of Beta(k, n - k + 1) and 0.975 of Beta(k + 1, n - k); without trials it
    is everything. Both arguments may be arrays.
    """
    share, count = np.asarray(share, dtype=float), np.asarray(count, dtype=float)
    known = np.isfinite(share) & (count > 0)
    n = np.where(known, count, 1.0)
    k = np.where(known, share * count, 0.5)
    tail = (1 - CONFIDENCE) / 2
    low = betaincinv(np.maximum(k, np.finfo(float).tiny), n - k + 1, tail)
    high = betaincinv(k + 1, np.maximum(n - k, np.finfo(float).tiny), 1 - tail)
    return np.where(known & (k > 0), low, 0.0), np.where(known & (k < n), high, 1.0)


def plain(key: object) -> tuple[object, ...]:
    """A key of a group in which a missing value equals a missing value."""
    parts: Sequence[object] = key if isinstance(key, tuple) else (key,)
    return tuple(None if value is None or value != value else value for value in parts)
