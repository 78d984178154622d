"""What explains the data as well as an effect that was found: named instead, a doubt, or behind."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection import rivals
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.decide import Options, Step
from fmu_didim.discovery.selection.parts import Part
from fmu_didim.discovery.selection.rivals import (
    Contest,
    Rivalry,
    Standing,
    _remark,
    ambiguities,
    fitted_rival,
    from_where_named,
    of_one_period,
    promising_instead,
    rivals_of,
    standing,
)
from fmu_didim.fit.fit import Fit
from fmu_didim.model.free_parameter import FreeParameter
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.by_hand import Catalogue, TableModel, candidate_of, effect_of, fit_of, residual

BUILDER: Any = Catalogue(
    effect_of("elastic", title="Elastic gear", confounded_with=("play", "lag")),
    effect_of("play", title="Play", has_minima=True, confounded_with=("elastic",)),
    effect_of("lag", title="Lag"), effect_of("gains", is_stated=True, confounded_with=("lag",)),
    effect_of("slide", title="Slide", class_name="rubs"),
    effect_of("rub", title="Rub", class_name="rubs"),
    joints=2,
)  # fmt: skip
CATALOGUE: Any = SimpleNamespace(fit=None)
"""Of signatures, of which a single effect asks none."""
ABSENT = "may be absent: gap = 0.012 ± 0.01 (p = 0.24)"


@pytest.mark.parametrize(
    ("lead", "objected", "wanted"),
    [
        (11.0, "", Standing.AHEAD),
        (10.0, "", Standing.AS_GOOD),
        (-10.0, "", Standing.AS_GOOD),
        (-10.1, "", Standing.BEHIND),
        (500.0, "held-out RMS ratio 1.02, its interval reaches 1.1", Standing.BEHIND),
        (500.0, "physically impossible: a negative stiffness", Standing.BEHIND),
        (12.0, ABSENT, Standing.AS_GOOD),  # play of an unsure width explains what an elastic gear does not
        (0.1, ABSENT, Standing.AS_GOOD),
        (-5.0, ABSENT, Standing.BEHIND),  # play of no width is the elastic gear itself, with more parameters
    ],
)
def test_how_a_rival_stands(lead: float, objected: str, wanted: Standing) -> None:
    assert standing(lead, 10.0, objected) is wanted


def model_with(*effects: EffectAtJoint, square: float = 2.0) -> Fit:
    return fit_of(TableModel(residual(square), {}, effects))


def at(name: str, joint: int = 1) -> EffectAtJoint:
    return EffectAtJoint(name, joint)


def found(effect_at: EffectAtJoint, *ambiguous: tuple[EffectAtJoint, float], **more: Any) -> Step:
    return Step(effect_at, 100.0, 1.0, 0.5, ambiguous, {}, {}, None, **more)


@pytest.mark.parametrize(
    ("step", "others", "forbidden", "wanted"),
    [
        (found(at("slide"), (at("lag"), 3.0)), (), (), [at("lag")]),
        (found(at("slide"), (at("rub"), 3.0)), (), (), []),  # a form of the same
        (found(at("slide"), (at("rub", 2), 3.0)), (), (), [at("rub", 2)]),  # on another joint it is not
        (found(at("slide"), (at("lag"), float("nan"))), (), (), []),  # it was never fitted
        (found(at("slide"), (at("lag"), 3.0)), (at("lag"),), (), []),  # it was found as well
        (found(at("elastic")), (), (), [at("play")]),  # whose fit in the round tells little; a lag's tells enough
        (found(at("elastic"), (at("play"), 3.0)), (), (), [at("play")]),
        (found(at("elastic")), (), ("play",), []),
        (found(at("play")), (), (), []),
    ],
)
def test_who_is_a_rival(
    step: Step, others: tuple[EffectAtJoint, ...], forbidden: tuple[str, ...], wanted: list[EffectAtJoint]
) -> None:
    fit = model_with(step.effect_at, *others)
    assert list(rivals_of(BUILDER, fit, step, Options(forbid=frozenset(forbidden)))) == wanted


class Beside:
    """The other effects, beside which candidates have these gains.

    Args:
        gains: of the effect that is named and its rivals. widely: squares that are left from the whole range.
    """

    builder = BUILDER

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, gains: dict[str, float], *, widely: float | None = None,
        objected: str = "",
    ) -> None:  # fmt: skip
        self.gains, self.objected, self.started = gains, objected, list[Proposal]()
        self.fit = model_with()
        monkeypatch.setattr(rivals, "Competition", lambda builder, fit: self)
        monkeypatch.setattr(rivals, "fit_without", lambda builder, fit, step: self.fit)
        monkeypatch.setattr(rivals, "objection", lambda candidate, *_, **__: self.objected)
        monkeypatch.setattr(
            rivals, "searched_widely",
            lambda beside, rival, **_: None if widely is None else self.assess(rival, model_with(rival, square=widely)),
        )  # fmt: skip
        monkeypatch.setattr(rivals, "fitted_to_minimum", lambda builder, candidate: candidate)
        monkeypatch.setattr(rivals, "without_superfluous", lambda builder, fit, steps, *_: (fit, steps))
        monkeypatch.setattr(rivals, "step_of", lambda accepted, ranking, *_: found(accepted.effect_at))

    def refit(self, proposal: Proposal, **_: Any) -> Fit:
        self.started.append(proposal)
        return model_with(proposal.effect_at)

    def finished(self, candidate: FittedCandidate) -> FittedCandidate:
        return candidate

    def assess(self, effect_at: EffectAtJoint, fit: Fit) -> FittedCandidate:
        return candidate_of(effect_at.effect, effect_at.joint, bic=self.gains[effect_at.effect], fit=fit)


LAG = found(at("slide"), (at("lag"), 3.0), members=(Proposal(at("lag"), {"T": 0.01}),))


@pytest.mark.parametrize(
    ("gains", "objected", "instead", "doubted"),
    [
        ({"slide": 100.0, "lag": 80.0}, "", False, False),
        ({"slide": 100.0, "lag": 95.0}, "", False, True),
        ({"slide": 100.0, "lag": 130.0}, "", True, False),
        ({"slide": 100.0, "lag": 130.0}, "held-out RMS ratio 1.1", False, False),
        ({"slide": 1000.0, "lag": 985.0}, "", False, True),  # within 2 % of the gain no form is exact
        ({"slide": 1000.0, "lag": 1015.0}, "", False, True),
    ],
)
def test_a_rival_is_named_instead_doubted_or_behind(
    monkeypatch: pytest.MonkeyPatch, gains: dict[str, float], objected: str, instead: bool, doubted: bool
) -> None:
    beside, fit, said = Beside(monkeypatch, gains, objected=objected), model_with(at("slide")), list[str]()
    rivalry = Rivalry(BUILDER, fit, Options(), Progress(said.append))
    changed = rivalry.instead(fit, [LAG], CATALOGUE)
    assert (changed is not None) == instead
    if changed is not None:
        whole, (step,) = changed
        assert whole.model.added_effects == (at("lag"),) and step.effect_at == at("lag")
        assert "accepted first" in step.remark and "30 more in BIC" in step.remark
    (told,) = rivalry.told(fit, [LAG])
    assert bool(told.rivals) == (doubted or instead)
    assert len(beside.started) == 1, "one contest is enough"
    if doubted:
        (doubt,) = ambiguities(BUILDER, [told])
        assert (
            doubt.code.name == "effect-ambiguous" and doubt.place == "slide, joint 1" and "Lag on joint 1" in doubt.text
        )


@pytest.mark.parametrize(
    ("named", "rival", "gain", "prefer", "wanted"),
    [
        ("lag", "gains", 120.0, (), Standing.BEHIND),  # the case states the gains: a lag that explains 83 % is named
        ("lag", "gains", 130.0, (), Standing.AHEAD),
        ("slide", "gains", 120.0, (), Standing.AHEAD),  # which gains do not resemble
        ("slide", "lag", 130.0, ("slide",), Standing.AS_GOOD),
        ("slide", "lag", 130.0, ("lag",), Standing.AHEAD),
    ],
)
def test_what_is_stated_or_preferred_stays(
    monkeypatch: pytest.MonkeyPatch, named: str, rival: str, gain: float, prefer: tuple[str, ...], wanted: Standing
) -> None:
    beside: Any = Beside(monkeypatch, {})
    held = Contest(beside, candidate_of(named, bic=100.0), ((candidate_of(rival, bic=gain), ""),))
    assert [how for _, _, how in held.standings(Options(prefer=prefer))] == [wanted]


@pytest.mark.parametrize(
    ("rival", "gain", "objected", "odd", "wanted"),
    [
        ("play", 81.0, "", "", Standing.AHEAD),  # four fifths are enough beside values that hardly any machine has
        ("play", 79.0, "", "", Standing.BEHIND),
        ("play", 81.0, "held-out RMS ratio 1.1", "", Standing.BEHIND),
        ("play", 81.0, "", "D1 = -3", Standing.BEHIND),  # as odd itself
        ("rub", 81.0, "", "", Standing.BEHIND),  # nothing that it is confounded with
        ("rub", 95.0, "", "", Standing.AS_GOOD),
    ],
)
def test_an_effect_with_odd_values_gives_way(
    monkeypatch: pytest.MonkeyPatch, rival: str, gain: float, objected: str, odd: str, wanted: Standing
) -> None:
    beside: Any = Beside(monkeypatch, {})
    named = candidate_of("elastic", bic=100.0, unusual="K1 = 3, usual is above 100")
    held = Contest(beside, named, ((candidate_of(rival, bic=gain, unusual=odd), objected),))
    assert [how for _, _, how in held.standings(Options())] == [wanted]
    prefer = Standing.AS_GOOD if wanted is Standing.AHEAD else wanted
    assert [how for _, _, how in held.standings(Options(prefer=("elastic",)))] == [prefer]


@pytest.mark.parametrize(
    ("named", "gain", "wanted"),
    [
        ("play", 120.0, Standing.AS_GOOD),  # it explains more, but with values that hardly any machine has
        ("play", 130.0, Standing.AHEAD),  # far more
        ("play", 80.0, Standing.BEHIND),
        ("slide", 120.0, Standing.AHEAD),  # nothing that it is confounded with
    ],
)
def test_a_rival_with_odd_values_does_not_take_the_place(
    monkeypatch: pytest.MonkeyPatch, named: str, gain: float, wanted: Standing
) -> None:
    """A stop at which the joint always lies had come to stand for a constant."""
    beside: Any = Beside(monkeypatch, {})
    odd = candidate_of("elastic", bic=gain, unusual="K1 = 3, usual is above 100")
    held = Contest(beside, candidate_of(named, bic=100.0), ((odd, ""),))
    assert [how for _, _, how in held.standings(Options())] == [wanted]


@pytest.mark.parametrize(
    ("lead", "said"),
    [
        (30.0, "explains 30 more in BIC in its place"),
        (-30.0, "but acts at 80 % of the positions; beside all others an"),
    ],
)
def test_why_a_rival_is_named_instead(lead: float, said: str) -> None:
    named = candidate_of("slide", bic=583.0, unusual="acts at 80 % of the positions")
    text = _remark(named, "Slide", "an offset", lead)
    assert said in text and text.startswith("Slide on joint 1 was accepted first")
    assert ("553 of 583 in BIC" in text) == (lead < 0)


@pytest.mark.parametrize(
    ("named", "is_nested", "gain", "cost", "more", "wanted"),
    [
        ("play", True, 95.0, 2.0, {}, Standing.AHEAD),  # an elastic gear that hardens, where play is of no width
        ("play", True, 89.0, 2.0, {}, Standing.BEHIND),
        ("play", True, 95.0, 2.0, {"objected": "held-out RMS ratio 1.1"}, Standing.BEHIND),
        ("play", True, 95.0, 4.0, {}, Standing.AS_GOOD),  # no simpler
        ("play", False, 95.0, 2.0, {}, Standing.AS_GOOD),
        ("slide", False, 95.0, 2.0, {}, Standing.AHEAD),  # a constant where one that settles was named
        ("slide", False, 104.0, 2.0, {}, Standing.AHEAD),
        ("slide", False, 89.0, 2.0, {}, Standing.BEHIND),
        ("slide", False, 95.0, 4.0, {}, Standing.AS_GOOD),
        ("slide", False, 95.0, 2.0, {"unusual": "k = 9, usual is 0 to 1"}, Standing.AS_GOOD),
        ("slide", False, 104.0, 2.0, {"objected": ABSENT}, Standing.AS_GOOD),
    ],
)
def test_of_those_as_good_the_one_with_fewer_values_is_named(
    monkeypatch: pytest.MonkeyPatch, named: str, is_nested: bool, gain: float, cost: float, more: dict[str, str],
    wanted: Standing,
) -> None:  # fmt: skip
    beside: Any = Beside(monkeypatch, {})
    rival = candidate_of("elastic", bic=gain, cost=cost, unusual=more.get("unusual", ""))
    first = candidate_of(named, bic=100.0, cost=4.0)
    held = Contest(beside, first, ((rival, more.get("objected", "")),), is_nested=is_nested)
    assert [how for _, _, how in held.standings(Options())] == [wanted]
    kept = Standing.AS_GOOD if wanted is Standing.AHEAD else wanted
    assert [how for _, _, how in held.standings(Options(prefer=(named,)))] == [kept]
    if wanted is Standing.AHEAD and gain < 100:
        assert "play explains" not in (text := _remark(first, "Play", "elastic gear", gain - 100.0))
        assert text.endswith("elastic gear explains as much in its place, with fewer values.")


class Gears(Beside):
    """Gears, what acts in them, and what a search for that finds.

    Args:
        inside: gain of what acts in the gear that is named, beside it; None where nothing does. objected: to it.
    """

    builder: Any = Catalogue(
        effect_of("elastic", title="Elastic gear", elastic=True, confounded_with=("play",)),
        effect_of("play", title="Play", elastic=True, has_minima=True, confounded_with=("elastic",)),
        effect_of("hard", title="Hardening", needs_elastic=True, confounded_with=("play",)),
        effect_of("teeth", title="Teeth", needs_elastic=True, frequency="number", confounded_with=("hard",)),
    )  # fmt: skip

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, gains: dict[str, float], inside: float | None, objected: str = "",
        square: float = 2.0,
    ) -> None:  # fmt: skip
        super().__init__(monkeypatch, gains, widely=0.5)
        self.asked: list[str] = []
        self.named = model_with(at("elastic"), square=square)

        def searched(how: str) -> Any:
            def found_inside(*_: Any) -> FittedCandidate | None:
                self.asked.append(how)
                fit = model_with(at("elastic"), at("hard"))
                return None if inside is None else candidate_of("hard", bic=inside, fit=fit)

            return found_inside

        monkeypatch.setattr(rivals, "harder", searched("beside"))
        monkeypatch.setattr(rivals, "hardened", searched("together"))
        monkeypatch.setattr(rivals, "inside_objection", lambda *_: objected)
        monkeypatch.setattr(rivals, "hardening_instead", lambda *_: self.asked.append("instead") or ())
        monkeypatch.setattr(
            rivals, "objection", lambda candidate, *_, **__: objected if candidate.effect_at == at("hard") else ""
        )

    def changed(self, rivalry: Rivalry | None = None) -> tuple[list[EffectAtJoint], str] | None:
        rivalry = rivalry or Rivalry(self.builder, self.named, Options(), Progress())
        found_instead = rivalry.instead(self.named, [found(at("elastic"), (at("play"), 3.0))], CATALOGUE)
        return None if found_instead is None else ([s.effect_at for s in found_instead[1]], found_instead[1][-1].remark)


BOTH = [at("elastic"), at("hard")]


@pytest.mark.parametrize(
    ("inside", "objected", "wanted"),
    [
        (30.0, "", BOTH),  # as much as play has more than the gear that does not harden
        (29.0, "", [at("play")]),
        (90.0, "physically impossible: K_cubic below 0", [at("play")]),
        (None, "", [at("play")]),
    ],
)
def test_play_does_not_take_the_place_of_a_gear_that_explains_more_if_it_hardens(
    monkeypatch: pytest.MonkeyPatch, inside: float | None, objected: str, wanted: list[EffectAtJoint]
) -> None:
    changed = Gears(monkeypatch, {"elastic": 100.0, "play": 130.0}, inside, objected).changed()
    assert changed is not None and changed[0] == wanted
    told = "Hardening on joint 1: beside elastic gear it explains more than play in the place of that."
    assert (changed[1] == told) == (wanted == BOTH)


@pytest.mark.parametrize(
    ("inside", "objected", "square", "wanted", "asked"),
    [
        (30.0, "", 2.0, BOTH, ["together"]),
        (30.0, "explains 2 % of the gap", 2.0, None, ["together", "instead"]),
        (None, "", 2.0, None, ["together", "instead"]),
        (30.0, "", 1.3, None, ["instead"]),  # its joint has hardly a gap left
    ],
)
def test_a_gear_with_a_gap_left_is_fitted_with_what_may_act_in_it_once(
    monkeypatch: pytest.MonkeyPatch, inside: float | None, objected: str, square: float,
    wanted: list[EffectAtJoint] | None, asked: list[str],
) -> None:  # fmt: skip
    gears = Gears(monkeypatch, {"elastic": 100.0, "play": 80.0}, inside, objected, square)
    rivalry = Rivalry(gears.builder, gears.named, Options(), Progress())
    changed = gears.changed(rivalry)
    assert (None if changed is None else changed[0]) == wanted and gears.asked == asked
    in_no_time = Rivalry(gears.builder, gears.named, Options(), Progress(ends=0.0))
    assert gears.changed(in_no_time) is None and gears.asked == asked
    assert gears.changed(rivalry) is None and gears.asked.count("together") == asked.count("together")


@pytest.mark.parametrize(
    ("effects", "wanted"),
    [
        ((at("elastic"), at("hard")), True),
        ((at("elastic"), at("teeth")), False),  # which no gear looks like: an error of it repeats
        ((at("elastic"), at("hard", 2)), False),
        ((at("elastic"),), False),
    ],
)
def test_gears_are_compared_with_what_acts_in_them(
    monkeypatch: pytest.MonkeyPatch, effects: tuple[EffectAtJoint, ...], wanted: bool
) -> None:
    gears, asked = Gears(monkeypatch, {"elastic": 100.0, "play": 130.0}, None), list[EffectAtJoint]()

    def others(beside: Any, fit: Fit, gear: EffectAtJoint, *_: Any) -> list[FittedCandidate]:
        asked.append(gear)
        return [candidate_of("play", bic=130.0)]

    monkeypatch.setattr(rivals, "other_gears", others)
    fit = model_with(*effects)
    held = Rivalry(gears.builder, fit, Options(), Progress())._held(fit, found(at("elastic")), None)
    assert asked == ([at("elastic")] if wanted else [])
    assert held is None or held.is_nested == wanted


def test_what_was_replaced_does_not_come_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where each of two leads beside what the search finds after it, the second stays."""
    Beside(monkeypatch, {"slide": 100.0, "lag": 130.0})
    fit = model_with(at("slide"))
    rivalry = Rivalry(BUILDER, fit, Options(), Progress())
    changed = rivalry.instead(fit, [LAG], CATALOGUE)
    assert changed is not None
    Beside(monkeypatch, {"slide": 130.0, "lag": 100.0})
    back = found(at("lag"), (at("slide"), 3.0), members=(Proposal(at("slide"), {}),))
    assert rivalry.instead(changed[0], [back], CATALOGUE) is None
    (told,) = rivalry.told(changed[0], [back])
    assert told.rivals == ((at("slide"), 30.0),), "but that it explains more is a doubt"


