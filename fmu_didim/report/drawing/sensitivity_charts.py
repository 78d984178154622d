"""A chart of sensitivities between bounds: an axis of parameters, a panel for each output."""

from __future__ import annotations

import numpy as np

from fmu_didim.report.drawing.charts import Chart, Panel, Series
from fmu_didim.report.numbers import pretty_unit
from fmu_didim.results.searches import GlobalSensitivityResult

HEIGHT = 180
"""[px] Of a panel."""


def sensitivity_chart(found: GlobalSensitivityResult) -> Chart:
    """mu* and sigma, or S1 and ST, of the parameters, those that matter most first."""
    names = ordered(found)
    places = np.arange(len(names), dtype=float)
    of_morris = found.method == "morris"
    panels = []
    for k, (output, unit) in enumerate(found.outputs.items()):
        total, main, spread = (
            np.array([float(table[name][k] or 0.0) for name in names])
            for table in (found.total, found.main, found.spread)
        )
        if of_morris:
            series = [
                Series("mu*", places - 0.1, total, "series0", kind="stems"),
                Series("sigma", places + 0.1, spread, "series1", kind="stems"),
            ]
            label = f"{output} ({pretty_unit(unit)})" if pretty_unit(unit) else output
        else:
            series = [
                Series("S1", places - 0.1, main, "series0", kind="stems"),
                Series("ST", places + 0.1, total, "series1", kind="stems"),
            ]
            label = output
        panels.append(Panel(label, series, height=HEIGHT))
    title = "Effect on the misfit" if of_morris else "Share of the variance of the misfit"
    ticks = list(zip(places.tolist(), names, strict=True))
    return Chart("sensitivity", title, panels, "parameter", ticks=ticks)


def ordered(found: GlobalSensitivityResult) -> list[str]:
    """Names of the parameters, those first whose effect is the largest part of that of the strongest, of any output."""
    names = list(found.total)
    table = np.array([[float(v or 0.0) for v in found.total[name]] for name in names])
    part = (table / np.maximum(table.max(axis=0), np.finfo(float).tiny)).max(axis=1)
    return [names[i] for i in np.argsort(-part, kind="stable")]
