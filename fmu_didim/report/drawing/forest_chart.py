"""Forest plot: values with their intervals beside the values that were expected, as parts of these or in standard
deviations."""

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


def forest_chart(
    name: str,
    title: str,
    expected: str,
    series: Mapping[str, Mapping[str, Expectation]],
    *,
    in_deviations: bool = False,
) -> Chart | None:
    """Deviation of values from the expected ones in percent of these, with 95 % intervals; None where nothing was
    expected that is not zero.

    Args:
        expected: what the values are compared with; series: name of each series -> name of a parameter -> its value.
        in_deviations: in standard deviations of each value in the place of percent, where some may be near zero.
    """
    kept = {
        head: {
            n: e
            for n, e in values.items()
            if (in_deviations or e.expected) and np.isfinite([e.value, e.std, e.expected]).all()
        }
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
        size = np.array([max(e.std, np.finfo(float).tiny) if in_deviations else abs(e.expected) / 100 for e in each])
        off = np.array([e.value - e.expected for e in each])
        spread = np.array([wide * e.std for e in each])
        style = "simulated" if len(kept) == 1 else f"series{k}"
        drawn.append(Series(head, places, off / size, style, "points", error=spread / size))
    panel = Panel(f"off {expected} ({'σ' if in_deviations else '%'})", drawn, height=HEIGHT, levels=(0.0,))
    return Chart(name, title, [panel], "parameter", ticks=_ticks(names))


def _ticks(names: Sequence[str]) -> list[tuple[float, str]]:
    return [(float(k), n) for k, n in enumerate(names)]
