"""What charts hold: values as they are written, residuals in bins, spectra, correlations, the loop, the matrix."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from fmu_didim.data.signals import Array, trajectory
from fmu_didim.report.drawing.charts import Chart, Panel, Series, chart_json, limited, points_per_trace
from fmu_didim.report.drawing.diagram import Wire, loop_diagram, wires
from fmu_didim.report.drawing.figures import COLOURS, matplotlib_figure
from fmu_didim.report.drawing.residual import Residual
from fmu_didim.report.drawing.residual_charts import autocorrelation, longest_even, spectrum, whiteness_charts
from fmu_didim.report.drawing.torque_charts import Simulated, samples_text, torque_chart
from fmu_didim.report.experiment_charts import RESIDUAL_CHARTS, ExperimentCharts, ResidualCharts, residual_sections
from fmu_didim.report.sections import Charts, Text, matrix
from tests.report.drawn import charts, line, plotted

RANDOM = np.random.default_rng(3)


def chart(*series: Series, **panel: object) -> Chart:
    return Chart("c", "A chart", [Panel("y", series, **panel)], "x")  # type: ignore[arg-type]


def written(shown: Chart) -> object:
    return charts(f'<script type="application/json" id="chart-c">{chart_json(shown)}</script>')["c"]


@pytest.mark.parametrize(
    "y",
    [np.sin(np.arange(500.0)), np.arange(5.0), np.logspace(-9, 3, 200), np.full(300, 2.5), np.zeros(200)],
    ids=["wave", "short", "decades", "constant", "zero"],
)
def test_values_are_written_to_what_can_be_seen(y: np.ndarray) -> None:
    y = y.copy()
    y[2] = np.nan
    found_x, found = line(written(chart(Series("a", np.arange(y.size) / 200, y, "final"))), 0, "a")
    np.testing.assert_allclose(found_x, np.arange(y.size) / 200, atol=1e-9)
    assert np.isnan(found[2])
    spread = np.nanmax(y) - np.nanmin(y)
    is_wide = np.nanmin(np.abs(y[y > 0]), initial=1.0) < np.nanmax(np.abs(y)) / 1e3
    np.testing.assert_allclose(found, y, rtol=1e-6, atol=0.0 if is_wide else 1.6e-5 * spread)


def test_axes_that_are_not_even_are_written_as_they_are() -> None:
    x = np.array([0.0, 0.1, 0.2, 0.5, 0.6])
    np.testing.assert_allclose(line(written(chart(Series("a", x, x, "final"))), 0, "a")[0], x, rtol=1e-6)


def test_text_cannot_leave_its_script() -> None:
    text = str(chart_json(chart(Series("</script><b>&", np.arange(3.0), np.arange(3.0), "final"))))
    assert not re.search(r"[<>&]", text)


def test_long_lines_are_thinned_and_points_are_not() -> None:
    x = np.arange(50_000.0)
    shown = chart(Series("a", x, np.sin(x), "final"), Series("b", x, x, "measured", "points"))
    points = points_per_trace([shown] * 4)
    thinned = limited(shown, points)
    assert thinned.panels[0].series[0].x.size <= points + 2
    assert thinned.panels[0].series[1].x.size == x.size


def test_the_page_says_that_long_lines_are_thinned() -> None:
    assert samples_text(np.arange(100.0)) == "100 samples over 99 s"
    assert samples_text(np.arange(40_000.0)).startswith("40000 samples over 39999 s; lines go through the smallest and")


def test_bounds_of_the_spectrum_and_of_the_correlations_hold_for_white_noise() -> None:
    inside_density, inside_correlation = [], []
    for _ in range(200):
        noise = RANDOM.normal(0, 0.3, 1000)
        frequency, density, (low, high) = spectrum(noise, 100.0)
        inside_density.append(np.mean((density[1:-1] > low) & (density[1:-1] < high)))
        inside_correlation.append(np.mean(np.abs(autocorrelation(noise, 40)) < 1.96 / np.sqrt(1000)))
        assert frequency[-1] == pytest.approx(50.0)
    assert np.mean(inside_density) == pytest.approx(0.95, abs=0.02)
    assert np.mean(inside_correlation) == pytest.approx(0.95, abs=0.02)


def test_spectrum_and_correlation_of_noise_with_a_memory() -> None:
    """e_t = 0.8 e_(t-1) + u_t has the correlations 0.8^k and the density 2 s^2 / f / |1 - 0.8 exp(-i w)|^2."""
    noise = lfilter([1.0], [1.0, -0.8], RANDOM.normal(0, 1.0, 200_000))
    np.testing.assert_allclose(autocorrelation(noise, 5), 0.8 ** np.arange(1, 6), atol=0.02)
    frequency, density, (_, high) = spectrum(noise, 100.0)
    theory = 2 / 100.0 / np.abs(1 - 0.8 * np.exp(-2j * np.pi * frequency / 100.0)) ** 2
    low = frequency < 5
    assert np.mean(density[low] / theory[low]) == pytest.approx(1.0, abs=0.1)
    assert np.mean(density[low] > high) > 0.95


def test_what_needs_a_grid_takes_the_longest_even_stretch() -> None:
    time = np.delete(np.arange(200) / 50, [40, 41])
    assert longest_even(time) == slice(40, 198)
    assert [c.name for c in whiteness_charts(ones(time))] == ["spectrum-1", "autocorrelation-1"]
    assert whiteness_charts(ones(time[:20])) == []


def ones(time: Array, *models: str) -> Residual:
    """A residual of one joint that is 1 throughout."""
    of_joint = {model: ("residual", np.ones(time.size)) for model in models or ("residual",)}
    return Residual("1", "a", trajectory(time, {"q1": time}), ["N.m"], [of_joint], [[]])


def test_of_two_models_the_last_one_is_named_where_it_alone_is_drawn() -> None:
    spectrum_of_both, correlation = whiteness_charts(ones(np.arange(100) / 50, "base model", "final model"))
    assert [series.name for series in spectrum_of_both.panels[0].series] == ["base model", "final model"]
    assert [series.name for series in correlation.panels[0].series] == ["final model"]
    assert correlation.panels[0].head == "Joint 1, final model"


@pytest.mark.parametrize("kind", RESIDUAL_CHARTS, ids=lambda kind: kind.draw.__name__)
def test_each_kind_of_charts_of_the_residual_is_on_the_page(kind: ResidualCharts) -> None:
    time = np.arange(100) / 50
    torque = torque_chart("torque-1", "a", time, np.ones((100, 1)), {"m": Simulated(np.zeros((100, 1)))}, ["N.m"])
    residual = replace(ones(time), quantities=[["position"]])
    charts = kind.draw(residual)
    assert charts
    _, shown = residual_sections([ExperimentCharts("a", "2 s", torque, residual)], "What the model leaves")
    drawn = [chart.name for block in shown.blocks if isinstance(block, Charts) for chart in block.charts]
    assert len(set(drawn)) == len(drawn)
    assert {chart.name for chart in charts} <= set(drawn)
    assert kind.text in [block.text for block in shown.blocks if isinstance(block, Text)]


def test_torque_is_drawn_at_the_control_rate_within_the_log() -> None:
    time, every = np.arange(1, 11) / 10, np.arange(0, 1500) / 1000
    model = Simulated(np.zeros((10, 2)), every, np.column_stack([every, -every]))
    shown = torque_chart(
        "t", "a", time, np.ones((10, 2)), {"simulated": model}, ["N.m", "N"], percent=[4.83], noise=[0.1]
    )
    simulated = shown.panels[2].series[1]
    assert (simulated.x[0], simulated.x[-1]) == (pytest.approx(0.1), pytest.approx(1.0))
    np.testing.assert_allclose(simulated.y, -simulated.x)
    assert shown.panels[1].range == (-0.2, 0.2)
    assert shown.panels[3].range is None
    assert [panel.label for panel in shown.panels] == ["torque (N·m)", "residual (N·m)", "force (N)", "residual (N)"]
    assert shown.panels[0].head == "Joint 1, relative error 4.83 %"
    np.testing.assert_allclose(shown.panels[1].series[0].y, 1.0)  # at the samples, not along the dense line


def test_figure_for_notebooks_has_the_same_lines_and_shows_itself() -> None:
    x, y = np.arange(3.0), np.array([1.0, 4.0, 2.0])
    shown = chart(Series("a", x, y, "base"), Series("b", x, 2 * y, "measured", "points"), head="Joint 1", log=True)
    figure = matplotlib_figure(shown)
    (axes,) = figure.axes
    drawn = plotted(axes)
    np.testing.assert_allclose(drawn["a"].get_xydata(), np.column_stack([x, y]))
    np.testing.assert_allclose(drawn["b"].get_ydata(), 2 * y)
    assert (drawn["a"].get_linestyle(), drawn["a"].get_color()) == ("--", COLOURS["base"])
    assert (drawn["b"].get_marker(), drawn["b"].get_linestyle()) == (".", "None")
    assert (axes.get_title("left"), axes.get_xlabel(), axes.get_yscale()) == ("Joint 1", "x", "log")
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["a", "b"]
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_figure_draws_errors_bands_stems_and_names_on_the_axis() -> None:
    x, y = np.arange(4.0), np.ones(4)
    shown = Chart("c", "A chart", [
        Panel("y", [Series("bars", x, y, "final", error=0.5 * y), Series("area", x, y, "base", band=0.25 * y)]),
        Panel("z", [Series("stem", x, y, "residual", "stems")], range=(-2.0, 2.0), levels=(0.5,)),
    ], "x", ticks=[(0.0, "one"), (3.0, "four")])  # fmt: skip
    above, below = matplotlib_figure(shown).axes
    tops = [segment[1][1] for segment in above.containers[0].lines[2][0].get_segments()]
    np.testing.assert_allclose(tops, 1.5)
    band = above.collections[-1].get_paths()[0].vertices[:, 1]
    assert (band.min(), band.max()) == (0.75, 1.25)
    assert [segment.tolist() for segment in below.collections[0].get_segments()][3] == [[3.0, 0.0], [3.0, 1.0]]
    assert [text.get_text() for text in below.get_xticklabels()] == ["one", "four"]
    assert below.patches and below.lines[0].get_ydata() == [0.5, 0.5]


LOOP = {
    "order": ["controller", "actuator_lag2", "plant"], "step_size_s": 0.004, "delay_samples": {"plant": 0.4},
    "ticks_per_step": {"controller": 2}, "outputs_after_step": ["controller"],
    "components": {
        "controller": {"kind": "fmu", "source": "a/vendor.fmu", "fmi_version": "2.0", "interface": "co-simulation"},
        "actuator_lag2": {"kind": "model", "name": "<lag>"}, "plant": {"kind": "model", "source": "robot.yaml"},
    },
    "connections": [
        "controller.q_ref1 <- 1 * reference.q1", "controller.q_ref2 <- 1 * reference.q2",
        "controller.q1 <- 1 * plant.q1", "plant.tau1 <- 35.15 * controller.command1",
        "actuator_lag2.u <- -35.15065 * controller.command2", "plant.tau2 <- 1 * actuator_lag2.y",
    ],
}  # fmt: skip


def test_wires_join_the_connections_of_two_components() -> None:
    assert wires(LOOP["connections"])[:3] == [
        Wire("reference", "controller", ("q",), (1.0,)), Wire("plant", "controller", ("q",), (1.0,)),
        Wire("controller", "plant", ("command",), (35.15,)),
    ]  # fmt: skip
    assert Wire("a", "b", ("x",), (35.15,)).text == "x × 35.15"


def test_drawing_of_the_loop_shows_rate_order_delay_and_gain() -> None:
    drawn = str(loop_diagram(LOOP))
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", drawn)
    for text in (
        "vendor.fmu",
        "FMI 2.0 co-simulation",
        "delay 0.4",
        "command × 35.15",
        "a row every 4 ms",
        "&lt;lag&gt;",
    ):
        assert text in texts, text
    assert any(text.startswith("1. in a step, 125 Hz") for text in texts)  # a period of two ticks
    assert "3. in a step, 250 Hz" in texts
    assert drawn.count('class="wire"') == 5
    assert loop_diagram({"step_size_s": 0.01, "order": ["controller", "plant"]}) is None


def test_matrix_has_two_hues_and_no_negative_zero() -> None:
    found = matrix("m", ["a", "b"], {"a": [1.0, -0.001], "b": [None, -0.5]}, largest=1.0)
    assert [[(c.text, c.sign, c.size) for c in row] for _, row in found.rows] == [
        [("1.00", 1, 60), ("0.00", -1, 0)], [("–", 1, 0), ("-0.50", -1, 30)]
    ]  # fmt: skip
    assert found.shows_values
    assert not matrix("m", [str(k) for k in range(20)], {}, largest=1.0).shows_values


@pytest.mark.filterwarnings("error")
def test_values_that_are_too_large_to_draw_are_gaps() -> None:
    """As those of a parameter over a described value that is zero but for rounding."""
    x = np.arange(3.0)
    found = line(written(chart(Series("a", x, np.array([1.0, 1e80, 2.0]), "final"))), 0, "a")[1]
    np.testing.assert_array_equal(found, [1.0, np.nan, 2.0])