def test_without_a_contest_the_set_of_the_round_is_doubted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rivals, "fit_without", lambda *_: None)
    fit = model_with(at("slide"))
    step = found(at("slide"), (at("lag"), 3.0), (at("rub"), 2.0), (at("play"), float("nan")))
    (told,) = Rivalry(BUILDER, fit, Options(), Progress()).told(fit, [step])
    assert [r for r, _ in told.rivals] == [at("lag")] and np.isnan(told.rivals[0][1])
    (doubt,) = ambiguities(BUILDER, [told])
    assert doubt.text == "Lag on joint 1 explains the data as well."


def test_a_rival_that_its_round_did_not_have_comes_into_the_set(monkeypatch: pytest.MonkeyPatch) -> None:
    """With its values, so that the motion which splits them can be designed."""
    Beside(monkeypatch, {"elastic": 100.0, "play": 104.0}, widely=0.5)
    fit, step = model_with(at("elastic")), found(at("elastic"), members=(Proposal(at("elastic"), {}),))
    (told,) = Rivalry(BUILDER, fit, Options(), Progress()).told(fit, [step])
    assert told.rivals == ((at("play"), 4.0),) and told.ambiguous == ((at("play"), 0.0),)
    assert [p.effect_at for p in told.members] == [at("elastic"), at("play")]


