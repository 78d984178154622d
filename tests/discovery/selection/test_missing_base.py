"""Friction that a black box lacks goes before an effect that does what all of it does, and not before others."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.missing_base import base_before
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.by_hand import Catalogue, TableModel, candidate_of, effect_of, fit_of, residual, table_fit

EFFECTS = Catalogue(
    effect_of("coulomb", is_base=True), effect_of("viscous", is_base=True), effect_of("drift"), joints=2
)  # fmt: skip
DRIFT, COULOMB = candidate_of("drift", bic=1000.0, cost=3.0), candidate_of("coulomb", bic=370.0, cost=2.0)


@pytest.fixture
def together(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The mean squares that coulomb and viscous friction leave together, and the effects asked for."""
    asked: list[Any] = [1.0]

    def refit(competition: Competition, proposal: Any) -> Any:
        asked.append(proposal.effect_at)
        known = competition.fit.model
        return fit_of(TableModel(residual(asked[0]), {}, (*known.added_effects, proposal.effect_at)), values=[2.5])

    monkeypatch.setattr(Competition, "refit", refit)
    return asked


def first(ranking: list[Any], *, allowed: bool = True) -> Any:
    competition = Competition(EFFECTS, table_fit(100.0))
    return base_before(competition, ranking, ranking[0], 15.0, lambda candidate: allowed)


def test_it_goes_first_where_all_of_it_explains_as_much(together: list[Any]) -> None:
    assert first([DRIFT, COULOMB]) is COULOMB
    assert together[1:] == [EffectAtJoint("viscous", 1)]


def test_an_effect_that_explains_more_than_all_of_it_stays(together: list[Any]) -> None:
    together[0] = 50.0
    assert first([DRIFT, COULOMB]) is DRIFT


def test_it_must_be_allowed_by_itself(together: list[Any]) -> None:
    assert first([DRIFT, COULOMB], allowed=False) is DRIFT


def test_friction_of_another_joint_does_not_count(together: list[Any]) -> None:
    other = candidate_of("coulomb", 2, bic=370.0)
    assert first([DRIFT, other]) is DRIFT
    assert len(together) == 1


def test_what_the_plant_has_is_not_added_again(together: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(EFFECTS, "identified", {"viscous"})
    together[0] = 0.0
    assert first([DRIFT, COULOMB]) is DRIFT  # coulomb alone explains less
    assert len(together) == 1


def test_an_accepted_base_effect_stays_whatever_else_there_is(together: list[Any]) -> None:
    best = replace(COULOMB, delta_bic=900.0)
    assert first([best, DRIFT]) is best
    assert len(together) == 1
    assert np.isfinite(together[0])
