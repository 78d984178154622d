"""Effects that have come, gone or grown between two logs, with a few effects to choose from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import pytest

from fmu_didim import SimulationError, read_robot
from fmu_didim.discovery.change import explain, worlds
from fmu_didim.discovery.change.answers import difference
from fmu_didim.discovery.change.contest import World
from fmu_didim.discovery.change.document import compared
from fmu_didim.discovery.change.log_fit import Known, LogFit, Promise
from fmu_didim.discovery.change.worlds import worlds_of
from fmu_didim.discovery.progress import Progress
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.model.loop_model import EffectAtJoint
from fmu_didim.results.comparison import ComparisonDocument
from fmu_didim.workflow.output.result import Result
from tests.discovery.change.pairs import ROBOT, answer, identified, log_of

RATE = 20.0
FEW = {name: EFFECTS[name] for name in ("log_time_shift", "torque_offset", "asymmetric_coulomb", "controller_gain")}
OFFSET = (0.0, 0.03)
"""[N.m] Of the torque log: five times its noise."""


@dataclass(frozen=True)
class Side:
    """A result and its log with its loop."""

    result: Result
    log: LogFit


@cache
def side(
    seed: int, *, late_s: float = 0.0, offset: tuple[float, float] = (0.0, 0.0), gain: tuple[float, float] = (1.0, 1.0),
    loaded: bool = False, noise: float = 1.0,
) -> Side:  # fmt: skip
    mass = (0.3, 0.2, 0.05) if loaded else None
    found = identified(log_of(RATE, seed, late_s=late_s, offset=offset, gain=gain, mass=mass, noise=noise))
    return Side(found, LogFit.of(found.model, read_robot(ROBOT), FEW))


def of(before: Side, after: Side) -> ComparisonDocument:
    return compared(answer("before", before.result), answer("after", after.result), (before.log, after.log))


def titles(found: ComparisonDocument) -> list[list[str]]:
    return [[part.title for part in cause.parts] for cause in found.causes]


def codes(found: ComparisonDocument) -> set[str]:
    return {reason.code for reason in found.reasons}


@pytest.mark.gate
def test_nothing_has_come_where_nothing_has_changed() -> None:
    found = of(side(1), side(2))
    assert (found.answer, found.verdict) == ("unchanged", "valid")
    assert any("too small to show" in condition for condition in found.conditions)
    assert not any("not looked for" in remark for remark in found.remarks)


@pytest.mark.gate
def test_a_clock_that_has_become_late_is_new_and_the_other_way_round_gone() -> None:
    new, gone = of(side(1), side(3, late_s=0.01)), of(side(3, late_s=0.01), side(1))
    assert (titles(new), titles(gone)) == (
        [["time shift of the torque log, new"]],
        [["time shift of the torque log, gone"]],
    )
    for found in (new, gone):
        amount = found.causes[0].parts[0].amounts[0]
        assert amount.std is not None
        assert abs(amount.value - 0.01) < 4 * amount.std
        assert found.p_value > 0.001  # the values alone do not show it


@pytest.mark.gate
def test_what_both_logs_have_is_told_and_is_no_change() -> None:
    found = of(side(4, offset=OFFSET), side(5, offset=OFFSET))
    assert (found.answer, found.text.partition(";")[0]) == (
        "unchanged",
        "beside torque offset on joint 2, which both logs show, the values differ by no more than noise",
    )
    assert "change-lacks" in codes(found)
    text = next(reason.text for reason in found.reasons if reason.code == "change-lacks")
    assert "torque offset on joint 2" in text
    loaded = of(side(4, offset=OFFSET), side(6, offset=OFFSET, loaded=True))
    assert titles(loaded) == [["payload on the last link"]]
    assert "change-lacks" in codes(loaded)


@pytest.mark.gate
@pytest.mark.parametrize(
    ("after", "named", "lacking"),
    [
        ({"seed": 4}, None, ("torque offset on joint 2",)),
        ({"seed": 6, "loaded": True}, "payload on the last link", ("torque offset on joint 2",)),
        ({"seed": 10, "late_s": 0.01}, None, ("torque offset on joint 2", "time shift of the torque log")),
    ],
)
def test_what_a_noisy_log_does_not_exclude_is_no_change(
    after: dict[str, Any], named: str | None, lacking: tuple[str, ...]
) -> None:
    """The log before has ten times the noise: by itself it tells nothing of what the log after shows, and an offset of
    twice its standard deviation may have been there, also beside a payload that is new."""
    found = of(side(51, noise=10.0), side(**after, offset=(0.0, 0.008)))
    assert found.verdict == "doubtful"
    if named is None:
        assert (found.answer, found.causes) == ("unchanged", [])
    else:
        assert titles(found)[0] == [named]
    assert not any(" new" in title or " gone" in title for cause in titles(found) for title in cause)
    text = next(reason.text for reason in found.reasons if reason.code == "change-lacks")
    assert text.endswith("which one log shows, and the other may have, too.")
    assert all(title in text for title in lacking)


@pytest.mark.gate
def test_what_a_noisy_log_excludes_is_new() -> None:
    """An offset of more than six standard deviations of the log before, of which that shows nothing."""
    found = of(side(51, noise=10.0), side(4, offset=OFFSET))
    assert titles(found) == [["torque offset on joint 2, new"]]
    assert "change-lacks" not in codes(found)


@pytest.mark.gate
def test_two_effects_that_both_logs_have_are_no_change() -> None:
    """Looked for one at a time, the second would seem to have come in one log and gone from the other."""
    found = of(side(11, late_s=0.01, offset=OFFSET), side(12, late_s=0.01, offset=OFFSET))
    assert (found.answer, found.causes) == ("unchanged", [])
    text = next(reason.text for reason in found.reasons if reason.code == "change-lacks")
    assert "torque offset on joint 2" in text
    assert "time shift of the torque log" in text
    assert "which both logs show" in text


@pytest.mark.gate
def test_what_both_logs_have_has_grown_by_what_it_has_grown() -> None:
    found = of(side(4, offset=OFFSET), side(7, offset=(0.0, 0.06)))
    assert titles(found)[0] == ["torque offset on joint 2, changed"]
    amount = found.causes[0].parts[0].amounts[0]
    assert amount.std is not None
    assert abs(amount.value - 0.03) < 4 * amount.std


@pytest.mark.gate
def test_two_effects_that_came_together_are_both_named() -> None:
    found = of(side(1), side(10, late_s=0.01, offset=OFFSET))
    assert found.answer == "named"
    assert set(titles(found)[0]) == {"time shift of the torque log, new", "torque offset on joint 2, new"}
    amounts = {part.kind: part.amounts[0] for part in found.causes[0].parts}
    for kind, truth in (("log_time_shift", 0.01), ("torque_offset", OFFSET[1])):
        assert amounts[kind].std is not None
        assert abs(amounts[kind].value - truth) < 4 * amounts[kind].std


@pytest.mark.gate
def test_where_a_loop_fails_with_effects_the_values_are_compared_and_that_is_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails(*_: object, **__: object) -> list[World]:
        raise SimulationError("The loop diverges.", got="inf", next_step="Try others.")

    monkeypatch.setattr(explain, "worlds_of", fails)
    found = of(side(1), side(9, loaded=True))
    assert titles(found) == [["payload on the last link"]]
    assert any("not looked for: The loop diverges (inf)." in remark for remark in found.remarks)


@pytest.mark.gate
def test_a_log_that_is_scaled_is_told_behind_a_gain_and_a_scale_of_one_factor() -> None:
    """The machine is as it was: what moved is the torque sensor of joint 2."""
    found = of(side(1), side(8, gain=(1.0, 1.15)))
    assert titles(found) == [["gain of the controller on joint 2, new", "torque scale of joint 2"]]
    assert any("joint 2 are one factor" in remark for remark in found.remarks)


@pytest.mark.gate
def test_effects_for_which_a_cause_of_the_values_stands_are_not_looked_for_again() -> None:
    before, after = side(1), side(3, late_s=0.01)
    first, second = answer("before", before.result), answer("after", after.result)
    between, _ = difference(first, second)
    known = tuple(Known(between.names, *one.values_of(between.names)) for one in (first, second))

    def kinds(covered: frozenset[tuple[str, int]]) -> set[str]:
        worlds = worlds_of(before.log, after.log, between, (known[0], known[1]), Progress(), covered=covered)
        return {form.kind for world in worlds for form in world.fixed}

    assert "log_time_shift" in kinds(frozenset())
    assert "log_time_shift" not in kinds(frozenset({("log_time_shift", 1)}))


@pytest.mark.parametrize(
    ("loud", "asked", "found"),
    [
        (({1}, set()), [], [("backlash", 1)]),
        ((set(), {2}), [], [("backlash", 2)]),
        (({1}, {1, 2}), [], [("backlash", 1), ("backlash", 2)]),
        (({1}, set()), [("backlash", 1)], []),  # fitted already
        ((set(), set()), [], []),  # residuals alike
    ],
)
def test_play_is_looked_for_where_one_residual_is_larger_whatever_its_slope_promises(
    loud: tuple[set[int], set[int]], asked: list[tuple[str, int]], found: list[tuple[str, int]]
) -> None:
    own = [(name, j) for name in ("torque_offset", "backlash") for j in (1, 2)]
    promises = [[Promise(EffectAtJoint(*at), -5.0, ()) for at in own]]
    builder = SimpleNamespace(effect=lambda at: EFFECTS[at.effect])
    ground = SimpleNamespace(sides=(SimpleNamespace(builder=builder),) * 2)
    search = worlds._Search(cast(Any, ground), 100, frozenset(), Progress())
    search.tried = [worlds._Tried((EffectAtJoint(*at),), (None, None)) for at in asked]
    every = [promises, promises]
    assert [(p.effect_at.effect, p.effect_at.joint) for p in search._of_many_minima(every, loud)] == found


def search_of(*tried: worlds._Tried) -> worlds._Search:
    """A search of two logs without loops, in which these were fitted."""
    builder = SimpleNamespace(effect=lambda at: EFFECTS[at.effect])
    ground = SimpleNamespace(sides=(SimpleNamespace(builder=builder),) * 2)
    search = worlds._Search(cast(Any, ground), 100, frozenset(), Progress())
    search.tried = list(tried)
    return search


def tried_of(name: str, joint: int, first: str | None, second: str | None) -> worlds._Tried:
    """An effect fitted to each log; a fit is a word here."""
    return worlds._Tried((EffectAtJoint(name, joint),), cast(Any, (first, second)))


@pytest.mark.parametrize(
    ("gains", "shared", "wanted"),
    [
        ((50.0, 40.0), (), ("before", "after")),  # each shows it
        ((50.0, 3.0), (), ("before", "in common with before")),
        ((3.0, 50.0), (), ("in common with after", "after")),
        ((3.0, 3.0), (), ("before", "after")),
        ((50.0, -20.0), ("after",), ("before", "after")),  # it has the values of the other one already
        ((50.0, None), (), ("before", None)),
    ],
)
def test_a_log_that_does_not_show_an_effect_by_itself_is_asked_with_the_values_of_the_other_one(
    gains: tuple[float, float | None], shared: tuple[str, ...], wanted: tuple[str | None, ...],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """A free fit makes anything of what it hardly shows: play of a hundredth of the width, which then has not changed
    by as much as is known of it."""
    gain = dict(zip(("before", "after"), gains, strict=True))
    search = search_of()
    monkeypatch.setattr(worlds._Search, "_beyond", lambda self, k, fit, effects: gain[fit])
    monkeypatch.setattr(worlds, "shared", lambda fit: fit in shared)
    monkeypatch.setattr(worlds, "in_common", lambda side, other, effect_at: f"in common with {other}")
    tried = tried_of("backlash", 1, "before", None if gains[1] is None else "after")
    assert search._as_known(tried) == wanted


def test_an_elastic_gear_is_tried_for_which_play_at_its_best_minimum_may_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its slope promises nothing, and that of the play did not either."""
    elastic, play = EffectAtJoint("joint_elasticity", 2), EffectAtJoint("backlash", 2)
    promises = [[Promise(play, -3.0, ()), Promise(elastic, -5.0, ())], []]
    search, asked = search_of(), list[EffectAtJoint]()

    def tries(self: Any, promise: Promise, shows: Any, *, if_nearer: bool = False) -> None:
        asked.append(promise.effect_at)
        self.tried.append(worlds._Tried((promise.effect_at,), (None, None)))

    def at_best(self: Any, tried: worlds._Tried, loud: Any) -> worlds._Tried:
        return tried_of("backlash", 2, None, "hits") if tried.effects[0] == play else tried

    monkeypatch.setattr(worlds._Search, "_promised", lambda self, k: promises if k else [[], []])
    monkeypatch.setattr(worlds._Search, "_try", tries)
    monkeypatch.setattr(worlds._Search, "_at_best_minima", at_best)
    monkeypatch.setattr(worlds._Search, "_beyond", lambda self, k, fit, effects: 100.0)
    monkeypatch.setattr(worlds._Search, "_of", lambda self, tried: ())
    monkeypatch.setattr(worlds, "louder", lambda sides: (set(), {2}))
    search.worlds()
    assert asked == [play, elastic]


