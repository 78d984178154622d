"""A saved result as one HTML file that needs no network: tables, figures and provenance."""

from __future__ import annotations

import math
from itertools import islice
from pathlib import Path

from markupsafe import Markup
from plotly.offline import get_plotlyjs

from fmu_didim.identification.result import ResultDocument, load_result
from fmu_didim.report import experiments, numbers, tables
from fmu_didim.report.figures import Plots, figure_json, history_figure, points_per_trace, signals_note, torque_figure
from fmu_didim.report.templates import write_page
from fmu_didim.report.verdict import verdict
from fmu_didim.tables import read_trajectory

REPORT_FILE = "report.html"
TEMPLATE = "page.html.j2"
TRACES_PER_JOINT = 3
BAR_RANGE = (0.1, 100.0)
"""Percent that the bars of the relative standard deviation cover, logarithmically."""
GRADES = ((10.0, "good"), (30.0, "doubtful"))
"""Up to these relative standard deviations in percent; beyond, the parameter is poorly known."""


def write_report(directory: Path) -> Path:
    """Write ``report.html`` beside the ``result.json`` of a directory and return its path.

    Raises:
        InputError: there is no result, or a table of torques that it names is missing.
    """
    document = load_result(directory)
    plots = _torque_plots(document, directory)
    history = figure_json(history_figure(document.history)) if document.history else None
    return write_page(
        directory / REPORT_FILE,
        TEMPLATE,
        document=document,
        verdict=verdict(document),
        cards=_cards(document),
        parameters=_parameter_groups(document),
        has_insignificant=any(p.interval[0] <= 0 <= p.interval[1] for p in document.parameters.values()),
        delay_lines=experiments.delay_lines(document),
        experiments=tables.experiment_table(document),
        errors=tables.error_table(document),
        noise=numbers.noise_text(document.noise_std, document.torque_unit),
        plots=plots,
        stages=tables.stage_table(document),
        history=tables.history_table(document),
        history_values=tables.history_values(document),
        history_figure=history,
        correlations=tables.correlation_table(document),
        loop_summary=numbers.loop_lines(document.loop),
        consistency_line=numbers.consistency_line(document),
        plant_columns=tables.column_table(document),
        wiring={k: document.loop.get(k) for k in _SHOWN_OF_LOOP},
        other_loop={k: v for k, v in document.loop.items() if k not in _SHOWN_OF_LOOP},
        plotly=Markup(get_plotlyjs()) if plots or history else None,
    )


_SHOWN_OF_LOOP = ("order", "step_size_s", "delay_samples", "hold", "components", "connections")


def _cards(document: ResultDocument) -> list[tuple[str, str]]:
    """The figures at the top: a head and a value each."""
    shown = {label: values[0] for label, values in experiments.error_rows(document)}
    if experiments.ALL_FITTED in shown:  # the cards have no room for each of them
        fitted = [label for label, e in document.experiments.items() if e.role == "estimation"]
        shown = {label: shown[label] for label in (experiments.ALL_FITTED, *shown) if label not in fitted}
    titles = {label: experiments.experiment_title(document, label) for label in shown}
    cards = [(f"torque error, {titles[label]}", numbers.percentage(error)) for label, error in shown.items()]
    if document.parameters:
        cards.append(("parameters", str(len(document.parameters))))
        cards.append(("condition number", numbers.significant(document.condition_number)))
    stages = ", main + finish" if document.finish_iterations else ""
    cards.append((f"iterations{stages}", numbers.iteration_count(document)))
    return cards


def _parameter_groups(
    document: ResultDocument,
) -> list[tuple[str, list[tuple[str, numbers.ParameterText, tuple[str, float] | None, str]]]]:
    """Head of each group -> name of each parameter, its texts, grade and length of its bar, and what carries it."""
    groups = experiments.parameter_groups(document)
    listed = [(name, p) for group in groups for name, p in group.parameters.items()]
    texts = numbers.aligned_parameters([experiments.shown_parameter(name, p) for name, p in listed])
    rows = iter([
        (name, text, _bar(p.rel_std_percent), p.standard or p.of)
        for (name, p), text in zip(listed, texts, strict=True)
    ])  # fmt: skip
    return [(group.head, list(islice(rows, len(group.parameters)))) for group in groups]


def _bar(percent: float | None) -> tuple[str, float] | None:
    """Grade, and length in percent of the cell."""
    if percent is None:
        return None
    low, high = BAR_RANGE
    length = 100.0 * math.log(min(max(percent, low), high) / low) / math.log(high / low)
    grade = next((grade for limit, grade in GRADES if percent <= limit), "refused")
    return grade, round(max(length, 2.0), 1)


def _torque_plots(document: ResultDocument, directory: Path) -> list[Plots]:
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
        note = signals_note(signals.time, limit)
        plots.append(Plots(experiments.experiment_title(document, label), note, figure_json(figure)))
    return plots
