"""Small plots of characters, for terminals."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fmu_didim.data.signals import Array

WIDTH, HEIGHT = 60, 13


def text_plot(x: Array, curves: Mapping[str, Array], *, x_name: str, y_name: str) -> list[str]:
    """Curves y(x) as lines of text, with the ends of both axes; where curves meet, the last one is shown.

    Args:
        x: (N,); curves: a character -> (N,) values.
    """
    y = np.concatenate(list(curves.values()))
    low, high = float(y.min()), float(y.max())
    left, right = float(x.min()), float(x.max())
    grid = np.full((HEIGHT, WIDTH), " ", dtype="<U1")
    if low < 0 < high:
        grid[_place(np.zeros(1), low, high, HEIGHT)] = "-"
    for mark, values in curves.items():
        grid[_place(values, low, high, HEIGHT), _place(x, left, right, WIDTH)] = mark[0]
    labels = [f"{high:9.3g}", *[" " * 9] * (HEIGHT - 2), f"{low:9.3g}"]
    rows = [f"{label} |{''.join(row)}".rstrip() for label, row in zip(labels, grid[::-1], strict=True)]
    ends = f"{left:<10.3g}{x_name:^{WIDTH - 20}}{right:>10.3g}"
    return [f"{y_name}", *rows, f"{'':10}+{'-' * WIDTH}", f"{'':11}{ends}"]


def _place(values: Array, low: float, high: float, count: int) -> Array:
    scale = (count - 1) / (high - low) if high > low else 0.0
    return np.asarray(np.rint((values - low) * scale), dtype=np.intp)
