"""The search in the whole range of an effect's parameters, and what the rounds make of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection import rounds, wide_search
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import Options
from fmu_didim.discovery.selection.rounds import (
    Discovery,
    Ending,
    _at_best_minima,
    _at_best_minimum,
    _ranked,
    _widely_searched,
    not_widely_searched,
)
from fmu_didim.discovery.selection.wide_search import (
    GENERATIONS,
    MOST_STEPS,
    PEOPLE,
    _evolved,
    _Range,
    searched_widely,
)
from fmu_didim.dynamics.effects import Search
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.by_hand import Catalogue, TableModel, candidate_of, effect_of, fit_of, residual

PLAY = EffectAtJoint("play", 1)


@pytest.mark.parametrize(
    ("search", "part", "value"),
    [
        (Search(1.0, 100.0, 5), 0.5, 10.0),
        (Search(1.0, 100.0, 5), 1.0, 100.0),
        (Search(0.1, 0.5, 3, logarithmic=False), 0.25, 0.2),
    ],
)
def test_a_parameter_as_a_part_of_its_range(search: Search, part: float, value: float) -> None:
    own = _Range(search)
    assert own.value(part) == pytest.approx(value) and own.part(value) == pytest.approx(part)
    assert own.part(1e9) == 1.0 and own.part(1e-9) == 0.0


def waves(parts: np.ndarray) -> float:
    """Minima a fifth apart in each direction, the deepest at 0.73."""
    off = parts - 0.73
    return float(np.sum(off**2) + 0.05 * np.sum(1 - np.cos(10 * np.pi * off)))


class TestEvolution:
    def test_the_deepest_of_many_minima_is_mostly_found(self) -> None:
        """A minimum beside it is a fifth away, and costs little more."""
        found = [_evolved(waves, 2, seed=seed, first=None, workers=1) for seed in range(12)]
        assert sum(np.abs(one - 0.73).max() < 0.05 for one in found) >= 10

    def test_the_number_of_threads_changes_nothing(self) -> None:
        one, two = (_evolved(waves, 3, seed=0, first=None, workers=workers) for workers in (1, 2))
        assert np.array_equal(one, two)

    def test_it_is_never_worse_than_what_was_known(self) -> None:
        def needle(parts: np.ndarray) -> float:
            return 0.0 if np.abs(parts - 0.123).max() < 1e-9 else 1.0 + parts[0]

        assert needle(_evolved(needle, 3, seed=0, first=np.full(3, 0.123), workers=1)) == 0.0

    def test_so_many_are_tried_and_all_in_the_range(self) -> None:
        asked: list[np.ndarray] = []
        _evolved(lambda parts: float(asked.append(parts.copy()) or waves(parts)), 3, seed=1, first=None, workers=1)
        assert len(asked) == 3 * PEOPLE * (GENERATIONS + 1)
        assert all(((parts >= 0) & (parts <= 1)).all() for parts in asked)


class Loop:
    """A competition whose misfit is a function of the gap alone.

    Args:
        steps: of the integration; stable: up to which gap the loop runs.
    """

    def __init__(self, *, steps: int = 100, stable: float = 1.0, time_up: bool = False) -> None:
        self.prepared: list[Any] = []
        self.refitted: list[Proposal] = []
        self.stable = stable
        model = SimpleNamespace(
            estimation_labels=("fitted",), joint_count=2, workers=1, added_effects=(), allowed_workers=lambda values: 1,
            integration_steps=lambda values: steps,
        )  # fmt: skip
        self.fit: Any = SimpleNamespace(model=model, values=np.zeros(1))
        self.builder: Any = SimpleNamespace(
            at=lambda effect_at: SimpleNamespace(search={"gap": Search(1e-3, 1.0, 5)}),
            prepare=lambda wanted, **_: self.prepared.append(wanted),
        )
        self.progress = Progress(ends=-1.0 if time_up else float("inf"))

    def misfit(self, proposal: Proposal, *, most_steps: float) -> float:
        count = len(self.builder.at(PLAY).search)
        assert 4 * count * PEOPLE * (GENERATIONS + 1) * most_steps == pytest.approx(MOST_STEPS)
        gap = proposal.values["gap"]
        return float(np.log(gap / 0.05) ** 2) if gap <= self.stable else np.inf

    def refit(self, proposal: Proposal) -> Any:
        self.refitted.append(proposal)
        return "fit"

    def assess(self, effect_at: EffectAtJoint, fit: Any) -> Any:
        return (effect_at, fit)

    def finished(self, candidate: Any) -> Any:
        return (*candidate, "finished")

    def found(self) -> Any:
        return searched_widely(self, PLAY, seed=0, progress=self.progress)  # type: ignore[arg-type]


def test_the_fit_starts_from_the_best() -> None:
    loop = Loop()
    assert loop.found() == (PLAY, "fit", "finished")
    (start,) = loop.refitted
    assert start.effect_at == PLAY and start.values["gap"] == pytest.approx(0.05, rel=0.2)
    assert loop.prepared == [[(PLAY,)]]


def test_what_was_fitted_is_in_the_first_generation(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the middle of its range what the plant lacks, such as the share of a motor with an inertia of its own."""
    begun: list[Any] = []
    monkeypatch.setattr(wide_search, "fitted_proposal", lambda fit, effect_at: Proposal(effect_at, {"gap": 0.1}))
    monkeypatch.setattr(
        wide_search, "_evolved", lambda misfit, count, *, first, **_: begun.append(first.tolist()) or first
    )  # fmt: skip
    loop = Loop()
    both = {"gap": Search(1e-3, 1.0, 5), "motor_share": Search(0.1, 0.5, 3, logarithmic=False)}
    loop.builder.at = lambda effect_at: SimpleNamespace(search=both)
    assert searched_widely(loop, PLAY, seed=0, progress=loop.progress, begin=loop.fit)  # type: ignore[arg-type]
    assert begun == [[pytest.approx(2 / 3), 0.5]]


