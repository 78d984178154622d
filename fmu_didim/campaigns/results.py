"""What a campaign gave: tables of its runs and parameters, and how good the answers of a group are.

    bias      mean(value - true)                         sigma     standard deviation of the values of a group
    stated    sqrt(mean(std^2))                          coverage  part of the 95 % intervals that hold the true value

Only valid and doubtful answers count for these; how many others there were stands beside them, and so does the coverage
with each of those as a miss. The interval of a coverage is Clopper and Pearson's (Biometrika 26, 1934), of as many
trials as there are different data: runs on the same data are no further evidence.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import beta

from fmu_didim.campaigns import thresholds as limits
from fmu_didim.campaigns.execute import FAILURES
from fmu_didim.campaigns.store import Store
from fmu_didim.errors import UnknownNameError
from fmu_didim.statistics import CONFIDENCE

VERDICTS = ("valid", "doubtful", "not_settled", "refused")
USED = ("valid", "doubtful")
"""Verdicts of answers that may be used, which alone count for bias, sigma and coverage."""


@dataclass(frozen=True)
class Status:
    """How far a campaign is.

    Attributes:
        planned: runs; verdicts: verdict -> runs; failures: status -> runs; open: not run yet.
        elsewhere: rows in the folder that belong to another plan, to other files or to another version of the code.
    """

    name: str
    planned: int
    verdicts: dict[str, int]
    failures: dict[str, int]
    open: int
    elsewhere: int
    others: list[str]

    def lines(self) -> list[str]:
        """For the terminal."""
        done = self.planned - self.open
        counts = [f"{n} {name.replace('_', ' ')}" for name, n in {**self.verdicts, **self.failures}.items() if n]
        lines = [f"{self.name}: {done} of {self.planned} runs done" + (f" ({', '.join(counts)})" if counts else "")]
        if self.open:
            lines.append(f"{self.open} open" + (f", running: {', '.join(self.others)}" if self.others else ""))
        if self.elsewhere:
            lines.append(f"{self.elsewhere} further rows are of another plan, version or file; they are used nowhere")
        return lines


class Results:
    """The results of a campaign in its folder: those of the runs that are planned now, no others."""

    def __init__(self, store: Store) -> None:
        self.store = store
        self.head = store.head()

    def __repr__(self) -> str:
        return f"Results({self.head['campaign']['name']!r}, {self.folder})"

    @property
    def folder(self) -> Path:
        """Where they are."""
        return self.store.folder

    @property
    def paths(self) -> list[str]:
        """The fields that vary, columns of the tables."""
        return list(dict.fromkeys(self.head["paths"]))

    @cached_property
    def _planned(self) -> pd.DataFrame:
        table = self.store.planned().to_pandas()
        labels = [json.loads(text) for text in table.pop("settings")]
        for path in self.paths:
            table[path] = [each.get(path) for each in labels]
        return table

    def status(self) -> Status:
        """How far it is; quick, as it reads few columns."""
        planned = set(self.store.planned()["id"].to_pylist())
        rows = self.store.rows(()).to_pylist()
        own = [row for row in rows if row["id"] in planned]
        return Status(
            name=self.head["campaign"]["name"], planned=len(planned),
            verdicts={v: sum(row["verdict"] == v for row in own) for v in VERDICTS},
            failures={s: sum(row["status"] == s for row in own) for s in FAILURES},
            open=len(planned) - len(own), elsewhere=len(rows) - len(own), others=self.store.others(),
        )  # fmt: skip

    @cached_property
    def _runs(self) -> pd.DataFrame:
        rows = self.store.rows([n for n in _COLUMNS if n != "seed"]).to_pandas()
        return self._planned.merge(rows, on="id", how="left").assign(
            status=lambda table: table["status"].fillna("open"),
            reasons=lambda table: [", ".join(r) if r is not None else "" for r in table["reasons"]],
        )

    def to_frame(self, *, parameters: bool = True) -> pd.DataFrame:
        """One row a planned run: what varies, status (``open`` where it was not run), verdict, message, figures.

        Args:
            parameters: a column for the value of each parameter too, ``<name>.std`` and ``<name>.true`` beside it.
        """
        if not parameters or self.parameters().empty:
            return self._runs.copy()
        wide = self.parameters().pivot(index="id", columns="parameter", values=["value", "std", "true"])
        wide.columns = [name if kind == "value" else f"{name}.{kind}" for kind, name in wide.columns]
        return self._runs.merge(wide, left_on="id", right_index=True, how="left")

    def parameters(self) -> pd.DataFrame:
        """One row a parameter of each run that has answered: value, std, low, high, true, and what varies."""
        return self._parameters.copy()

    @cached_property
    def _parameters(self) -> pd.DataFrame:
        table = self.store.rows(["parameters"])
        lists = table["parameters"].combine_chunks()
        counts = np.asarray(lists.value_lengths().fill_null(0))
        inner = lists.flatten()
        found = pd.DataFrame({name: inner.field(name).to_pandas() for name in inner.type.names})
        found = found.rename(columns={"name": "parameter"})
        found.insert(0, "id", np.repeat(table["id"].to_pandas().to_numpy(), counts))
        shown = ["id", "data", "seed", "verdict", *self.paths]
        return self._runs[shown].merge(found, on="id")

    def summary(self, *by: str) -> pd.DataFrame:
        """One row a group: how many runs came to what, iterations, errors, and how good their answers are.

        Args:
            by: fields that vary; by default all of them, without the seed.

        Raises:
            UnknownNameError: nothing of this name varies.
        """
        names = self._grouping(by)
        groups = self._runs.groupby(names, dropna=False, sort=False) if names else [((), self._runs)]
        quality = self._quality(names)
        rows = []
        for key, group in groups:
            key = key if isinstance(key, tuple) else (key,)
            verdict, status = group["verdict"], group["status"]
            row = dict(zip(names, key, strict=True)) | {"runs": len(group)}
            row |= {v: int((verdict == v).sum()) for v in VERDICTS}
            row |= {"failed": int(status.isin(FAILURES).sum()), "open": int((status == "open").sum())}
            row["data"] = int(group.loc[status != "open", "data"].nunique())
            row["iterations"] = group["iterations"].median()
            row["error_percent"] = group.loc[verdict.isin(USED), "error_percent"].median()
            row["seconds"] = group["seconds"].median()
            rows.append(row | quality.get(_plain(key), {}))
        return pd.DataFrame(rows)

    def _grouping(self, by: Sequence[str]) -> list[str]:
        for name in by:
            if name not in self.paths:
                raise UnknownNameError("field that varies", name, self.paths, where=str(self.folder))
        return list(by) if by else self.paths

    def _quality(self, names: list[str]) -> dict[tuple[object, ...], dict[str, float]]:
        """Group -> coverage of all parameters together, its interval, and it with runs without answer as misses."""
        table = self._by_parameter(names)
        if table.empty or table["coverage"].isna().all():
            return {}
        table = table[table["coverage"].notna()]
        found: dict[tuple[object, ...], dict[str, float]] = {}
        for key, group in table.groupby(names, dropna=False, sort=False) if names else [((), table)]:
            key = key if isinstance(key, tuple) else (key,)
            share, data = float(group["coverage"].mean()), int(group["data"].min())
            low, high = proportion_interval(share, data)
            found[_plain(key)] = {
                "coverage": share, "coverage_low": low, "coverage_high": high,
                "coverage_least": float(group["coverage_least"].mean()),
                "largest_bias_in_sigma": float(group["bias_in_sigma"].abs().max()),
            }  # fmt: skip
        return found

    def by_parameter(self, *by: str) -> pd.DataFrame:
        """One row a group and parameter: mean, sigma, stated sigma; where the true value is known bias and coverage.

        Args:
            by: fields that vary; by default all of them, without the seed.
        """
        return self._by_parameter(self._grouping(by))

    def _by_parameter(self, names: list[str]) -> pd.DataFrame:
        used = self._parameters[self._parameters["verdict"].isin(USED)]
        if used.empty:
            return pd.DataFrame()
        has_truth = used["true"].notna()
        inside = (used["low"] <= used["true"]) & (used["true"] <= used["high"])
        used = used.assign(
            error=used["value"] - used["true"], variance=used["std"] ** 2, inside=inside.where(has_truth, 0).astype(int)
        )
        groups = used.groupby([*names, "parameter", "unit"], dropna=False, sort=False)
        found = groups.agg(
            used=("id", "size"), data=("data", "nunique"), true=("true", "mean"), known=("true", "count"),
            value=("value", "mean"), bias=("error", "mean"), sigma=("value", "std"), variance=("variance", "mean"),
            inside=("inside", "sum"),
        ).reset_index()  # fmt: skip
        found["stated"] = np.sqrt(found.pop("variance"))
        found["bias_in_sigma"] = found["bias"] / found["stated"]
        ran = self._runs[self._runs["status"] != "open"]
        counts = ran.groupby(names, dropna=False).size().rename("ran").reset_index() if names else None
        found = found.merge(counts, on=names, how="left") if counts is not None else found.assign(ran=len(ran))
        hits, known = found.pop("inside"), found.pop("known").replace(0, np.nan)
        found["coverage"] = hits / known
        found["coverage_least"] = (hits / found["ran"]).where(known.notna())
        bounds = [proportion_interval(c, int(n)) for c, n in zip(found["coverage"], found["data"], strict=True)]
        found["coverage_low"], found["coverage_high"] = [b[0] for b in bounds], [b[1] for b in bounds]
        return found

    def confusion(self) -> pd.DataFrame:
        """Of discoveries: hidden effects by what was named, in runs; empty for identifications."""
        runs = self._runs[self._runs["answer"].notna()]
        if runs.empty:
            return pd.DataFrame()
        hidden = runs["hidden"].fillna("not known").replace("", "nothing")
        return pd.crosstab(hidden.rename("hidden"), runs["named"].replace("", "nothing").rename("named"))

    def remarks(self) -> list[str]:
        """What to have in mind with these figures."""
        status, runs, found = self.status(), self._runs, list[str]()
        ran = runs[runs["status"] != "open"]
        without = int((~ran["verdict"].isin(USED)).sum())
        if without:
            parts = {**{v: status.verdicts[v] for v in VERDICTS if v not in USED}, **status.failures}
            counted = ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in parts.items() if n)
            found.append(
                f"{without} of {len(ran)} runs gave no answer that may be used ({counted}): bias, sigma and coverage "
                f"are of the other {len(ran) - without} alone; 'with misses' counts those as intervals that miss."
            )
        if status.verdicts["doubtful"]:
            found.append(
                f"{status.verdicts['doubtful']} answers are doubtful; they count, as their values may be used."
            )
        if status.open:
            found.append(f"{status.open} of {status.planned} runs are not run yet.")
        if not self._parameters.empty and self._parameters["true"].notna().any():
            found += self._remarks_on_coverage(ran)
        return found + status.lines()[-1:] if status.elsewhere else found

    def _remarks_on_coverage(self, ran: pd.DataFrame) -> list[str]:
        found = []
        data = int(ran["data"].nunique())
        if data < len(ran):
            found.append(
                f"{len(ran)} runs are on {data} different data: runs with the same data err together, and intervals of "
                "coverage count the data."
            )
        table = self.by_parameter()
        few = table[table["data"] < limits.FEW_RUNS]
        if not few.empty:
            groups = len(few.drop_duplicates(self.paths)) if self.paths else 1
            found.append(
                f"{groups} groups have fewer than {limits.FEW_RUNS} data: their coverage and sigma say little."
            )
        unknown = self._parameters.loc[self._parameters["true"].isna(), "parameter"].unique()
        if len(unknown):
            found.append(f"No true value is known of {', '.join(unknown)}: other parameters are regrouped into it.")
        return found


_COLUMNS = (
    "status", "verdict", "reasons", "message", "iterations", "finish_iterations", "error_percent", "held_out_percent",
    "condition_number", "answer", "named", "hidden", "gap_before", "gap_after", "seconds", "cpu_seconds", "attempt",
    "started", "host",
)  # fmt: skip


def proportion_interval(share: float, count: int) -> tuple[float, float]:
    """95 % interval of a probability, of which ``share`` of ``count`` trials came true (Clopper and Pearson 1934)."""
    if count < 1 or not np.isfinite(share):
        return 0.0, 1.0
    hits, tail = share * count, (1 - CONFIDENCE) / 2
    low = float(beta.ppf(tail, hits, count - hits + 1)) if hits > 0 else 0.0
    high = float(beta.ppf(1 - tail, hits + 1, count - hits)) if hits < count else 1.0
    return low, high


def _plain(key: Sequence[object]) -> tuple[object, ...]:
    """A key of a group in which a missing value equals a missing value."""
    return tuple(None if value is None or value != value else value for value in key)
