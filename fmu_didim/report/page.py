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
    delay_lines,
    disagreeing,
    error_rows,
    experiment_title,
    noise_text,
    parameter_groups,
    shown_parameter,
)
from fmu_didim.report.figures import figure_json, history_figure, points_per_trace, torque_figure
from fmu_didim.report.numbers import (
    MISSING,
    ParameterText,
    consistency_line,
    decimal_aligned,
    iteration_count,
    loop_summary,
    percentage,
    significant,
)
from fmu_didim.report.tables import (
    column_table,
    correlation_table,
    error_table,
    experiment_table,
    history_table,
    history_values,
    stage_table,
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
        experiments=experiment_table(document),
        warnings=[agreement.warning for agreement in disagreeing(document).values()],
        errors=error_table(document),
        noise=noise_text(document),
        plots=plots,
        stages=stage_table(document),
        history=history_table(document),
        history_values=history_values(document),
        history_figure=history,
        correlations=correlation_table(document),
        loop_summary=loop_summary(document),
        consistency_line=consistency_line(document),
        plant_columns=column_table(document),
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
