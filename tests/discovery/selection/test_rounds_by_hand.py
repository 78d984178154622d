"""The rounds, with a hand-made competition: what is added, refined, taken out again, and when they end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from fmu_didim.base.errors import SimulationError
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection import beside_others, parts, rounds
from fmu_didim.discovery.selection.beside_others import _rests_last, by_importance, without_superfluous
from fmu_didim.discovery.selection.candidates import (
    Comparison,
    FittedCandidate,
    Fruitless,
    Outcome,
    ScreenedCandidate,
    TriedCandidate,
)
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import Options, Step
from fmu_didim.discovery.selection.rounds import (
    Ending,
    _along_valley,
    _base_instead,
    _beside,
    _candidates,
    _rivals,
    _with_shapes_held,
    run_rounds,
)
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.free_parameter import LOG
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.by_hand import (
    Catalogue,
    Removable,
    TableModel,
    candidate_of,
    effect_of,
    fit_of,
    residual,
    with_effects,
)


def added(names: str | Sequence[str], **more: Any) -> FittedCandidate:
    """The candidate that adds the last of these effects."""
    return candidate_of(names[-1], fit=with_effects(*names, **more))


class ByHand:
    """What the rounds call, and what it was called with.

    Args:
        outcomes: of the decision, round by round. checked, again: steps of the first pre-check, and of the second.
    """

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, *outcomes: Any, checked: Sequence[Any] = (), again: Sequence[Any] = ()
    ) -> None:
        self.catalogues: list[tuple[Any, list[EffectAtJoint]]] = []
        self.screened: list[Fit] = []
        self.fitted: list[tuple[Any, dict[str, Any]]] = []
        self.stepped: list[tuple[Any, ...]] = []
        self.backward: list[list[Any]] = []
        self.helds: list[Any] = []
        self.left: tuple[EffectAtJoint, ...] = ()
        self.cut_in = 0
        self.unfitted: tuple[Any, ...] = ()
        self.reached: list[Any] = []
        self.judged: list[Any] = []
        self.fruitless: list[Fruitless] = []
        self.checks: list[Fit] = []
        self.paired: list[int] = []
        self.pairs: list[str] = []
        self.exchanges: list[str] = []
        self.contested: list[str] = []
        self.doubted: list[str] = []
        self.gap_is_large = True
        self.untold: list[FittedCandidate] = []
        self._outcomes, self._checked = list(outcomes), [list(checked), list(again)]
        monkeypatch.setattr(rounds, "may_be_promising", lambda fit: self.gap_is_large)
        for name in ("pre_check", "decide", "minimise", "step_of", "_pair"):
            monkeypatch.setattr(rounds, name, getattr(self, f"do_{name.strip('_')}"))
        monkeypatch.setattr(beside_others, "minimise", self.do_minimise)
        monkeypatch.setattr(rounds, "Rivalry", self.do_rivalry)
        monkeypatch.setattr(rounds, "held_out_objection", lambda *_, **__: "")
        monkeypatch.setattr(rounds, "without_superfluous", self.do_backward)
        monkeypatch.setattr(rounds, "by_importance", lambda steps, fit, builder: tuple(steps))
        monkeypatch.setattr(rounds, "too_small", lambda *_, **__: ())
        monkeypatch.setattr(rounds, "simple_form", lambda *_: self.untold.pop() if self.untold else None)
        monkeypatch.setattr(rounds, "Competition", self.do_competition)
        monkeypatch.setattr(rounds, "SignatureCatalogue", self.do_catalogue)

    def do_pre_check(self, builder: Any, base: Fit, *_: Any) -> tuple[Fit, list[Any]]:
        self.checks.append(base)
        found = self._checked.pop(0) if self._checked else []
        return (with_effects("limit") if found else base), found

    def do_pair(self, competition: Any, ranking: Any, base: Fit, steps: list[Any], *_: Any) -> Any:
        self.paired.append(len(steps))
        if not self.pairs:
            return None
        return with_effects("c", "d"), [
            *steps,
            *(SimpleNamespace(effect_at=EffectAtJoint(n, 1)) for n in self.pairs.pop()),
        ]

    def instead(self, fit: Fit, steps: list[Any], catalogue: Any) -> Any:
        self.contested.append("".join(s.effect_at.effect for s in steps))
        if not self.exchanges:
            return None
        name = self.exchanges.pop()
        names = [*(s.effect_at.effect for s in steps[:-1]), name]
        return with_effects(*names), [*steps[:-1], SimpleNamespace(effect_at=EffectAtJoint(name, 1))]

    def told(self, fit: Fit, steps: Any) -> Any:
        self.doubted.append("".join(s.effect_at.effect for s in steps))
        return steps

    def do_catalogue(self, builder: Any, fit: Fit, *, candidates: list[EffectAtJoint], progress: Progress) -> Any:
        self.catalogues.append((fit, candidates))
        return SimpleNamespace(fit=fit, left=self.left)

    def do_rivalry(self, builder: Any, base: Fit, options: Options, progress: Progress) -> Any:
        return SimpleNamespace(base=base, options=options, progress=progress, instead=self.instead, told=self.told)

    def do_competition(self, builder: Any, fit: Fit, fruitless: Fruitless) -> Any:
        self.fruitless.append(fruitless)

        def screen(catalogue: Any) -> list[Any]:
            self.screened.append(fit)
            return ["screened"]

        return SimpleNamespace(
            builder=builder, fit=fit, finished="to the end", screen=screen,
            shortlist=lambda screened: [*screened, "shortlisted"],
            compare=self.do_contend, fruitless=fruitless,
        )  # fmt: skip

    def do_contend(self, chosen: Any, *, progress: Progress, reach: float = 4.0) -> Comparison:
        if reach == np.inf:
            self.reached.append(chosen)
            return Comparison((candidate_of("late"),), (TriedCandidate(EffectAtJoint("late", 1), Outcome.FITTED, 5.0),))
        cut = len(self.screened) == self.cut_in
        tried = [TriedCandidate(EffectAtJoint("a", 1), Outcome.FITTED, 7.0)]
        lost = {EffectAtJoint("lost", len(self.screened)): 3.0}
        if self.unfitted:
            late = TriedCandidate(EffectAtJoint("late", 1), Outcome.LEFT_EARLY)
            return Comparison((candidate_of("first"),), (late, *tried), self.unfitted)
        return Comparison(
            (*chosen, "fitted"), (*tried, TriedCandidate(EffectAtJoint("b", 1), Outcome.NOT_TRIED)) if cut else tried,
            fruitless=Fruitless(lost, {EffectAtJoint("vain", len(self.screened)): 3.0}),
        )  # fmt: skip

    def do_decide(
        self,
        ranking: Any,
        fit: Fit,
        options: Any,
        *,
        base: Fit,
        held: Any,
        at_harmonic: Any,
        may_be: Any,
        finished: Any,
        class_of: Any,
        rivals_of: Any,
    ) -> Any:
        if not self.unfitted:
            assert ranking == ("screened", "shortlisted", "fitted")
        self.judged.append([getattr(c, "effect_at", None) for c in ranking])
        assert finished == "to the end"
        competition, screened = held.args
        assert (competition.builder, competition.fit) == (EFFECTS, fit)
        assert all(class_of(EffectAtJoint(name, 1)) == effect.class_name for name, effect in EFFECTS.effects.items())
        self.helds.append((screened, fit, base))
        return self._outcomes.pop(0)

    def do_minimise(self, model: Any, noise: Any, **more: Any) -> Fit:
        self.fitted.append((model, more))
        return replace(fit_of(model, values=model.start), simulations=77)

    def do_step_of(self, accepted: FittedCandidate, ranking: Any, competition: Any, options: Any) -> Any:
        self.stepped.append((accepted, ranking, competition.fit))
        return SimpleNamespace(effect_at=accepted.effect_at)

    def do_backward(self, builder: Any, fit: Fit, steps: list[Any], *_: Any) -> tuple[Fit, list[Any]]:
        self.backward.append(list(steps))
        return fit, steps


EFFECTS = Catalogue(
    effect_of("a"), effect_of("b"), effect_of("shift"),
    *(effect_of(name, is_proposed=False) for name in ("bristles", "c", "d", "limit", *"stop")),
)  # fmt: skip
BASE = with_effects()


def run(**options: Any) -> tuple[Any, list[str]]:
    said: list[str] = []
    return run_rounds(EFFECTS, BASE, Options(**options), Progress(said.append)), said


def test_nothing_is_added_where_all_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    reasons = ((EffectAtJoint("a", 1), "too small"),)
    competition = ByHand(monkeypatch, reasons)
    found, said = run()
    assert (found.base, found.final, found.steps, found.refused) == (BASE, BASE, (), reasons)
    assert said == ["signatures of 3 candidates", "competition of the candidates"]
    assert competition.helds == [(["screened"], BASE, BASE)]


def test_effects_are_added_one_after_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = added("a"), added("ab")
    competition = ByHand(monkeypatch, first, second, ())
    found, said = run()
    assert [s.effect_at.effect for s in found.steps] == ["a", "b"]
    assert said[2:] == ["added: a on joint 1", "added: b on joint 1"]
    # From the minimum of the first the second is looked for.
    assert [m.added_effects for m, _ in competition.fitted] == [
        first.fit.model.added_effects,
        second.fit.model.added_effects,
    ]
    assert all(more == {"stopping": Stopping(updates=1, exact=True)} for _, more in competition.fitted)
    assert [fit.simulations for fit in competition.screened] == [0, 77, 77]
    assert found.final.simulations == 77 and found.base is BASE
    assert [fit.simulations for _, _, fit in competition.stepped] == [0, 77]
    assert all(accepted.fit.simulations == 77 for accepted, _, _ in competition.stepped)
    assert [len(steps) for steps in competition.backward] == [1, 2]
    assert len(competition.catalogues) == 1  # the motion hardly changes
    assert found.refused == ()


@pytest.mark.parametrize(
    ("is_stated", "unusual", "wanted"),
    [(False, "", ""), (True, "", "c"), (False, "falls with the speed", "bc"), (True, "falls with the speed", "bc")],
)
def test_which_effects_an_effect_gives_way_to(is_stated: bool, unusual: str, wanted: str) -> None:
    """One that no machine has also to one of its own class."""
    catalogue = Catalogue(
        effect_of("a", class_name="one", is_stated=is_stated, confounded_with=("b", "c", "not in the catalogue")),
        effect_of("b", class_name="one"), effect_of("c"), effect_of("d"),
    )  # fmt: skip
    competition = cast(Competition, SimpleNamespace(builder=catalogue))
    assert _rivals(competition, candidate_of("a", unusual=unusual)) == set(wanted)


def test_what_has_a_simple_form_is_taken_where_its_own_is_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nothing else is accepted; a round later nothing is."""
    competition = ByHand(monkeypatch, (), ())
    competition.untold = [added("a")]
    found, said = run()
    assert [s.effect_at.effect for s in found.steps] == ["a"] and "added: a on joint 1" in said


