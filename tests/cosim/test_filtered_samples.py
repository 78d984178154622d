"""Samples behind a low-pass without phase: their weights against a filter that was run, and what a log must say."""

import numpy as np
import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.cosim import sample_operator
from fmu_didim.cosim.sampling import filter_response
from fmu_didim.data.filters import LowPass

STEP, TICKS, CUTOFF_HZ = 1e-3, 4000, 40.0
AT = np.arange(0.5, 3.5, 0.01)


def filtered(values, times=AT, cutoff_hz=CUTOFF_HZ, step=STEP, start=0.0):
    operator = sample_operator(
        times, start=start, step=step, tick_count=values.shape[0], kind="filtered", cutoff_hz=cutoff_hz
    )
    return operator.apply(values[operator.ticks])


@pytest.mark.parametrize("hz", [0.0, 5.0, 20.0, 40.0, 60.0, 90.0])
def test_an_oscillation_keeps_its_phase_and_loses_what_the_filter_takes(hz):
    middle = (np.arange(TICKS) + 0.5) * STEP  # a held command acts as that in the middle of its period
    found = filtered(np.cos(2 * np.pi * hz * middle))
    held = np.sinc(hz * STEP)  # by which the amplitude of a held oscillation is smaller
    np.testing.assert_allclose(found, filter_response(np.array(hz), CUTOFF_HZ) * held * np.cos(2 * np.pi * hz * AT),
                               atol=2e-3)  # fmt: skip


def test_it_is_the_low_pass_of_a_case_run_forward_and_backward():
    rng = np.random.default_rng(0)
    values = np.repeat(rng.normal(size=TICKS // 20), 20)
    fine = np.repeat(values, 10)  # the held command, ten times as fine
    run = LowPass(CUTOFF_HZ).apply(fine, 10 / STEP)
    at = np.rint(AT / STEP * 10).astype(int)
    between = (run[at - 1] + run[at]) / 2  # an instant lies between two of the fine periods
    np.testing.assert_allclose(filtered(values), between, atol=3e-3)


def test_what_does_not_change_stays_and_so_do_the_ends():
    assert filtered(np.full(TICKS, 3.0), np.arange(0.0, 4.0, 0.01)) == pytest.approx(3.0, abs=1e-12)


def test_the_instants_may_lie_between_ticks_and_the_data_may_begin_anywhere():
    values = np.cos(2 * np.pi * 3.0 * (np.arange(TICKS) + 0.5) * STEP)
    times = AT + 0.37 * STEP
    expected = filter_response(np.array(3.0), CUTOFF_HZ) * np.cos(2 * np.pi * 3.0 * times)
    np.testing.assert_allclose(filtered(values, times), expected, atol=1e-3)
    np.testing.assert_allclose(filtered(values, times + 7.0, start=7.0), expected, atol=1e-3)


def test_a_shift_of_the_stamps_shifts_the_samples():
    values = np.cos(2 * np.pi * 3.0 * (np.arange(TICKS) + 0.5) * STEP)
    operator = sample_operator(AT, start=0.0, step=STEP, tick_count=TICKS, kind="filtered", cutoff_hz=CUTOFF_HZ)
    late = operator.stamped_later(2.5, TICKS)
    expected = np.cos(2 * np.pi * 3.0 * (AT - 2.5 * STEP))
    np.testing.assert_allclose(late.apply(values[late.ticks]), expected, atol=1e-3)
    assert late.cutoff_hz == operator.at(np.arange(5)).cutoff_hz == CUTOFF_HZ


def test_a_filter_needs_a_cutoff():
    with pytest.raises(InputError, match="cut-off"):
        sample_operator(AT, start=0.0, step=STEP, tick_count=TICKS, kind="filtered")
