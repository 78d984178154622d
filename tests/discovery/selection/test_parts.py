"""A stop is named only where it explains more than a spring at rest elsewhere: decisions, with hand-made fits."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import pytest

from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection import parts
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import Options
from fmu_didim.discovery.selection.parts import parts_instead, parts_of_named, simple_form
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.fit.fit import Fit
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.by_hand import Catalogue, TableModel, candidate_of, effect_of, fit_of, residual, table_fit

CATALOGUE: Any = Catalogue(
    effect_of("stop", title="Stop", stands_for=("spring", "offset")), effect_of("spring"), effect_of("offset")
)  # fmt: skip
STOP = candidate_of("stop", bic=1000.0, cost=2.0)  # what is within 20 of it is as good


@dataclass
class Fits:
    """What fits of the parts tell.

    Attributes:
        together: gain of both. alone: of each beside those before it; no entry: it cannot be simulated.
        share: of the gap; values: what makes one implausible. asked: the effects fitted.
    """

    together: float = 1100.0
    alone: dict[str, float] = field(default_factory=lambda: {"spring": 100.0, "offset": 700.0})
    share: float = 0.01
    implausible: str = ""
    asked: list[str] = field(default_factory=list)

    def refit(self, competition: Competition, proposal: Any) -> Fit | None:
        name = proposal.effect_at.effect
        self.asked.append(name)
        known = competition.fit.model.added_effects
        model = TableModel(residual(1.0), {}, (*known, proposal.effect_at))
        return fit_of(model) if name in self.alone else None

    def assess(self, competition: Competition, effect_at: EffectAtJoint, found: Fit) -> Any:
        why = "physically impossible" if effect_at.effect == self.implausible else ""
        return candidate_of(effect_at.effect, bic=self.alone[effect_at.effect], share=self.share, fit=found,
                            implausible=why)  # fmt: skip


def instead(monkeypatch: pytest.MonkeyPatch, fits: Fits, *, present: str = "", **options: Any) -> tuple[list[str], str]:
    """The effects to add instead of the stop, and the remark."""
    monkeypatch.setattr(Competition, "refit", lambda self, proposal: fits.refit(self, proposal))
    monkeypatch.setattr(Competition, "assess", lambda self, effect_at, found: fits.assess(self, effect_at, found))
    monkeypatch.setattr(parts, "bic_gain", lambda *_: fits.together)
    monkeypatch.setattr(parts, "implausible", lambda *_: "")
    base = table_fit(100.0)
    known = table_fit(100.0, added_effects=(EffectAtJoint(present, 1),) if present else ())
    found, remark = parts_instead(Competition(CATALOGUE, known), STOP, base, Options(**options))
    return [part.candidate.effect_at.effect for part in found], remark


@pytest.mark.parametrize(
    ("together", "named", "remark"),
    [
        (1100.0, ["offset", "spring"], ""),
        (1010.0, ["offset", "spring"], "Stop on joint 1 explains these data as well: BIC difference 10."),
        (985.0, ["offset", "spring"], "Stop on joint 1 explains these data as well: BIC difference -15."),
        (979.0, [], ""),
        (300.0, [], ""),
    ],
)
def test_the_parts_are_named_unless_the_stop_explains_more(
    monkeypatch: pytest.MonkeyPatch, together: float, named: list[str], remark: str
) -> None:
    """The part that explains most alone first; how small a share the other closes does not count."""
    assert instead(monkeypatch, Fits(together)) == (named, remark)


@pytest.mark.parametrize(
    ("fits", "options"),
    [
        (Fits(alone={"offset": 700.0}), {}),  # the spring cannot be simulated
        (Fits(alone={"offset": 700.0, "spring": 9.0}), {}),  # no evidence of a spring beside the offset
        (Fits(implausible="spring"), {}),
        (Fits(), {"forbid": frozenset({"spring"})}),
        (Fits(), {"prefer": ("stop",)}),
        (Fits(), {"present": "offset"}),  # the spring alone had its chance
    ],
)
def test_the_stop_stays_where_a_part_cannot_be(
    monkeypatch: pytest.MonkeyPatch, fits: Fits, options: dict[str, Any]
) -> None:
    assert instead(monkeypatch, fits, **options) == ([], "")


def test_parts_that_are_impossible_together_are_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside the spring an offset, alone possible, may not be."""
    fits = Fits()
    base = table_fit(100.0)
    monkeypatch.setattr(Competition, "refit", lambda self, proposal: fits.refit(self, proposal))
    monkeypatch.setattr(Competition, "assess", lambda self, effect_at, found: fits.assess(self, effect_at, found))
    monkeypatch.setattr(parts, "bic_gain", lambda *_: fits.together)
    monkeypatch.setattr(parts, "implausible", lambda fit, index, effect, link: "no" if effect.name == "offset" else "")
    assert parts_instead(Competition(CATALOGUE, base), STOP, base, Options()) == ((), "")