@pytest.mark.parametrize(("time_up", "acts_in_it"), [(True, False), (False, True)])
def test_where_no_contest_is_run(monkeypatch: pytest.MonkeyPatch, time_up: bool, acts_in_it: bool) -> None:
    """What acts in an elastic gear would go with it: a rival has more to explain than the gear alone."""
    Beside(monkeypatch, {"slide": 100.0, "lag": 95.0})
    fit = model_with(at("slide"), *([at("play")] if acts_in_it else []))
    progress = Progress(ends=0.0 if time_up else float("inf"))
    assert Rivalry(BUILDER, fit, Options(), progress)._held(fit, LAG, None) is None


@pytest.mark.parametrize(
    ("rival", "known", "widely", "left"),
    [
        ("lag", True, 0.5, 800.0),  # one minimum is found from its round
        ("lag", False, 0.5, None),
        ("play", True, 0.5, 200.0),
        ("play", True, 3.0, 800.0),
        ("play", True, None, 800.0),  # the whole range takes too long
        ("play", False, 0.5, 200.0),
        ("play", False, None, None),
    ],
)
def test_a_rival_of_many_minima_is_looked_for_in_its_whole_range(
    monkeypatch: pytest.MonkeyPatch, rival: str, known: bool, widely: float | None, left: float | None
) -> None:
    beside: Any = Beside(monkeypatch, {"lag": 1.0, "play": 1.0}, widely=widely)
    step = found(at("elastic"), members=(Proposal(at(rival), {}),) if known else ())
    candidate = fitted_rival(beside, at(rival), step, Options(), Progress())
    assert (None if candidate is None else candidate.fit.chi_square) == (None if left is None else pytest.approx(left))


