"""What held-out data say of an effect, on residuals made by hand: what confirms it, and what must not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fmu_didim.data.signals import Array
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import Options, _remark, decide, objection
from fmu_didim.discovery.selection.held_out import (
    FEWEST_BLOCKS,
    Lenience,
    amplitude_in_few_blocks,
    confirming_joint,
    held_out_amplitude,
    held_out_objection,
    held_out_remark,
    shared_weights,
    tells_nothing,
    typical_ratio,
    unconfirmed,
)
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import held_out_ratio
from tests.discovery.by_hand import SIGNS, Catalogue, candidate_of, effect_of, table_fit

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
    before, after = (
        table_fit(own, held_out={"other": table}, **more) for own, table in zip((50.0, 10.0), tables, strict=True)
    )
    vars(before)["held_out_jacobian"] = np.zeros((0, 1, 0)) if columns is None else columns[:, None, None]
    return before, after


def spoiled(size: float = 1.0, *, drift: float, seed: int = 0) -> tuple[Array, Array]:
    """Residuals without and with an effect of size 0.6, ``size`` times that on held-out data, where the other
    parameters have drifted along with it."""
    rest = white(seed)
    first = rest + size * 0.6 * EFFECT
    return first, first - 0.6 * EFFECT + drift * BASE


@pytest.mark.parametrize(
    ("shown", "fitted", "nothing"),
    [
        (0.0, 0.02, True),  # hardly changes these data, and is not there: nobody can tell
        (0.02, 0.02, True),
        (0.0, 1.0, False),  # would show, and does not
        (1.0, 1.0, False),  # shows
        (-2.0, 0.3, False),  # the prediction gets worse by more than chance
    ],
)
def test_held_out_data_that_an_effect_would_hardly_change_tell_nothing(
    shown: float, fitted: float, nothing: bool
) -> None:
    first = white() + shown * EFFECT
    assert tells_nothing(*fits(first, first - fitted * EFFECT)) is nothing


@pytest.mark.parametrize(("measured", "accepted"), [(True, True), (False, False)])
def test_only_what_follows_a_measurement_may_be_named_where_held_out_data_tell_nothing(
    measured: bool, accepted: bool
) -> None:
    first = white()
    before, after = fits(first, first - 0.02 * EFFECT)
    candidate = replace(candidate_of(bic=500.0, fit=after), is_measured=measured)
    assert (objection(candidate, before, Options(), base=before) == "") is accepted


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


@pytest.mark.parametrize(("size", "drift", "confirmed"), [(1.0, 0.75, True), (1.3, 0.95, True), (0.7, 0.45, False)])
def test_an_effect_of_another_size_is_not_confirmed_by_its_size(size: float, drift: float, confirmed: bool) -> None:
    """What copies another effect along the fitted motion has another size where the joints move otherwise."""
    rest = 0.5 * white()
    first = rest + size * 0.6 * EFFECT
    before, after = fits(first, first - 0.6 * EFFECT + drift * BASE, columns=BASE)
    ratio, amplitude = held_out_ratio(before, after), held_out_amplitude(before, after)
    assert ratio is not None and amplitude is not None
    assert amplitude.low > 0.5 and ratio.value < 1.0 < ratio.high
    assert (amplitude.high >= 1.0) is confirmed
    assert (held_out_objection(before, after) == "") is confirmed


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


def short(left: list[float], other: float) -> tuple[Fit, Fit]:
    """Fits of two joints, the second of which an effect explains: in each block of half a second of what was held out
    it leaves so much of 1 there, and on the first joint 3 in turn by ``other`` more and less."""
    sign = np.resize([1.0, -1.0], 5 * len(left))
    turns = np.repeat(np.resize([1 + other, 1 - other], len(left)), 5)
    first = np.column_stack([3 * sign, sign])
    second = np.column_stack([3 * sign * turns, sign * np.repeat(left, 5)])
    before, after = (
        table_fit(*squares, held_out={"other": table}) for squares, table in (((9, 4), first), ((9, 1), second))
    )
    vars(before)["held_out_jacobian"] = np.zeros((0, 2, 0))
    return before, after


@pytest.mark.parametrize(
    ("left", "other", "joint"),
    [
        ([0.8, 0.9, 0.7, 0.9, 0.8], 0.05, 2),
        ([0.8, 0.9, 0.7, 0.9, 1.1], 0.05, 0),  # larger in one block
        ([0.8, 0.9, 0.7, 0.9], 0.05, 0),  # four blocks show it by chance once in 16 times
        ([0.8] * (FEWEST_BLOCKS - 1), 0.05, 2),
        ([0.8] * FEWEST_BLOCKS, 0.05, 0),  # there its size is asked
    ],
)
def test_short_held_out_data_confirm_an_effect_in_each_block_of_its_joint(
    left: list[float], other: float, joint: int
) -> None:
    before, after = short(left, other)
    ratio = held_out_ratio(before, after)
    assert ratio is not None and ratio.value < 1 <= ratio.high
    assert confirming_joint(before, after) == joint
    if len(left) < FEWEST_BLOCKS:
        assert (unconfirmed(before, after) == "") is bool(joint)
        assert f"but that of joint {joint} is in each block of 0.5 s" in held_out_remark(before, after) or not joint


def test_what_makes_the_whole_worse_is_not_confirmed_by_one_joint() -> None:
    before, after = short([0.8, 0.9, 0.7, 0.9, 0.8], 0.4)
    ratio = held_out_ratio(before, after)
    assert ratio is not None and ratio.value > 1
    assert confirming_joint(before, after) == 2
    assert unconfirmed(before, after).startswith(f"held-out RMS ratio {ratio.value:.3f}")


def test_the_joint_that_confirms_is_the_one_of_the_fit() -> None:
    """Not the one that is the better of the two on what was held out."""
    before, after = short([0.8, 0.9, 0.7, 0.9, 0.8], 0.05)
    swapped = [table_fit(*squares, held_out={"other": one.model.held_out["other"]}) for squares, one in
               (((9, 4), before), ((2, 4), after))]  # fmt: skip
    assert confirming_joint(*swapped) == 0


def test_what_the_other_parameters_can_make_as_well_is_not_judged() -> None:
    """A limit that the held-out data do not reach moves the other parameters alone."""
    rest = white()
    before, after = fits(rest + 0.1 * BASE, rest, columns=BASE)
    assert held_out_amplitude(before, after) is None
    assert held_out_amplitude(*fits(rest, rest, columns=BASE)) is None


def test_a_model_that_cannot_be_run_has_no_size() -> None:
    assert held_out_amplitude(*fits(white(), None)) is None


def test_an_effect_of_half_its_size_is_hardly_ever_confirmed() -> None:
    """At one half both models are as good; one effect of forty is confirmed by chance."""
    confirmed = 0
    for seed in range(80):
        amplitude = held_out_amplitude(*fits(*spoiled(0.5, drift=0.3, seed=seed), columns=BASE))
        confirmed += amplitude is not None and amplitude.low > 0.5
    assert confirmed <= 8  # two are expected


def test_an_effect_that_is_absent_is_not_confirmed() -> None:
    confirmed = 0
    for seed in range(80):
        amplitude = held_out_amplitude(*fits(*spoiled(0.0, drift=0.3, seed=seed), columns=BASE))
        confirmed += amplitude is not None and amplitude.low > 0.5
    assert confirmed == 0


def test_the_user_is_told_what_confirmed_it() -> None:
    before, after = fits(*spoiled(drift=0.65), columns=BASE)
    ratio, amplitude = held_out_ratio(before, after), held_out_amplitude(before, after)
    remark = held_out_remark(before, after)
    assert f"RMS ratio {ratio.value:.3f}, {ratio.low:.3f} to {ratio.high:.3f}" in remark
    assert remark.endswith(f"held-out data show the effect at {amplitude}")
    assert held_out_remark(*fits(*spoiled(drift=0.0), columns=BASE)) == ""  # the whole prediction is better
    assert held_out_remark(*fits(white(), white())) == ""
    assert held_out_remark(table_fit(50.0), table_fit(10.0)) == ""  # no held-out data


@pytest.mark.parametrize(
    ("more", "drift", "chosen"),
    [
        (0.0, 0.65, "one"),  # held-out data show nothing of what the second parameter adds
        (0.6, 0.65, "two"),  # they do
        (0.0, 0.0, "two"),  # the whole prediction is better with the best: nothing else is asked
    ],
)
def test_of_a_class_the_one_that_held_out_data_ask_for_is_taken(more: float, drift: float, chosen: str) -> None:
    """The best by BIC has two parameters, the other one of its class one; ``more`` is what the second really adds."""
    second = 0.6 * np.sign(np.sin(2 * np.pi * 0.41 * TIME))
    first, after = spoiled(drift=drift)
    first, after = first + more / 0.6 * second, after + more / 0.6 * second
    before, simple = fits(first, after, columns=BASE)
    _, rich = fits(first, after - (second if more else 0.05 * second))
    vars(simple)["held_out_jacobian"] = BASE[:, None, None]
    ranking = [candidate_of("two", bic=400.0, cost=2.0, fit=rich), candidate_of("one", bic=300.0, fit=simple)]
    base = table_fit(101.0)
    found = decide(ranking, before, Options(), base=base, class_of=lambda at: "loss")
    assert isinstance(found, FittedCandidate) and found.effect_at.effect == chosen
    # Of another class it is another effect, and the best is the best.
    other = decide(ranking, before, Options(), base=base)
    assert isinstance(other, FittedCandidate) and other.effect_at.effect == "two"


def test_the_user_is_told_that_a_larger_one_explains_the_fitted_data_better() -> None:
    second = 0.6 * np.sign(np.sin(2 * np.pi * 0.41 * TIME))
    first, after = spoiled(drift=0.65)
    before, simple = fits(first, after, columns=BASE)
    vars(simple)["held_out_jacobian"] = BASE[:, None, None]
    _, rich = fits(first, after - 0.05 * second)
    effects = Catalogue(
        effect_of("two", class_name="loss", title="Two"), effect_of("one", class_name="loss", title="One")
    )
    ranking = [candidate_of("two", bic=400.0, cost=2.0, fit=rich), candidate_of("one", bic=300.0, fit=simple)]
    remark = _remark(ranking[1], ranking, Competition(effects, before), Options())
    assert remark.startswith("One on joint 1: as a whole the held-out error may not be smaller (RMS ratio ")
    assert remark.endswith(
        " Two explains the fitted data better, by a BIC difference of 100; held-out data do not confirm what it has "
        "more."
    )
    as_good = candidate_of("one", bic=395.0, fit=simple)
    assert "Two" not in _remark(as_good, [ranking[0], as_good], Competition(effects, before), Options())


HITS, AT_START = Lenience(hits=True), Lenience(at_start=True)


def missed(typical: float, *, burst: float, blocks: int = 2) -> tuple[Fit, Fit]:
    """An effect beside which the error of a typical block is so many times what it was, and in a few blocks, where its
    hits come at another moment, an error of this size comes to it; blocks of five samples."""
    first = 2.0 * white()
    second = typical * first
    for block in range(blocks):
        second[40 + 100 * block : 45 + 100 * block] += burst
    return fits(first, second)


@pytest.mark.parametrize(
    ("typical", "burst", "strictly", "leniently"),
    [
        (0.8, 0.0, True, True),
        (0.8, 6.0, False, True),  # the right model, one hit too early
        (0.9, 4.0, False, True),
        (1.0, 0.0, False, False),
        (1.03, 0.0, False, False),
        (0.8, 25.0, False, False),  # the whole prediction is worse: it may not be used
    ],
)
def test_hits_at_other_moments_do_not_hide_what_a_typical_block_confirms(
    typical: float, burst: float, strictly: bool, leniently: bool
) -> None:
    before, after = missed(typical, burst=burst)
    assert (unconfirmed(before, after) == "") is strictly
    assert (unconfirmed(before, after, lenience=AT_START) == "") is strictly
    assert (unconfirmed(before, after, lenience=HITS) == "") is leniently
    remark = held_out_remark(before, after, lenience=HITS)
    assert ("that of a typical block of 0.5 s is" in remark) is (leniently and not strictly)


def test_what_is_better_in_one_block_alone_is_no_typical_block() -> None:
    first = white()
    first[40:45] += 6.0
    second = first.copy()
    second[40:45] -= 6.0
    assert typical_ratio(*fits(first, second)).high >= 1.0
    assert unconfirmed(*fits(first, second), lenience=HITS) != ""


def test_a_few_blocks_are_no_typical_ones() -> None:
    short = 2.0 * white(count=5 * (FEWEST_BLOCKS - 1))
    assert typical_ratio(*fits(short, 0.5 * short)) is None
    assert typical_ratio(*fits(white(), None)) is None  # the loop cannot be run there


def begun(size: float, *, count: int = 3, noise: float = 1.0, seed: int = 0) -> tuple[Fit, Fit]:
    """An effect of 20 deviations in the first samples, there so many times as large as it was fitted."""
    shown = np.zeros(COUNT)
    shown[:count] = 20.0, -20.0, 20.0, *(20.0,) * (count - 3)
    first = noise * white(seed) + size * shown
    return fits(first, first - shown, columns=BASE)


@pytest.mark.parametrize(
    ("size", "strictly", "leniently"),
    [(1.0, False, True), (0.95, False, True), (0.8, False, False), (0.4, False, False), (-1.0, False, False)],
)
def test_a_start_confirms_what_a_few_samples_show(size: float, strictly: bool, leniently: bool) -> None:
    """Of blocks that are drawn at random a third holds none of these samples."""
    before, after = begun(size)
    assert (unconfirmed(before, after) == "") is strictly
    assert (unconfirmed(before, after, lenience=HITS) == "") is strictly
    assert (unconfirmed(before, after, lenience=AT_START) == "") is leniently
    remark = held_out_remark(before, after, lenience=AT_START)
    assert ("the few samples that show it, where the data begin" in remark) is leniently


def test_what_shows_in_many_blocks_is_judged_by_all_of_them() -> None:
    before, after = fits(*spoiled(drift=0.65), columns=BASE)
    assert amplitude_in_few_blocks(before, after) is None
    assert amplitude_in_few_blocks(*fits(white(), None)) is None


def test_its_interval_holds_the_size_and_is_that_of_the_samples_that_show_it() -> None:
    found = [amplitude_in_few_blocks(*begun(1.0, seed=seed)) for seed in range(200)]
    assert all(one is not None for one in found)
    held = np.mean([one.low < 1.0 < one.high for one in found if one is not None])
    assert 0.9 < held <= 1.0
    louder = [amplitude_in_few_blocks(*begun(1.0, noise=4.0, seed=seed)) for seed in range(200)]
    quiet, loud = (np.mean([one.high - one.low for one in those if one is not None]) for those in (found, louder))
    assert loud > 2.0 * quiet, "what neither model explains there counts"