@pytest.mark.parametrize(
    ("named", "present", "fits", "wanted", "asked"),
    [
        ("stop", "", Fits(1100.0), ["offset", "spring"], ["spring", "offset", "spring"]),
        ("stop", "", Fits(985.0), ["offset", "spring"], ["spring", "offset", "spring"]),  # as good: the common ones
        ("stop", "", Fits(979.0), [], ["spring", "offset", "spring"]),
        # A constant that was found beside it stays, and the spring takes its place alone.
        ("stop", "offset", Fits(985.0), ["spring"], ["spring"]),
        ("stop", "offset", Fits(979.0), [], ["spring"]),
        ("stop", "", Fits(alone={"offset": 700.0, "spring": 9.0}), [], ["spring", "offset", "spring"]),
        ("compensator", "", Fits(985.0), ["offset", "spring"], ["spring", "offset", "spring"]),
    ],
)
def test_what_stands_for_others_meets_them_again_beside_all_that_was_found(
    monkeypatch: pytest.MonkeyPatch, named: str, present: str, fits: Fits, wanted: list[str], asked: list[str]
) -> None:
    """A stop was named for a spring at rest elsewhere, which held-out data did not confirm without friction by the
    load."""
    instead(monkeypatch, fits)  # sets what the fits tell
    fits.asked.clear()
    builder: Any = Catalogue(
        effect_of("stop", title="Stop", stands_for=("spring", "offset")),
        effect_of("compensator", title="Compensator", simple_form=("spring", "offset")),
        *map(effect_of, ("spring", "offset")),
    )  # fmt: skip
    others = table_fit(100.0, added_effects=(EffectAtJoint("lag", 1), *[EffectAtJoint(present, 1)] * bool(present)))
    candidate, catalogue = candidate_of(named, bic=1000.0, cost=2.0), cast(Any, SimpleNamespace(fit=others))
    found = parts_of_named(Competition(builder, others), candidate, catalogue, others, Options(), Progress())
    assert [part.candidate.effect_at.effect for part in found] == wanted
    assert fits.asked == asked


COMPENSATED: Any = Catalogue(
    effect_of("compensator", title="Compensator", simple_form=("spring", "offset")),
    *map(effect_of, ("spring", "offset")),
)  # fmt: skip


