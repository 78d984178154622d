"""The report of a campaign: one page that needs no network, and its tables as CSV and Parquet."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
from pyarrow.csv import write_csv
from pyarrow.parquet import write_table

from fmu_didim.base.files import whole_file
from fmu_didim.campaigns.reporting.charts import page_figures
from fmu_didim.campaigns.reporting.quality import USABLE, plain
from fmu_didim.campaigns.reporting.results import Results
from fmu_didim.campaigns.reporting.sections import brief_report, confusion_section, group_columns, groups_section, shown
from fmu_didim.campaigns.running.store import FILES, unwritable
from fmu_didim.report.discovery.sections import DISCOVERY_FILE
from fmu_didim.report.drawing.forest_chart import Expectation, forest_chart
from fmu_didim.report.numbers import MISSING, pretty_unit, significant
from fmu_didim.report.page import write_page
from fmu_didim.report.sections import Block, Charts, Column, Folded, Link, Report, Section, Table, note, words
from fmu_didim.results.result import REPORT_FILE
from fmu_didim.workflow.case_files import shell_line

ROWS_OPEN = 48
"""[rows] Of the table of parameters up to which the page shows it unfolded: six groups of eight."""
ROWS_SHOWN = 5000
"""[rows] Most runs that the page lists one by one; files hold all of them."""
CELL_RUNS = 25
"""[runs] Most runs that a group of the page links to, those without answer first."""
FOREST = "How far the mean of the answers of each group is off the truth, and where 95 % of the answers lie."
VALUES_SHOWN = 500
"""[rows] Most values of a field whose groups the page lists by this field alone."""


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
            texts = frame.select_dtypes(exclude=["number", "bool"]).columns
            plain = {column: mixed.get(column, frame[column]).map(_no_formula) for column in texts}
            for suffix, write, columns in ((".csv", write_csv, plain), (".parquet", write_table, mixed)):
                content = pa.Table.from_pandas(frame.assign(**columns), preserve_index=False)
                if columns is plain:
                    content = content.rename_columns([_no_formula(column) for column in content.column_names])
                path = results.folder / f"{name}{suffix}"
                with whole_file(path) as temporary:
                    write(content, temporary)
                written.append(path)
        page = results.folder / REPORT_FILE
        with whole_file(page) as temporary:
            write_page(campaign_report(results, tables["groups"], tables["by_parameter"]), temporary)
    except OSError as error:
        raise unwritable(results.folder, error) from error
    return [page, *written]


def _text(value: Any) -> Any:
    return value if value is None or isinstance(value, str) else None if value != value else str(value)


_FORMULA = re.compile(r"[=+\-@\t\r\n]")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)


def _no_formula(text: Any) -> Any:
    """A text that spreadsheets take for text: one that begins as a formula does gets a ``'`` in front.

    Source: OWASP, "CSV Injection".
    """
    if isinstance(text, str) and _FORMULA.match(text) and not _NUMBER.fullmatch(text):
        return f"'{text}"
    return text


def campaign_report(results: Results, groups: pd.DataFrame, quality: pd.DataFrame) -> Report:
    """All that is shown of a campaign, from its groups and the quality of each parameter in each of them."""
    status, head = results.status(), results.head
    provenance: dict[str, Any] = {"campaign": {k: v for k, v in head["campaign"].items() if k != "case"}}
    provenance |= {name: head[name] for name in ("version", "code", "planned", "folder")}
    if head.get("file"):
        command = ["fmu-didim", "campaign", "run", head["file"], "--out", str(results.folder.resolve())]
        provenance["command"] = shell_line(command)
    runs = results.to_frame(parameters=False)
    order = runs["verdict"].isin(USABLE).astype(int)
    runs = runs.assign(order=order).sort_values("order", kind="stable")  # those without answer first
    fields = [(path, results.groups(path)) for path in results.paths] if len(results.paths) > 1 else []
    sections = [
        groups_section(groups, results.paths, _links(results, groups, runs), quantity=results.quantity),
        Section("By field", [], anchor="axes"),
        *(
            Section(path, [Table(group_columns(of, [path], quantity=results.quantity))])
            for path, of in fields
            if len(of) <= VALUES_SHOWN
        ),
        *_figures(results),
        _parameters(results, quality),
        confusion_section(results.confusion()),
        _runs(results, runs),
    ]
    return brief_report(
        status, sections, results.remarks(), description=head["campaign"].get("description", ""),
        cards=_cards(groups, status.planned - status.open, status.planned), provenance=provenance,
    )  # fmt: skip


def _cards(summary: pd.DataFrame, done: int, planned: int) -> list[tuple[str, str]]:
    cards = [("runs", f"{done} of {planned}")]
    for name in (*USABLE, "not_settled", "refused", "failed"):
        if summary[name].sum():
            cards.append((name.replace("_", " "), str(summary[name].sum())))
    if "coverage" in summary and summary["coverage"].notna().any():
        weights = summary["valid"] + summary["doubtful"]
        share = (summary["coverage"] * weights).sum() / weights.sum()
        cards.append(("coverage of the 95 % intervals", _percent(share)))
    return cards


def _links(results: Results, groups: pd.DataFrame, runs: pd.DataFrame) -> list[list[Link]]:
    """Of each group the first of its runs, as far as the page lists them."""
    grouped = runs.groupby(results.paths, dropna=False, sort=False) if results.paths else [((), runs)]
    members = {plain(key): group for key, group in grouped}
    listed = set(runs.head(ROWS_SHOWN)["id"])
    found = []
    for row in groups.to_dict("records"):
        group = members[plain(tuple(row[path] for path in results.paths))].head(CELL_RUNS)
        each = zip(group["id"], map(_word, group["verdict"], group["status"]), strict=True)
        found.append([
            Link(id_[:8] + ("" if word == "valid" else f" ({word})"), f"#run-{id_}", word)
            for id_, word in each if id_ in listed
        ])  # fmt: skip
    return found


def _figures(results: Results) -> list[Section]:
    """Bias and sigma over each field that varies."""
    found = [Section("Bias and σ", [], anchor="figures")]
    for path, chart, drawn in page_figures({path: results.by_parameter(path) for path in results.paths}):
        if chart is not None:
            text = "In percent of the true value, where it is not known of the mean."
            found.append(Section(path, [note(text), Charts([chart])]))
        elif drawn is not None:
            found.append(Section(path, [note("Bias in units of σ; orange: positive, blue: negative."), drawn]))
    return found


def _parameters(results: Results, quality: pd.DataFrame) -> Section:
    """Bias, sigma and coverage of each parameter in each group."""
    rows = quality.head(ROWS_SHOWN).to_dict("records")
    figures = {"mean": "value", "true": "true", "bias": "bias", "σ": "sigma", "σ stated": "stated"}
    columns = [words(path, [shown(r[path]) for r in rows]) for path in results.paths]
    columns.append(words("parameter", [r["parameter"] for r in rows]))
    columns.append(words("unit", [pretty_unit(r["unit"]) for r in rows]))
    columns += [Column(head, [significant(r[name]) for r in rows]) for head, name in figures.items()]
    columns.append(Column("bias / σ", [significant(r["bias_in_sigma"], 2) for r in rows]))
    columns.append(Column("coverage", [_percent(r["coverage"]) for r in rows]))
    columns.append(Column("answers of runs", [f"{r['used']} of {r['ran']}" for r in rows]))
    text = "σ: standard deviation of the answers of a group; σ stated: root of the mean of their variances."
    several: dict[str, dict[str, Expectation]] = {}
    for r in rows:
        group = ", ".join(shown(r[path]) for path in results.paths) or "all runs"
        several.setdefault(group, {})[r["parameter"]] = Expectation(r["value"], r["sigma"], r["true"])
    forest = forest_chart("forest", "Means of the answers beside the true values", "the truth", several)
    folded = Folded("All of them", Table(columns), is_open=len(rows) <= ROWS_OPEN)
    drawn: list[Block] = [note(FOREST), Charts([forest])] if forest is not None else []
    return Section("Parameters", [note(text), *drawn, folded], anchor="parameters")


def _runs(results: Results, runs: pd.DataFrame) -> Section:
    """The runs one by one."""
    rows = runs.head(ROWS_SHOWN).to_dict("records")
    ids = [r["id"] for r in rows]
    pages = [[f"{FILES}/{id_}/{name}" for name in (REPORT_FILE, DISCOVERY_FILE)] for id_ in ids]  # of kept runs
    kept = [next((name for name in names if (results.folder / name).is_file()), "") for names in pages]
    links = [[Link(id_, page)] for id_, page in zip(ids, kept, strict=True)]
    columns = [
        words("run", ids, links=links),
        *(words(path, [shown(r[path]) for r in rows]) for path in results.paths),
        Column("seed", [str(r["seed"]) for r in rows]),
        words("verdict", [_word(r["verdict"], r["status"]) for r in rows]),
        *_provided(rows),
        Column(f"{results.quantity} error %", [significant(r["error_percent"]) for r in rows]),
        Column("iterations", [shown(r["iterations"]) for r in rows]),
        Column("s", [significant(r["seconds"], 2) for r in rows]),
        words("message", [r["message"].partition("\n")[0] if isinstance(r["message"], str) else "" for r in rows]),
    ]
    left = len(runs) - len(rows)
    command = shell_line(["fmu-didim", "campaign", "show", str(results.folder)])
    text = f"One of them in full: {command} ID" + (f"; {left} more are in runs.csv" if left else "")
    blocks: Sequence[Block] = [note(text), Table(columns, anchors=[f"run-{id_}" for id_ in ids])]
    return Section("Runs", blocks, anchor="runs")


def _provided(rows: Sequence[Mapping[str, Any]]) -> list[Column]:
    """What the valid answers rest on; no column where none rests on anything."""
    found = [r["conditions"] for r in rows]
    return [words("provided that", found, shrinks=True)] if any(found) else []


def _word(verdict: Any, status: str) -> str:
    return verdict.replace("_", " ") if isinstance(verdict, str) else status


def _percent(share: float) -> str:
    return MISSING if share is None or share != share else f"{100 * share:.1f} %"