def test_what_an_effect_would_stand_for_is_added_in_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both parts as steps of their own, the second one from the minimum, and nothing of the effect itself."""
    ByHand(monkeypatch, added("shift"), ())
    first, second = added("a"), added("ab")
    beside = SimpleNamespace(fit=first.fit)
    taken = (parts.Part(cast(Competition, SimpleNamespace(fit=BASE)), first),
             parts.Part(cast(Competition, beside), second))  # fmt: skip
    monkeypatch.setattr(rounds, "parts_instead", lambda *_: (taken, "It explains these data as well."))
    stepped: list[tuple[Any, ...]] = []

    def step_of(accepted: FittedCandidate, ranking: Any, competition: Any, options: Any) -> Step:
        stepped.append((accepted.effect_at.effect, ranking, competition.fit, accepted.fit.simulations))
        return Step(accepted.effect_at, 0.0, 0.0, 0.0, (), {}, {}, None, remark="Own." * (len(stepped) == 1))

    monkeypatch.setattr(rounds, "step_of", step_of)
    found, said = run()
    assert [(s.effect_at.effect, s.remark) for s in found.steps] == [
        ("a", "Own. It explains these data as well."), ("b", ""),
    ]  # fmt: skip
    assert [(name, fit, simulations) for name, _, fit, simulations in stepped] == [("a", BASE, 0), ("b", first.fit, 77)]
    assert [len(ranking) for _, ranking, _, _ in stepped] == [1, 1]
    assert found.final.model.added_effects == second.fit.model.added_effects
    assert said[2:] == ["added: a on joint 1", "added: b on joint 1"]


def test_what_is_known_is_kept_before_the_first_round_and_after_each(monkeypatch: pytest.MonkeyPatch) -> None:
    ByHand(monkeypatch, added("a"), added("ab"), ())
    kept: list[Any] = []
    run_rounds(EFFECTS, BASE, Options(), Progress(), kept.append)
    assert [[s.effect_at.effect for s in d.steps] for d in kept] == [[], ["a"], ["a", "b"]]
    assert all(d.ending is Ending.RUNNING and d.base is BASE for d in kept)
    assert [d.final.simulations for d in kept] == [0, 77, 77]


def test_what_the_pre_check_found_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    ByHand(monkeypatch, (), checked=[SimpleNamespace(effect_at=EffectAtJoint("limit", 1))])
    kept: list[Any] = []
    run_rounds(EFFECTS, BASE, Options(), Progress(), kept.append)
    assert [len(d.steps) for d in kept] == [0, 1]


@pytest.mark.parametrize("cut_in", [1, 2])
def test_a_round_that_the_time_cuts_decides_nothing(monkeypatch: pytest.MonkeyPatch, cut_in: int) -> None:
    """The best may be among those that were not tried: what complete rounds have accepted stays."""
    ByHand(monkeypatch, added("a"), added("ab"), ()).cut_in = cut_in
    found, _ = run()
    assert [s.effect_at.effect for s in found.steps] == ["a"][: cut_in - 1]
    assert found.ending is Ending.TIME_UP and found.refused == ()
    assert [len(comparison) for comparison in found.tried] == [1] * (cut_in - 1) + [2]


def test_what_was_out_of_reach_of_a_best_that_is_refused_is_fitted_after_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """A candidate that was left early is not lost where the best cannot be accepted."""
    reasons = ((EffectAtJoint("first", 1), "fails"),)
    competition = ByHand(monkeypatch, reasons, reasons)
    competition.unfitted = ("late",)
    found, _ = run()
    assert competition.reached == [("late",)]
    first, late = EffectAtJoint("first", 1), EffectAtJoint("late", 1)
    assert competition.judged == [[first], [first, late]]
    assert [(t.effect_at.effect, t.outcome) for t in found.tried[0]] == [
        ("a", Outcome.FITTED),
        ("late", Outcome.FITTED),
    ]
    assert found.refused == reasons


def test_what_was_out_of_reach_stays_so_where_the_best_is_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    competition = ByHand(monkeypatch, added("a"), added("ab"))
    competition.unfitted = ("late",)
    found, _ = run(rounds=2)
    assert competition.reached == [] and len(found.steps) == 2
    assert found.tried[0][0].outcome is Outcome.LEFT_EARLY


def test_without_all_signatures_nothing_is_decided(monkeypatch: pytest.MonkeyPatch) -> None:
    competition = ByHand(monkeypatch, added("a"))
    competition.left = (EffectAtJoint("b", 1),)
    found, _ = run()
    assert found.ending is Ending.TIME_UP and not competition.screened
    assert [(t.effect_at.effect, t.outcome) for t in found.tried[0]] == [
        (name, Outcome.NOT_TRIED) for name in ("a", "b", "shift")
    ]


def test_nothing_is_begun_when_the_time_is_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a pre-check would have tried is named, too."""
    competition = ByHand(monkeypatch)
    builder = Catalogue(*EFFECTS.effects.values(), effect_of("limit", is_proposed=False, pre_check="at the peaks"))
    found = run_rounds(builder, BASE, Options(forbid=frozenset({"a"})), Progress(ends=0.0))
    assert found.ending is Ending.TIME_UP and not competition.catalogues
    assert {t.effect_at.effect for t in found.tried[0]} == {"limit", "b", "shift"}


