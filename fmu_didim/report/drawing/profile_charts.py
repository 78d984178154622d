"""Charts of profiles: the misfit over one parameter, and how the others make up for it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.report.drawing.charts import SERIES, Chart, Panel, Series
from fmu_didim.report.numbers import pretty_unit
from fmu_didim.results.result import ParameterResult
from fmu_didim.results.searches import ProfileResult

PARABOLA_POINTS = 61
"""[points] Of the curve by linear theory."""
FIRST = 2
"""[1] Number of the first colour of the other parameters: those before look like profile and parabola."""
MOVES = 0.5
"""[standard deviations] By which another parameter moves along a profile before it is drawn."""


def profile_chart(name: str, number: int, found: ProfileResult, parameters: Mapping[str, ParameterResult]) -> Chart:
    """The profile of a parameter beside the parabola of linear theory, and below it what moves with it."""
    value, chi_square, own = np.array(found.value), np.array(found.chi_square), parameters[name]
    unit = pretty_unit(own.unit)
    along = np.linspace(value.min(), value.max(), PARABOLA_POINTS)
    parabola = ((along - own.value) / own.std) ** 2 if own.std > 0 else np.full(along.size, np.nan)
    highest = max(1.5 * found.height, float(chi_square.max()))
    series = [
        Series("linear", along, np.where(parabola <= highest, parabola, np.nan), "base"),
        Series("profile", value, chi_square, "final"),
        Series("fits", value, chi_square, "final", kind="points", legend=False),
    ]
    panels = [Panel("chi-square", series, levels=[found.height])]
    moved = _moves(found, parameters)
    if moved:
        lines = [Series(other, value, y, f"series{k}") for k, (other, y) in enumerate(moved.items(), start=FIRST)]
        panels.append(Panel("others (σ)", lines, head="What makes up for it, in standard deviations of the answer"))
    return Chart(f"profile-{number}", f"Profile of {name}", panels, f"{name} ({unit})" if unit else name)


def _moves(found: ProfileResult, parameters: Mapping[str, ParameterResult]) -> dict[str, Array]:
    """Name of the other parameters that move most -> by how many of their standard deviations."""
    moves = {
        name: (np.array(values) - parameters[name].value) / parameters[name].std
        for name, values in found.others.items()
        if name in parameters and parameters[name].std > 0
    }
    ordered = sorted(moves, key=lambda name: -float(np.ptp(moves[name])))[: SERIES - FIRST]
    return {name: moves[name] for name in ordered if np.ptp(moves[name]) > MOVES}