@pytest.mark.parametrize(
    ("changes", "is_searched"),
    [
        ({"steps": int(MOST_STEPS / (4 * PEOPLE * (GENERATIONS + 1)))}, True),
        ({"steps": int(1.01 * MOST_STEPS / (4 * PEOPLE * (GENERATIONS + 1)))}, False),  # it would take too long
        ({"stable": 1e-2}, True),
        ({"stable": 1e-4}, False),  # nothing of it can be simulated
        ({"time_up": True}, False),
    ],
)
def test_where_it_is_searched_at_all(changes: dict[str, Any], is_searched: bool) -> None:
    loop = Loop(**changes)
    assert (loop.found() is not None) == is_searched == bool(loop.refitted)


@pytest.mark.parametrize(("most", "is_run"), [(100, True), (99, False), (np.inf, True)])
def test_what_needs_more_steps_than_its_share_counts_as_what_cannot_be_simulated(most: float, is_run: bool) -> None:
    run: list[Array] = []
    model = SimpleNamespace(
        start=np.array([2.0]), free_parameters=SimpleNamespace(limits=(np.array([0.0]), np.array([1.0]))),
        integration_steps=lambda values: 100, output_residual=lambda values: run.append(values) or residual(4.0),
    )  # fmt: skip
    competition: Any = SimpleNamespace(
        fit=SimpleNamespace(residual=residual(9.0), model=None), builder=SimpleNamespace(build=lambda *_: model),
        base=SimpleNamespace(rest_of=lambda x: x, weighted=lambda x: x),
    )  # fmt: skip
    found = Competition.misfit(competition, Proposal(PLAY, {"gap": 0.1}), most_steps=most)
    assert np.isfinite(found) == is_run == bool(run)
    assert all(values.tolist() == [1.0] for values in run)


def candidate(name: str, square: float, joint: int = 1, bic: float = 100.0) -> FittedCandidate:
    """A candidate that leaves this mean square."""
    at = EffectAtJoint(name, joint)
    return candidate_of(name, joint, bic=bic, fit=fit_of(TableModel(residual(square), {}, (at,))))


def beside(squares: Sequence[float] = (2.0, 2.0), *, named: tuple[EffectAtJoint, ...] = ()) -> Any:
    """A competition beside a model that leaves these mean squares on its joints."""
    builder = Catalogue(effect_of("play", has_minima=True), effect_of("spring"), joints=len(squares))
    return SimpleNamespace(
        builder=builder, fit=fit_of(TableModel(residual(*squares), {}, named)), finished=lambda c: c
    )  # fmt: skip


@pytest.mark.parametrize(
    ("name", "again", "objected", "wanted"),
    [
        ("play", 1.0, "", "again"),
        ("play", 3.0, "", "first"),  # it is no better one
        ("play", 1.0, "held-out data speak against it", "first"),
        ("play", None, "", "first"),
        ("spring", 1.0, "", "first"),  # which has one minimum
    ],
)
def test_an_accepted_effect_is_taken_at_its_best_minimum(
    monkeypatch: pytest.MonkeyPatch, name: str, again: float | None, objected: str, wanted: str
) -> None:
    first, other = candidate(name, 2.0), None if again is None else candidate(name, again, bic=200.0)
    begun: list[Any] = []

    def searched(*_: Any, begin: Any, **more: Any) -> FittedCandidate | None:
        begun.append(begin)
        return other

    monkeypatch.setattr(rounds, "searched_widely", searched)
    monkeypatch.setattr(rounds, "objection", lambda *_, **__: objected)
    found = _at_best_minimum(beside(), first, first.fit, Options(), Progress())
    assert found is (other if wanted == "again" else first)
    assert begun == ([first.fit] if name == "play" else [])