def test_a_search_that_went_through_is_complete(monkeypatch: pytest.MonkeyPatch) -> None:
    ByHand(monkeypatch, added("a"), ())
    assert run()[0].ending is Ending.COMPLETE


@pytest.mark.parametrize("time_is_up", [False, True])
def test_a_search_is_not_complete_where_the_time_was_up_in_what_follows_the_candidates(
    monkeypatch: pytest.MonkeyPatch, time_is_up: bool
) -> None:
    """What was begun last, such as gears with an error of their teeth, may have been cut: nothing is settled."""
    reasons = ((EffectAtJoint("b", 1), "too small"),)
    competition = ByHand(monkeypatch, added("a"), reasons)
    now = [0.0]

    def pair(*_: Any) -> None:
        now[0] = 9.0 if time_is_up else 4.0

    monkeypatch.setattr(rounds, "_pair", pair)
    found = run_rounds(EFFECTS, BASE, Options(), Progress(ends=5.0, now=lambda: now[0]))
    assert found.ending is (Ending.TIME_UP if time_is_up else Ending.COMPLETE)
    assert [s.effect_at.effect for s in found.steps] == ["a"] and found.refused == reasons
    assert competition.doubted == ([] if time_is_up else ["a"])


def test_a_model_that_stays_has_a_plant_of_its_own_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    """Candidates share plants in which others stand idle: what is accepted is fitted to its minimum without those."""
    stayed: list[Fit] = []
    monkeypatch.setattr(EFFECTS, "settled", lambda fit: stayed.append(fit) or replace(fit, simulations=99))
    competition = ByHand(monkeypatch, added("a"), ())
    found, _ = run()
    assert [fit.model.added_effects for fit in stayed] == 2 * [(EffectAtJoint("a", 1),)]
    assert found.final.simulations == 99 and competition.fitted


