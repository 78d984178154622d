"""A saved result as one HTML file that needs no network: tables, figures and provenance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup
from plotly.offline import get_plotlyjs

from fmu_didim.identification.result import ResultDocument, load_result
from fmu_didim.report.experiments import (
    ALL_FITTED,
    agreement_text,
    at,
    delay_lines,
    difference_text,
    disagreeing,
    error_rows,
    experiment_title,
    noise_text,
    own_names,
    parameter_groups,
    shown_parameter,
    shown_unit,
)
from fmu_didim.report.figures import figure_json, history_figure, points_per_trace, torque_figure
from fmu_didim.report.numbers import (
    MISSING,
    ParameterText,
    Rounding,
    consistency_line,
    decimal_aligned,
    iteration_count,
    loop_summary,
    percentage,
    pretty_unit,
    rounding,
    significant,
)
from fmu_didim.report.templates import rendered
from fmu_didim.report.verdict import verdict
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
    """One experiment: its title, the figure as JSON, and what to say of it."""

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
    history = Markup(figure_json(history_figure(document.history))) if document.history else None
    return write_page(
        directory / REPORT_FILE,
        TEMPLATE,
        document=document,
        verdict=verdict(document),
        cards=_cards(document),
        parameters=_parameter_groups(document),
        has_insignificant=any(p.interval[0] <= 0 <= p.interval[1] for p in document.parameters.values()),
        delay_lines=delay_lines(document),
        experiments=_experiment_table(document),
        warnings=[agreement.warning for agreement in disagreeing(document).values()],
        errors=_error_table(document),
        noise=noise_text(document),
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
    path.write_text(rendered(template, **values), encoding="utf-8")
    return path


_SHOWN_OF_LOOP = ("order", "step_size_s", "delay_samples", "hold", "components", "connections")


def _mapping(value: Any) -> dict[str, Any]:
    return dict(value) if isinstance(value, Mapping) else {}


def _cards(document: ResultDocument) -> list[tuple[str, str]]:
    """The figures at the top: a head and a value each."""
    shown = {label: values[0] for label, values in error_rows(document)}
    if ALL_FITTED in shown:  # the cards have no room for each of them
        fitted = [label for label, e in document.experiments.items() if e.role == "estimation"]
        shown = {ALL_FITTED: shown[ALL_FITTED]} | {k: v for k, v in shown.items() if k not in fitted}
    cards = [(f"torque error, {experiment_title(document, k)}", percentage(v)) for k, v in shown.items()]
    if document.parameters:
        cards.append(("parameters", str(len(document.parameters))))
        cards.append(("condition number", significant(document.condition_number)))
    cards.append(("iterations" + (", main + finish" if document.finish_iterations else ""), iteration_count(document)))
    return cards


def _parameter_groups(document: ResultDocument) -> list[tuple[str, list[tuple[ParameterText, Bar | None, str]]]]:
    """Head of each group -> each parameter with its numbers aligned, its bar and what carries it."""
    groups = parameter_groups(document)
    listed = [(name, p) for group in groups for name, p in group.parameters.items()]
    rows = [shown_parameter(name, p) for name, p in listed]
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
    shown = []
    for row, (name, parameter), cells in zip(rows, listed, zip(*columns, strict=True), strict=True):
        value, std, percent, low, high = cells
        text = ParameterText(name, value, std, percent, row.unit or MISSING, (low, high), row.insignificant)
        shown.append((text, _bar(parameter.rel_std_percent), parameter.standard or parameter.of))
    return [(group.head, [shown.pop(0) for _ in group.parameters]) for group in groups]


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
        joints = range(1, len(units) + 1)
        measured, simulated = (signals.select([f"tau_{s}{j}" for j in joints]) for s in ("measured", "simulated"))
        error = document.relative_error_percent.get(label)
        figure = torque_figure(
            signals.time, measured, {"simulated": simulated}, units,
            percent=error.per_joint if error is not None else (), limit=limit,
        )  # fmt: skip
        count = signals.time.size
        note = f"{count} samples over {signals.time[-1] - signals.time[0]:.6g} s"
        if count > limit:
            note += f"; drawn by the extremes of {(limit - 2) // 2} stretches"
        plots.append(TorquePlot(experiment_title(document, label), Markup(figure_json(figure)), note))
    return plots


def _experiment_table(document: ResultDocument) -> Table | None:
    """What each experiment is, how it agrees with the others, and why it could not be simulated."""
    found = document.experiments
    if not found:
        return None
    columns = {"experiment": list(found), "role": [e.role for e in found.values()]}
    columns["samples"] = [str(e.samples) for e in found.values()]
    columns["rate (Hz)"] = [f"{e.rate_hz:.6g}" for e in found.values()]
    for j, unit in enumerate(document.torque_unit):
        head = f"RMS residual, joint {j + 1} ({pretty_unit(unit)})"
        columns[head] = [significant(at(e.noise_std, j), 2) for e in found.values()]
    words = ["experiment", "role"]
    if any(e.agreement is not None for e in found.values()):
        columns["p-value of its agreement"] = [agreement_text(e.agreement) for e in found.values()]
        columns["would differ most"] = [difference_text(e.agreement) for e in found.values()]
        words.append("would differ most")
    if any(e.own for e in found.values()):
        columns["own parameters"] = [", ".join(own_names(label, e)) or MISSING for label, e in found.items()]
        words.append("own parameters")
    if any(e.failure for e in found.values()):
        columns["failure"] = [e.failure or MISSING for e in found.values()]
        words.append("failure")
    places = tuple(k for k, head in enumerate(columns) if head in words)
    return aligned(Table(tuple(columns), tuple(zip(*columns.values(), strict=True)), places))


def _error_table(document: ResultDocument) -> Table | None:
    """Relative error of each experiment, of all fitted ones, and noise, a row an experiment."""
    errors = error_rows(document)
    if not errors:
        return None
    heads = ("", "total", *(f"joint {j + 1}" for j in range(len(document.torque_unit))))
    rows = tuple((label, *(significant(v) for v in values)) for label, values in errors)
    return aligned(Table(heads, rows, (0,)))


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
    columns.append([shown_unit(p) or MISSING for p in document.parameters.values()])
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