def test_the_best_rival_takes_the_place(monkeypatch: pytest.MonkeyPatch) -> None:
    beside: Any = Beside(monkeypatch, {"slide": 100.0, "lag": 130.0, "elastic": 150.0})
    step = found(
        at("slide"), (at("lag"), 3.0), (at("elastic"), 4.0),
        members=(Proposal(at("lag"), {}), Proposal(at("elastic"), {})),
    )  # fmt: skip
    fit = model_with(at("slide"))
    held = Rivalry(BUILDER, beside.fit, Options(), Progress())._held(fit, step, None)
    assert isinstance(held, Contest)
    assert [(c.effect_at.effect, lead) for c, lead, _ in held.standings(Options())] == [
        ("elastic", 50.0),
        ("lag", 30.0),
    ]


@pytest.mark.parametrize(
    ("gain", "promises", "wanted"),
    [
        (100.0, {"slide": 95.0, "lag": 105.0}, []),  # within what decides nothing
        (100.0, {"slide": 95.0, "lag": 106.0}, ["lag"]),
        (2142.0, {"slide": 975.0, "lag": 1086.0}, ["lag"]),  # the others have taken up half of it, from a rival, too
        (2142.0, {"slide": 975.0, "lag": 990.0}, []),
        (100.0, {"slide": 900.0, "lag": 111.0}, ["lag"]),  # a promise that its own fit does not keep
        (100.0, {"lag": 111.0}, ["lag"]),  # it promises nothing itself: the others can make it
        (100.0, {"slide": 50.0, "lag": 80.0, "rub": 90.0, "gains": 70.0}, ["rub", "lag"]),  # the first two
        (100.0, {"slide": 50.0, "elastic": 90.0}, []),  # it may only stand for the effect that is named
        (100.0, {"slide": 50.0, "rolls": 90.0}, []),  # that is its simple form
        (100.0, {"slide": 50.0, "rolls on": 90.0}, ["rolls on"]),  # a part of it alone
    ],
)
def test_what_promises_more_in_the_place_of_an_effect(
    gain: float, promises: dict[str, float], wanted: list[str]
) -> None:
    builder: Any = Catalogue(
        effect_of("slide"), effect_of("lag"), effect_of("rub"), effect_of("gains"),
        effect_of("elastic", stands_for=("slide",)),
        effect_of("rolls", simple_form=("slide",)), effect_of("rolls on", simple_form=("slide", "lag")),
    )  # fmt: skip
    builder.has_place = lambda effect_at, others: True
    without, fit = model_with(), model_with(at("slide"))
    screened = [SimpleNamespace(effect_at=at(name), predicted=promised) for name, promised in promises.items()]
    beside: Any = SimpleNamespace(builder=builder, fit=without, screen=lambda _: screened)
    catalogue: Any = SimpleNamespace(fit=without)
    found = promising_instead(beside, catalogue, fit, candidate_of("slide", bic=gain), Options(), ())
    assert [s.effect_at.effect for s in found] == wanted