@pytest.mark.parametrize(("most", "count"), [(0, 0), (1, 1), (2, 2)])
def test_no_more_rounds_than_asked_for(monkeypatch: pytest.MonkeyPatch, most: int, count: int) -> None:
    ByHand(monkeypatch, added("a"), added("ab"), added("abc"))
    found, _ = run(rounds=most)
    assert len(found.steps) == count


def test_what_was_led_astray_or_in_vain_is_known_in_the_rounds_after(monkeypatch: pytest.MonkeyPatch) -> None:
    competition = ByHand(monkeypatch, added("a"), added("ab"), ())
    run(rounds=3)
    for lost in ([f.astray for f in competition.fruitless], [f.vain for f in competition.fruitless]):
        assert [{a.joint for a in known} for known in lost] == [set(), {1}, {1, 2}]


def test_effects_of_the_pre_check_count_as_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    competition = ByHand(monkeypatch, added("ab"), checked=[SimpleNamespace(effect_at=EffectAtJoint("limit", 1))])
    found, _ = run(rounds=2)
    assert [s.effect_at.effect for s in found.steps] == ["limit", "b"]
    assert competition.screened[0].model.added_effects == (EffectAtJoint("limit", 1),)
    assert competition.catalogues[0][0] is competition.screened[0]


def test_what_others_have_laid_bare_is_checked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A limit of the torque beside a payload: before that is in the model it is a small part of the gap."""
    limit = SimpleNamespace(effect_at=EffectAtJoint("limit", 1))
    competition = ByHand(monkeypatch, added("a"), (), (), again=[limit])
    found, _ = run()
    assert [s.effect_at.effect for s in found.steps] == ["a", "limit"]
    assert [len(steps) for steps in competition.backward] == [1, 2]  # what the limit makes superfluous is taken out
    assert [fit.simulations for fit in competition.checks] == [0, 77, 0]  # the last time beside the limit


def test_where_the_gap_is_closed_nothing_is_checked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    competition = ByHand(monkeypatch, added("a"), ())
    competition.gap_is_large = False
    run()
    assert len(competition.checks) == 1


@pytest.mark.parametrize(("outcomes", "count"), [([()], 1), ([added("a"), ()], 2)])
def test_the_same_fit_is_not_checked_twice(
    monkeypatch: pytest.MonkeyPatch, outcomes: Sequence[Any], count: int
) -> None:
    competition = ByHand(monkeypatch, *outcomes)
    run()
    assert len(competition.checks) == count


@pytest.mark.parametrize(("most", "found"), [(5, "acd"), (3, "acd"), (2, "a")])
def test_where_none_is_accepted_two_together_may_be(monkeypatch: pytest.MonkeyPatch, most: int, found: str) -> None:
    competition = ByHand(monkeypatch, added("a"), (), ())
    competition.pairs = ["cd"]
    assert "".join(s.effect_at.effect for s in run(rounds=most)[0].steps) == found
    assert competition.paired == {5: [1, 3], 3: [1], 2: []}[most][: len(competition.paired)]


def test_a_rival_that_explains_more_takes_the_place_and_the_search_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before two are tried together."""
    competition = ByHand(monkeypatch, added("a"), (), added("cb"), ())
    competition.exchanges = ["c"]
    found, _ = run()
    assert [s.effect_at.effect for s in found.steps] == ["c", "b"]
    assert (competition.contested, competition.paired) == (["a", "cb"], [2])
    assert competition.doubted == ["cb"]
    assert [a.effect for a in competition.screened[-1].model.added_effects] == ["c", "b"]


def test_rivals_are_told_apart_in_a_complete_search_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    competition = ByHand(monkeypatch, added("a"), added("ab"), ())
    competition.cut_in = 2
    assert run()[0].ending is Ending.TIME_UP and competition.doubted == []


