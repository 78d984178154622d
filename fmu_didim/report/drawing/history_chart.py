"""The history of values over many logs: each against the date, with the range of the reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime

import numpy as np

from fmu_didim.base.distributions import normal_isf
from fmu_didim.report.drawing.charts import Chart, Panel, Series
from fmu_didim.report.drawing.residual_charts import CONFIDENCE
from fmu_didim.report.numbers import pretty_unit, with_unit
from fmu_didim.results.watch import WatchDocument, WatchedLog

HEIGHT = 110
"""[px] Of each value."""
STYLE: Mapping[str, tuple[str, str]] = {
    "reference": ("reference", "base"),
    "unchanged": ("unchanged", "simulated"),
    "doubtful": ("doubtful", "faint"),
    "changed": ("changed", "failed"),
}
"""State -> entry of the legend and style."""
MOST_TICKS = 8
"""[dates] Below the axis."""
SECONDS_A_DAY = 86400.0
UPRIGHT = 1e-6
"""[1] Of the range of dates, by which the line of the onset leans: a line rises."""


def history_chart(document: WatchDocument) -> Chart | None:
    """Values with intervals of 95 % of each log, in the range in which logs of the reference lie; None without any."""
    shown = [log for log in document.logs if log.values]
    if not shown or not document.values:
        return None
    dates = [datetime.fromisoformat(log.date) for log in shown]
    days = np.array([(date - dates[0]).total_seconds() / SECONDS_A_DAY for date in dates])
    place = {log.name: float(day) for log, day in zip(shown, days, strict=True)}
    panels = [_panel(document, name, shown, place, k == 0) for k, name in enumerate(document.values)]
    return Chart("history", "History of the values", panels, "date", ticks=_ticks(days, dates))


def _panel(
    document: WatchDocument, name: str, shown: Sequence[WatchedLog], place: Mapping[str, float], is_first: bool
) -> Panel:
    wide, value = float(normal_isf((1 - CONFIDENCE) / 2)), document.values[name]
    series, low, high = list[Series](), *value.band
    for state, (head, style) in STYLE.items():
        own = [log for log in shown if log.state == state and name in log.values]
        if not own:
            continue
        y = np.array([log.values[name].value for log in own])
        error = wide * np.array([log.values[name].std for log in own])
        low, high = min(low, float((y - error).min())), max(high, float((y + error).max()))
        x = np.array([place[log.name] for log in own])
        series.append(Series(head, x, y, style, "points", error=error, legend=is_first))
    if document.onset is not None and document.onset.log in place:
        whole, days = max(place.values()) or 1.0, sorted(set(place.values()))
        first = place[document.onset.log]
        at = (first + max((day for day in days if day < first), default=first)) / 2
        series.append(Series(
            "onset", np.array([at, at + UPRIGHT * whole]), np.array([low, high]), "measured", legend=is_first
        ))  # fmt: skip
    return Panel(
        pretty_unit(value.unit) or "1", series, head=with_unit(name, ""), height=HEIGHT, range=value.band,
        levels=(value.mean,),
    )  # fmt: skip


def _ticks(days: np.ndarray, dates: Sequence[datetime]) -> list[tuple[float, str]]:
    """Dates at some logs, about equally far apart; with the time where all are of one day or two."""
    span = float(days[-1]) or 1.0
    kept, last = list[tuple[float, str]](), -np.inf
    for day, date in zip(days, dates, strict=True):
        if day - last >= span / MOST_TICKS:
            text = date.strftime("%Y-%m-%d") if span >= 2 else date.strftime("%d. %H:%M")
            kept.append((float(day), text))
            last = day
    return kept