def test_a_second_effect_is_looked_for_beside_the_gears_for_which_the_best_may_stand(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Beside a gain that is not fitted yet, the gear of the neighbour may explain more than the right one."""
    gains = {"soft 1": 190.0, "soft 2": 179.0, "gain": 171.0, "little": 5.0}
    search = search_of(
        tried_of("joint_elasticity", 1, "soft 1", None), tried_of("joint_elasticity", 2, "soft 2", None),
        tried_of("controller_gain", 2, "gain", None), tried_of("backlash", 1, "little", None),
    )  # fmt: skip
    firsts = list[tuple[int, EffectAtJoint]]()
    monkeypatch.setattr(worlds._Search, "_beyond", lambda self, k, fit, effects: gains[fit])
    monkeypatch.setattr(worlds._Search, "_completed", lambda self, effects, fits, sides: worlds._Tried(effects, fits))
    monkeypatch.setattr(worlds._Search, "_of", lambda self, tried: ())
    monkeypatch.setattr(
        worlds._Search, "_seconds", lambda self, k, first: firsts.append((k, first.effects[0])) or ()
    )  # fmt: skip
    monkeypatch.setattr(worlds, "shared", lambda fit: False)
    monkeypatch.setattr(worlds, "settled", lambda fit: fit)
    assert list(search.with_second()) == []
    assert firsts == [(0, EffectAtJoint("joint_elasticity", 1)), (0, EffectAtJoint("joint_elasticity", 2))]
