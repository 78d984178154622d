"""Which cause explains a change where an effect may have come, gone or grown: worlds of made-up values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmu_didim.data.signals import Array
from fmu_didim.discovery.change import document
from fmu_didim.discovery.change.contest import Contest, Form, Lack, World, contest
from fmu_didim.discovery.change.difference import Difference
from fmu_didim.results.comparison import ResidualChange

NAMES = ("a", "b", "c", "d")
NONE = np.zeros((4, 0))
NEW = Form("play", 1, "play, new", ("gap",), ("rad",), lambda x: NONE)
PLAY = (Lack("play", 1, "play on joint 1", ()),)
SEED = 3


def difference(*change: float) -> Difference:
    """Of values with a deviation of 1, and noise."""
    noise = np.random.default_rng(SEED).normal(size=4)
    return Difference(NAMES, ("N.m",) * 4, np.zeros(4), noise + change, np.eye(4), np.inf, 1000)


def single(k: int) -> Form:
    table = np.eye(4)[:, [k]]
    return Form("parameter", 0, f"{NAMES[k]} alone", (NAMES[k],), ("N.m",), lambda x: table)


def with_play(found: Difference, gain: float) -> World:
    return World(found, (NEW,), (np.array([0.01]),), (np.array([0.001]),), gain, cost=1)


def answer(*worlds: World) -> Contest:
    return contest(worlds, lambda world: [single(k) for k in range(4)])


def titles(found: Contest) -> list[list[str]]:
    return [[form.title for form in e.forms] for e in found.named]


STILL = (0.0, 0.0, 0.0, 0.0)
FAR = (30.0, -20.0, 25.0, 40.0)
"""What play that the model lacks does to the values."""


def test_an_effect_that_explains_both_log_and_values_is_named_alone() -> None:
    found = answer(World(difference(*FAR)), with_play(difference(*STILL), 500.0))
    assert titles(found) == [["play, new"]]
    assert found.named[0].amounts == (np.array([0.01]),)


def test_an_effect_shows_where_no_value_has_moved() -> None:
    found = answer(World(difference(*STILL)), with_play(difference(*STILL), 60.0))
    assert titles(found) == [["play, new"]]


@pytest.mark.parametrize("gain", [0.0, 10.0, 16.0])
def test_an_effect_that_gains_no_more_than_its_cost_and_the_margin_is_not_named(gain: float) -> None:
    found = answer(World(difference(*STILL)), with_play(difference(*STILL), gain))
    assert not found.is_changed
    assert found.named == ()


def test_an_effect_and_a_value_that_moved_beside_it_are_named_together() -> None:
    found = answer(World(difference(30, -20, 25, 100)), with_play(difference(0, 0, 0, 60), 500.0))
    assert titles(found) == [["play, new", "d alone"]]


def test_a_value_that_moves_little_beside_an_effect_is_not_named_with_it() -> None:
    """It would lower the criterion by less than the margin: 3.2² less its cost, and what noise adds."""
    rest = np.array([0.0, 0.0, 0.0, 3.2])
    quiet = Difference(NAMES, ("N.m",) * 4, np.zeros(4), rest, np.eye(4), np.inf, 1000)
    found = answer(World(difference(*FAR)), with_play(quiet, 500.0))
    assert titles(found) == [["play, new"]]


def test_a_value_that_explains_it_all_is_not_beaten_by_an_effect_that_explains_less() -> None:
    moved = difference(0, 20, 0, 0)
    assert titles(answer(World(moved), with_play(difference(9, 9, 9, 9), 60.0))) == [["b alone"]]


def test_both_are_told_where_the_data_cannot_tell_them_apart() -> None:
    """A value alone leaves 4.7 and costs one more, the effect 11.2 less what it gains."""
    moved = difference(0, 20, 0, 0)
    found = titles(answer(World(moved), with_play(difference(*STILL), 6.5)))
    assert {tuple(names) for names in found} == {("b alone",), ("play, new",)}


def test_what_both_logs_have_is_no_change() -> None:
    both = World(difference(*STILL), gain=400.0, cost=1, lacks=PLAY)
    found = answer(World(difference(*FAR)), both, with_play(difference(9, 9, 9, 9), 200.0))
    assert not found.is_changed
    assert found.lacks == PLAY
    moved = replace(both, difference=difference(0, 0, 40, 0))
    found = answer(World(difference(*FAR)), moved, with_play(difference(9, 9, 9, 9), 200.0))
    assert titles(found) == [["c alone"]]
    assert found.lacks == PLAY


def test_values_alone_are_not_named_where_all_together_have_not_changed() -> None:
    """The information criterion by itself would: 14 of one value of four, p = 0.007."""
    change: Array = np.array([0, np.sqrt(14), 0, 0])
    quiet = Difference(NAMES, ("N.m",) * 4, np.zeros(4), change, np.eye(4), np.inf, 10)
    far = with_play(difference(9, 9, 9, 9), 0.0)
    assert not answer(World(quiet), far).is_changed


def test_an_effect_beside_a_cause_that_holds_the_better_one_is_no_rival_unless_it_explains_more() -> None:
    both = np.eye(4)[:, :2]
    wide = Form("frictions", 0, "a and b, each by itself", ("a", "b"), ("N.m",) * 2, lambda x: both)

    def among(gain: float) -> Contest:
        worlds = (World(difference(60.0, 0, 0, 0)), with_play(difference(60.0, 0, 0, 0), gain))
        return contest(worlds, lambda world: [*(single(k) for k in range(4)), wide])

    assert titles(among(14.0)) == [["a alone"]]
    assert ["play, new", "a alone"] in titles(among(200.0))


def test_what_one_log_shows_and_the_other_may_have_too_is_no_change() -> None:
    """By itself the effect is new; that the other log has as much of it explains both as well."""
    maybe = World(difference(*STILL), gain=60.0, cost=1, lacks=(Lack("play", 1, "play on joint 1", (), is_sure=False),))
    found = answer(World(difference(*STILL)), with_play(difference(*STILL), 60.0), maybe)
    assert not found.is_changed
    assert [lack.is_sure for lack in found.lacks] == [False]


def test_a_second_effect_that_explains_little_of_the_change_is_not_named_but_told() -> None:
    """No model of an effect is exact: 40 of 4000 may be that."""
    other = Form("ripple", 2, "ripple, new", ("size",), ("N.m",), lambda x: NONE)
    one = with_play(difference(*STILL), 4000.0)
    none = np.zeros(1)
    two = World(difference(*STILL), (NEW, other), (none, none), (none, none), 4040.0, cost=2)
    found = answer(World(difference(*FAR)), one, two)
    assert titles(found) == [["play, new"]]
    assert found.further is not None
    assert [form.title for form in found.further.forms] == ["play, new", "ripple, new"]
    much = replace(two, gain=4400.0)
    assert titles(answer(World(difference(*FAR)), one, much)) == [["play, new", "ripple, new"]]


def test_a_cause_is_not_named_twice_where_another_world_has_more_values() -> None:
    """That a moved is a part of that a and b did, also where both logs have play, whose gap is one more value."""
    names, table = (*NAMES, "gap"), np.eye(5)
    rest = np.append(difference(60, 0, 0, 0).after, 0.0)
    more = Difference(names, ("N.m",) * 5, np.zeros(5), rest, np.eye(5), np.inf, 1000)
    both = World(more, gain=400.0, cost=1, lacks=PLAY)
    wide = Form("frictions", 0, "a and b, each by itself", ("a", "b"), ("N.m",) * 2, lambda x: np.eye(4)[:, :2])
    worlds = (World(difference(60, 0, 0, 0)), with_play(difference(60, 0, 0, 0), 380.0), both)

    def forms(world: World) -> list[Form]:
        if world is both:
            return [replace(single(k), columns=lambda x, k=k: table[:, [k]]) for k in range(4)]
        return [*(single(k) for k in range(4)), wide]

    assert titles(contest(worlds, forms)) == [["a alone"]]


def test_gains_of_drives_that_amount_to_the_same_are_one_cause() -> None:
    """A drive of two that gives less, or all that give more, and the other one less."""
    gain = Form("drive", 1, "gain of drive 1, new", ("gain",), ("1",), lambda x: NONE, scales=frozenset({1}))
    other = replace(gain, joint=2, title="gain of drive 2, new", scales=frozenset({2}))
    every = replace(single(0), kind="scale", title="scale of all", scales=frozenset({1, 2}))
    none = (np.zeros(1),)
    one, two = (
        World(difference(*moved), (form,), none, none, 500.0, cost=1)
        for form, moved in ((gain, STILL), (other, (20, 0, 0, 0)))
    )
    found = contest((World(difference(*FAR)), one, replace(two, gain=515.0)), lambda world: [every])
    assert titles(found) == [["gain of drive 1, new"]]


@pytest.mark.parametrize(
    ("left", "explains"),
    [
        (31.0, True),  # noise of four values is four of them: 27 beyond it are less than 2 % of 1500
        (33.0, True),
        (36.0, False),
    ],
)
def test_a_rest_is_small_by_what_it_is_beyond_its_noise(left: float, explains: bool) -> None:
    rest = np.array([0.0, 0.0, 0.0, np.sqrt(left)])
    quiet = Difference(NAMES, ("N.m",) * 4, np.zeros(4), rest, np.eye(4), np.inf, 1000)
    found = contest((World(difference(*STILL)), with_play(quiet, 1500.0)), lambda world: [])
    assert (titles(found) == [["play, new"]]) is explains


@pytest.mark.parametrize(
    ("gain_in_both", "said"),
    [
        (480.0, [["d alone"]]),  # the other log may have it as well, and says so a little
        (491.0, [["d alone"]]),
        (509.0, [["d alone"]]),
        (473.0, [["play, new", "d alone"], ["d alone"]]),  # a little better as new: nobody can tell
        (440.0, [["play, new", "d alone"]]),  # the other log has nothing of it
    ],
)
def test_what_one_log_shows_and_the_other_does_not_exclude_is_no_change_beside_a_value_that_moved(
    gain_in_both: float, said: list[list[str]]
) -> None:
    moved = difference(0, 0, 0, 15)
    both = World(moved, gain=gain_in_both, cost=1, lacks=(Lack("play", 1, "play on joint 1", (), is_sure=False),))
    found = answer(World(moved), with_play(moved, 485.0), both)
    assert titles(found) == said


def test_an_effect_that_explains_far_more_and_leaves_values_that_differ_is_told_behind_unchanged() -> None:
    """It is not quite what has happened: 'unchanged' would hide it."""
    far = difference(9, -9, 9, 9)
    found = contest((World(difference(*STILL)), with_play(far, 600.0)), lambda world: [])
    assert (found.is_changed, found.named) == (False, ())
    assert found.in_part is not None
    assert [form.title for form in found.in_part.forms] == ["play, new"]
    none = contest((World(difference(*STILL)), with_play(far, 200.0)), lambda world: [])
    assert none.in_part is None
    (doubt,) = document._rest(found)
    assert doubt.code.name == "change-in-part"
    for text in (doubt.text, document._beside(found, [])):
        assert "lay, new (gap +0.01 ± 0.001 rad) would explain the logs far better" in text
        assert "of 4" in text


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        (False, ""),
        (True, "; but the residual of tau1 is not as large as before, and nothing that was tried explains that"),
    ],
)
def test_a_residual_that_is_not_as_large_is_told_beside_unchanged(*, changed: bool, text: str) -> None:
    residual = ResidualChange(label="tau1", unit="N.m", before=1.0, after=2.0, p_value=1e-9, changed=changed)
    assert document._beside(Contest(), [residual]) == text
    assert document._rest(Contest()) == []
    assert document._beside(Contest(is_changed=True), [residual]) == ""


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ((60, 12, -12, 12), "; a alone (a +62 ± 1 N.m) explains 92 % of it, and what that leaves"),
        ((30, 20, -20, 20), ""),
    ],
)
def test_a_cause_that_explains_most_but_not_all_is_told_behind_unknown(change: tuple[float, ...], told: str) -> None:
    """Machines differ from day to day by more than what was done to them: payload and nothing else is rare."""
    found = answer(World(difference(*change)))
    assert (found.is_changed, found.named) == (True, ())
    assert document._largest_part(found)[: len(told)] == told
    assert bool(document._largest_part(found)) == bool(told)
