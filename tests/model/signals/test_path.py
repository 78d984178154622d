"""What a signal becomes on its way, against answers known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.data.signals import Array
from fmu_didim.model.signals.path import changed, signal_key

EVEN = np.linspace(0.0, 10.0, 101)
UNEVEN = np.cumsum(np.random.default_rng(1).uniform(0.02, 0.2, 101))


@pytest.mark.parametrize("time", [EVEN, UNEVEN])
@pytest.mark.parametrize("is_held", [True, False])
@pytest.mark.parametrize("neutral", [{}, {"scale": 1.0}, {"lag": 0.0}, {"delay": 0.0}, {"upper limit": 9.0}])
def test_nothing_changes_where_all_is_neutral(time: Array, neutral: dict[str, float], *, is_held: bool) -> None:
    signal = np.sin(time)
    assert changed(time, signal, neutral, is_held=is_held) == pytest.approx(signal, abs=1e-14)


@pytest.mark.parametrize("time", [EVEN, UNEVEN])
@pytest.mark.parametrize("is_held", [True, False])
@pytest.mark.parametrize("parameter", ["lag", "delay"])
def test_little_of_it_changes_little(time: Array, parameter: str, *, is_held: bool) -> None:
    """No step at the neutral value, so that a fit can pass it."""
    signal = np.sin(time)
    assert changed(time, signal, {parameter: 1e-6}, is_held=is_held) == pytest.approx(signal, abs=1e-4)


@pytest.mark.parametrize("time", [EVEN, UNEVEN])
def test_a_lag_of_a_ramp_is_known(time: Array) -> None:
    """T z' + z = 2 t, z(t_0) = 2 t_0."""
    since = time - time[0]
    wanted = 2 * time - 2 * 0.7 * (1 - np.exp(-since / 0.7))
    assert changed(time, 2 * time, {"lag": 0.7}) == pytest.approx(wanted, abs=1e-12)


def test_a_lag_of_a_held_step_has_its_mean_over_each_step() -> None:
    step = np.where(EVEN >= 5, 1.0, 0.0)
    fine = np.linspace(0, 10, 100001)
    whole = np.where(fine >= 5 - 1e-9, 1 - np.exp(-(fine - 5) / 0.8), 0.0)
    means = [whole[(fine >= a - 1e-9) & (fine < a + 0.1 - 1e-9)].mean() for a in EVEN[:-1]]
    assert changed(EVEN, step, {"lag": 0.8}, is_held=True)[:-1] == pytest.approx(np.array(means), abs=1e-4)


@pytest.mark.parametrize("delay", [0.3, 0.04, -0.25])
@pytest.mark.parametrize("time", [EVEN, UNEVEN])
def test_a_delay_of_what_is_held_keeps_its_integral(time: Array, delay: float) -> None:
    held = np.where(time >= 4, 2.0, -1.0)
    found = changed(time, held, {"delay": delay}, is_held=True)
    begin = time[np.argmax(time >= 4)] + delay
    end = time[-1]
    assert float(found[:-1] @ np.diff(time)) == pytest.approx(2 * (end - begin) - (begin - time[0]), abs=1e-9)


def test_a_delay_of_a_straight_signal_moves_it() -> None:
    assert changed(EVEN, 3 * EVEN, {"delay": 0.33})[10:] == pytest.approx(3 * (EVEN - 0.33)[10:])
    assert changed(EVEN, 3 * EVEN, {"delay": 0.33})[0] == 0.0


def test_scale_offset_drift_transient_and_limits_come_in_this_order() -> None:
    time = EVEN + 2.0
    values = {"scale": 2.0, "offset": 1.0, "drift": 0.1, "transient": -3.0, "fades": 0.5, "upper limit": 1.6}
    wanted = np.minimum(2 * np.sin(time) + 1 + 0.1 * EVEN - 3 * np.exp(-EVEN / 0.5), 1.6)
    assert changed(time, np.sin(time), values) == pytest.approx(wanted)
    assert changed(time, np.sin(time), {"lower limit": -0.2}).min() == -0.2
    assert signal_key("a.b:c", "scale") == "a.b:c:scale"