@pytest.mark.parametrize(
    ("unusual", "promises", "wanted"),
    [
        ("", {"stop": 612.0, "offset": 571.0}, []),
        ("acts at 80 % of the positions", {"stop": 612.0, "offset": 571.0}, ["offset"]),
        ("acts at 80 % of the positions", {"stop": 612.0, "offset": 400.0}, []),  # four fifths of 583 are 466
        ("acts at 80 % of the positions", {"stop": 612.0, "lag": 571.0}, []),  # nothing that it is confounded with
    ],
)
def test_what_an_effect_with_odd_values_is_confounded_with_may_promise_less(
    unusual: str, promises: dict[str, float], wanted: list[str]
) -> None:
    builder: Any = Catalogue(effect_of("stop", confounded_with=("offset",)), effect_of("offset"), effect_of("lag"))
    builder.has_place = lambda effect_at, others: True
    without, fit = model_with(), model_with(at("stop"))
    screened = [SimpleNamespace(effect_at=at(name), predicted=promised) for name, promised in promises.items()]
    beside: Any = SimpleNamespace(builder=builder, fit=without, screen=lambda _: screened)
    catalogue: Any = SimpleNamespace(fit=without)
    named = candidate_of("stop", bic=583.0, unusual=unusual)
    found = promising_instead(beside, catalogue, fit, named, Options(), ())
    assert [s.effect_at.effect for s in found] == wanted


