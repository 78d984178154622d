"""A saved result as one HTML file that needs no network: tables, figures and provenance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from fmu_didim.identification.result import ResultDocument, load_result
from fmu_didim.report.figures import history_figure, points_per_trace, torque_figure
from fmu_didim.report.numbers import (
    MISSING,
    ParameterText,
    Rounding,
    consistency_line,
    decimal_aligned,
    iteration_count,
    loop_line,
    loop_parameters,
    loop_summary,
    parameter_text,
    percentage,
    pretty_unit,
    rounding,
    significant,
    verdict,
)
from fmu_didim.signals import read_trajectory

REPORT_FILE = "report.html"
TEMPLATE = "page.html.j2"
TRACES_PER_JOINT = 3
BAR_RANGE = (0.1, 100.0)
"""Percent that the bars of the relative standard deviation cover, logarithmically."""
GRADES = ((10.0, "good"), (30.0, "doubtful"))
"""Up to these relative standard deviations in percent; beyond, the parameter is poorly known."""
FORMULAS = {"paper": "σ, paper's formula", "cramer_rao": "Cramér-Rao bound"}
MAIN_SIGMA = {"didim": "σ, corrected formula"}


@dataclass(frozen=True)
class Bar:
    """A horizontal bar: its length in percent of the cell and its grade."""

    length: float
    grade: str


@dataclass(frozen=True)
class TorquePlot:
    """One experiment: its title, the figure as JSON, and what to say about its points."""

    title: str
    figure: Markup
    note: str


@dataclass(frozen=True)
class Table:
    """Heads and rows of texts; the first column is a name, ``text_columns`` hold words, the others numbers."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    text_columns: tuple[int, ...] = (0,)


def write_report(directory: Path) -> Path:
    """Write ``report.html`` beside the ``result.json`` of a directory and return its path.

    Raises:
        InputError: there is no result, or a table of torques that it names is missing.
    """
    document = load_result(directory)
    plots = _torque_plots(document, directory)
    history = Markup(history_figure(document.history)) if document.history else None
    loop = loop_parameters(document)
    return write_page(
        directory / REPORT_FILE,
        TEMPLATE,
        document=document,
        verdict=verdict(document),
        cards=_cards(document),
        parameters=_parameter_rows(document),
        has_insignificant=any(p.interval[0] <= 0 <= p.interval[1] for p in document.parameters.values()),
        loop_lines=[loop_line(document, name) for name in loop],
        errors=_error_table(document),
        plots=plots,
        stages=_stage_table(document),
        history=_history_table(document),
        history_values=_history_values(document),
        history_figure=history,
        correlations=_correlation_table(document),
        loop_summary=loop_summary(document),
        consistency_line=consistency_line(document),
        plant_columns=_column_table(document),
        components=_mapping(document.loop.get("components")),
        delays=_mapping(document.loop.get("delay_samples")),
        wiring={k: document.loop.get(k) for k in _SHOWN_OF_LOOP},
        other_loop={k: v for k, v in document.loop.items() if k not in _SHOWN_OF_LOOP},
        plotly=Markup(get_plotlyjs()) if plots or history else None,
    )


