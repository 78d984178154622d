"""Forest plot: values with their intervals beside the values that were expected, as parts of these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fmu_didim.base.distributions import normal_isf
from fmu_didim.report.drawing.charts import SERIES, Chart, Panel, Series
from fmu_didim.report.drawing.residual_charts import CONFIDENCE

HEIGHT = 200
"""[px]"""
APART = 0.5
"""[1] Of the way from one name to the next, over which the values of several series stand side by side."""


@dataclass(frozen=True)
class Expectation:
    """A value with its standard deviation, and the value that was expected."""

    value: float
    std: float
    expected: float


def forest_chart(name: str, title: str, expected: str, series: Mapping[str, Mapping[str, Expectation]]) -> Chart | None:
    """Deviation of values from the expected ones in percent of these, with 95 % intervals; None where nothing was
    expected that is not zero.

    Args:
        expected: what the values are compared with; series: name of each series -> name of a parameter -> its value.
    """
    kept = {
        head: {n: e for n, e in values.items() if e.expected and np.isfinite([e.value, e.std, e.expected]).all()}
        for head, values in list(series.items())[:SERIES]
    }
    names = list(dict.fromkeys(n for values in kept.values() for n in values))
    if not names:
        return None
    drawn, width = list[Series](), APART / max(len(kept), 1)
    wide = float(normal_isf((1 - CONFIDENCE) / 2))
    for k, (head, values) in enumerate(kept.items()):
        each = list(values.values())
        places = np.array([names.index(n) for n in values]) + width * (k - (len(kept) - 1) / 2)
        size = np.array([abs(e.expected) for e in each])
        off = np.array([e.value - e.expected for e in each])
        spread = np.array([wide * e.std for e in each])
        style = "simulated" if len(kept) == 1 else f"series{k}"
        drawn.append(Series(head, places, 100 * off / size, style, "points", error=100 * spread / size))
    panel = Panel(f"off {expected} (%)", drawn, height=HEIGHT, levels=(0.0,))
    return Chart(name, title, [panel], "parameter", ticks=_ticks(names))


def _ticks(names: Sequence[str]) -> list[tuple[float, str]]:
    return [(float(k), n) for k, n in enumerate(names)]
