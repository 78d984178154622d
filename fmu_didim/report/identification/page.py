"""A saved result as one HTML file that needs no network: tables, figures and provenance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

from fmu_didim.data.signals import Trajectory
from fmu_didim.data.tables import read_trajectory
from fmu_didim.report import experiments, numbers
from fmu_didim.report.drawing.charts import Chart, limited, points_per_trace
from fmu_didim.report.drawing.diagram import loop_diagram
from fmu_didim.report.drawing.residual_charts import against_chart, colour_charts
from fmu_didim.report.drawing.torque_charts import Simulated, history_chart, samples_text, torque_chart
from fmu_didim.report.html.templates import write_page
from fmu_didim.report.identification import tables
from fmu_didim.report.verdict import verdict
from fmu_didim.results.result import ParameterResult, ResultDocument, read_result

REPORT_FILE = "report.html"
TEMPLATE = "page.html.j2"
BAR_RANGE = (0.1, 100.0)
"""Percent that the bars of the relative standard deviation cover, logarithmically."""
GRADES = ((10.0, "good"), (30.0, "doubtful"))
"""Up to these relative standard deviations in percent; beyond, the parameter is poorly known."""


@dataclass(frozen=True)
class Experiment:
    """The charts of an experiment: title, what to say of it, torque, residual against the motion, its colour."""

    title: str
    note: str
    torque: Chart
    against: Sequence[Chart] = ()
    colour: Sequence[Chart] = ()

    @property
    def charts(self) -> list[Chart]:
        """All of them."""
        return [self.torque, *self.against, *self.colour]

    def limited(self, points: int) -> Experiment:
        """The same with at most so many points along a line."""
        groups = ([limited(chart, points) for chart in group] for group in (self.against, self.colour))
        against, colour = groups
        return replace(self, torque=limited(self.torque, points), against=against, colour=colour)


@dataclass(frozen=True)
class Row:
    """A parameter on the page.

    Attributes:
        bar: grade and length in percent of its relative standard deviation; beside: further values of it.
        carrier: what carries it.
    """

    name: str
    text: numbers.ParameterText
    bar: tuple[str, float] | None
    beside: tuple[str, ...]
    carrier: str


def write_report(directory: Path) -> Path:
    """Write ``report.html`` beside the ``result.json`` of a directory and return its path.

    Raises:
        InputError: there is no result, or a table of torques that it names is missing.
    """
    document = read_result(directory)
    found = drawn_experiments(document, directory)
    points = points_per_trace([chart for part in found for chart in part.charts])
    found = [part.limited(points) for part in found]
    beside = _beside(document)
    return write_page(
        directory / REPORT_FILE,
        TEMPLATE,
        document=document,
        verdict=verdict(document),
        cards=_cards(document),
        parameters=_parameter_groups(document, beside),
        beside=list(beside),
        has_insignificant=any(p.interval[0] <= 0 <= p.interval[1] for p in document.parameters.values()),
        delay_lines=experiments.delay_lines(document),
        experiments=tables.experiment_table(document),
        errors=tables.error_table(document),
        noise=numbers.noise_text(document.noise_std, document.torque_unit),
        torques=found,
        residuals=[part for part in found if part.against or part.colour],
        stages=tables.stage_table(document),
        history=tables.history_table(document),
        history_values=tables.history_values(document),
        history_chart=history_chart(document.history),
        correlation=tables.correlation_matrix(document),
        correlations=tables.correlation_table(document),
        loop_summary=numbers.loop_lines(document.loop),
        diagram=loop_diagram(document.loop),
        consistency_line=numbers.consistency_line(document),
        plant_columns=tables.column_table(document),
    )


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


def _beside(document: ResultDocument) -> dict[str, dict[str, float | None]]:
    """Head of each further column of the parameters -> values by name: start, and the robot description."""
    columns: dict[str, dict[str, float | None]] = {}
    begins = [k for k, it in enumerate(document.history) if k == 0 or document.history[k - 1].note]
    if begins:
        columns["start"] = dict(document.history[begins[-1]].parameters)
    described = {name: p.described for name, p in document.parameters.items()}
    if any(described.values()):
        columns["by description"] = described
    return columns


def _parameter_groups(
    document: ResultDocument, beside: dict[str, dict[str, float | None]]
) -> list[tuple[str, list[Row]]]:
    """Head of each group -> its parameters."""
    groups = experiments.parameter_groups(document)
    listed = [(name, p) for group in groups for name, p in group.parameters.items()]
    texts = numbers.aligned_parameters([experiments.shown_parameter(name, p) for name, p in listed])
    columns = [
        numbers.decimal_aligned([_value(p, values.get(name)) for name, p in listed]) for values in beside.values()
    ]
    rows = iter([
        Row(name, text, _bar(p.rel_std_percent), tuple(column[k] for column in columns), p.standard or p.of)
        for k, ((name, p), text) in enumerate(zip(listed, texts, strict=True))
    ])  # fmt: skip
    return [(group.head, list(islice(rows, len(group.parameters)))) for group in groups]


def _value(parameter: ParameterResult, value: float | None) -> str:
    """Another value of a parameter, to the digits of what was identified."""
    return numbers.MISSING if value is None else numbers.rounding(parameter.value, parameter.std).text(value)


def _bar(percent: float | None) -> tuple[str, float] | None:
    """Grade, and length in percent of the cell."""
    if percent is None:
        return None
    low, high = BAR_RANGE
    length = 100.0 * math.log(min(max(percent, low), high) / low) / math.log(high / low)
    grade = next((grade for limit, grade in GRADES if percent <= limit), "refused")
    return grade, round(max(length, 2.0), 1)


def drawn_experiments(document: ResultDocument, directory: Path) -> list[Experiment]:
    """The charts of each experiment whose torque was saved."""
    found = []
    for number, (label, file) in enumerate(document.signals.items(), start=1):
        signals = read_trajectory(directory / file)
        every = document.simulated.get(label)
        dense = read_trajectory(directory / every) if every is not None else None
        found.append(_experiment(document, label, number, signals, dense))
    return found


def _experiment(
    document: ResultDocument, label: str, number: int, signals: Trajectory, dense: Trajectory | None
) -> Experiment:
    units = document.torque_unit
    joints = range(1, len(units) + 1)
    measured, simulated = (signals.select([f"tau_{s}{j}" for j in joints]) for s in ("measured", "simulated"))
    model = Simulated(simulated, *((dense.time, dense.values) if dense is not None else (None, None)))
    error = document.relative_error_percent.get(label)
    title = experiments.experiment_title(document, label)
    torque = torque_chart(
        f"torque-{number}", f"Torque, {title}", signals.time, measured, {"simulated": model}, units,
        percent=error.per_joint if error is not None else (), noise=document.noise_std,
    )  # fmt: skip
    residual = measured - simulated
    against = [
        against_chart(
            f"{quantity}-{number}-{j}", j, quantity, units[j - 1], signals.column(f"{column}{j}"),
            {"residual": ("residual", residual[:, j - 1])},
        )
        for j in joints
        for quantity, column in (("velocity", "dq"), ("position", "q"))
        if f"{column}{j}" in signals.names
    ]  # fmt: skip
    each = [{"residual": ("residual", residual[:, j - 1])} for j in joints]
    colour = colour_charts(str(number), title, signals.time, each, units)
    return Experiment(title, samples_text(signals.time), torque, against, colour)
