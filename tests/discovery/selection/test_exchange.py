"""What promises more in the place of an effect than that explains beside all others: a rival as those of its set."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection import beside_others, rivals
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.decide import Options, Step
from fmu_didim.discovery.selection.rivals import Rivalry
from fmu_didim.fit.fit import Fit
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.by_hand import Removable, TableModel, candidate_of, effect_of, fit_of, residual, with_effects


class Exchange:
    """What explains more in the place of one of the effects a and b, and what an exchange asks.

    Args:
        squares: what models leave, by their effects. promised: what candidates promise beside which others.
        objected: candidates that are not accepted.
    """

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, squares: dict[str, float], promised: dict[tuple[str, str], float],
        objected: str = "", names: str = "ab", stands_for: dict[str, str] | None = None,
    ) -> None:  # fmt: skip
        self.squares, self.promised = squares, promised
        stands_for = stands_for or {}
        self.fitted: list[str] = []
        monkeypatch.setattr(beside_others, "minimise", self.minimise)
        monkeypatch.setattr(rivals, "from_where_named", lambda beside, rival, named: rival)
        monkeypatch.setattr(rivals, "Competition", self.competition)
        monkeypatch.setattr(rivals, "step_of", lambda c, ranking, *_: step_of_(c))
        monkeypatch.setattr(rivals, "objection", lambda c, *_, **__: "no" if c.effect_at.effect in objected else "")
        steps = [replace(step_of_(candidate_of(n)), remark="") for n in names]
        base = with_effects()
        catalogue: Any = SimpleNamespace(fit=base)
        builder: Any = Removable(
            *(effect_of(n, title=n, class_name=n, stands_for=stands_for.get(n, ())) for n in "abcd")
        )
        self.fit, self.rivalry = (
            with_effects(*names, square=squares[names]),
            Rivalry(builder, base, Options(), Progress()),
        )
        self.found = self.rivalry.instead(self.fit, steps, catalogue)
        self.told = self.rivalry.told(self.fit, steps)

    @property
    def named(self) -> str:
        return "" if self.found is None else "".join(sorted(s.effect_at.effect for s in self.found[1]))

    def minimise(self, model: TableModel, noise: Any, **more: Any) -> Fit:
        names = "".join(a.effect for a in model.added_effects)
        slopes = np.ones((400, 1, len(model.free_parameters)))
        return fit_of(replace(model, own=residual(self.squares[names])), values=model.start, jacobian=slopes)

    def competition(self, builder: Any, fit: Fit) -> Any:
        kept = "".join(a.effect for a in fit.model.added_effects)

        def gain(names: str) -> float:
            return float(400 * np.log(self.squares[kept] / self.squares[names]))

        def compare(chosen: Any, *, progress: Progress, reach: float) -> Any:
            names = [s.effect_at.effect for s in chosen]
            self.fitted += [kept + n for n in names]
            ranking = [candidate_of(n, bic=gain(kept + n), fit=with_effects(*kept, n)) for n in names]
            return SimpleNamespace(ranking=tuple(ranking))

        screened = [
            SimpleNamespace(effect_at=EffectAtJoint(n, 1), predicted=p)
            for (others, n), p in sorted(self.promised.items(), key=lambda item: -item[1]) if others == kept
        ]  # fmt: skip
        return SimpleNamespace(
            assess=lambda at, found: candidate_of(
                at.effect, bic=gain("".join(a.effect for a in found.model.added_effects)), fit=found
            ),
            screen=lambda catalogue: screened, compare=compare, finished=lambda candidate: candidate, builder=builder,
            fit=fit,
        )  # fmt: skip


def step_of_(candidate: FittedCandidate) -> Step:
    return Step(candidate.effect_at, candidate.delta_bic, 1.0, 0.5, (), {}, {}, None)


SQUARES = {"ab": 1.0, "b": 2.0, "a": 3.0, "c": 4.0, "bc": 0.9, "ac": 0.95, "bd": 0.99}
"""Beside b, c is ahead of a by 42 in BIC, and d by 4; beside a, c is ahead of b by 21."""


@pytest.mark.parametrize(
    ("promised", "objected", "fitted", "named"),
    [
        ({("b", "c"): 400.0}, "", ["bc"], "bc"),  # a explains 277 beside b
        ({("b", "c"): 280.0}, "", [], ""),  # promises hardly more than a
        ({("b", "c"): 400.0}, "c", ["bc"], ""),  # held-out data speak against it, say
        ({("b", "d"): 400.0}, "", ["bd"], ""),  # as good as a decides nothing
        ({("a", "c"): 500.0, ("b", "c"): 400.0}, "", ["bc"], "bc"),  # what explains least is looked at first
        ({("a", "c"): 500.0}, "", ["ac"], "ac"),
        ({("b", "a"): 400.0, ("b", "b"): 400.0}, "", [], ""),  # they are there
        ({("b", "d"): 401.0, ("b", "c"): 400.0}, "", ["bd", "bc"], "bc"),
        ({}, "", [], ""),
    ],
)
def test_what_explains_more_beside_all_others_takes_the_place_of_an_effect(
    monkeypatch: pytest.MonkeyPatch, promised: dict[tuple[str, str], float], objected: str, fitted: list[str],
    named: str,
) -> None:  # fmt: skip
    found = Exchange(monkeypatch, SQUARES, promised, objected)
    assert found.fitted == fitted and found.named == named
    if named:
        assert found.found is not None
        assert any("beside all others" in step.remark for step in found.found[1])


@pytest.mark.parametrize(("parts", "named"), [("a", ""), ("b", ""), ("d", "bc")])
def test_what_may_stand_for_an_effect_does_not_take_its_place(
    monkeypatch: pytest.MonkeyPatch, parts: str, named: str
) -> None:
    """A stop for a spring, or for the constant beside it."""
    assert Exchange(monkeypatch, SQUARES, {("b", "c"): 400.0}, stands_for={"c": parts}).named == named


def test_a_single_effect_is_not_exchanged(monkeypatch: pytest.MonkeyPatch) -> None:
    """The round that named it has compared it with all others."""
    assert Exchange(monkeypatch, {"a": 1.0, "": 9.0, "c": 0.5}, {("", "c"): 1e4}, names="a").found is None


def test_a_candidate_that_explains_as_much_is_a_doubt(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the search for others in the place of a found so is no rival of its round."""
    told = {
        s.effect_at.effect: [r.effect for r, _ in s.rivals]
        for s in Exchange(monkeypatch, SQUARES, {("b", "d"): 400.0}).told
    }
    assert told == {"a": ["d"], "b": []}
