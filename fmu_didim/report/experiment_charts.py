"""What a page draws of each experiment: its torque over time, and charts of the residual, one row of a table each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from fmu_didim.report.drawing.charts import Chart
from fmu_didim.report.drawing.residual import Residual
from fmu_didim.report.drawing.residual_charts import against_charts, share_with, whiteness_charts
from fmu_didim.report.drawing.skeleton import Skeleton
from fmu_didim.report.numbers import capitalised
from fmu_didim.report.sections import Block, Charts, Matrix, Moving, Section, matrix, note

OVER_TIME = "Residual = measured − simulated; grey: two standard deviations of the noise either way."


@dataclass(frozen=True)
class ResidualCharts:
    """A kind of charts of the residual: how to read them, and what draws those of an experiment."""

    text: str
    draw: Callable[[Residual], Sequence[Chart]]


POSTURE = (
    "Residual over the posture: percent of the squared residual of each joint (rows) that go with the position of each "
    "joint (columns), beyond what noise gives. A row that stands out is a joint whose load, gravity or coupling the "
    "model lacks; along one motion positions go together, and so do their shares."
)
SKELETON = (
    "The robot along the simulated motion, and the path of its end, stronger in colour where the residual of a joint "
    "is larger: a step for each of its standard deviations. The last link, dotted, is drawn as long as the others are "
    "on average."
)
LEAST_SHARE = 20.0
"""[percent] Share of the full colour where none is as large."""
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
    """What is drawn of an experiment: title, length of the log, torque and residual; what else was measured, and the
    robot that moves."""

    title: str
    length: str
    torque: Chart
    residual: Residual
    channels: Chart | None = None
    skeleton: Skeleton | None = None


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


def _over_posture(part: ExperimentCharts) -> list[Block]:
    """The residual over the positions of all joints."""
    table = posture_matrix(part.residual)
    blocks: list[Block] = [] if table is None else [note(POSTURE), table]
    return blocks if part.skeleton is None else [*blocks, note(SKELETON), Moving(part.skeleton)]


def posture_matrix(residual: Residual) -> Matrix | None:
    """How much of the squared residual of each joint goes with the position of each joint, in percent."""
    count = len(residual.of_joints)
    places = [f"q{k}" for k in range(1, count + 1)]
    if residual.names or count < 2 or not set(places) <= set(residual.signals.names):
        return None
    rows = {}
    for j, models in enumerate(residual.of_joints):
        *_, (_, values) = models.values()
        rows[residual.head(j)] = [100 * share_with(residual.signals.column(place), values) for place in places]
    largest = max(LEAST_SHARE, *(share for row in rows.values() for share in row))
    return matrix("Residual over the posture", places, rows, largest=largest, digits=0)


def residual_sections(parts: Sequence[ExperimentCharts], heading: str, advice: str = "") -> list[Section]:
    """The charts of the residual, an experiment a section; ``advice`` stands above those of each."""
    found = []
    for part in parts:
        blocks = list[Block]()
        for kind in RESIDUAL_CHARTS:
            charts = Charts(kind.draw(part.residual), in_grid=True)
            text = kind.text.replace("simulated motion", OF_A_MODEL) if part.residual.names else kind.text
            blocks += [note(text), charts] if charts else []
        blocks += _over_posture(part)
        if blocks:
            found.append(Section(capitalised(part.title), [note(advice), *blocks]))
    return [Section(heading, [], anchor="residual"), *found] if found else []