@pytest.mark.parametrize(
    ("lead", "against", "wanted"),
    [
        (1.0, "lowest", "first"),  # a damping that the fitted motion does not show
        (1.0, "", "lowest"),
        (1.0, "first", "lowest"),
        (1.0, "both", "lowest"),  # the rounds and the final model say the rest
        (4.0, "lowest", "lowest"),  # the data tell them apart
    ],
)
def test_of_two_fits_that_the_data_hardly_tell_apart_held_out_data_choose(
    monkeypatch: pytest.MonkeyPatch, lead: float, against: str, wanted: str
) -> None:
    before = with_effects()
    fits = {"lowest": replace(before, chi_square=100.0), "first": replace(before, chi_square=100.0 + lead)}
    spoken = [fits[name] for name in fits if against in (name, "both")]
    monkeypatch.setattr(
        rounds, "held_out_objection", lambda one, other, **_: "worse" if any(other is f for f in spoken) else ""
    )  # fmt: skip
    assert _along_valley(before, candidate_of("a", fit=fits["first"]), fits["lowest"], Options()) is fits[wanted]


class Pairs:
    """Candidates that held-out data speak against, and what they say of two of them.

    Args:
        helps: pairs of effects that are accepted, the first one in the model first.
        against: the fit before, of which held-out data say that a pair does not help.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, helps: Sequence[str], against: str = "") -> None:
        self.helps, self.against = helps, against
        self.tried: list[str] = []
        monkeypatch.setattr(rounds, "Competition", lambda builder, fit: self.competition(builder, fit))
        monkeypatch.setattr(rounds, "objection", self.objection)
        monkeypatch.setattr(rounds, "held_out_objection", self.held_out)
        monkeypatch.setattr(rounds, "minimise", lambda model, noise, **more: fit_of(model, values=model.start))
        monkeypatch.setattr(rounds, "step_of", lambda c, ranking, *_: step(c))
        monkeypatch.setattr(rounds, "without_superfluous", lambda builder, fit, steps, *_: (fit, steps))

    def competition(self, builder: Any, fit: Fit) -> Any:
        names = "".join(a.effect for a in fit.model.added_effects)

        def refit(proposal: Proposal) -> Fit | None:
            self.tried.append(names + proposal.effect_at.effect)
            return with_effects(*names, proposal.effect_at.effect)

        return SimpleNamespace(
            builder=builder, fit=fit, refit=refit, finished=lambda c: c,
            assess=lambda at, found: candidate_of(at.effect, fit=found),
        )  # fmt: skip

    def objection(self, candidate: FittedCandidate, fit: Fit, *_: Any, base: Fit) -> str:
        names = "".join(a.effect for a in candidate.fit.model.added_effects)
        if len(names) == 1:
            return "too small" if names == "d" else f"{rounds.FAILS_HELD_OUT} 1.1"
        return "" if names in self.helps else f"{rounds.FAILS_HELD_OUT} 1.1"

    def held_out(self, before: Fit, after: Fit, *, seed: int) -> str:
        names = "".join(a.effect for a in before.model.added_effects) or "none"
        return "does not help" if names == self.against else ""


def step(candidate: FittedCandidate) -> Step:
    return Step(candidate.effect_at, 1.0, 1.0, 1.0, (), {}, {}, None)


@pytest.mark.parametrize(
    ("helps", "against", "tried", "found"),
    [
        (["ab"], "", ["ab"], "ab"),
        (["ac"], "", ["ab", "ac"], "ac"),
        (["bc"], "", ["ab", "ac", "bc"], "bc"),
        ([], "", ["ab", "ac", "bc"], ""),
        (["ab"], "b", ["ab", "ac", "bc"], ""),  # the first one says nothing beside the second
        (["ab"], "none", ["ab", "ac", "bc"], ""),  # both together do not help
        (["ad"], "", ["ab", "ac", "bc"], ""),  # more than held-out data speaks against the fourth
    ],
)
def test_two_effects_that_confirm_each_other(
    monkeypatch: pytest.MonkeyPatch, helps: Sequence[str], against: str, tried: list[str], found: str
) -> None:
    """A tilted base and a lag of the drive: either was refused because the other was not in the model."""
    pairs = Pairs(monkeypatch, helps, against)
    said: list[str] = []
    builder = Catalogue(*(effect_of(name) for name in "abcde"))
    ranking = [candidate_of(name, fit=with_effects(name)) for name in "dabc"] + [candidate_of("e", bic=9.0)]
    competition = pairs.competition(builder, BASE)
    added_now = rounds._pair(competition, ranking, BASE, [], Options(), Progress(said.append))
    assert pairs.tried == tried
    if not found:
        assert added_now is None and said == []
        return
    assert added_now is not None
    fit, steps = added_now
    assert [a.effect for a in fit.model.added_effects] == list(found) == [s.effect_at.effect for s in steps]
    assert "only beside" in steps[0].remark and steps[1].remark == ""
    assert said == [f"added together: {found[0]} on joint 1 and {found[1]} on joint 1"]


def test_two_forms_of_one_effect_are_no_pair(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = Pairs(monkeypatch, ["ab"])
    builder = Catalogue(*(effect_of(name, class_name="one") for name in "ab"))
    ranking = [candidate_of(name, fit=with_effects(name)) for name in "ab"]
    assert rounds._pair(pairs.competition(builder, BASE), ranking, BASE, [], Options(), Progress()) is None
    assert pairs.tried == []


def test_signatures_are_made_anew_when_the_samples_shift(monkeypatch: pytest.MonkeyPatch) -> None:
    shifted = added(["shift"], owner=LOG)
    competition = ByHand(monkeypatch, shifted, added(["shift", "b"], owner=LOG), ())
    run()
    assert [[c.effect for c in candidates] for _, candidates in competition.catalogues] == [
        ["a", "b", "shift"],
        ["a", "b"],
    ]
    assert competition.catalogues[1][0].simulations == 77


@pytest.mark.parametrize(
    ("forbid", "wanted"), [((), ["a1", "a2", "b1", "b2", "shift1", "shift2"]), (("a", "shift"), ["b1", "b2"])]
)
def test_candidates_are_all_that_may_be_proposed_on_all_joints(forbid: Sequence[str], wanted: list[str]) -> None:
    builder = Catalogue(*EFFECTS.effects.values(), joints=2)
    found = _candidates(builder, Options(forbid=frozenset(forbid)))
    assert [f"{c.effect}{c.joint}" for c in found] == wanted


def test_what_the_robot_has_already_is_no_candidate() -> None:
    builder = Catalogue(*EFFECTS.effects.values(), joints=2)
    builder.description = SimpleNamespace(
        joints=[SimpleNamespace(effects=["a"]), SimpleNamespace(effects=["b", "shift"])]
    )
    found = _candidates(builder, Options())
    assert [f"{c.effect}{c.joint}" for c in found] == ["a2", "b1", "shift1"]


GEARED = Catalogue(effect_of("a"), effect_of("gear", elastic=True), effect_of("teeth", needs_elastic=True), joints=2)


def test_what_acts_in_a_gear_is_a_candidate_where_one_was_added() -> None:
    def found(*added: EffectAtJoint) -> list[str]:
        return [f"{c.effect}{c.joint}" for c in _candidates(GEARED, Options(), added)]

    without = ["a1", "a2", "gear1", "gear2"]
    assert found() == without and found(EffectAtJoint("a", 2)) == without
    assert found(EffectAtJoint("gear", 2)) == [*without, "teeth2"]


def test_signatures_of_what_acts_in_a_gear_are_those_beside_all_that_was_found() -> None:
    """The gear rings otherwise with each effect; all other signatures stay as they are."""
    asked: list[tuple[Fit, list[EffectAtJoint]]] = []

    def extended(fit: Fit, candidates: list[EffectAtJoint], progress: Progress) -> Any:
        asked.append((fit, candidates))
        return "more"

    catalogue: Any = SimpleNamespace(fit=BASE, extended=extended)
    for names, more in ((("a",), []), (("gear",), ["teeth"]), (("gear", "a"), ["teeth"]), (("gear", "teeth"), [])):
        fit, asked[:] = with_effects(*names), []
        candidates = [c for c in _candidates(GEARED, Options(), fit.model.added_effects) if c.joint == 1]
        found = _beside(GEARED, catalogue, fit, candidates, Progress())
        assert [[c.effect for c in joined] for at, joined in asked if at is fit] == ([more] if more else [])
        assert found == ("more" if more else catalogue)


@pytest.mark.parametrize(("described", "wanted"), [(True, ["a1"]), (False, ["a1", "coulomb1"])])
def test_what_every_robot_has_is_a_candidate_for_a_black_box(described: bool, wanted: list[str]) -> None:
    """Unless its parameters are identified: then the base model has it."""
    known = effect_of("viscous", is_proposed=False, is_base=True)
    builder = Catalogue(effect_of("a"), effect_of("coulomb", is_proposed=False, is_base=True), known)
    builder.identified = {"viscous"}
    if described:
        builder.description = SimpleNamespace(joints=[SimpleNamespace(effects=[])])
    assert [f"{c.effect}{c.joint}" for c in _candidates(builder, Options())] == wanted


def backward(
    monkeypatch: pytest.MonkeyPatch, squares: dict[tuple[str, ...], float | None], names: str = "ab",
    costs: dict[str, float] | None = None, **options: Any,
) -> tuple[Fit, list[str], list[Any], list[str]]:  # fmt: skip
    """The backward test with given mean squares of the models that have these effects."""
    calls: list[Any] = []

    def minimise(model: TableModel, noise: Any, **more: Any) -> Fit:
        names = tuple(a.effect for a in model.added_effects)
        calls.append((names, more))
        square = squares[names]
        if square is None:
            raise SimulationError("It diverges.", next_step="Change it.")
        slopes = np.ones((400, 1, len(model.free_parameters)))
        return fit_of(replace(model, own=residual(square)), values=model.start, jacobian=slopes)

    monkeypatch.setattr(beside_others, "minimise", minimise)
    steps = [Step(EffectAtJoint(n, 1), 100.0, 1.0, 0.5, (), {}, {}, None) for n in names]
    said: list[str] = []
    fit, left = without_superfluous(
        Removable(costs=costs), with_effects(*names, square=1.0), steps, Options(**options), Progress(said.append)
    )  # fmt: skip
    for step in left[:-1] if None not in squares.values() else ():  # the fit without it is kept, for its evidence
        assert step.without is not None and step.effect_at not in step.without.model.added_effects
    return fit, [s.effect_at.effect for s in left], calls, said


def test_effects_that_still_explain_much_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    fit, left, calls, said = backward(monkeypatch, {("b",): 2.0})
    assert left == ["a", "b"] and said == []
    assert [a.effect for a in fit.model.added_effects] == ["a", "b"]
    ((names, more),) = calls
    assert names == ("b",) and more["stopping"] == Stopping(updates=1)
    # The sensitivities of all parameters that stay: of the base and of b.
    assert more["jacobian"][0, 0].tolist() == [1.0, 3.0]


@pytest.mark.parametrize(
    ("square", "cost", "stays"),
    [
        # 400 samples of which all count: 400 log(square) - cost log 400 against 10.
        (float(np.exp((10.01 + 5.9914645) / 400)), 1.0, True),
        (float(np.exp((9.99 + 5.9914645) / 400)), 1.0, False),
        (float(np.exp((10.01 + 3 * 5.9914645) / 400)), 3.0, True),
        (float(np.exp((9.99 + 3 * 5.9914645) / 400)), 3.0, False),
    ],
)
def test_an_effect_that_is_worth_little_more_is_taken_out(
    monkeypatch: pytest.MonkeyPatch, square: float, cost: float, stays: bool
) -> None:
    fit, left, _, said = backward(monkeypatch, {("b",): square}, costs={"a": cost})
    assert left == (["a", "b"] if stays else ["b"])
    assert said == ([] if stays else ["taken out again: a on joint 1"])
    assert [a.effect for a in fit.model.added_effects] == left


@pytest.mark.parametrize(("size", "stays"), [(0.101, True), (0.099, False)])
def test_half_of_the_smallest_gain_must_remain(monkeypatch: pytest.MonkeyPatch, size: float, stays: bool) -> None:
    _, left, _, _ = backward(monkeypatch, {("b",): 1.0 + size**2}, threshold=-1e3)
    assert left == (["a", "b"] if stays else ["b"])


def test_half_of_the_smallest_gain_is_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    _, left, _, _ = backward(monkeypatch, {("b",): 4.0}, threshold=-1e3, smallest_gain=2 * float(np.sqrt(3.0)))
    assert left == ["a", "b"]


def test_what_is_left_is_fitted_once_more(monkeypatch: pytest.MonkeyPatch) -> None:
    _, _, calls, _ = backward(monkeypatch, {("b",): 1.0})
    assert [(names, sorted(more)) for names, more in calls] == [(("b",), ["jacobian", "stopping"]), (("b",), [])]


def test_all_but_the_newest_are_tested_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    squares = {("b", "c"): 1.0, ("c",): 1.0, ("a", "c"): 2.0}
    fit, left, calls, _ = backward(monkeypatch, squares, names="abc")
    assert left == ["c"] and [a.effect for a in fit.model.added_effects] == ["c"]
    assert [names for names, _ in calls] == [("b", "c"), ("b", "c"), ("c",), ("c",)]


def test_an_effect_without_which_nothing_runs_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    _, left, _, _ = backward(monkeypatch, {("b", "c"): None, ("a", "c"): 1.0}, names="abc")
    assert left == ["a", "c"]


@pytest.mark.parametrize(
    ("others", "shapes", "why", "count"),
    [
        ((), ("vs",), "", 2),
        (None, ("vs",), "", 0),
        ((), (), "", 0),
        (None, ("vs",), "may be absent: Fs = 1 ± 2", 2),
        ((), ("vs",), "may be absent: Fs = 1 ± 2", 0),
        (None, (), "may be absent: Fs = 1 ± 2", 0),
    ],
)
def test_shapes_are_held_outside_the_torque_balance_and_in_it_where_an_amplitude_is_not_told(
    others: Any, shapes: tuple[str, ...], why: str, count: int
) -> None:
    asked: list[Any] = []

    def held(candidate: Any) -> Any:
        asked.append(candidate)
        return iter(["one", "two"])

    builder = SimpleNamespace(at=lambda effect_at: SimpleNamespace(shapes=shapes))
    competition = SimpleNamespace(builder=builder, with_shapes_held=held)
    wanted, other = (
        ScreenedCandidate(SimpleNamespace(effect_at=EffectAtJoint(n, 1)), np.ones(1), 1.0, 1.0, others)
        for n in ("b", "a")
    )
    found = list(_with_shapes_held(competition, [other, wanted], candidate_of("b", implausible=why)))
    assert len(found) == count
    assert asked == ([wanted] if count else [])


@pytest.mark.parametrize(
    ("present", "allowed", "left", "wanted"),
    [
        (["drift"], True, ["coulomb"], ["coulomb from the base"]),  # the only other one goes
        (["drift", "spring"], True, ["spring", "coulomb"], ["spring", "coulomb"]),
        (["drift"], True, ["drift", "coulomb"], None),  # nothing is superfluous beside it
        (["drift"], False, ["coulomb"], None),
        ([], True, ["coulomb"], None),
    ],
)
def test_an_effect_of_every_base_model_takes_the_place_of_what_it_makes_superfluous(
    monkeypatch: pytest.MonkeyPatch, present: list[str], allowed: bool, left: list[str], wanted: list[str] | None
) -> None:
    """Whatever part of the first gap it explains, as long as nothing else speaks against it."""
    coulomb = candidate_of("coulomb", fit=with_effects("drift", "coulomb"))
    spring = candidate_of("spring", fit=with_effects("drift", "spring"))
    asked: list[tuple[tuple[FittedCandidate, ...], float]] = []

    def decide(ranking: Any, fit: Fit, options: Options, **_: Any) -> Any:
        asked.append((ranking, options.smallest_part))
        return ranking[0] if allowed else ((ranking[0].effect_at, "its values are not possible"),)

    class FromBase(SimpleNamespace):
        def assess(self, effect_at: EffectAtJoint, fit: Fit) -> FittedCandidate:
            return candidate_of(f"{effect_at.effect} from the base", fit=fit)

    def backward(builder: Any, fit: Fit, steps: list[Any], *_: Any) -> Any:
        return fit, [step for step in steps if step.effect_at.effect in left]

    monkeypatch.setattr(rounds, "decide", decide)
    monkeypatch.setattr(rounds, "minimise", lambda model, noise, **_: fit_of(model, values=model.start))
    monkeypatch.setattr(rounds, "step_of", lambda accepted, *_: SimpleNamespace(effect_at=accepted.effect_at))
    monkeypatch.setattr(rounds, "without_superfluous", backward)
    monkeypatch.setattr(rounds, "Competition", lambda builder, fit: FromBase())
    builder = Catalogue(effect_of("drift"), effect_of("spring"), effect_of("coulomb", is_base=True))
    competition = SimpleNamespace(builder=builder, fit=with_effects("drift"), finished=None)
    steps = [SimpleNamespace(effect_at=EffectAtJoint(name, 1)) for name in present]
    found = _base_instead(competition, [spring, coulomb], BASE, steps, Options(), Progress())  # type: ignore[arg-type]
    assert asked == ([((coulomb,), 0.0)] if present else [])
    assert (None if found is None else [step.effect_at.effect for step in found[1]]) == wanted


@pytest.mark.parametrize(
    ("squares", "costs", "names", "wanted"),
    [
        ({"b": 2.0, "a": 3.0}, {}, "ab", "ba"),  # without b the rest is 3, without a it is 2
        ({"b": 3.0, "a": 2.0}, {}, "ab", "ab"),
        ({"b": 2.0, "a": 2.0}, {}, "ab", "ab"),  # as they were found
        ({"b": 2.0, "a": 2.0}, {"a": 3.0}, "ab", "ba"),  # what takes more parameters explains less
        ({"bc": 2.0, "ac": 4.0, "ab": 3.0}, {}, "abc", "bca"),
        ({"b": None, "a": 9.0}, {}, "ab", "ab"),  # without a the loop cannot run
        ({}, {}, "a", "a"),
    ],
)
@pytest.mark.parametrize("known", [True, False])
def test_effects_are_named_by_what_each_explains_beside_all_others(
    monkeypatch: pytest.MonkeyPatch, squares: dict[str, float | None], costs: dict[str, float], names: str,
    wanted: str, known: bool,
) -> None:  # fmt: skip
    """By the fits of the backward test where these lack one effect alone, else by new ones."""
    asked: list[str] = []

    def minimise(model: TableModel, noise: Any, **more: Any) -> Fit:
        kept = "".join(a.effect for a in model.added_effects)
        asked.append(kept)
        square = squares[kept]
        if square is None:
            raise SimulationError("It diverges.", next_step="Change it.")
        return fit_of(replace(model, own=residual(square)), values=model.start)

    monkeypatch.setattr(beside_others, "minimise", minimise)
    whole, builder = with_effects(*names, square=1.0), Removable(*map(effect_of, names), costs=costs)
    steps = [Step(EffectAtJoint(n, 1), 100.0, 1.0, 0.5, (), {}, {}, None) for n in names]
    if known and None not in squares.values():
        others = ["".join(n for n in names if n != s.effect_at.effect) for s in steps]
        steps = [
            replace(s, without=with_effects(*kept, square=squares.get(kept, 1.0)))
            for s, kept in zip(steps, others, strict=True)
        ]
    found = by_importance(steps, whole, builder)
    assert "".join(s.effect_at.effect for s in found) == wanted
    assert len(asked) == (0 if len(names) == 1 or (known and None not in squares.values()) else len(names))


def test_the_fit_before_a_later_effect_does_not_say_what_an_earlier_one_explains(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It lacks both: all that both explain would be one's own."""
    squares = {"b": 2.0, "a": 3.0}
    monkeypatch.setattr(
        beside_others, "minimise",
        lambda model, noise, **_: fit_of(
            replace(model, own=residual(squares["".join(a.effect for a in model.added_effects)])), values=model.start
        ),
    )  # fmt: skip
    steps = [
        Step(EffectAtJoint("a", 1), 100.0, 1.0, 0.5, (), {}, {}, None, without=with_effects(square=50.0)),
        Step(EffectAtJoint("b", 1), 100.0, 1.0, 0.5, (), {}, {}, None, without=with_effects("a", square=3.0)),
    ]
    found = by_importance(steps, with_effects("a", "b", square=1.0), Removable(*map(effect_of, "ab")))
    assert [s.effect_at.effect for s in found] == ["b", "a"]


