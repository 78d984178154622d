"""Charts of the residual: against velocity and position, its spectrum, its autocorrelation.

For noise alone of N samples the spectrum is flat within the bounds of a chi-square distribution, and all but one in
twenty autocorrelations lie within 1.96 / sqrt(N). Sources: Welch, IEEE Trans. AU-15 (1967); Box, Jenkins, Time Series
Analysis, chapter 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmu_didim.base.distributions import chi2_isf, chi2_ppf, normal_isf
from fmu_didim.data.signals import Array
from fmu_didim.data.spectrum import power_density
from fmu_didim.report.drawing.charts import Chart, Panel, Series
from fmu_didim.report.drawing.residual import Residual
from fmu_didim.report.numbers import pretty_unit, with_unit

PANEL_HEIGHT = 140
BINS = 24
SMALLEST_BIN = 5
"""[samples] With fewer in a bin the standard error is unreliable."""
MOST_POINTS = 2000
"""[samples] Above this number single samples are not drawn."""
SEGMENTS = 8
"""[segments] Of a spectrum, overlapping by half; fewer if a segment had less than SHORTEST_SEGMENT samples."""
SHORTEST_SEGMENT = 32
LAGS = 40
"""[lags] Autocorrelations that are drawn."""
CONFIDENCE = 0.95
STEP_TOLERANCE = 0.01
"""[1] Part of a step by which equally spaced stamps may differ."""


@dataclass(frozen=True)
class Quantity:
    """A quantity on the horizontal axis: its column without the joint number, title and units."""

    column: str
    title: str
    linear: str
    angular: str

    def unit(self, torque_unit: str) -> str:
        """The unit for a joint with this unit of torque."""
        return pretty_unit(self.linear if torque_unit == "N" else self.angular)


QUANTITIES = {
    "velocity": Quantity("dq", "velocity", "m/s", "rad/s"),
    "position": Quantity("q", "position", "m", "rad"),
    "torque": Quantity("base", "simulated torque", "N", "N.m"),
}
"""By their names in the regions of a discovery."""


def against_charts(residual: Residual) -> list[Chart]:
    """Mean residual of each joint in bins of the quantities over which it is drawn."""
    return [
        against_chart(residual, j, quantity)
        for j, quantities in enumerate(residual.quantities, start=1)
        for quantity in quantities
    ]


def against_chart(residual: Residual, joint: int, quantity: str) -> Chart:
    """Mean residual of a joint, from 1, in bins of a quantity (N,), with twice its standard error, and each sample.

    The bins hold equally many samples. The error is s / sqrt(N) of the residuals in the bin, as if they were
    independent; model error and coloured noise make the true one larger.
    """
    torque_unit, models = residual.units[joint - 1], residual.of_joints[joint - 1]
    if quantity in residual.further:
        column, title, unit = quantity, quantity, pretty_unit(residual.further[quantity])
    else:
        kind = QUANTITIES[quantity]
        column, title, unit = f"{kind.column}{joint}", kind.title, kind.unit(torque_unit)
    at, series = residual.signals.column(column), []
    for model, (style, values) in models.items():
        centre, mean, error = binned(at, values)
        if len(models) == 1 and at.size <= MOST_POINTS:
            series.append(Series("samples", at, values, "faint", "points", legend=False))
        series.append(Series(model, centre, mean, style, error=2 * error))
    head = f"{residual.head(joint - 1)}, against {title}"
    panel = Panel(with_unit("residual", pretty_unit(torque_unit)), series, head, 170, levels=(0.0,))
    place = residual.quantities[joint - 1].index(quantity) + 1 if quantity in residual.further else quantity
    return Chart(
        f"binned-{residual.key}-{joint}-{place}", f"Residual of {residual.text(joint - 1)} against {title}", [panel],
        with_unit(title, unit),
    )  # fmt: skip


def binned(at: Array, values: Array, *, bins: int = BINS) -> tuple[Array, Array, Array]:
    """Centre, mean and standard error of the mean of (N,) values in bins of (N,) ``at`` with equally many samples."""
    edges = np.unique(np.quantile(at, np.linspace(0, 1, min(bins, max(at.size // SMALLEST_BIN, 1)) + 1)))
    if edges.size < 2:
        return at[:1], np.array([values.mean()]), np.zeros(1)
    place = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, edges.size - 2)
    count = np.bincount(place, minlength=edges.size - 1)
    full = np.maximum(count, 1)
    mean = np.bincount(place, values, minlength=count.size) / full
    centre = np.bincount(place, at, minlength=count.size) / full
    square = np.bincount(place, (values - mean[place]) ** 2, minlength=count.size)
    error = np.sqrt(square / np.maximum(count - 1, 1) / full)
    kept = count >= min(SMALLEST_BIN, at.size)
    return centre[kept], mean[kept], error[kept]


def share_with(at: Array, values: Array) -> float:
    """Part of the variance of (N,) values that means of bins of (N,) ``at`` explain, less what they do by chance."""
    _, mean, error = binned(at, values)
    variance = float(values.var())
    if mean.size < 2 or variance <= 0:
        return 0.0
    explained = float(np.mean((mean - values.mean()) ** 2) - np.mean(error**2))
    return min(max(explained / variance, 0.0), 1.0)


def longest_even(time: Array) -> slice:
    """The longest part of (N,) instants that is equally spaced."""
    steps = np.diff(time)
    usual = float(np.median(steps)) if steps.size else 1.0
    breaks = np.flatnonzero(np.abs(steps - usual) > STEP_TOLERANCE * usual)
    ends = np.concatenate([[-1], breaks, [time.size - 1]])
    longest = int(np.argmax(np.diff(ends)))
    return slice(int(ends[longest]) + 1, int(ends[longest + 1]) + 1)


def spectrum(values: Array, rate_hz: float) -> tuple[Array, Array, tuple[float, float]]:
    """Frequencies (m,) in Hz above zero, power density (m,) of (N,) values by Welch, and the bounds of white noise.

    The bounds hold CONFIDENCE of the densities of white noise as strong as the values.
    """
    length = min(max(2 * values.size // (SEGMENTS + 1), SHORTEST_SEGMENT), values.size)
    frequency, density = power_density(values, rate_hz, length)
    segments = max((values.size - length) // (length - length // 2) + 1, 1)
    freedom = 36 * segments**2 / (19 * segments - 1)  # of Hann windows that overlap by half: Welch, 1967
    level = 2 * float(values.var()) / rate_hz / freedom
    tail = (1 - CONFIDENCE) / 2
    return frequency[1:], density[1:], (level * float(chi2_ppf(tail, freedom)), level * float(chi2_isf(tail, freedom)))


def autocorrelation(values: Array, lags: int) -> Array:
    """Correlation (lags,) of (N,) values with themselves, 1, 2, ... samples later."""
    centred = values - values.mean()
    power = float(centred @ centred) or 1.0
    return np.array([float(centred[k:] @ centred[:-k]) / power for k in range(1, lags + 1)])


def whiteness_charts(residual: Residual) -> list[Chart]:
    """Spectrum and autocorrelation of the residuals of all joints with the bounds of white noise.

    Of two models, bounds and autocorrelation are those of the last.
    """
    time = residual.signals.time
    even = longest_even(time)
    count = even.stop - even.start
    if count < SHORTEST_SEGMENT:
        return []
    rate = (count - 1) / float(time[even.stop - 1] - time[even.start])
    lags = np.arange(1, min(LAGS, count // 4) + 1)
    white = float(normal_isf((1 - CONFIDENCE) / 2)) / np.sqrt(count)
    spectra, correlations = [], []
    for j, (unit, models) in enumerate(zip(residual.units, residual.of_joints, strict=True), start=1):
        densities, stems, bounds = [], [], None
        for model, (style, values) in models.items():
            frequency, density, bounds = spectrum(values[even], rate)
            densities.append(Series(model, frequency, density, style))
            stems.append(Series(model, lags, autocorrelation(values[even], lags.size), style, "stems"))
        head = residual.head(j - 1)
        label = f"({pretty_unit(unit)})²/Hz"
        spectra.append(Panel(label, densities, head, PANEL_HEIGHT, range=bounds, log=True))
        last = f"{head}, {stems[-1].name}" if len(stems) > 1 else head
        correlations.append(Panel("correlation", stems[-1:], last, PANEL_HEIGHT, (-white, white), levels=(0.0,)))
    return [
        Chart(f"spectrum-{residual.key}", f"Spectrum of the residual, {residual.title}", spectra, "frequency (Hz)",
              log=True),
        Chart(f"autocorrelation-{residual.key}", f"Autocorrelation of the residual, {residual.title}", correlations,
              "lag (samples)"),
    ]  # fmt: skip
