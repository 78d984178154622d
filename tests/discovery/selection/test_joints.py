"""What joints have in common is looked for on all of them, and confirmed together: decisions, with hand-made fits."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.selection import joints
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import Options
from fmu_didim.discovery.selection.joints import on_further_joints, shared_remark
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.fit.fit import Fit
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.by_hand import Catalogue, TableModel, candidate_of, effect_of, fit_of, residual, table_fit

CATALOGUE: Any = Catalogue(
    effect_of("drag", is_shared=True), effect_of("cubic", is_shared=True), effect_of("spring"), joints=4
)
HELD_OUT = 10.0
"""Mean square of each joint on held-out data before anything is named there."""


@dataclass
class Fits:
    """What fits of further joints tell.

    Attributes:
        left: joint -> mean square that its effect leaves there on held-out data; no entry: it cannot be simulated.
        beside: joint -> what is objected beside those before it. asked: the joints fitted.
    """

    left: dict[int, float] = field(default_factory=dict)
    beside: dict[int, dict[str, Any]] = field(default_factory=dict)
    asked: list[int] = field(default_factory=list)

    def fit(self, *named: EffectAtJoint) -> Fit:
        squares = [HELD_OUT] * 4
        for effect_at in named:
            squares[effect_at.joint - 1] = self.left.get(effect_at.joint, HELD_OUT)
        return fit_of(TableModel(residual(1.0, 1.0, 1.0, 1.0), {"other": uneven(len(named), *squares)}, named))

    def refit(self, competition: Competition, proposal: Any) -> Fit | None:
        joint = proposal.effect_at.joint
        self.asked.append(joint)
        known = competition.fit.model.added_effects
        return self.fit(*known, proposal.effect_at) if joint in self.left else None

    def assess(self, competition: Competition, effect_at: EffectAtJoint, found: Fit) -> FittedCandidate:
        return candidate_of(effect_at.effect, effect_at.joint, fit=found, **self.beside.get(effect_at.joint, {}))


def uneven(seed: int, *squares: float) -> np.ndarray:
    """(SAMPLES, n) of about these mean squares, as uneven as data are: an interval of a ratio has a width."""
    table = residual(*squares)
    return np.asarray(table * np.random.default_rng(seed).uniform(0.5, 1.5, size=table.shape))


def further(
    monkeypatch: pytest.MonkeyPatch, fits: Fits, *others: FittedCandidate, effect: str = "drag", room: int = 4
) -> list[int]:
    """The joints on which the effect of joint 2 is named, too."""
    monkeypatch.setattr(Competition, "refit", lambda self, proposal: fits.refit(self, proposal))
    monkeypatch.setattr(Competition, "assess", lambda self, effect_at, found: fits.assess(self, effect_at, found))
    monkeypatch.setattr(joints, "proposal_of", lambda found: Proposal(found.effect_at, {}))
    named = candidate_of(effect, 2, fit=fits.fit(EffectAtJoint(effect, 2)))
    competition = Competition(CATALOGUE, fits.fit())
    base = table_fit(100.0, 100.0, 100.0, 100.0)
    found = on_further_joints(competition, (named, *others), named, base, Options(), room)
    return [part.candidate.effect_at.joint for part in found]


ONE, THREE, FOUR = (candidate_of("drag", j, bic=b) for j, b in ((1, 20.0), (3, 150.0), (4, 9.0)))


@pytest.mark.parametrize(
    ("left", "found"),
    [
        ({3: 5.0, 1: 6.0}, [3, 1]),
        ({3: 5.0}, [3]),  # the other cannot be simulated
        ({3: 5.0, 1: 12.0}, [3]),  # its error does not fall there
        ({2: 10.0, 3: 9.999, 1: 9.999}, []),  # held-out data do not confirm them together
        ({}, []),
    ],
)
def test_held_out_data_are_asked_for_all_together(
    monkeypatch: pytest.MonkeyPatch, left: dict[int, float], found: list[int]
) -> None:
    assert further(monkeypatch, Fits({2: 5.0, **left}), THREE, ONE, FOUR) == found


@pytest.mark.parametrize(
    ("beside", "found"),
    [
        ({"bic": 9.0}, [1]),
        ({"change": 0.5}, [1]),
        ({"implausible": "may be absent"}, [1]),
        ({"share": 0.001}, [3, 1]),  # a small part of the gap each: what counts is what they explain together
    ],
)
def test_each_must_be_accepted_beside_those_before(
    monkeypatch: pytest.MonkeyPatch, beside: dict[str, Any], found: list[int]
) -> None:
    assert further(monkeypatch, Fits({2: 5.0, 3: 5.0, 1: 5.0}, {3: beside}), THREE, ONE) == found


def test_none_is_fitted_that_gains_nothing_or_that_no_machine_has(monkeypatch: pytest.MonkeyPatch) -> None:
    fits = Fits(dict.fromkeys((1, 2, 3, 4), 5.0))
    others = [
        FOUR, replace(ONE, implausible="negative"), replace(THREE, unusual="falls with the speed"),
        candidate_of("cubic", 3), candidate_of("spring", 1),
    ]  # fmt: skip
    assert further(monkeypatch, fits, *others) == []
    assert fits.asked == []


def test_only_what_joints_have_in_common(monkeypatch: pytest.MonkeyPatch) -> None:
    assert further(monkeypatch, Fits(dict.fromkeys((1, 2, 3), 5.0)), candidate_of("spring", 3), effect="spring") == []
    shared = {name for name, effect in EFFECTS.items() if effect.is_shared}
    assert shared == {"stribeck", "power_viscous", "quadratic_viscous", "cubic_viscous"}


def test_no_more_than_there_is_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    fits = Fits({2: 5.0, 3: 5.0, 1: 5.0})
    assert further(monkeypatch, fits, THREE, ONE, room=1) == [3]
    assert further(monkeypatch, fits, THREE, ONE, room=0) == []


@pytest.mark.parametrize(
    ("named", "text"),
    [
        ((3,), "Drag on joint 3, as on joint 2: held-out data confirm these together"),
        ((3, 1), "Drag on joint 3 and joint 1, as on joint 2: held-out data confirm these together"),
    ],
)
def test_it_is_told(named: tuple[int, ...], text: str) -> None:
    parts = [joints.Part(Competition(CATALOGUE, table_fit(1.0)), candidate_of("drag", j)) for j in named]
    assert shared_remark("Drag", candidate_of("drag", 2), parts).startswith(text)
