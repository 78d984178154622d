"""A saved result as one self-contained HTML page; nothing is recomputed, nothing is loaded from a network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from fmu_didim.identification.result import ResultDocument, load_result
from fmu_didim.report.figures import history_figure, points_per_trace, torque_figure
from fmu_didim.report.numbers import (
    ParameterText,
    iteration_count,
    label_title,
    loop_line,
    loop_parameters,
    parameter_text,
    percentage,
    pretty_unit,
    rounding,
    significant,
    verdict,
)
from fmu_didim.signals import read_trajectory

REPORT_FILE = "report.html"
STAGE_TITLES = {"paper": "DIDIM, the paper's eq. (8)", "cramer_rao": "Cramér-Rao bound"}
"""What the formulas of a stage are called; others keep their names."""


@dataclass(frozen=True)
class Figure:
    """A figure of the page: the id of its element, its title and its Plotly JSON."""

    key: str
    title: str
    json: str


@dataclass(frozen=True)
class Table:
    """A table: its head and its rows of texts."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def write_report(directory: Path) -> Path:
    """Write ``report.html`` beside ``result.json`` and return its path.

    Raises:
        InputError: the folder holds no result, or a torque table it names is missing.
    """
    from jinja2 import Environment, StrictUndefined
    from plotly.offline import get_plotlyjs

    document = load_result(directory)
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string((files("fmu_didim.report") / "page.html.j2").read_text(encoding="utf-8"))
    text = template.render(
        document=document,
        verdict=verdict(document),
        parameters=_parameters(document),
        loop_lines=[loop_line(document, name) for name in loop_parameters(document)],
        figures=_figures(document, directory),
        errors=_errors(document),
        stages=_stages(document),
        history=_history(document),
        correlations=[(a, b, f"{value:+.3f}") for a, b, value in document.correlations],
        facts=_facts(document),
        loop=nested(document.loop),
        provenance=nested(document.provenance),
        plotly=get_plotlyjs(),
    )
    path = directory / REPORT_FILE
    path.write_text(text, encoding="utf-8")
    return path


def nested(value: Any) -> Any:
    """A value for the page: mappings and lists keep their form, numbers become short texts."""
    if isinstance(value, Mapping) and value:
        return {str(k): nested(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        if all(isinstance(v, int | float | str) for v in value):
            return ", ".join(nested(v) for v in value) or "none"
        return [nested(v) for v in value]
    if isinstance(value, float):
        return f"{value:.10g}"
    return str(value) if value or value == 0 else "none"


def _parameters(document: ResultDocument) -> list[tuple[ParameterText, str]]:
    return [(parameter_text(name, p), p.standard) for name, p in document.parameters.items()]


def _figures(document: ResultDocument, directory: Path) -> list[Figure]:
    found: list[Figure] = []
    limit = points_per_trace(3 * len(document.torque_unit) * len(document.signals))
    for label, name in document.signals.items():
        signals = read_trajectory(directory / name)
        error = document.relative_error_percent.get(label)
        json = torque_figure(signals, document.torque_unit, error, limit=limit)
        found.append(Figure(f"torque-{len(found)}", f"Torque on the {label_title(label)} data", json))
    if document.history:
        found.append(Figure("history", "Iterations", history_figure(document.history)))
    return found


def _errors(document: ResultDocument) -> Table:
    joints = [f"joint {j}" for j in range(1, len(document.torque_unit) + 1)]
    rows = [
        (label_title(label), percentage(error.total), *(percentage(v) for v in error.per_joint))
        for label, error in document.relative_error_percent.items()
    ]
    if document.noise_std:
        noise = [
            f"{significant(v, 2)} {pretty_unit(u)}"
            for v, u in zip(document.noise_std, document.torque_unit, strict=True)
        ]
        rows.append(("standard deviation of the residual (estimation)", "", *noise))
    return Table(("", "total", *joints), tuple(rows))


def _stages(document: ResultDocument) -> Table:
    """Value and standard deviations of every stage and formula, a row a parameter."""
    head = ["parameter"]
    columns: list[Mapping[str, str]] = []
    for name, stage in document.stages.items():
        texts = {k: rounding(v, stage.std[k]) for k, v in stage.value.items()}
        title = name.upper() if name == "didim" else name
        head += [f"{title}: value", f"{title}: σ"]
        columns.append({k: texts[k].text(v) for k, v in stage.value.items()})
        columns.append({k: significant(v) for k, v in stage.std.items()})
        for formula, values in stage.formulas.items():
            head.append(f"σ, {STAGE_TITLES.get(formula, formula)}")
            columns.append({k: significant(v) for k, v in values.items()})
    names: Sequence[str] = list(document.parameters)
    return Table(tuple(head), tuple((name, *(column.get(name, "") for column in columns)) for name in names))


def _history(document: ResultDocument) -> Table:
    names = list(document.parameters) or sorted({k for it in document.history for k in it.parameters})
    rows = [
        (
            f"{it.stage} {it.number}",
            percentage(it.relative_error_percent),
            significant(it.change, 2),
            *(significant(it.parameters.get(name), 5) for name in names),
            it.note,
        )
        for it in document.history
    ]
    return Table(("iteration", "torque error", "change", *names, "note"), tuple(rows))


def _facts(document: ResultDocument) -> list[tuple[str, str]]:
    facts = [("Estimator", document.estimator)]
    if document.status != "refused":
        error = document.integration_error
        facts += [
            ("Iterations", iteration_count(document) + (" (main + finish)" if document.finish_iterations else "")),
            ("Condition number", significant(document.condition_number)),
            ("Integration error of the torque", percentage(None if error is None else 100 * error)),
        ]
    return facts
