"""The test of all values at once: how often it is wrong, and how much it sees."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim import InputError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.change.contest import Contest, Form, World, smallest_sets
from fmu_didim.discovery.change.contest import contest as contest_in
from fmu_didim.discovery.change.difference import CHANGED, SEEN, Difference

NAMES = ("a", "b", "c", "d", "e")
DRAWS = 2000


def covariance() -> Array:
    table = np.random.default_rng(5).normal(size=(5, 5))
    return np.asarray(table @ table.T + 0.1 * np.eye(5))


def changed(change: Array, size: float = 1.0, freedom: float = np.inf) -> Difference:
    return Difference(NAMES, ("N.m",) * 5, np.ones(5), 1 + change, size * covariance(), freedom, 1000)


@pytest.mark.parametrize("freedom", [30.0, np.inf])
def test_false_alarms_and_power_are_as_stated(freedom: float) -> None:
    rng, alarms, seen = np.random.default_rng(1), 0, 0
    noise = rng.multivariate_normal(np.zeros(5), covariance(), size=DRAWS)
    sizes = rng.chisquare(freedom, DRAWS) / freedom if np.isfinite(freedom) else np.ones(DRAWS)
    least = changed(noise[0], freedom=freedom).least_seen
    for d, size in zip(noise, sizes, strict=True):
        alarms += changed(d, float(size), freedom).p_value < 0.05
        seen += changed(d + least * (np.arange(5) == 2), float(size), freedom).p_value < CHANGED
    spread = np.sqrt(0.05 * 0.95 / DRAWS)
    assert abs(alarms / DRAWS - 0.05) < 4 * spread
    assert abs(seen / DRAWS - SEEN) < 4 * spread


def test_known_from_few_samples_it_alarms_no_more_often() -> None:
    """By chi-square, without Fisher's ratio, it would: 18 samples of noise."""
    rng, alarms, careless = np.random.default_rng(2), 0, 0
    for d, size in zip(
        rng.multivariate_normal(np.zeros(5), covariance(), size=DRAWS), rng.chisquare(18, DRAWS) / 18, strict=True
    ):
        alarms += changed(d, float(size), 18).p_value < 0.01
        careless += changed(d, float(size)).p_value < 0.01
    assert alarms < 0.01 * DRAWS + 4 * np.sqrt(0.01 * DRAWS)
    assert careless > 2 * alarms


def test_joint_intervals_hold_all_changes_at_once() -> None:
    draws = np.random.default_rng(3).multivariate_normal(np.zeros(5), covariance(), size=DRAWS)
    outside = sum(bool((np.abs(d) > (one := changed(d)).bounds * one.deviation).any()) for d in draws)
    assert outside / DRAWS < 0.05 + 4 * np.sqrt(0.05 * 0.95 / DRAWS)


def test_one_that_moved_is_named_beside_correlated_ones() -> None:
    rng, alone, smallest = np.random.default_rng(4), 0, 0
    move = 8 * changed(np.zeros(5)).deviation[3]
    for _ in range(100):
        d = rng.multivariate_normal(np.zeros(5), covariance())
        d[3] += move
        found = changed(d)
        assert found.moved[3]
        alone += found.moved.sum() == 1
        smallest += smallest_sets(found)[0][0] == ("d",)
    assert alone >= 88  # 95 of 100, and their spread
    assert smallest == 100


def test_nothing_moves_where_all_together_have_not() -> None:
    size = changed(np.zeros(5)).least_seen[0] * (np.arange(5) == 0)
    sizes = [found for part in np.linspace(0, 1, 50) if (found := changed(part * size)).p_value > CHANGED]
    assert not any(found.moved.any() for found in sizes)
    assert min(found.holm.min() for found in sizes) < 0.05  # which one by itself would have been called moved


def test_a_covariance_of_no_rank_is_refused() -> None:
    table = np.ones((2, 2))
    with pytest.raises(InputError, match="do not tell how far"):
        _ = Difference(("a", "b"), ("1", "1"), np.zeros(2), np.ones(2), table, np.inf, 10).total


def form(name: str, *columns: int) -> Form:
    table = np.eye(5)[:, list(columns)]
    return Form(name, 0, name, tuple(NAMES[k] for k in columns), ("N.m",) * len(columns), lambda x: table)


def contest(difference: Difference, forms: tuple[Form, ...]) -> Contest:
    return contest_in([World(difference)], lambda world: forms)


FORMS = (form("first", 0), form("second", 1, 2), form("third", 3), form("fourth", 4))


def test_the_contest_names_the_right_cause_and_refuses_what_none_explains() -> None:
    deviation = changed(np.zeros(5)).deviation
    noise = np.random.default_rng(6).multivariate_normal(np.zeros(5), covariance())
    both = contest(changed(noise + 30 * deviation * np.isin(np.arange(5), (1, 2))), FORMS)
    assert [e.forms[0].kind for e in both.named] == ["second"]
    two = contest(changed(noise + 30 * deviation * np.isin(np.arange(5), (0, 3))), FORMS)
    assert [sorted(form.kind for form in e.forms) for e in two.named] == [["first", "third"]]
    without = contest(changed(noise + 30 * deviation * np.isin(np.arange(5), (0, 3, 4))), FORMS[:3])
    assert without.named == ()
    assert without.others


def test_a_cause_that_contains_a_better_one_is_no_rival_of_it() -> None:
    noise = np.random.default_rng(6).multivariate_normal(np.zeros(5), covariance())
    deviation = changed(np.zeros(5)).deviation
    wide = (*FORMS, form("first and more", 0, 4))
    for size in (15, 300):
        change = noise + size * deviation * (np.arange(5) == 0)
        assert [e.forms[0].kind for e in contest(changed(change), wide).named] == ["first"]
    more = contest(changed(noise + 30 * deviation * np.isin(np.arange(5), (0, 4))), wide)
    assert [e.forms[0].kind for e in more.named] == ["first and more"]


def test_a_second_change_that_is_small_beside_the_first_is_told() -> None:
    noise = np.random.default_rng(6).multivariate_normal(np.zeros(5), covariance())
    least = changed(np.zeros(5)).least_seen
    one = contest(changed(noise + 200 * least * (np.arange(5) == 0)), FORMS)
    assert [e.forms[0].kind for e in one.named] == ["first"]
    assert not one.named[0].leaves_more_than_noise
    assert one.further is None
    two = contest(changed(noise + least * [200, 0, 0, 4, 0]), FORMS)
    assert [e.forms[0].kind for e in two.named] == ["first"]
    assert two.named[0].leaves_more_than_noise
    assert two.further is not None
    assert {f.kind for f in two.further.forms} == {"first", "third"}


def test_causes_that_move_the_values_alike_are_told_as_a_set() -> None:
    rival = Form("rival", 0, "rival", ("x",), ("1",), lambda x: np.array([[1.0], [0.02], [0], [0], [0]]))
    deviation = changed(np.zeros(5)).deviation
    found = contest(changed(15 * deviation * (np.arange(5) == 0)), (*FORMS, rival))
    assert {e.forms[0].kind for e in found.named} == {"first", "rival"}
