"""A chart as a Plotly figure, for notebooks."""

from __future__ import annotations

from itertools import accumulate

import plotly.graph_objects as go

from fmu_didim.report.drawing.charts import Chart, Panel, Series

COLOURS = {
    "measured": "#374151", "simulated": "#0072b2", "residual": "#d55e00", "base": "#d55e00", "final": "#0072b2",
    "failed": "#b42318", "faint": "#9aa3b0", "series0": "#0072b2", "series1": "#d55e00", "series2": "#009e73",
    "series3": "#cc79a7", "series4": "#e69f00", "series5": "#56b4e9", "series6": "#7a3db8", "series7": "#444444",
}  # fmt: skip
"""Those of Okabe and Ito, which the colour-blind can tell apart."""
DASHED = ("base", "series1", "series5")
GAP = 40
SENDS_DATA = ("sendChartToCloud", "sendDataToCloud")
"""Buttons of plotly.js that upload the data of a figure."""


def plotly_figure(chart: Chart) -> go.Figure:
    """The panels below each other over one axis, with the entries of the legend once."""
    figure = go.Figure()
    heights = [panel.height + GAP for panel in chart.panels]
    total = sum(heights)
    tops = [total - above for above in accumulate(heights, initial=0)]
    known: set[str] = set()
    for k, panel in enumerate(chart.panels):
        axis = "" if k == 0 else str(k + 1)
        for series in panel.series:
            is_new = series.legend and series.name not in known
            known.add(series.name)
            figure.add_trace(_trace(series, f"y{axis}", shown=is_new))
        domain = ((tops[k] - panel.height) / total, tops[k] / total)
        figure.update_layout({f"yaxis{axis}": _axis(panel, domain)})
        if panel.head:
            figure.add_annotation(
                text=f"<b>{panel.head}</b>", x=0, y=domain[1], xref="paper", yref="paper", xanchor="left",
                yanchor="bottom", showarrow=False,
            )  # fmt: skip
    last = "" if len(chart.panels) == 1 else str(len(chart.panels))
    figure.update_layout(
        xaxis={"title": chart.label, "anchor": f"y{last}", "type": "log" if chart.log else "linear"},
        height=total + 120, hovermode="x unified", template="plotly_white", modebar={"remove": list(SENDS_DATA)},
        legend={"orientation": "h", "y": 1.0, "yanchor": "bottom", "x": 0, "yref": "container"},
    )  # fmt: skip
    if chart.ticks:
        places, texts = zip(*chart.ticks, strict=True)
        figure.update_xaxes(tickvals=places, ticktext=texts)
    return figure


def _trace(series: Series, axis: str, *, shown: bool) -> go.Scatter:
    colour = COLOURS[series.style]
    return go.Scatter(
        x=series.x, y=series.y, name=series.name, legendgroup=series.name, showlegend=shown, yaxis=axis,
        mode="markers" if series.kind == "points" else "lines",
        marker={"color": colour, "size": 5},
        line={"color": colour, "width": 1.5, "dash": "dash" if series.style in DASHED else "solid"},
        error_y={"type": "data", "array": series.error} if series.error.size else None,
    )  # fmt: skip


def _axis(panel: Panel, domain: tuple[float, float]) -> dict[str, object]:
    return {"title": panel.label, "domain": domain, "type": "log" if panel.log else "linear"}