@pytest.mark.parametrize(
    ("implausible", "bic", "accepted", "together", "is_taken"),
    [
        ("its form is not told: Fgc = 1 ± 10, kgc = 2 ± 30", 1000.0, None, 1010.0, True),
        ("its form is not told: Fgc = 1 ± 10, kgc = 2 ± 30", 1000.0, None, 985.0, True),
        ("its form is not told: Fgc = 1 ± 10, kgc = 2 ± 30", 1000.0, None, 970.0, False),  # it explains more
        # Something else is accepted: this must explain less than the other one, by more than decides nothing.
        ("its form is not told: Fgc = 1 ± 10, kgc = 2 ± 30", 1000.0, 979.0, 1010.0, True),
        ("its form is not told: Fgc = 1 ± 10, kgc = 2 ± 30", 1000.0, 981.0, 1010.0, False),
        ("its form is not told: Fgc = 1 ± 10, kgc = 2 ± 30", 1000.0, 1500.0, 1010.0, False),
        # Other objections have no simple form as their cause.
        ("physically impossible: kgc = -3 ± 1 below 0", 1000.0, None, 1010.0, False),
        ("", 1000.0, None, 1010.0, False),
    ],
)
def test_what_has_a_form_that_is_not_told_is_named_by_its_simple_form(
    monkeypatch: pytest.MonkeyPatch, implausible: str, bic: float, accepted: float | None, together: float,
    is_taken: bool,
) -> None:  # fmt: skip
    fits = Fits(together)
    monkeypatch.setattr(Competition, "refit", lambda self, proposal: fits.refit(self, proposal))
    monkeypatch.setattr(Competition, "assess", lambda self, effect_at, found: fits.assess(self, effect_at, found))
    monkeypatch.setattr(parts, "bic_gain", lambda *_: fits.together)
    monkeypatch.setattr(parts, "implausible", lambda *_: "")
    base = table_fit(100.0)
    candidate = candidate_of("compensator", bic=bic, implausible=implausible)
    other = None if accepted is None else candidate_of("lag", bic=accepted)
    ranking = sorted(filter(None, (candidate, other, candidate_of("drag", bic=5.0))), key=lambda c: -c.delta_bic)
    found = simple_form(Competition(COMPENSATED, base), ranking, other, base, Options())
    assert found is (candidate if is_taken else None)
    if accepted is not None and not is_taken:
        assert not fits.asked  # nothing is fitted for what decides nothing


def test_what_an_effect_stands_for_is_in_the_catalogue() -> None:
    stand = {name: e.stands_for or e.simple_form for name, e in EFFECTS.items() if e.stands_for or e.simple_form}
    assert set(stand) == {"contact_stop", "contact_stop_lower", "gravity_compensator"}
    for named in stand.values():
        assert all(EFFECTS[name].is_proposed and not EFFECTS[name].stands_for for name in named)


def test_nothing_is_fitted_for_an_effect_that_stands_for_none(monkeypatch: pytest.MonkeyPatch) -> None:
    fits = Fits()
    monkeypatch.setattr(Competition, "refit", lambda self, proposal: fits.refit(self, proposal))
    base = table_fit(100.0)
    assert parts_instead(Competition(CATALOGUE, base), candidate_of("spring"), base, Options()) == ((), "")
    assert fits.asked == []


LOADS: Any = Catalogue(
    effect_of("stop", class_name="load", title="Stop", stands_for=("spring", "offset")),
    effect_of("lower", class_name="load", stands_for=("spring", "offset")),
    effect_of("spring", class_name="load"), effect_of("hard", class_name="load"), effect_of("offset"),
)  # fmt: skip