@pytest.mark.parametrize(
    ("rival", "from_named", "at_minimum", "left"),
    [
        ({"bic": 120.0, "left": 0.5}, 0.1, 0.1, 0.5),  # ahead: nothing is fitted again
        ({"bic": 90.0, "left": 2.0}, 1.8, 1.5, 1.5),
        ({"bic": 90.0, "left": 2.0}, 2.5, 1.7, 1.7),  # its first fit was nearer
        ({"bic": 90.0, "left": 2.0}, None, 1.7, 1.7),
        ({"bic": 90.0, "left": 2.0}, 0.9, 0.1, 0.9),  # ahead from there
        ({"bic": 50.0, "left": 2.0}, 2.5, 0.1, 2.0),  # far behind from both: it is not fitted to its minimum
    ],
)
def test_a_rival_behind_starts_where_the_named_effect_has_led_all_else(
    monkeypatch: pytest.MonkeyPatch, rival: dict[str, float], from_named: float | None, at_minimum: float, left: float
) -> None:
    begun = list[list[float]]()

    def refit(proposal: Proposal, *, begin: Any) -> Fit | None:
        begun.append(list(begin))
        return None if from_named is None else model_with(at("lag"), square=from_named)

    def minimum(builder: Any, candidate: FittedCandidate) -> FittedCandidate:
        return candidate_of("lag", bic=rival["bic"], fit=model_with(at("lag"), square=at_minimum))

    monkeypatch.setattr(rivals, "fitted_to_minimum", minimum)
    monkeypatch.setattr(rivals, "proposal_of", lambda candidate: Proposal(at("lag"), {}))
    tilt = FreeParameter("tilt", "rad", "plant", "tilt", -0.29, 1.0)
    offset = FreeParameter("offset", "N.m", "plant", "offset", 0.0, 1.0)
    named_fit = fit_of(TableModel(residual(1.0), {}, (at("slide"),), (offset, tilt)), values=[5.0, -0.29])
    beside: Any = SimpleNamespace(
        builder=BUILDER, fit=fit_of(TableModel(residual(3.0), {}, (), (tilt,)), values=[0.1]), refit=refit,
        finished=lambda candidate: candidate,
        assess=lambda effect_at, fit: candidate_of("lag", bic=rival["bic"], fit=fit),
    )  # fmt: skip
    before = candidate_of("lag", bic=rival["bic"], fit=model_with(at("lag"), square=rival["left"]))
    found = from_where_named(beside, before, candidate_of("slide", bic=100.0, fit=named_fit))
    assert found.fit.chi_square == pytest.approx(left * before.fit.chi_square / rival["left"])
    assert begun == ([] if rival["bic"] > 100.0 else [[-0.29]])


