"""Charts as they are drawn: those of a page, decoded without the code that wrote them, and lines of Matplotlib."""

from __future__ import annotations

import base64
import json
import re
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from fmu_didim.data.signals import Array


def charts(page: str) -> dict[str, Any]:
    """Name of each chart -> its JSON."""
    found = re.findall(r'<script type="application/json" id="chart-([^"]+)">(.*?)</script>', page, re.S)
    return {name: json.loads(text) for name, text in found}


def values(coded: Any) -> Array:
    """Numbers (N,) of a coded array."""
    if "count" in coded:
        return np.asarray(coded["first"] + coded["step"] * np.arange(coded["count"]))
    if "floats" in coded:
        return np.frombuffer(base64.b64decode(coded["floats"]), dtype="<f4").astype(float)
    steps = np.frombuffer(base64.b64decode(coded["steps"]), dtype="<u2").astype(float)
    return np.where(steps > 65_534, np.nan, coded["low"] + coded["scale"] * steps)


def line(chart: Any, panel: int, name: str) -> tuple[Array, Array]:
    """Instants and values of a series of a panel."""
    found = next(series for series in chart["panels"][panel]["series"] if series["name"] == name)
    return values(chart["axes"][found["x"]]), values(found["y"])


def plotted(axes: Axes) -> dict[str, Line2D]:
    """Name of each line that belongs in a legend -> the line."""
    return {str(found.get_label()): found for found in axes.lines if not str(found.get_label()).startswith("_")}