@pytest.mark.parametrize(
    ("order", "wanted"),
    [
        (["torque_offset@1", "spring@1"], ["spring@1", "torque_offset@1"]),
        (["spring@1", "torque_offset@1"], ["spring@1", "torque_offset@1"]),
        (["torque_offset@1", "spring@2"], ["torque_offset@1", "spring@2"]),
        (["torque_offset@1", "stribeck@2", "spring@1"], ["stribeck@2", "spring@1", "torque_offset@1"]),
        (
            ["torque_offset@2", "torque_offset@1", "spring@1", "stribeck@2"],
            ["torque_offset@2", "spring@1", "torque_offset@1", "stribeck@2"],
        ),
        (["torque_offset@1"], ["torque_offset@1"]),
    ],
)
def test_where_a_spring_rests_is_named_behind_it(order: list[str], wanted: list[str]) -> None:
    """However much the constant explains."""
    places = [EffectAtJoint(name, int(joint)) for name, joint in (one.split("@") for one in order)]
    steps = [Step(a, 100.0, 1.0, 0.5, (), {}, {}, None) for a in places]
    builder: Any = Catalogue(effect_of("spring", rest="torque_offset"), *map(effect_of, ("torque_offset", "stribeck")))
    found = _rests_last(steps, builder)
    assert [f"{s.effect_at.effect}@{s.effect_at.joint}" for s in found] == wanted
