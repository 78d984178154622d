"""The charts of an identification: torque and residual of each experiment whose torque was saved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fmu_didim.data.signals import Trajectory
from fmu_didim.data.tables import read_trajectory
from fmu_didim.report import experiments
from fmu_didim.report.drawing.charts import Chart
from fmu_didim.report.drawing.residual_charts import against_chart, whiteness_charts
from fmu_didim.report.drawing.torque_charts import Simulated, samples_text, torque_chart
from fmu_didim.report.numbers import capitalised
from fmu_didim.report.sections import Charts, Section, note
from fmu_didim.results.result import ResultDocument

OVER_TIME = "Residual = measured − simulated; grey: two standard deviations of the noise either way."
BINS = "Means of bins with equally many samples, ± twice their standard error as if samples were independent."
WHITE = "Grey: where white noise as strong as the residual would keep 95 % of its points."


@dataclass(frozen=True)
class ExperimentCharts:
    """The charts of an experiment: title, length of the log, torque, residual against the motion, its whiteness."""

    title: str
    length: str
    torque: Chart
    against: Sequence[Chart] = ()
    whiteness: Sequence[Chart] = ()


def torque_sections(parts: Sequence[ExperimentCharts]) -> list[Section]:
    """Torque and residual over time, an experiment a section."""
    return [
        Section(capitalised(part.title), [note(f"{part.length}. {OVER_TIME}"), Charts([part.torque])]) for part in parts
    ]


def residual_sections(parts: Sequence[ExperimentCharts], heading: str, of: str, advice: str) -> list[Section]:
    """The residual against the motion, its spectrum and its autocorrelation; ``of``: which model is drawn."""
    found = [Section(heading, [], anchor="residual")]
    for part in parts:
        blocks: list[Charts] = [Charts(part.against, in_grid=True), Charts(part.whiteness, in_grid=True)]
        notes = [note(f"Residual against the simulated motion. {BINS} {advice}".rstrip()),
                 note(f"Spectrum and autocorrelation of the residual{of}. {WHITE}")]  # fmt: skip
        shown = [each for pair in zip(notes, blocks, strict=True) if pair[1] for each in pair]
        found.append(Section(capitalised(part.title), shown))
    return found


def saved_charts(document: ResultDocument, directory: Path) -> list[ExperimentCharts]:
    """The charts of each experiment.

    Raises:
        InputError: a table of torques that the result names is missing.
    """
    found = []
    for number, (label, file) in enumerate(document.signals.items(), start=1):
        signals = read_trajectory(directory / file)
        every = document.simulated.get(label)
        dense = read_trajectory(directory / every) if every is not None else None
        found.append(_experiment(document, label, number, signals, dense))
    return found


def _experiment(
    document: ResultDocument, label: str, number: int, signals: Trajectory, dense: Trajectory | None
) -> ExperimentCharts:
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
    residuals = [{"residual": ("residual", (measured - simulated)[:, j - 1])} for j in joints]
    against = [
        against_chart(
            f"{quantity}-{number}-{j}", j, quantity, units[j - 1], signals.column(f"{column}{j}"), residuals[j - 1]
        )
        for j in joints
        for quantity, column in (("velocity", "dq"), ("position", "q"))
        if f"{column}{j}" in signals.names
    ]
    whiteness = whiteness_charts(str(number), title, signals.time, residuals, units)
    return ExperimentCharts(title, samples_text(signals.time), torque, against, whiteness)
