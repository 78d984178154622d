"""What a page draws of each experiment: its torque over time, and charts of the residual, one row of a table each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from fmu_didim.report.drawing.charts import Chart
from fmu_didim.report.drawing.residual import Residual
from fmu_didim.report.drawing.residual_charts import against_charts, whiteness_charts
from fmu_didim.report.numbers import capitalised
from fmu_didim.report.sections import Block, Charts, Section, note

OVER_TIME = "Residual = measured − simulated; grey: two standard deviations of the noise either way."


@dataclass(frozen=True)
class ResidualCharts:
    """A kind of charts of the residual: how to read them, and what draws those of an experiment."""

    text: str
    draw: Callable[[Residual], Sequence[Chart]]


OF_A_MODEL = "simulated output and the inputs"
"""Over what the residuals of a model are drawn, in the place of the motion."""
RESIDUAL_CHARTS = (
    ResidualCharts(
        "Residual against the simulated motion. Means of bins with equally many samples, ± twice their standard error "
        "as if samples were independent.",
        against_charts,
    ),
    ResidualCharts(
        "Spectrum and autocorrelation of the residual. Grey: where white noise as strong as the residual would keep "
        "95 % of its points.",
        whiteness_charts,
    ),
)
"""In this order on the page, of an identification and of a discovery."""


@dataclass(frozen=True)
class ExperimentCharts:
    """What is drawn of an experiment: title, length of the log, torque and residual; and what else was measured."""

    title: str
    length: str
    torque: Chart
    residual: Residual
    channels: Chart | None = None


def torque_sections(parts: Sequence[ExperimentCharts]) -> list[Section]:
    """Torque, what else was measured, and their residuals over time, an experiment a section."""
    return [
        Section(
            capitalised(part.title),
            [
                note(f"{part.length}. {OVER_TIME}"),
                Charts([part.torque, *([] if part.channels is None else [part.channels])]),
            ],
        )
        for part in parts
    ]


def residual_sections(parts: Sequence[ExperimentCharts], heading: str, advice: str = "") -> list[Section]:
    """The charts of the residual, an experiment a section; ``advice`` stands above those of each."""
    found = []
    for part in parts:
        blocks = list[Block]()
        for kind in RESIDUAL_CHARTS:
            charts = Charts(kind.draw(part.residual), in_grid=True)
            text = kind.text.replace("simulated motion", OF_A_MODEL) if part.residual.names else kind.text
            blocks += [note(text), charts] if charts else []
        if blocks:
            found.append(Section(capitalised(part.title), [note(advice), *blocks]))
    return [Section(heading, [], anchor="residual"), *found] if found else []