def write_page(path: Path, template: str, **values: Any) -> Path:
    """Write the page that a template of this folder gives with these values, and return its path."""
    environment = Environment(
        loader=PackageLoader("fmu_didim.report", "."), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    path.write_text(environment.get_template(template).render(**values), encoding="utf-8")
    return path


_SHOWN_OF_LOOP = ("order", "step_size_s", "delay_samples", "hold", "components", "connections")


def _mapping(value: Any) -> dict[str, Any]:
    return dict(value) if isinstance(value, Mapping) else {}


def _cards(document: ResultDocument) -> list[tuple[str, str]]:
    """The figures at the top: a head and a value each."""
    cards = [
        (f"torque error, {label}", percentage(error.total)) for label, error in document.relative_error_percent.items()
    ]
    if document.parameters:
        cards.append(("parameters", str(len(document.parameters))))
        cards.append(("condition number", significant(document.condition_number)))
    cards.append(("iterations" + (", main + finish" if document.finish_iterations else ""), iteration_count(document)))
    return cards


def _parameter_rows(document: ResultDocument) -> list[tuple[ParameterText, Bar | None, str]]:
    """Each parameter with its numbers aligned, its bar and the standard parameter behind it."""
    rows = [parameter_text(name, p) for name, p in document.parameters.items()]
    columns = [
        decimal_aligned(texts)
        for texts in (
            [row.value for row in rows],
            [row.std for row in rows],
            [row.percent for row in rows],
            [row.interval[0] for row in rows],
            [row.interval[1] for row in rows],
        )
    ]
    result = []
    for row, parameter, cells in zip(rows, document.parameters.values(), zip(*columns, strict=True), strict=True):
        value, std, percent, low, high = cells
        unit = "samples" if row.name == "delay" and not parameter.standard else row.unit
        shown = ParameterText(row.name, value, std, percent, unit or MISSING, (low, high), row.insignificant)
        result.append((shown, _bar(parameter.rel_std_percent), parameter.standard))
    return result


def _bar(percent: float | None) -> Bar | None:
    if percent is None:
        return None
    low, high = BAR_RANGE
    length = 100.0 * math.log(min(max(percent, low), high) / low) / math.log(high / low)
    grade = next((grade for limit, grade in GRADES if percent <= limit), "refused")
    return Bar(round(max(length, 2.0), 1), grade)


def _torque_plots(document: ResultDocument, directory: Path) -> list[TorquePlot]:
    units = document.torque_unit
    limit = points_per_trace(TRACES_PER_JOINT * len(units) * len(document.signals))
    plots = []
    for label, file in document.signals.items():
        signals = read_trajectory(directory / file)
        figure = torque_figure(signals, units, document.relative_error_percent.get(label), limit=limit)
        count = signals.time.size
        note = f"{count} samples over {signals.time[-1] - signals.time[0]:.6g} s"
        if count > limit:
            note += f"; drawn by the extremes of {(limit - 2) // 2} stretches"
        plots.append(TorquePlot(label, Markup(figure), note))
    return plots


def _error_table(document: ResultDocument) -> Table | None:
    """Relative error of each experiment and noise, a row a joint."""
    errors, units = document.relative_error_percent, document.torque_unit
    if not errors:
        return None
    heads = ("", *(f"{label} (%)" for label in errors), "noise σ", "unit")
    rows = [("total", *(significant(e.total) for e in errors.values()), "", "")]
    for j, unit in enumerate(units):
        shares = (significant(e.per_joint[j] if j < len(e.per_joint) else None) for e in errors.values())
        noise = significant(document.noise_std[j] if j < len(document.noise_std) else None, 2)
        rows.append((f"joint {j + 1}", *shares, noise, pretty_unit(unit)))
    return aligned(Table(heads, tuple(rows), (0, len(heads) - 1)))


def _stage_table(document: ResultDocument) -> Table | None:
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
    columns.append([pretty_unit(p.unit) or MISSING for p in document.parameters.values()])
    rows = tuple(zip(document.parameters, *columns, strict=True))
    return aligned(Table(tuple(heads), rows, (0, len(heads) - 1)))


def _deviation(digits: Rounding | None, std: float | None) -> str:
    return MISSING if digits is None or std is None else digits.deviation(std)


def _history_table(document: ResultDocument) -> Table:
    rows = tuple(
        (
            f"{it.stage} {it.number}",
            significant(it.relative_error_percent, 5),
            significant(it.change, 2),
            significant(it.condition_number),
            it.note,
        )
        for it in document.history
    )
    heads = ("iteration", "torque error (%)", "relative change", "condition number", "note")
    return aligned(Table(heads, rows, (0, 4)))


def _history_values(document: ResultDocument) -> Table:
    """The parameters simulated in each iteration, one column an iteration."""
    names = list(dict.fromkeys(name for it in document.history for name in it.parameters))
    heads = ("parameter", *(f"{it.stage} {it.number}" for it in document.history))
    rows = tuple((name, *(_six(it.parameters.get(name)) for it in document.history)) for name in names)
    return Table(heads, rows)


def _six(value: float | None) -> str:
    return MISSING if value is None else f"{value:.6g}"


def _correlation_table(document: ResultDocument) -> Table | None:
    rows = tuple((f"{a} – {b}", f"{value:+.3f}") for a, b, value in document.correlations)
    return Table(("pair", "correlation"), rows) if rows else None


def _column_table(document: ResultDocument) -> Table | None:
    """The columns of the regressor, from the plant against from the robot description."""
    found = document.consistency
    if found is None or not found.columns:
        return None
    rows = tuple(
        (name, significant(c.difference, 2), significant(c.cosine, 6), significant(c.size, 4), str(c.joint))
        for name, c in found.columns.items()
    )
    heads = ("parameter", "difference", "cosine", "size in the plant", "joint")
    return Table(heads, rows)


def aligned(table: Table) -> Table:
    """Decimal points below each other in the columns of numbers."""
    columns = [
        column if k in table.text_columns else decimal_aligned(column)
        for k, column in enumerate(zip(*table.rows, strict=True))
    ]
    return Table(table.heads, tuple(zip(*columns, strict=True)), table.text_columns)