@dataclass
class Together:
    """Fits of a constant and a stop in the place of a spring that explains 1000.

    Attributes:
        together: gain of both, by the stop; left: what each leaves, of which the better one counts.
        beside_spring: gain of the constant beside the spring; none if it is no candidate there.
        hardens: gain of another spring beside it; none if it is no candidate.
        objected: effects that held-out data speak against.
    """

    together: float = 1100.0
    left: dict[str, float] = field(default_factory=lambda: {"stop": 1.0, "lower": 2.0})
    beside_spring: float | None = 20.0
    hardens: float | None = None
    objected: str = ""
    asked: list[str] = field(default_factory=list)

    def screen(self, competition: Competition, catalogue: Any) -> list[Any]:
        known = {a.effect for a in competition.fit.model.added_effects}
        names = {*self.left, "spring"} | (
            {"offset"} if "spring" not in known or self.beside_spring is not None else set()
        )
        names |= {"hard"} if self.hardens is not None else set()
        return [SimpleNamespace(effect_at=EffectAtJoint(n, 1)) for n in sorted(names - known)]

    def compare(self, competition: Competition, chosen: Any, *, progress: Progress, reach: float) -> Any:
        known, ranking = competition.fit.model.added_effects, []
        for effect_at in (s.effect_at for s in chosen):
            self.asked.append(effect_at.effect)
            model = TableModel(residual(self.left.get(effect_at.effect, 3.0)), {}, (*known, effect_at))
            bic = self.beside_spring or 0.0 if any(a.effect == "spring" for a in known) else 500.0
            ranking.append(candidate_of(effect_at.effect, bic=bic, share=0.01, fit=fit_of(model)))
        return SimpleNamespace(ranking=tuple(ranking))

    def gain(self, before: Any, after: Any, *_: Any) -> float:
        names = {a.effect for a in after.model.added_effects}
        if "spring" not in names:
            return self.together
        return 1000.0 + max(
            (self.beside_spring or 0.0) * ("offset" in names), (self.hardens or 0.0) * ("hard" in names)
        )

    def named(self, monkeypatch: pytest.MonkeyPatch, *, named: str = "spring", **options: Any) -> list[str]:
        monkeypatch.setattr(Competition, "screen", lambda own, catalogue: self.screen(own, catalogue))
        monkeypatch.setattr(Competition, "compare", lambda own, chosen, **more: self.compare(own, chosen, **more))
        monkeypatch.setattr(parts, "bic_gain", self.gain)
        monkeypatch.setattr(parts, "implausible", lambda fit, i, effect, link: "no" * (effect.name == self.objected))
        base = table_fit(100.0)
        spring = candidate_of(named, bic=1000.0, fit=table_fit(5.0, added_effects=(EffectAtJoint(named, 1),)))
        catalogue: Any = SimpleNamespace(fit=base)
        found = parts_of_named(Competition(LOADS, base), spring, catalogue, base, Options(**options), Progress())
        return [part.candidate.effect_at.effect for part in found]


@pytest.mark.parametrize(
    ("fits", "wanted"),
    [
        (Together(), ["offset", "stop"]),
        (Together(left={"stop": 2.0, "lower": 1.0}), ["offset", "lower"]),  # which of the stops explains more
        (Together(left={"lower": 1.0}), ["offset", "lower"]),
        (Together(left={}), []),  # no stop promises anything
        (Together(together=1021.0), []),  # within 2 % of what both explain nothing is decided
        (Together(together=1100.0, beside_spring=90.0), []),  # the spring rests elsewhere: it has a constant, too
        (Together(together=1100.0, beside_spring=None), ["offset", "stop"]),
        (Together(together=1100.0, hardens=70.0), ["offset", "stop"]),
        (Together(together=1100.0, hardens=90.0), []),  # the spring hardens, and is linear, too
        (Together(objected="offset"), []),
    ],
)
def test_a_constant_and_a_stop_take_the_place_of_a_spring(
    monkeypatch: pytest.MonkeyPatch, fits: Together, wanted: list[str]
) -> None:
    assert fits.named(monkeypatch) == wanted


@pytest.mark.parametrize(
    ("named", "options"),
    [
        ("stop", {"prefer": ("stop",)}),
        ("stop", {"forbid": frozenset({"offset"})}),
        ("offset", {}),
        ("spring", {"prefer": ("spring",)}),
        ("spring", {"forbid": frozenset({"offset"})}),
    ],
)
def test_what_keeps_its_place_is_not_fitted_in_parts(
    monkeypatch: pytest.MonkeyPatch, named: str, options: dict[str, Any]
) -> None:
    fits = Together()
    assert fits.named(monkeypatch, named=named, **options) == [] and fits.asked == []
