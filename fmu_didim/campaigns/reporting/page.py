"""The report of a campaign: one page that needs no network, and its tables as CSV and Parquet."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pyarrow as pa
from pyarrow.csv import write_csv
from pyarrow.parquet import write_table

from fmu_didim.base.files import whole_file
from fmu_didim.campaigns.reporting.charts import page_figures
from fmu_didim.campaigns.reporting.notebook import banner
from fmu_didim.campaigns.reporting.quality import USED
from fmu_didim.campaigns.reporting.results import Results
from fmu_didim.campaigns.reporting.texts import shown
from fmu_didim.campaigns.running.store import FILES, unwritable
from fmu_didim.report.html.templates import write_page
from fmu_didim.report.identification.page import REPORT_FILE
from fmu_didim.report.identification.tables import Table, table
from fmu_didim.report.numbers import MISSING, pretty_unit, significant
from fmu_didim.workflow.case_files import shell_line

ROWS_OPEN = 48
"""[rows] Of the table of parameters up to which the page shows it unfolded: six groups of eight."""
ROWS_SHOWN = 5000
"""[rows] Most runs that the page lists one by one; files hold all of them."""
CELL_RUNS = 25
"""[runs] Most runs that a group of the page links to, those without answer first."""

TEMPLATE = "campaign.html.j2"
DISCOVERY_REPORT = "discovery.html"


@dataclass(frozen=True)
class Cell:
    """A group of runs on the page: its texts, and the runs that it links to."""

    texts: tuple[str, ...]
    runs: tuple[tuple[str, str], ...]


def write_campaign_report(results: Results) -> list[Path]:
    """Write ``report.html`` and the tables to the folder of a campaign; returns their paths.

    Raises:
        InputError: nothing was run yet, or they cannot be written.
    """
    tables = {
        "runs": results.to_frame(parameters=False), "parameters": results.parameters(),
        "groups": results.groups(), "by_parameter": results.by_parameter(),
    }  # fmt: skip
    written = []
    try:
        for name, frame in tables.items():
            mixed = {column: frame[column].map(_text) for column in frame.columns if frame[column].dtype == object}
            content = pa.Table.from_pandas(frame.assign(**mixed), preserve_index=False)
            for suffix, write in ((".csv", write_csv), (".parquet", write_table)):
                path = results.folder / f"{name}{suffix}"
                with whole_file(path) as temporary:
                    write(content, temporary)
                written.append(path)
        page = results.folder / REPORT_FILE
        with whole_file(page) as temporary:
            _write_page(results, tables["groups"], tables["by_parameter"], temporary)
    except OSError as error:
        raise unwritable(results.folder, error) from error
    return [page, *written]


def _text(value: Any) -> Any:
    return value if value is None or isinstance(value, str) else None if value != value else str(value)


def _write_page(results: Results, summary: pd.DataFrame, quality: pd.DataFrame, path: Path) -> None:
    status = results.status()
    head = results.head
    campaign = head["campaign"]
    runs = results.to_frame(parameters=False)
    figures = page_figures({path: results.by_parameter(path) for path in results.paths})
    confusion = results.confusion()
    provenance: dict[str, Any] = {"campaign": {k: v for k, v in campaign.items() if k != "case"}}
    provenance |= {name: head[name] for name in ("version", "code", "planned", "folder")}
    if head.get("file"):
        words = ["fmu-didim", "campaign", "run", head["file"], "--out", str(results.folder.resolve())]
        provenance["command"] = shell_line(words)
    write_page(
        path,
        TEMPLATE,
        document=SimpleNamespace(name=campaign["name"], provenance=provenance),
        verdict=banner(status),
        description=campaign.get("description", ""),
        cards=_cards(summary, status.planned - status.open, status.planned),
        remarks=results.remarks(),
        heads=_group_heads(results, summary),
        groups=_groups(results, summary, runs),
        axes=_axes(results),
        parameters=_parameters(results, quality),
        rows_open=ROWS_OPEN,
        figures=figures,
        confusion=None if confusion.empty else _confusion(confusion),
        rows=_rows(results, runs),
        row_heads=("run", *results.paths, "seed", "verdict", "torque error %", "iterations", "s", "message"),
        left_out=max(len(runs) - ROWS_SHOWN, 0),
        show=shell_line(["fmu-didim", "campaign", "show", str(results.folder)]),
    )


def _cards(summary: pd.DataFrame, done: int, planned: int) -> list[tuple[str, str]]:
    cards = [("runs", f"{done} of {planned}")]
    for name in (*USED, "not_settled", "refused", "failed"):
        if summary[name].sum():
            cards.append((name.replace("_", " "), str(summary[name].sum())))
    if "coverage" in summary and summary["coverage"].notna().any():
        weights = summary["valid"] + summary["doubtful"]
        cards.append(
            ("coverage of the 95 % intervals", _percent((summary["coverage"] * weights).sum() / weights.sum()))
        )
    return cards


def _counts(summary: pd.DataFrame) -> list[str]:
    """The counts of groups that say something: none that is zero everywhere, no data where each run has its own."""
    told = [name for name in ("doubtful", "not_settled", "refused", "failed", "open") if summary[name].any()]
    data = ["data"] if (summary["data"] != summary["runs"]).any() else []
    return ["runs", *data, "valid", *told]


def _group_heads(results: Results, summary: pd.DataFrame) -> tuple[str, ...]:
    found = [
        *results.paths,
        *(name.replace("_", " ") for name in _counts(summary)),
        "iterations",
        "torque error %",
        "s",
    ]
    return (
        *found,
        *(("coverage", "95 % interval", "with misses", "largest bias / σ") if "coverage" in summary else ()),
    )


def _groups(results: Results, summary: pd.DataFrame, runs: pd.DataFrame) -> list[Cell]:
    """The rows of all groups, each with links to its runs, those without answer first."""
    order = runs["verdict"].isin(USED).astype(int)
    runs = runs.assign(order=order).sort_values("order", kind="stable")
    grouped = runs.groupby(results.paths, dropna=False, sort=False) if results.paths else [((), runs)]
    members = {_key(key): group for key, group in grouped}
    listed = set(runs.head(ROWS_SHOWN)["id"])
    counts = _counts(summary)
    cells = []
    for row in summary.to_dict("records"):
        texts = [shown(row[path]) for path in results.paths]
        texts += [str(row[name]) for name in counts]
        texts += [shown(row["iterations"]), significant(row["error_percent"]), significant(row["seconds"], 2)]
        if "coverage" in row:
            low, high = row["coverage_low"], _percent(row["coverage_high"])
            interval = f"{100 * low:.1f} to {high}" if low == low else MISSING
            texts += [_percent(row["coverage"]), interval, _percent(row["coverage_least"])]
            texts.append(significant(row["largest_bias_in_sigma"], 2))
        group = members[_key(tuple(row[path] for path in results.paths))].head(CELL_RUNS)
        links = [
            (id_, _word(verdict, status))
            for id_, verdict, status in zip(group["id"], group["verdict"], group["status"], strict=True)
            if id_ in listed
        ]
        cells.append(Cell(tuple(texts), tuple(links)))
    return cells


def _axes(results: Results) -> list[tuple[str, Table]]:
    """For each field that varies, the groups by it alone."""
    found = []
    for path in results.paths if len(results.paths) > 1 else []:
        summary = results.groups(path)
        names = _counts(summary)
        heads = [path, *(name.replace("_", " ") for name in names), "iterations"]
        if "coverage" in summary:
            heads += ["coverage", "with misses", "largest bias / σ"]
        rows = []
        for r in summary.to_dict("records"):
            rows.append([shown(r[path]), *(str(r[n]) for n in names), shown(r["iterations"])])
            if "coverage" in summary:
                rows[-1] += [_percent(r["coverage"]), _percent(r["coverage_least"])]
                rows[-1].append(significant(r["largest_bias_in_sigma"], 2))
        made = table(heads, rows, (0,), is_aligned=False)
        if made is not None and len(rows) <= ROWS_SHOWN // 10:
            found.append((path, made))
    return found


def _parameters(results: Results, quality: pd.DataFrame) -> Table | None:
    """Bias, sigma and coverage of each parameter in each group."""
    figures = {"mean": "value", "true": "true", "bias": "bias", "σ": "sigma", "σ stated": "stated"}
    heads = [*results.paths, "parameter", "unit", *figures, "bias / σ", "coverage", "answers of runs"]
    rows = [
        [*(shown(r[path]) for path in results.paths), r["parameter"], pretty_unit(r["unit"]),
         *(significant(r[name]) for name in figures.values()), significant(r["bias_in_sigma"], 2),
         _percent(r["coverage"]), f"{r['used']} of {r['ran']}"]
        for r in quality.head(ROWS_SHOWN).to_dict("records")
    ]  # fmt: skip
    words = tuple(range(len(results.paths) + 2))
    return table(heads, rows, words, is_aligned=False) if rows else None


def _confusion(counts: pd.DataFrame) -> Table:
    rows = [
        [str(hidden), *(str(n) if n else "" for n in row)]
        for hidden, row in zip(counts.index, counts.to_numpy(), strict=True)
    ]
    return Table(("hidden \\ named", *map(str, counts.columns)), tuple(map(tuple, rows)))


def _rows(results: Results, runs: pd.DataFrame) -> list[tuple[str, str | None, tuple[str, ...]]]:
    """Id, page and texts of the runs that are listed: those without answer first."""
    order = runs["verdict"].isin(USED).astype(int)
    kept = runs.assign(order=order).sort_values("order", kind="stable").head(ROWS_SHOWN)
    found = []
    for row in kept.to_dict("records"):
        texts = [*(shown(row[path]) for path in results.paths), str(row["seed"]), _word(row["verdict"], row["status"])]
        texts += [significant(row["error_percent"]), shown(row["iterations"]), significant(row["seconds"], 2)]
        texts.append(_first_line(row["message"]))
        found.append((row["id"], _page_of(results.folder, row["id"]), tuple(texts)))
    return found


def _page_of(folder: Path, id_: str) -> str | None:
    """The page of a run whose files were kept."""
    names = (f"{FILES}/{id_}/{name}" for name in (REPORT_FILE, DISCOVERY_REPORT))
    return next((name for name in names if (folder / name).is_file()), None)


def _first_line(text: Any) -> str:
    return str(text).partition("\n")[0] if isinstance(text, str) else ""


def _word(verdict: Any, status: str) -> str:
    return verdict.replace("_", " ") if isinstance(verdict, str) else status


def _percent(share: float) -> str:
    return MISSING if share is None or share != share else f"{100 * share:.1f} %"


def _key(key: Any) -> str:
    parts: Iterable[Any] = key if isinstance(key, tuple) else (key,)
    return json.dumps([None if v is None or v != v else v for v in parts], default=str)
