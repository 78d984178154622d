"""The charts of a campaign: sigma and bias of each parameter over a field that varies."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from fmu_didim.base.errors import InputError
from fmu_didim.campaigns.reporting.sections import shown
from fmu_didim.report.drawing.charts import SERIES, Chart, Panel, Series
from fmu_didim.report.sections import Matrix, matrix

PANEL_HEIGHT = 220
PANELS = (("Standard deviation σ", "sigma"), ("Bias, without its sign", "bias"))


def page_figures(qualities: Mapping[str, pd.DataFrame]) -> list[tuple[str, Chart | None, Matrix | None]]:
    """Bias and sigma over each field of numbers; over the others a map of the bias of each parameter.

    Args:
        qualities: path of each field that varies -> bias, sigma and coverage of each parameter for each of its values.
    """
    found: list[tuple[str, Chart | None, Matrix | None]] = []
    for path, quality in qualities.items():
        if quality.empty or quality[path].nunique() < 2:
            continue
        if not _are_numbers(quality[path]):
            if quality["bias_in_sigma"].notna().any():
                cross = quality.assign(shown=quality[path].map(shown)).pivot_table(
                    index="shown", columns="parameter", values="bias_in_sigma", sort=False
                )
                rows = {
                    str(name): list(map(float, row)) for name, row in zip(cross.index, cross.to_numpy(), strict=True)
                }
                most = max(float(np.nanmax(np.abs(cross.to_numpy()))), 1.0)
                names = list(map(str, cross.columns))
                found.append((path, None, matrix(f"bias / σ over {path}", names, rows, largest=most, digits=1)))
        elif quality[["sigma", "bias"]].notna().any(axis=None):
            found.append((path, field_chart(quality, path, f"field-{len(found) + 1}"), None))
    return found


def field_chart(quality: pd.DataFrame, path: str, name: str = "field") -> Chart:
    """Sigma, and where true values are known bias, of each parameter over a field, in percent of the value.

    Args:
        quality: a row for each parameter and value of the field; those are places on an axis, or names on it.

    Raises:
        InputError: there is neither sigma nor bias.
    """
    columns = [column for _, column in PANELS if not quality.empty and quality[column].notna().any()]
    if not columns:
        raise InputError(
            "There is neither scatter nor bias to draw: each group has at most one answer, and no true value is known.",
            next_step="remarks() says what is missing; to_frame() has the values.",
        )  # fmt: skip
    quality = quality.assign(size=np.abs(quality["true"].fillna(quality["value"])).replace(0.0, 1.0) / 100)
    ticks: list[tuple[float, str]] = []
    if _are_numbers(quality[path]):
        quality = quality.assign(place=quality[path]).sort_values("place", kind="stable")
    else:
        places, names = pd.factorize(quality[path].map(shown))
        quality, ticks = quality.assign(place=places), [(float(k), str(v)) for k, v in enumerate(names)]
    panels = []
    for head, column in [panel for panel in PANELS if panel[1] in columns]:
        lines = [
            Series(
                str(parameter), group["place"].to_numpy(float),
                np.abs(group[column] / group["size"]).to_numpy(float), f"series{k % SERIES}",
                "points" if ticks else "line",
            )
            for k, (parameter, group) in enumerate(quality.groupby("parameter", sort=False))
        ]  # fmt: skip
        panels.append(Panel("% of the value", lines, head, PANEL_HEIGHT, log=True))
    drawn = " and ".join(word for word, column in (("σ", "sigma"), ("bias", "bias")) if column in columns)
    title = f"{drawn} of each parameter over {path}, in percent of its true, else of its mean value"
    return Chart(name, title, panels, path, log=not ticks and bool((quality["place"] > 0).all()), ticks=ticks)


def _are_numbers(values: pd.Series) -> bool:
    return all(isinstance(v, int | float) and not isinstance(v, bool) and v == v for v in values)