@pytest.mark.parametrize(
    ("squares", "named", "in_ranking", "wanted"),
    [
        ((2.0, 2.0), (), {}, [1, 2]),
        ((2.0, 1.3), (), {}, [1]),  # a gap of 0.55 is not looked at
        ((2.0, 2.0), (EffectAtJoint("play", 2),), {}, [1]),
        ((2.0, 2.0), (), {1: 0.5}, [2]),  # the ranking has a better minimum
        ((2.0, 2.0), (), {1: 1.5}, [1, 2]),
        ((1.0, 1.0), (), {}, []),
    ],
)
def test_minima_are_looked_for_on_joints_with_a_gap(
    monkeypatch: pytest.MonkeyPatch, squares: tuple[float, float], named: tuple[EffectAtJoint, ...],
    in_ranking: dict[int, float], wanted: list[int],
) -> None:  # fmt: skip
    monkeypatch.setattr(rounds, "searched_widely", lambda c, a, **_: candidate(a.effect, 1.0, a.joint))
    ranking = [candidate("spring", 1.0), *(candidate("play", square, j) for j, square in in_ranking.items())]
    found = _at_best_minima(beside(squares, named=named), ranking, Options(), Progress())
    assert [(c.effect_at.effect, c.effect_at.joint) for c in found] == [("play", j) for j in wanted]


@pytest.mark.parametrize(
    ("squares", "named", "too_long", "unseen", "other"),
    [
        ((2.0, 2.0), (), {1, 2}, "joints 1, 2 ", ""),
        ((2.0, 2.0), (), {2}, "joint 2 ", ""),
        ((2.0, 1.3), (), {1, 2}, "joint 1 ", ""),  # a gap of 0.55 would not have been looked at
        ((2.0, 2.0), (), set(), "", ""),
        ((1.0, 1.0), (), {1, 2}, "", ""),
        ((2.0, 2.0), (EffectAtJoint("play", 2),), {1, 2}, "joint 1 ", "joint 2 "),
        ((1.0, 1.0), (EffectAtJoint("play", 2), EffectAtJoint("spring", 1)), {1, 2}, "", "joint 2 "),
        ((1.0, 1.0), (EffectAtJoint("play", 2),), {1}, "", ""),
    ],
)
def test_what_was_not_searched_in_its_whole_range_is_told(
    monkeypatch: pytest.MonkeyPatch, squares: tuple[float, float], named: tuple[EffectAtJoint, ...],
    too_long: set[int], unseen: str, other: str,
) -> None:  # fmt: skip
    monkeypatch.setattr(wide_search, "takes_too_long", lambda builder, fit, a: a.joint in too_long)
    competition = beside(squares, named=named)
    for effect in competition.builder.effects.values():
        effect.title = effect.name.capitalize()
    discovery = Discovery(competition.fit, competition.fit, ())
    notes = not_widely_searched(competition.builder, discovery, Options())
    told = [n for n in notes if "may be there and not be found" in n], [n for n in notes if "may explain more" in n]
    assert len(notes) == bool(unseen) + bool(other)
    for found, where, begin in zip(told, (unseen, other), ("Play was looked for on ", "Play on "), strict=True):
        assert [text.startswith(f"{begin}{where}") for text in found] == [True] * bool(where)
    cut = replace(discovery, ending=Ending.TIME_UP)
    assert not_widely_searched(competition.builder, cut, Options()) == []


def test_a_ranking_with_other_fits_is_in_order() -> None:
    ranking = [candidate("spring", 1.0, bic=100.0), candidate("play", 1.0, bic=50.0)]
    better = candidate("play", 0.5, bic=150.0)
    assert _ranked(ranking, better) == (better, ranking[0])


@pytest.mark.parametrize("accepted", [True, False])
def test_what_is_accepted_at_a_better_minimum_is_added(monkeypatch: pytest.MonkeyPatch, accepted: bool) -> None:
    again = [candidate("play", 1.0, 1, bic=50.0), candidate("play", 1.0, 2, bic=70.0)]
    judged: list[Any] = []

    def decide(ranking: Any, *_: Any, **__: Any) -> Any:
        judged.append(ranking)
        return ranking[0] if accepted else ((ranking[0].effect_at, "no"),)

    monkeypatch.setattr(rounds, "decide", decide)
    monkeypatch.setattr(rounds, "_with", lambda c, ranking, one, *_: (one.fit, [one.effect_at.joint]))
    competition = beside()
    found = _widely_searched(competition, again, again, competition.fit, [], Options(), Progress())
    assert judged == [[again[1], again[0]]] and (found == (again[1].fit, [2]) if accepted else found is None)
    assert _widely_searched(competition, again, [], competition.fit, [], Options(), Progress()) is None
    assert len(judged) == 1