@pytest.mark.parametrize(
    ("ripple", "teeth", "doubted"),
    [
        (at("ripple"), 24.4, True),
        (at("ripple"), 24.9, False),  # over half a turn they drift apart by 0.3 of a period
        (at("ripple", 2), 24.4, False),  # of another joint
        (at("slide"), 24.4, False),  # does not repeat
    ],
)
def test_an_error_of_a_gear_that_repeats_as_a_ripple_does(
    monkeypatch: pytest.MonkeyPatch, ripple: EffectAtJoint, teeth: float, doubted: bool
) -> None:
    """It may be one ripple that acts on the link: of one in a blind case both were named."""
    builder: Any = Catalogue(
        effect_of("ripple", title="Torque ripple", frequency="nr"), effect_of("slide"),
        effect_of("teeth", needs_elastic=True, frequency="number"), joints=2,
    )  # fmt: skip
    numbers, moved = {"ripple": 24.3, "teeth": teeth, "slide": np.nan}, 2 * np.pi / 2
    monkeypatch.setattr(
        rivals, "repeats",
        lambda fit, i, effect: numbers[effect.name] * moved / (2 * np.pi) if effect.frequency else np.inf,
    )  # fmt: skip
    told = of_one_period(builder, model_with(ripple, at("teeth")))
    assert [(d.code.name, d.place) for d in told] == [("effect-ambiguous", "teeth, joint 1")] * doubted
    assert all("the torque ripple there" in d.text and "acts on the link" in d.text for d in told)


