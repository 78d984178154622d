"""What held-out data say of an effect, on residuals made by hand: what confirms it, and what must not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fmu_didim.data.signals import Array
from fmu_didim.discovery.selection import held_out
from fmu_didim.discovery.selection.held_out import (
    FEWEST_BLOCKS,
    held_out_amplitude,
    held_out_objection,
    held_out_remark,
    shared_weights,
    unconfirmed,
)
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import held_out_ratio
from tests.discovery.by_hand import SIGNS, table_fit

COUNT = SIGNS.size
TIME = np.arange(COUNT) / 10.0
EFFECT = np.sign(np.sin(2 * np.pi * 0.13 * TIME))
"""A square wave of eight seconds."""
BASE = np.cos(2 * np.pi * 0.31 * TIME)
"""What the other parameters can make."""


def white(seed: int = 0, count: int = COUNT) -> Array:
    return np.random.default_rng(seed).standard_normal(count)


def fits(first: Array, second: Array | None, columns: Array | None = None, **more: Any) -> tuple[Fit, Fit]:
    """Fits without and with an effect that leave these residuals (N,) on held-out data."""
    tables = [None if r is None else r[:, None] for r in (first, second)]
    before, after = (table_fit(50.0, held_out={"other": table}, **more) for table in tables)
    vars(before)["held_out_jacobian"] = np.zeros((0, 1, 0)) if columns is None else columns[:, None, None]
    return before, after


def spoiled(size: float = 1.0, *, drift: float, seed: int = 0) -> tuple[Array, Array]:
    """Residuals without and with an effect of size 0.6, ``size`` times that on held-out data, where the other
    parameters have drifted along with it."""
    rest = white(seed)
    first = rest + size * 0.6 * EFFECT
    return first, first - 0.6 * EFFECT + drift * BASE


def test_an_effect_is_confirmed_beside_parameters_that_drifted_with_it() -> None:
    """The drift takes away on held-out data most of what the effect gains."""
    before, after = fits(*spoiled(drift=0.65), columns=BASE)
    ratio, amplitude = held_out_ratio(before, after), held_out_amplitude(before, after)
    assert ratio is not None and amplitude is not None
    assert ratio.value < 1.0 < ratio.high
    assert amplitude.low < 1.0 < amplitude.high
    assert amplitude.low > 0.5
    assert held_out_objection(before, after) == ""
    # Where nothing is known of what the others can make, the same residuals confirm nothing.
    alone = fits(*spoiled(drift=0.65))
    assert held_out_objection(*alone).startswith(f"held-out RMS ratio {ratio.value:.3f}, its interval reaches")


def test_a_model_that_predicts_worse_is_never_confirmed() -> None:
    before, after = fits(*spoiled(drift=0.9), columns=BASE)
    ratio, amplitude = held_out_ratio(before, after), held_out_amplitude(before, after)
    assert ratio is not None and amplitude is not None
    assert 1.0 < ratio.value < 1.1
    assert amplitude.low > 0.5
    assert unconfirmed(before, after) == f"held-out RMS ratio {ratio.value:.3f}, its interval reaches {ratio.high:.3f}"
    assert held_out_remark(before, after) == ""


@pytest.mark.parametrize("size", [0.55, 0.3])
def test_an_effect_that_may_be_half_as_large_is_not_confirmed(size: float) -> None:
    before, after = fits(*spoiled(size, drift=0.0), columns=BASE)
    amplitude = held_out_amplitude(before, after)
    assert amplitude is not None
    assert amplitude.value == pytest.approx(size, abs=0.15)
    assert held_out_objection(before, after) != ""


def test_the_objection_says_how_large_it_is() -> None:
    before, after = fits(*spoiled(0.6, drift=0.0, seed=2), columns=BASE)
    amplitude, objection = held_out_amplitude(before, after), held_out_objection(before, after)
    assert objection.endswith(f"; there it has {amplitude}")
    assert str(amplitude).endswith("times its fitted size")


def test_glitches_do_not_hide_an_effect() -> None:
    """Three samples of a hundred deviations that no model explains."""
    first, second = spoiled(drift=0.65)
    glitch = np.zeros(COUNT)
    glitch[[37, 181, 302]] = 100.0, -100.0, 100.0
    clean, struck = fits(first, second, columns=BASE), fits(first + glitch, second + glitch, columns=BASE)
    one, other = held_out_amplitude(*clean), held_out_amplitude(*struck)
    assert one is not None and other is not None
    assert other.value == pytest.approx(one.value, abs=0.1)
    assert other.low > 0.5
    assert held_out_ratio(*struck).high > 1.0


def test_a_sample_weighs_less_only_where_neither_model_explains_it() -> None:
    one, other = white(1)[:, None], white(2)[:, None]
    one[5], other[5] = 30.0, 0.1  # explained by the second alone
    one[9], other[9] = 0.1, 30.0
    one[14], other[14] = 30.0, 40.0
    weights = shared_weights(one, other, np.array([2.0]))
    assert np.array_equal(weights, shared_weights(other, one, np.array([2.0])))
    assert weights[5] == weights[9] == 0.5
    assert weights[14] == pytest.approx(0.5 * np.sqrt(3.0 * 2.0 / 30.0), rel=1e-12)
    assert np.count_nonzero(weights != 0.5) == 1


def test_a_model_error_everywhere_is_no_glitch() -> None:
    large = 20.0 * white(1)[:, None]
    assert np.mean(shared_weights(large, large, np.array([1.0])) < 1.0) < 0.01


def test_an_effect_that_comes_and_goes_for_long_is_less_certain() -> None:
    """The same samples of an effect that helps in some blocks and harms in others, in and out of order."""
    helps = np.where(white(3, COUNT // 5).repeat(5) > -0.84, 1.0, -1.0)  # four blocks of five
    rest = 0.3 * SIGNS
    order = np.random.default_rng(4).permutation(COUNT)
    blocks = fits(rest + helps, rest + helps - 1.0)
    mixed = fits(rest + helps[order], rest + helps[order] - 1.0)
    wide, narrow = held_out_amplitude(*blocks), held_out_amplitude(*mixed)
    assert wide is not None and narrow is not None
    assert wide.value == pytest.approx(narrow.value, abs=1e-9)
    assert wide.high - wide.low > 1.8 * (narrow.high - narrow.low)


@pytest.mark.parametrize(("blocks", "enough"), [(FEWEST_BLOCKS - 1, False), (FEWEST_BLOCKS, True)])
def test_few_held_out_data_confirm_nothing_this_way(blocks: int, enough: bool) -> None:
    first, second = (r[: 5 * blocks] for r in spoiled(drift=0.2))
    assert (held_out_amplitude(*fits(first, second)) is not None) is enough


def test_what_the_other_parameters_can_make_as_well_is_not_judged() -> None:
    """A limit that the held-out data do not reach moves the other parameters alone."""
    rest = white()
    before, after = fits(rest + 0.1 * BASE, rest, columns=BASE)
    assert held_out_amplitude(before, after) is None
    assert held_out_amplitude(*fits(rest, rest, columns=BASE)) is None


def test_a_model_that_cannot_be_run_has_no_size() -> None:
    assert held_out_amplitude(*fits(white(), None)) is None


def test_an_effect_of_half_its_size_is_hardly_ever_confirmed(monkeypatch: pytest.MonkeyPatch) -> None:
    """At one half both models are as good; four effects of a thousand may be confirmed by chance."""
    monkeypatch.setattr(held_out, "AMPLITUDE_DRAWS", 4000)
    confirmed = 0
    for seed in range(60):
        amplitude = held_out_amplitude(*fits(*spoiled(0.5, drift=0.3, seed=seed), columns=BASE))
        confirmed += amplitude is not None and amplitude.low > 0.5
    assert confirmed <= 3


def test_the_user_is_told_what_confirmed_it() -> None:
    before, after = fits(*spoiled(drift=0.65), columns=BASE)
    ratio, amplitude = held_out_ratio(before, after), held_out_amplitude(before, after)
    remark = held_out_remark(before, after)
    assert f"RMS ratio {ratio.value:.3f}, {ratio.low:.3f} to {ratio.high:.3f}" in remark
    assert remark.endswith(f"held-out data show the effect at {amplitude}")
    assert held_out_remark(*fits(*spoiled(drift=0.0), columns=BASE)) == ""  # the whole prediction is better
    assert held_out_remark(*fits(white(), white())) == ""
    assert held_out_remark(table_fit(50.0), table_fit(10.0)) == ""  # no held-out data
