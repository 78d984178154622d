"""The results of a campaign: tables of its runs, parameters and groups, and remarks on them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.campaigns.reporting.quality import USABLE, by_parameter, of_all_parameters, plain
from fmu_didim.campaigns.reporting.sections import brief_report, confusion_section, group_columns, groups_section
from fmu_didim.campaigns.reporting.status import VERDICTS, Status, status_of
from fmu_didim.campaigns.running.store import FAILURES, Store
from fmu_didim.report.sections import Table
from fmu_didim.report.terminal import section_lines, table_lines, wrapped

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FEW_RUNS = 20
"""[runs] Data sets of a group below which its coverage says little: 19 of 20 inside leave 75 % to 99.9 %."""
GROUPS_PRINTED = 12
"""[groups] Most groups that are printed; otherwise the groups by each single field."""


class Results:
    """The results of a campaign in its folder; only those of the runs that are planned now."""

    def __init__(self, store: Store) -> None:
        self.store = store
        self.head = store.head()
        self._qualities: dict[tuple[str, ...], pd.DataFrame] = {}

    def __repr__(self) -> str:
        return f"Results({self.head['campaign']['name']!r}, {self.folder})"

    @property
    def folder(self) -> Path:
        """The folder of the results."""
        return self.store.folder

    @property
    def quantity(self) -> str:
        """What its cases fit, in a word: torque, or the outputs of a model."""
        return str(self.head.get("quantity", "torque"))

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
        """The progress of the campaign; quick, as it reads few columns."""
        return status_of(self.store)

    @cached_property
    def _runs(self) -> pd.DataFrame:
        rows = self.store.rows([n for n in _COLUMNS if n != "seed"]).to_pandas()
        return self._planned.merge(rows, on="id", how="left").assign(
            status=lambda table: table["status"].fillna("open"),
            reasons=lambda table: [_joined(r, ", ") for r in table["reasons"]],
            conditions=lambda table: [_joined(r, "; ") for r in table["conditions"]],
        )

    def to_frame(self, *, parameters: bool = True) -> pd.DataFrame:
        """One row a planned run: the fields that vary, status (``open`` if not run yet), verdict, what it rests on,
        message, figures.

        Args:
            parameters: a column for the value of each parameter too, ``<name>.std`` and ``<name>.true`` beside it.
        """
        if not parameters or self.parameters().empty:
            return self._runs.copy()
        wide = self.parameters().pivot(index="id", columns="parameter", values=["value", "std", "true"])
        wide.columns = [name if kind == "value" else f"{name}.{kind}" for kind, name in wide.columns]
        return self._runs.merge(wide, left_on="id", right_index=True, how="left")

    def parameters(self) -> pd.DataFrame:
        """One row a parameter of each answered run: value, std, low, high, true, and the fields that vary."""
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

    def summary(self) -> str:
        """The text for the terminal: groups, hidden effects against named ones, remarks."""
        tables, paths = [group_columns(whole := self.groups(), self.paths, quantity=self.quantity)], self.paths
        if len(whole) > GROUPS_PRINTED and len(paths) > 1:
            tables = [group_columns(self.groups(path), [path], quantity=self.quantity) for path in paths]
        blocks = [table_lines(Table(columns), width=None) for columns in tables]
        blocks.append(section_lines(confusion_section(self.confusion())))
        blocks.append([line for remark in self.remarks() for line in wrapped(remark, "- ", "  ")])
        return "\n\n".join("\n".join(block) for block in (self.status().lines()[:2], *blocks) if block)

    def full_id(self, begin: str) -> str:
        """The id of the planned run that begins so; raises UnknownNameError where there is none, or more than one."""
        known = self.store.planned()["id"].to_pylist()
        found = [id_ for id_ in known if id_.startswith(begin)]
        if len(found) != 1:
            raise UnknownNameError("run", begin, found or known[:10], where=str(self.folder))
        return str(found[0])

    def describe(self, begin: str) -> list[str]:
        """All that is known of a run, line by line; ``begin``: the first digits of its id."""
        row = self._runs[self._runs["id"] == self.full_id(begin)].iloc[0].to_dict()
        named = {**{path: row[path] for path in self.paths}, "seed": row["seed"]}
        lines = [f"run {row['id']}", *(f"  {path} = {value}" for path, value in named.items()), ""]
        known = {k: v for k, v in row.items() if k not in (*named, "id") and v is not None and v == v and v != ""}
        lines += [f"{key}: {value}" for key, value in known.items()]
        for p in self._parameters[self._parameters["id"] == row["id"]].to_dict("records"):
            true = f", true {p['true']:.6g}" if p["true"] == p["true"] else ""
            lines.append(f"  {p['parameter']} = {p['value']:.6g} ± {p['std']:.2g} {p['unit']}{true}")
        return [*lines, "", f"again: fmu-didim campaign retry {self.folder} --only {row['id']}"]

    def groups(self, *by: str) -> pd.DataFrame:
        """One row a group: number of runs by verdict, of valid ones that rest on what their data do not show
        (``conditional``), iterations, errors, and the quality of the answers.

        Args:
            by: fields that vary; by default all of them, without the seed.

        Raises:
            UnknownNameError: nothing of this name varies.
        """
        names = self._grouping(by)
        groups = self._runs.groupby(names, dropna=False, sort=False) if names else [((), self._runs)]
        quality = of_all_parameters(self.by_parameter(*by), names)
        rows = []
        for key, group in groups:
            key = key if isinstance(key, tuple) else (key,)
            verdict, status = group["verdict"], group["status"]
            row = dict(zip(names, key, strict=True)) | {"runs": len(group)}
            row |= {v: int((verdict == v).sum()) for v in VERDICTS}
            row["conditional"] = int((group["conditions"] != "").sum())
            row |= {"failed": int(status.isin(FAILURES).sum()), "open": int((status == "open").sum())}
            row["data"] = int(group.loc[status != "open", "data"].nunique())
            row["iterations"] = group["iterations"].median()
            row["error_percent"] = group.loc[verdict.isin(USABLE), "error_percent"].median()
            row["seconds"] = group["seconds"].median()
            rows.append(row | quality.get(plain(key), {}))
        return pd.DataFrame(rows)

    def _grouping(self, by: Sequence[str]) -> list[str]:
        for name in by:
            if name not in self.paths:
                raise UnknownNameError("field that varies", name, self.paths, where=str(self.folder))
        return list(by) if by else self.paths

    def by_parameter(self, *by: str) -> pd.DataFrame:
        """One row a group and parameter: mean, sigma, stated sigma; where the true value is known bias and coverage.

        Args:
            by: fields that vary; by default all of them, without the seed.
        """
        names = self._grouping(by)
        if tuple(names) not in self._qualities:
            self._qualities[tuple(names)] = by_parameter(self._runs, self._parameters, names)
        return self._qualities[tuple(names)].copy()

    def plot(self, field: str | None = None) -> Figure:
        """A Matplotlib figure: sigma and, where true values are known, bias of each parameter over a field that varies.

        Args:
            field: its path, the first one by default.

        Raises:
            UnknownNameError: nothing of this name varies; InputError: no field varies, or there is nothing to draw.
        """
        from fmu_didim.campaigns.reporting.charts import field_chart
        from fmu_didim.report.drawing.figures import matplotlib_figure

        if field is None and not self.paths:
            raise InputError(
                "There is no axis to draw over: only the seeds vary.", where=str(self.folder),
                next_step="by_parameter() has bias, sigma and coverage; or let the campaign vary a field.",
            )  # fmt: skip
        path = field or self.paths[0]
        return matplotlib_figure(field_chart(self.by_parameter(path), path))

    def _repr_html_(self) -> str:
        """For notebooks: progress, groups and remarks."""
        from fmu_didim.report.page import notebook_html

        groups = groups_section(self.groups(), self.paths, quantity=self.quantity)
        return notebook_html(brief_report(self.status(), [groups], self.remarks()))

    def confusion(self) -> pd.DataFrame:
        """Of discoveries: number of runs by hidden and by named effects; empty for identifications."""
        runs = self._runs[self._runs["answer"].notna()]
        if runs.empty:
            return pd.DataFrame()
        hidden = runs["hidden"].fillna("not known").replace("", "nothing")
        return pd.crosstab(hidden.rename("hidden"), runs["named"].replace("", "nothing").rename("named"))

    def remarks(self) -> list[str]:
        """Remarks for the reader of these figures."""
        status, runs, found = self.status(), self._runs, list[str]()
        ran = runs[runs["status"] != "open"]
        without = int((~ran["verdict"].isin(USABLE)).sum())
        if without:
            parts = {**{v: status.verdicts[v] for v in VERDICTS if v not in USABLE}, **status.failures}
            counted = ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in parts.items() if n)
            found.append(
                f"{without} of {len(ran)} runs gave no answer that may be used ({counted}): bias, sigma and coverage "
                f"are those of the other {len(ran) - without}; 'with misses' counts the former as intervals that miss."
            )
        if status.verdicts["doubtful"]:
            found.append(
                f"{status.verdicts['doubtful']} answers are doubtful; they count, because their values may be used."
            )
        resting = [text for text in runs["conditions"] if text]
        if resting:
            found.append(
                f"{len(resting)} of {status.verdicts['valid']} valid answers rest on what their data do not show "
                f"(conditions of each run), the first of them: provided that {resting[0]}."
            )
        if status.open:
            found.append(f"{status.open} of {status.planned} runs have not run yet.")
        if not self._parameters.empty and self._parameters["true"].notna().any():
            found += self._remarks_on_coverage(ran)
        return found + status.lines()[-1:] if status.elsewhere else found

    def _remarks_on_coverage(self, ran: pd.DataFrame) -> list[str]:
        found, data = list[str](), int(ran["data"].nunique())
        if data < len(ran):
            found.append(
                f"{len(ran)} runs are on {data} different data: runs on the same data err together, so intervals of "
                "coverage count the data."
            )
        table = self.by_parameter()
        few = table[table["data"] < FEW_RUNS]
        if not few.empty:
            groups = len(few.drop_duplicates(self.paths)) if self.paths else 1
            found.append(f"{groups} groups have fewer than {FEW_RUNS} data: their coverage and sigma say little.")
        unknown = self._parameters.loc[self._parameters["true"].isna(), "parameter"].unique()
        if len(unknown):
            found.append(f"No true value is known of {', '.join(unknown)}: other parameters are regrouped into it.")
        return found


def _joined(texts: Any, by: str) -> str:
    """Texts of a run in a row; empty where it has none."""
    return by.join(texts) if isinstance(texts, Iterable) else ""


_COLUMNS = (
    "status", "verdict", "reasons", "conditions", "message", "iterations", "finish_iterations", "error_percent",
    "held_out_percent", "condition_number", "answer", "named", "hidden", "gap_before", "gap_after", "findings",
    "seconds", "cpu_seconds", "attempt", "started", "host",
)  # fmt: skip