@pytest.mark.parametrize(
    ("names", "gain", "said_of"),
    [
        (("lag", "play"), 111.0, "lag and play together explain more"),
        (("lag", "play"), 110.0, "lag and play together explain as much"),
        (("lag",), 95.0, "lag explains as much"),
        (("lag",), 150.0, "lag explains more"),
    ],
)
def test_others_that_explain_as_much_take_the_place_of_one(
    monkeypatch: pytest.MonkeyPatch, names: tuple[str, ...], gain: float, said_of: str
) -> None:
    """Once: the effect that has lost its place does not come back."""
    beside: Any = Beside(monkeypatch, {"slide": 100.0})
    whole = model_with(*map(at, names))
    both = tuple(Part(beside, candidate_of(n, fit=whole)) for n in names)
    monkeypatch.setattr(rivals, "gain_of", lambda beside, parts: gain)
    asked = list[str]()

    def parts_of(beside: Any, named: FittedCandidate, *_: Any) -> Any:
        asked.append(named.effect_at.effect)
        return both if named.effect_at.effect == "slide" else ()

    monkeypatch.setattr(rivals, "parts_of_named", parts_of)
    monkeypatch.setattr(rivals, "together_like", lambda builder, effect_at: [[at("lag"), at("play")]])
    fit, said = model_with(at("slide")), list[str]()
    rivalry = Rivalry(BUILDER, fit, Options(), Progress(said.append))
    changed = rivalry.instead(fit, [found(at("slide"))], CATALOGUE)
    assert changed is not None
    there, steps = changed
    assert there is whole and [s.effect_at for s in steps] == list(map(at, names))
    assert steps[0].remark == f"Slide on joint 1 was accepted first; {said_of} in its place, beside all others."
    assert said[-1] == f"{' and '.join(f'{name}, joint 1' for name in names)} instead of slide, joint 1"
    assert rivalry.instead(fit, [found(at("slide"))], CATALOGUE) is None and asked == ["slide"]
