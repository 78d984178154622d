"""When an elastic gear and its error are taken together, by fits whose figures are made up."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection import gears
from fmu_didim.discovery.selection.decide import Options
from fmu_didim.discovery.selection.gears import _judged, _places, gear_with_error
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.by_hand import Catalogue, candidate_of, effect_of, table_fit

GEAR, ERROR = EffectAtJoint("gear", 1), EffectAtJoint("teeth", 1)


def builder_of(joints: int = 1, **costs: float) -> Any:
    more = (effect_of("play", elastic=True), effect_of("gear", elastic=True), effect_of("teeth", needs_elastic=True))
    return Catalogue(effect_of("a"), *more, joints=joints, costs={"play": 3.0, **costs})


def places(*mean_squares: float, forbid: frozenset[str] = frozenset()) -> list[tuple[str, str, int]]:
    fit = table_fit(*mean_squares)
    competition: Any = SimpleNamespace(
        builder=builder_of(len(mean_squares)), fit=SimpleNamespace(torque_alone=fit, model=SimpleNamespace(
            joint_count=len(mean_squares), added_effects=()
        )),
    )  # fmt: skip
    return [(g.effect, e.effect, g.joint) for g, e in _places(competition, Options(forbid=forbid))]


def test_the_simplest_gear_is_tried_where_a_gap_is_left_the_largest_first() -> None:
    assert places(4.0, 9.0) == [("gear", "teeth", 2), ("gear", "teeth", 1)]
    # A gap of 0.6 of the noise: its square, and that of the noise beside it.
    assert places(1.35, 9.0) == [("gear", "teeth", 2)] and len(places(1.37, 9.0)) == 2
    assert places(9.0, forbid=frozenset({"gear"})) == [("play", "teeth", 1)]
    assert places(9.0, forbid=frozenset({"teeth"})) == []


class Judged:
    """A judgement where the two gain this much, and each is objected to or not."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, gain: float, objections: tuple[str, str] = ("", "")) -> None:
        self.base = table_fit(9.0)
        left, costs = list(objections), list[float]()
        self.costs = costs

        def bic(before: Any, after: Any, cost: float, noise: Any) -> float:
            costs.append(cost)
            return gain

        model = SimpleNamespace(added_effects=(GEAR, ERROR))
        self.whole: Any = SimpleNamespace(model=model, noise=None)
        builder: Any = SimpleNamespace(
            at=builder_of(gear=2.0, teeth=5.0).at, without=lambda model, index: f"without {index}",
            effect=lambda a: SimpleNamespace(title=a.effect),
        )  # fmt: skip
        assess = lambda effect_at, fit: candidate_of(effect_at.effect, bic=1.0)  # noqa: E731
        self.competition: Any = SimpleNamespace(builder=builder, fit=self.base, assess=assess)
        monkeypatch.setattr(gears, "bic_gain", bic)
        monkeypatch.setattr(gears, "minimise", lambda model, noise, stopping: model)
        monkeypatch.setattr(gears, "objection", lambda candidate, fit, options, base: left.pop(0))
        monkeypatch.setattr(gears, "Competition", lambda builder, fit: SimpleNamespace(fit=fit, assess=assess))
        monkeypatch.setattr(gears, "replace", self.replaced)
        monkeypatch.setattr(gears, "step_of", lambda accepted, *_: SimpleNamespace(effect=accepted.effect_at.effect))

    def replaced(self, what: Any, **more: Any) -> Any:
        return SimpleNamespace(**{**vars(what), **more})

    def __call__(self, *others: float) -> Any:
        ranking = [candidate_of("a", bic=bic) for bic in others]
        return _judged(self.competition, ranking, self.whole, (GEAR, ERROR), self.base, Options())


def test_both_are_taken_with_a_remark_on_the_gear(monkeypatch: pytest.MonkeyPatch) -> None:
    judged = Judged(monkeypatch, 100.0)
    fit, steps = judged(5.0, -20.0)
    assert fit is judged.whole and [s.effect for s in steps] == ["gear", "teeth"]
    assert steps[0].remark == "gear on joint 1: it shows only beside teeth on joint 1, which acts in it."
    assert judged.costs == [7.0]  # the parameters of both


@pytest.mark.parametrize(("best", "taken"), [(89.0, True), (91.0, False)])
def test_what_one_effect_explains_needs_no_two(monkeypatch: pytest.MonkeyPatch, best: float, taken: bool) -> None:
    assert (Judged(monkeypatch, 100.0)(best) is not None) == taken


@pytest.mark.parametrize("objections", [("too small", ""), ("", "too small")])
def test_both_must_stand(monkeypatch: pytest.MonkeyPatch, objections: tuple[str, str]) -> None:
    assert Judged(monkeypatch, 100.0, objections)() is None


def test_nothing_is_found_where_no_gear_can_be_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gears, "_places", lambda *_: iter([(GEAR, ERROR)]))
    monkeypatch.setattr(gears, "_starts", lambda *_: [])
    said: list[str] = []
    assert gear_with_error(SimpleNamespace(), (), None, Options(), Progress(said.append)) is None  # type: ignore[arg-type]
    assert said == ["gear with teeth on joint 1"]
