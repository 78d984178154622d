"""The decision, on candidates made by hand: what is accepted, refused, ambiguous."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmu_didim.discovery.selection import decide as decide_module
from fmu_didim.discovery.selection import rounds
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import (
    Options,
    _simplest,
    decide,
    nearness,
    objection,
    step_of,
    too_small,
)
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.fit.ending import Ending
from fmu_didim.fit.gap import Ratio, gaps, held_out_ratio
from fmu_didim.model.free_parameter import LOG, PLANT, FreeParameter
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.by_hand import (
    SAMPLES,
    SIGNS,
    Catalogue,
    TableModel,
    candidate_of,
    effect_of,
    fit_of,
    residual,
    table_fit,
)

BEFORE, BASE = table_fit(50.0), table_fit(101.0)


def refused(candidate: FittedCandidate, **options: Any) -> str:
    return objection(candidate, BEFORE, Options(**options), base=BASE)


def verdict(*ranking: FittedCandidate, held: Any = lambda candidate: (), **options: Any) -> Any:
    return decide(
        ranking, BEFORE, Options(**options), base=BASE, held=held
    )  # fmt: skip


@pytest.mark.parametrize(
    ("larger", "at_harmonic", "taken"),
    [
        ({"change": 0.5}, {"change": 0.4, "is_known": True}, True),
        ({"change": 0.5}, None, False),  # no motor is stated, or the best frequency is one of its own
        ({"change": 0.5}, {"change": 0.1, "is_known": True}, False),
        ({"change": 0.5}, {"change": 0.4, "is_known": True, "bic": 9.0}, False),
        ({"bic": 9.0}, {"change": 0.4, "is_known": True}, False),  # too small for a name by its evidence, not its size
        ({"implausible": "Fc1 is negative"}, {"change": 0.4, "is_known": True}, False),
    ],
)
def test_a_ripple_of_the_motor_beside_a_larger_one_that_is_too_small_for_a_name(
    larger: dict[str, Any], at_harmonic: dict[str, Any] | None, taken: bool
) -> None:
    known = None if at_harmonic is None else candidate_of(**at_harmonic)
    found = decide(
        [candidate_of(**larger)], BEFORE, Options(), base=BASE, at_harmonic=lambda candidate: known
    )  # fmt: skip
    assert (found is known) if taken else isinstance(found, tuple)


@pytest.mark.parametrize(
    ("harmonic", "other", "may_be", "named"),
    [
        ({"change": 0.4}, {"bic": 71.0, "change": 0.5}, True, False),  # it follows a ripple beside it
        ({"change": 0.4}, {"bic": 71.0, "change": 0.5}, False, True),  # of another joint, or far away
        ({"change": 0.4}, {"bic": 48.0, "change": 0.5}, True, True),
        ({"change": 0.7}, {"bic": 71.0, "change": 0.5}, True, True),  # large enough whatever its frequency is
    ],
)
def test_a_small_harmonic_is_not_named_for_a_better_ripple_beside_it(
    harmonic: dict[str, Any], other: dict[str, Any], may_be: bool, named: bool
) -> None:
    known, beside = candidate_of("known", bic=49.0, is_known=True, **harmonic), candidate_of("beside", **other)
    ranking = sorted([known, beside], key=lambda c: -c.delta_bic)
    found = decide(ranking, BEFORE, Options(), base=BASE, may_be=lambda candidate, one: may_be)
    assert (found is known) if named else (isinstance(found, tuple) and found[1][1] == decide_module.BESIDE_HARMONIC)


def held_out(first: np.ndarray, second: np.ndarray | None, **more: Any) -> tuple[Any, FittedCandidate]:
    """The fit before with a residual on held-out data, and a candidate with another one."""
    before = table_fit(50.0, held_out={"other": first}, **more)
    return before, candidate_of(fit=table_fit(10.0, held_out={"other": second}))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"bic": 10.0}, ""),
        ({"bic": 9.99}, "BIC difference 10.0 below 10"),
        ({"bic": -3.0}, "BIC difference -3.0 below 10"),
        ({"change": 0.6}, ""),
        ({"change": 0.59}, "changes the torque by 0.59 of the noise, less than 0.6"),
        ({"change": 0.59, "is_known": True}, ""),  # it repeats as the motor does
        ({"change": 0.2, "is_known": True}, ""),
        ({"change": 0.19, "is_known": True}, "changes the torque by 0.19 of the noise, less than 0.2"),
        ({"bic": 9.99, "is_known": True}, "BIC difference 10.0 below 10"),
        ({"size": 0.2}, ""),
        ({"size": 0.19}, "explains 0.19 of the noise, less than 0.2"),
        ({"share": 0.05}, ""),
        ({"share": 0.0499}, "explains 5 % of the gap, less than 5 %"),
        ({"fit": table_fit(46.99)}, ""),
        ({"fit": table_fit(47.01)}, "explains 3.0 % of the gap of the base model on its joint, less than 3 %"),
        ({"fit": table_fit(47.01), "bends_gear": True}, ""),  # the stiffness of the gear hangs on it
        ({"implausible": "Fc1 is negative"}, "Fc1 is negative"),
    ],
)
def test_each_objection(change: dict[str, Any], reason: str) -> None:
    assert refused(candidate_of(**change)) == reason


@pytest.mark.parametrize(
    ("owner", "is_virtual", "told"), [(LOG, True, True), (LOG, False, False), (PLANT, True, False)]
)
def test_a_clock_too_small_to_be_named_is_told_as_one_of_a_set(owner: str, is_virtual: bool, told: bool) -> None:
    """Beside a virtual controller nothing tells it from a lag."""
    shift = FreeParameter("log_shift", "s", owner, "log_shift", 0.002, 1.0, effect=0)
    model = TableModel(residual(10.0), {}, (EffectAtJoint("log_time_shift", 1),), (shift,), is_virtual=is_virtual)
    slopes = np.full((SAMPLES, 1, 1), 250.0)  # of a sample: 0.2 ms
    small = candidate_of("log_time_shift", change=0.52, fit=fit_of(model, values=[0.002], jacobian=slopes))
    text = "; one set with a lag, a delay and how long a torque is held: 2.00 ± 0.2"
    assert refused(small).startswith(f"changes the torque by 0.52 of the noise, less than 0.6{text if told else ''}")
    assert (text in refused(small)) == told


@pytest.mark.parametrize(
    ("option", "change"),
    [
        ("threshold", {"bic": 150.0}),
        ("smallest_size", {"change": 150.0}),
        ("smallest_gain", {"size": 150.0}),
        ("smallest_share", {"share": 150.0}),
    ],
)
def test_the_options_move_the_thresholds(option: str, change: dict[str, Any]) -> None:
    candidate = candidate_of(**{"bic": 1e3, **change})
    assert refused(candidate, **{option: 149.0}) == ""
    assert refused(candidate, **{option: 151.0}) != ""


def test_the_smallest_part_is_an_option_too() -> None:
    assert refused(candidate_of(), smallest_part=0.39) == ""
    assert refused(candidate_of(), smallest_part=0.41).startswith("explains 40.0 % of the gap of the base model")


def test_a_part_as_large_as_the_smallest_is_enough() -> None:
    three, one = fit_of(TableModel(3.0 * SIGNS[:, None])), candidate_of(fit=fit_of(TableModel(SIGNS[:, None])))
    assert objection(one, three, Options(smallest_part=1.0), base=three) == ""


@pytest.mark.parametrize(
    ("second", "reason"),
    [
        (0.999, ""),
        (1.0, "held-out RMS ratio 1.000, its interval reaches 1.000"),
        (1.25, "held-out RMS ratio 1.250, its interval reaches 1.250"),
    ],
)
def test_held_out_data_must_be_explained_better(second: float, reason: str) -> None:
    before, candidate = held_out(residual(16.0), second * residual(16.0))
    assert objection(candidate, before, Options(), base=BASE) == reason


def test_a_mean_below_one_is_not_enough_where_the_interval_reaches_it() -> None:
    second = residual(16.0) * np.where(np.arange(SIGNS.size) < 200, 0.2, 1.3)[:, None]
    before, candidate = held_out(residual(16.0), second)
    ratio = held_out_ratio(before, candidate.fit)
    assert ratio is not None
    assert ratio.value == pytest.approx(np.sqrt((0.04 + 1.69) / 2), rel=1e-12)
    assert ratio.low < ratio.value < 1.0 < ratio.high
    assert objection(candidate, before, Options(), base=BASE).startswith(
        f"held-out RMS ratio 0.930, its interval reaches {ratio.high:.3f}; there it has 0.68 ("
    )


def test_blocks_of_half_a_second_are_drawn() -> None:
    # Every second block of five samples (0.5 s at 10 Hz) is worse: drawn whole, their number varies.
    worse = np.where(np.arange(SIGNS.size) // 5 % 2 == 0, 0.5, 1.0)[:, None]
    before, candidate = held_out(residual(1.0), residual(1.0) * worse)
    ratio = held_out_ratio(before, candidate.fit)
    again = held_out_ratio(before, candidate.fit, seed=1)
    assert ratio is not None and again is not None
    deviation = 0.75 / 2 / np.sqrt(80) / (2 * 0.625**0.5)  # of the mean square over 80 blocks, then of its root
    assert ratio.high - ratio.low == pytest.approx(2 * 1.96 * deviation, rel=0.06)
    assert ratio.value == again.value == pytest.approx(np.sqrt(0.625))
    assert (ratio.low, ratio.high) != (again.low, again.high)


@pytest.mark.parametrize(("rate", "blocks"), [(10.0, 80), (1.0, 400)])
def test_a_block_holds_one_sample_at_least(rate: float, blocks: int, monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[tuple[int, ...]] = []
    real = np.random.default_rng

    class Spy:
        def integers(self, low: int, high: int, size: tuple[int, int]) -> Any:
            sizes.append((high, *size))
            return real(0).integers(low, high, size=size)

    monkeypatch.setattr(np.random, "default_rng", lambda seed: Spy())
    before, candidate = held_out(residual(1.0), residual(0.5), rate_hz=rate)
    held_out_ratio(before, candidate.fit)
    assert sizes == [(blocks, 2000, blocks)]


def test_without_held_out_data_there_is_no_ratio() -> None:
    assert held_out_ratio(BEFORE, candidate_of().fit) is None


def test_a_model_that_cannot_be_run_on_held_out_data_is_worse_than_any() -> None:
    before, candidate = held_out(residual(16.0), None)
    ratio = held_out_ratio(before, candidate.fit)
    assert (ratio.value, ratio.low, ratio.high) == (np.inf, np.inf, np.inf)
    assert objection(candidate, before, Options(), base=BASE).startswith("held-out RMS ratio inf")


def test_all_held_out_experiments_count() -> None:
    before = table_fit(50.0, held_out={"a": residual(9.0), "b": residual(1.0)})
    after = table_fit(10.0, held_out={"a": residual(1.0), "b": residual(1.0)})
    assert held_out_ratio(before, after).value == pytest.approx(np.sqrt(2 / 10))


@pytest.mark.parametrize(
    ("gain", "wanted"), [(10.0, 10.0), (499.0, 10.0), (501.0, 10.02), (1000.0, 20.0), (-2000.0, 10.0)]
)
def test_nearness_is_ten_or_two_percent_of_a_large_gain(gain: float, wanted: float) -> None:
    assert nearness(gain, Options()) == pytest.approx(wanted, rel=1e-12)
    assert nearness(gain, Options(threshold=30.0)) == 30.0


def test_the_simplest_has_the_fewest_parameters_and_then_the_best_fit() -> None:
    one = [
        candidate_of("a", bic=100.0, cost=2.0), candidate_of("b", bic=95.0, cost=1.0),
        candidate_of("c", bic=97.0, cost=1.0),
    ]  # fmt: skip
    assert _simplest(one, Options()).effect_at.effect == "c"
    assert _simplest(one, Options(prefer=("x", "a", "b"))).effect_at.effect == "a"
    assert _simplest(one, Options(prefer=("b",))).effect_at.effect == "b"
    assert _simplest(one, Options(prefer=("x",))).effect_at.effect == "c"


@pytest.mark.parametrize(
    ("ratio", "cost", "unusual", "chosen"),
    [
        ((0.4, 0.3, 0.99), 1.0, "", "b"),
        ((0.4, 0.3, 1.0), 1.0, "", "a"),  # perhaps
        ((2.5, 1.2, 3.5), 1.0, "", "a"),
        (None, 1.0, "", "a"),  # no held-out data
        ((0.4, 0.3, 0.99), 2.0, "", "a"),  # with more values
        ((0.4, 0.3, 0.99), 1.0, "k = 9, usual is 0 to 1", "a"),
    ],
)
def test_of_those_as_simple_held_out_data_decide(
    monkeypatch: pytest.MonkeyPatch, ratio: Any, cost: float, unusual: str, chosen: str
) -> None:
    """A dead zone that one motion never leaves is a constant, which led by less: another motion tells them apart."""
    first, second = candidate_of("a", bic=296.1), candidate_of("b", bic=296.0, cost=cost, unusual=unusual)
    ratios = {(id(first.fit), id(second.fit)): ratio}

    def between(before: Any, after: Any, *, seed: int) -> Ratio | None:
        found = ratios[id(before), id(after)]
        return None if found is None else Ratio(*found)

    monkeypatch.setattr(decide_module, "held_out_ratio", between)
    assert _simplest([first, second], Options()).effect_at.effect == chosen
    assert _simplest([first, second], Options(prefer=("b",))).effect_at.effect == "b"


def test_of_those_as_good_one_with_usual_values_is_taken() -> None:
    """A drag that falls with the speed stood for a power of the velocity, which has one parameter more."""
    power, drag = candidate_of("a", cost=2.0), candidate_of("b", bic=95.0, cost=1.0, unusual="Fq = -0.5 ± 0.03")
    assert verdict(power, drag).effect_at.effect == "a"
    assert verdict(replace(power, unusual="Fp = -2 ± 0.1"), drag).effect_at.effect == "b"
    assert verdict(drag, power).effect_at.effect == "a"
    assert verdict(drag).effect_at.effect == "b"  # named, and doubted


def test_the_best_is_accepted() -> None:
    assert verdict(candidate_of("a", bic=100.0), candidate_of("b", bic=50.0)).effect_at == EffectAtJoint("a", 1)


@pytest.mark.parametrize(
    ("best", "other", "chosen"),
    [(100.0, 90.01, "b"), (100.0, 90.0, "a"), (1000.0, 980.1, "b"), (1000.0, 980.0, "a")],
)
def test_of_those_as_good_the_simpler_one_is_taken(best: float, other: float, chosen: str) -> None:
    first, second = candidate_of("a", bic=best, cost=2.0), candidate_of("b", bic=other, cost=1.0)
    assert verdict(first, second).effect_at.effect == chosen


def test_a_simpler_one_with_an_objection_is_not_taken() -> None:
    first, second = candidate_of("a", bic=100.0, cost=2.0), candidate_of("b", bic=99.0, cost=1.0, share=0.01)
    assert verdict(first, second).effect_at.effect == "a"


def test_a_refused_one_gives_way_to_the_next() -> None:
    first, second = candidate_of("a", bic=200.0, change=0.1), candidate_of("b", bic=100.0)
    assert verdict(first, second).effect_at.effect == "b"


def test_all_reasons_are_kept_in_order() -> None:
    found = verdict(candidate_of("a", bic=20.0, size=0.1), candidate_of("b", 2, bic=5.0))
    assert found == (
        (EffectAtJoint("a", 1), "explains 0.10 of the noise, less than 0.2"),
        (EffectAtJoint("b", 2), "BIC difference 5.0 below 10"),
    )


def test_none_is_accepted_of_none() -> None:
    assert verdict() == ()


def test_shapes_are_held_where_only_the_held_out_data_object() -> None:
    before, failing = held_out(residual(16.0), 1.1 * residual(16.0))
    asked: list[FittedCandidate] = []
    worse = replace(failing, delta_bic=99.0)
    better = candidate_of(bic=80.0, fit=table_fit(12.0, held_out={"other": 0.5 * residual(16.0)}))
    last = replace(better, delta_bic=70.0)

    def held(candidate: FittedCandidate) -> Iterator[FittedCandidate]:
        asked.append(candidate)
        yield from (worse, better, last)

    small = candidate_of("b", 2, bic=90.0, share=0.01)
    found = decide([small, failing], before, Options(), base=BASE, held=held)
    assert found is better
    assert asked == [failing]
    refusal = decide([small, failing], before, Options(), base=BASE)
    assert [a.effect for a, _ in refusal] == ["b", "coulomb"]


@pytest.mark.parametrize(
    ("why", "asks"),
    [
        ("may be absent: Fp = -2.1 ± 3.4 (p = 0.52)", True),
        ("its form is not told: Fgc = 35 ± 5e+05", False),
        ("physically impossible: Fs = -1 ± 0.1 below 0", False),
    ],
)
def test_shapes_are_held_where_free_ones_leave_the_amplitude_untold(why: str, asks: bool) -> None:
    """On a measured TX40 a friction by a power of the velocity gained 151 in BIC, with an amplitude of -2.1 ± 3.4."""
    untold, told = candidate_of(implausible=why), candidate_of(bic=80.0)
    asked: list[FittedCandidate] = []

    def held(candidate: FittedCandidate) -> Iterator[FittedCandidate]:
        asked.append(candidate)
        yield from (untold, told)

    found = verdict(untold, held=held)
    assert found is told if asks else found == ((untold.effect_at, why),)
    assert asked == ([untold] if asks else [])


def given_up(candidate: FittedCandidate) -> FittedCandidate:
    return replace(candidate, fit=replace(candidate.fit, ending=Ending.HOPELESS))


@pytest.mark.parametrize(
    ("unfinished", "to_the_end", "accepted", "asked"),
    [
        (candidate_of(bic=50.0), candidate_of(bic=60.0), True, 1),
        (candidate_of(bic=50.0), candidate_of(bic=60.0, share=0.01), False, 1),  # what made it good was chance
        (candidate_of(bic=5.0), candidate_of(bic=60.0), False, 0),
    ],
)
def test_a_fit_that_was_given_up_is_judged_at_its_minimum(
    unfinished: FittedCandidate, to_the_end: FittedCandidate, accepted: bool, asked: int
) -> None:
    calls: list[FittedCandidate] = []

    def finish(candidate: FittedCandidate) -> FittedCandidate:
        calls.append(candidate)
        return to_the_end

    small = candidate_of("b", 2, bic=90.0, share=0.01)
    found = decide(
        [small, given_up(unfinished)], BEFORE, Options(), base=BASE, finished=finish
    )  # fmt: skip
    assert (found is to_the_end) is accepted
    assert accepted or isinstance(found, tuple)
    assert len(calls) == asked


def test_what_is_as_good_as_the_winner_is_finished_too() -> None:
    """The one with fewer parameters would be taken, were it not for what it comes to."""
    winner = candidate_of("a", bic=100.0, cost=2.0)
    near = given_up(candidate_of("b", bic=98.0, cost=1.0))
    for end, name in ((candidate_of("b", bic=98.0, size=0.1), "a"), (candidate_of("b", bic=98.0, cost=1.0), "b")):
        found = decide([winner, near], BEFORE, Options(), base=BASE, finished=lambda c, end=end: end)
        assert isinstance(found, FittedCandidate) and found.effect_at.effect == name


def test_gaps_of_all_experiments() -> None:
    fit = fit_of(TableModel(residual(5.0, 1.0), {"other": residual(17.0, 0.5), "broken": None}))
    found = gaps(fit)
    assert {label: values.tolist() for label, values in found.items()} == {
        "fitted": [pytest.approx(2.0), pytest.approx(0.0, abs=1e-7)], "other": [4.0, 0.0], "broken": [np.inf, np.inf],
    }  # fmt: skip


CATALOGUE = Catalogue(
    effect_of("coulomb", class_name="friction"),
    effect_of("viscous", class_name="friction"),
    effect_of("offset"),
    effect_of("delay", class_name="lag"),
    effect_of("log shift", class_name="lag", place="measurement"),
    effect_of("gain", place="drive"),
    effect_of("gains", class_name="gain", place="controller"),
)


def step(accepted: FittedCandidate, ranking: list[FittedCandidate], before: Any = BEFORE) -> Any:
    return step_of(accepted, ranking, Competition(CATALOGUE, before), Options())


def test_a_step_names_what_the_data_cannot_tell_from_it() -> None:
    best, accepted = candidate_of("offset", bic=100.0), candidate_of("coulomb", bic=95.0, share=0.7, size=2.0)
    near, far = candidate_of("delay", 2, bic=85.1), candidate_of("delay", 3, bic=84.9)
    found = step(accepted, [best, accepted, near, far])
    assert (found.effect_at, found.delta_bic, found.size, found.share) == (EffectAtJoint("coulomb", 1), 95.0, 2.0, 0.7)
    assert found.ambiguous[:2] == ((EffectAtJoint("offset", 1), 0.0), (EffectAtJoint("delay", 2), pytest.approx(14.9)))
    assert [a for a, _ in found.ambiguous[2:]] == [EffectAtJoint("viscous", 1)]
    assert np.isnan(found.ambiguous[2][1])
    assert [(p.effect_at.effect, p.effect_at.joint) for p in found.members] == [
        ("coulomb", 1), ("offset", 1), ("delay", 2)
    ]  # fmt: skip
    assert found.members[0].values == {"coulomb": 2.5}
    assert found.ratio is None and found.remark == ""


@pytest.mark.parametrize("is_held", [True, False])
def test_a_step_tells_which_shape_was_held(is_held: bool) -> None:
    at = EffectAtJoint("power", 3)
    amplitude = FreeParameter("Fp3", "N.m", PLANT, "Fp3", 2.5, 1.0, effect=0)
    shape = FreeParameter("alpha3", "1", PLANT, "alpha3", 0.6, 1.0, 0.2, 2.5, effect=0, is_shape=True)
    free = (amplitude, shape.held() if is_held else shape)
    fit = fit_of(TableModel(residual(10.0), {}, (at,), free), values=[2.5, 0.6])
    catalogue = Catalogue(effect_of("power", title="Friction by a power of the velocity"))
    accepted = candidate_of("power", 3, fit=fit)
    found = step_of(accepted, [accepted], Competition(catalogue, BEFORE), Options())
    told = "Friction by a power of the velocity on joint 3: alpha3 = 0.6 was held as it was screened, because"
    assert found.remark.startswith(told) if is_held else found.remark == ""


def test_nearness_of_a_step_is_that_of_the_best() -> None:
    best, accepted, other = (candidate_of(n, bic=b) for n, b in (("a", 1000.0), ("coulomb", 985.0), ("offset", 966.0)))
    assert [a.effect for a, _ in step(accepted, [best, accepted, other]).ambiguous][:2] == ["a", "offset"]


def test_nearness_does_not_grow_with_others_of_a_ranking() -> None:
    """Two per cent of the best gain: 40 here, and 10 of a small one; the others of the ranking are far below."""
    accepted = candidate_of("coulomb", bic=2000.0)
    near, far = candidate_of("delay", 2, bic=1965.0), candidate_of("delay", 3, bic=1955.0)
    assert [c.joint for c, _ in step(accepted, [accepted, near, far]).ambiguous if c.effect == "delay"] == [2]


def test_exactly_at_the_nearness_is_no_longer_ambiguous() -> None:
    accepted, at_edge = candidate_of("delay", bic=100.0), candidate_of("delay", 2, bic=90.0)
    assert step(accepted, [accepted, at_edge]).ambiguous == ()


def test_a_member_that_was_fitted_is_named_once() -> None:
    accepted, other = candidate_of("coulomb", bic=100.0), candidate_of("viscous", bic=99.0)
    assert step(accepted, [accepted, other]).ambiguous == ((EffectAtJoint("viscous", 1), 1.0),)


@pytest.mark.parametrize("name", ["delay", "log shift"])
def test_a_shift_of_the_log_and_a_lag_stand_for_each_other_by_their_fits_alone(name: str) -> None:
    assert step(candidate_of(name), [candidate_of(name)]).ambiguous == ()


def test_gaps_and_ratio_of_a_step() -> None:
    before = table_fit(50.0, held_out={"other": residual(26.0)})
    accepted = candidate_of("offset")
    model = replace(accepted.fit.model, own=residual(10.0), held_out={"other": residual(6.5)})
    accepted = replace(accepted, fit=fit_of(model, values=[2.5]))
    found = step(accepted, [accepted], before)
    assert {k: v.tolist() for k, v in found.before.items()} == {"fitted": [pytest.approx(7.0)], "other": [5.0]}
    assert {k: v.tolist() for k, v in found.after.items()} == {
        "fitted": [pytest.approx(3.0)],
        "other": [pytest.approx(5.5**0.5)],
    }
    assert found.ratio.value == pytest.approx(0.5)


def test_options_as_they_are_written_down() -> None:
    assert Options().record()["rounds"] == 5
    found = Options(forbid=frozenset({"b", "a"}), prefer=("c",), rounds=2).record()
    assert found == {
        "forbid": ["a", "b"], "prefer": ["c"], "rounds": 2, "threshold": 10.0, "smallest_size": 0.6,
        "smallest_gain": 0.2, "smallest_share": 0.05, "smallest_part": 0.03, "seed": 0,
    }  # fmt: skip


@pytest.mark.parametrize(("one", "other"), [("gain", "gains"), ("gains", "gain")])
@pytest.mark.parametrize(("behind", "told"), [(9.9, True), (10.1, False), (None, False)])
def test_one_factor_and_one_of_each_gain_are_a_set_by_their_fits_alone(
    one: str, other: str, behind: float | None, told: bool
) -> None:
    """One is the other with all factors alike, so that the data tell; not as forms of one friction, of which any is
    named beside the others."""
    accepted = candidate_of(one, bic=100.0)
    rivals = [] if behind is None else [candidate_of(other, bic=100.0 - behind)]
    found = step(accepted, [accepted, *rivals])
    assert [a.effect for a, _ in found.ambiguous] == ([other] if told else [])


@pytest.mark.parametrize(
    ("rival", "joint", "bic", "objected", "prefer", "wanted"),
    [
        ("lag", 1, 85.0, False, (), "lag"),  # the case states the gains, and nearly as much is explained without
        ("lag", 1, 79.0, False, (), "gains"),
        ("lag", 2, 85.0, False, (), "gains"),
        ("lag", 1, 85.0, True, (), "gains"),
        ("drag", 1, 85.0, False, (), "gains"),  # which is not confounded with them
        ("lag", 1, 85.0, False, ("gains",), "gains"),
    ],
)
def test_what_the_case_states_is_changed_last(
    monkeypatch: pytest.MonkeyPatch, rival: str, joint: int, bic: float, objected: bool, prefer: tuple[str, ...],
    wanted: str,
) -> None:  # fmt: skip
    best, other = candidate_of("gains", bic=100.0, cost=2.0), candidate_of(rival, joint, bic=bic)
    said = {id(other): "no" if objected else ""}
    monkeypatch.setattr(decide_module, "objection", lambda candidate, *_, **__: said.get(id(candidate), ""))
    monkeypatch.setattr(decide_module, "is_confirmed_by_size_alone", lambda *_, **__: False)
    found = decide(
        [best, other], BEFORE, Options(prefer=prefer), base=BEFORE,
        rivals_of=lambda candidate: frozenset({"lag"} if candidate.effect_at.effect == "gains" else ()),
    )  # fmt: skip
    assert isinstance(found, FittedCandidate) and found.effect_at.effect == wanted


@pytest.mark.parametrize(
    ("unusual", "rival", "bic", "rival_unusual", "wanted"),
    [
        ("falls with the speed", "stribeck", 85.0, "", "stribeck"),
        ("falls with the speed", "stribeck", 79.0, "", "drag"),  # the drag explains far more
        ("falls with the speed", "stribeck", 85.0, "vs = 9", "drag"),  # which is as odd
        ("", "stribeck", 85.0, "", "drag"),
        ("falls with the speed", "ripple", 85.0, "", "drag"),  # which is not confounded with it
    ],
)
def test_values_of_hardly_any_machine_give_way_to_what_explains_nearly_as_much(
    monkeypatch: pytest.MonkeyPatch, unusual: str, rival: str, bic: float, rival_unusual: str, wanted: str
) -> None:
    """By the rule of the rounds."""
    best, other = candidate_of("drag", unusual=unusual), candidate_of(rival, bic=bic, unusual=rival_unusual)
    monkeypatch.setattr(decide_module, "objection", lambda *_, **__: "")
    monkeypatch.setattr(decide_module, "is_confirmed_by_size_alone", lambda *_, **__: False)
    effects = Catalogue(effect_of("drag", confounded_with=("stribeck",)), effect_of("stribeck"), effect_of("ripple"))
    competition: Any = SimpleNamespace(builder=effects, fit=BEFORE, finished=None)
    found = rounds._judge(competition, BEFORE, Options())([best, other])
    assert isinstance(found, FittedCandidate) and found.effect_at.effect == wanted


@pytest.mark.parametrize(
    ("given", "is_kept"),
    [
        ({"change": 0.5}, True),
        ({"change": 0.5, "share": 0.01}, True),  # a small one explains a small share
        ({"change": 0.1}, False),
        ({"change": 0.5, "size": 0.1}, False),
        ({"change": 0.5, "implausible": "negative"}, False),
        ({"change": 0.7, "implausible": "negative"}, False),  # refused for something else
        ({"change": 0.5, "bic": 5.0}, False),
    ],
)
def test_what_is_too_small_for_a_name_alone_is_kept(given: dict[str, Any], is_kept: bool) -> None:
    candidate, other = candidate_of("ripple", **given), candidate_of("lag", change=0.3, bic=50.0, implausible="odd")
    reasons = verdict(candidate, other)
    assert {a.effect for a, _ in reasons} == {"ripple", "lag"}
    found = too_small((candidate, other), reasons, BEFORE, Options(), base=BASE)
    assert [c.effect_at.effect for c in found] == ["ripple"] * is_kept


@pytest.mark.parametrize("rival", ["spring", "torque_offset", "contact_stop"])
def test_the_cube_of_a_spring_without_the_spring_gives_way(rival: str) -> None:
    """As a constant that nothing but the cube hides: along a motion far from zero one follows the other."""
    competition: Any = SimpleNamespace(builder=Catalogue(*EFFECTS.values()), fit=BEFORE, finished=None)
    assert rival in rounds._rivals(competition, candidate_of("cubic_spring", unusual="acts without a spring"))
