"""The pre-check, with trials and candidates made by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import SimulationError
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection import pre_check as checking
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import Options
from fmu_didim.discovery.selection.pre_check import _held_out_tells, _tried, may_be_promising, pre_check
from fmu_didim.dynamics.effects import PreCheck
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import Ratio
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.by_hand import Catalogue, TableModel, candidate_of, effect_of, fit_of, noise, residual, table_fit

WHITE = noise((1.0, 1.0))
CHECK = PreCheck("limit", (1.0, 0.5))
AFTER = table_fit(0.1, 0.1)


class Builder(Catalogue):
    """Limits the torque of a joint; what a limited model leaves is the measured torque less that of the trial.

    Args:
        left: (joint, value rounded) -> factor of the residual; None where it cannot be simulated.
        refused: joints to which nothing can be added.
    """

    def __init__(self, *effects: Any, left: Any = None, refused: Sequence[int] = ()) -> None:
        super().__init__(*effects, joints=2)
        self.left, self.refused = left or {}, refused
        self.proposed: list[Proposal] = []

    def at(self, effect_at: EffectAtJoint) -> Any:
        return SimpleNamespace(can_be_added=effect_at.joint not in self.refused, cost=1.0, amplitudes=(), shapes=())

    def build(self, model: TableModel, proposals: Sequence[Proposal]) -> Any:
        (proposal,) = proposals
        self.proposed.append(proposal)
        factor = self.left[proposal.effect_at.joint, round(proposal.values["limit"], 6)]
        own = residual(1.0, 1.0)

        def one(values: Any) -> Any:
            if factor is None:
                raise SimulationError("It diverges.", next_step="Change it.")
            return np.sqrt(factor) * own

        return SimpleNamespace(start=np.zeros(0), output_residual=one)


def ramp(white: Noise = WHITE) -> Fit:
    """Measured torque from -3 to 1 on joint 1, from 0 to 8 on joint 2; what a fit leaves has mean square 1 each."""
    own = np.column_stack([np.linspace(-3, 1, 401), np.linspace(0, 8, 401)])[:400]
    model = TableModel(own)
    fit = fit_of(model, white=white)
    return replace(fit, outputs=own - residual(1.0, 1.0), chi_square=800.0)


def test_limits_are_tried_at_quantiles_of_the_size_of_the_torque() -> None:
    builder, fit = Builder(left={(1, 3.0): 0.7, (1, 1.0): 0.9, (2, 7.98): 0.8, (2, 3.99): 0.6}), ramp()
    builder.left[1, round(float(np.quantile(np.abs(fit.model.measured[:, 0]), 0.5)), 6)] = 0.9
    found = _tried("limit", CHECK, Competition(builder, fit))
    assert [(cost, at.joint) for cost, at, _ in found] == [
        (pytest.approx(480.0), 2), (pytest.approx(560.0), 1), (pytest.approx(640.0), 2), (pytest.approx(720.0), 1)
    ]  # fmt: skip
    assert [value for _, _, value in found] == pytest.approx([3.99, 3.0, 7.98, 1.0], abs=0.01)
    assert [p.effect_at for p in builder.proposed][:2] == [EffectAtJoint("limit", 1)] * 2


def test_trials_that_cannot_be_added_or_simulated_are_left_out() -> None:
    left = {(2, 7.98): None, (2, 3.99): 0.5}
    found = _tried("limit", CHECK, Competition(Builder(left=left, refused=[1]), ramp(noise((1.0, 2.0)))))
    assert [(cost, at.joint, value) for cost, at, value in found] == [(pytest.approx(250.0), 2, pytest.approx(3.99))]


def test_what_the_model_has_is_not_tried_again() -> None:
    fit = ramp()
    present = replace(fit, model=replace(fit.model, added_effects=(EffectAtJoint("limit", 2),)))
    builder = Builder(left={(1, 3.0): 0.7, (1, 1.0): 0.9})
    builder.left[1, round(float(np.quantile(np.abs(fit.model.measured[:, 0]), 0.5)), 6)] = 0.9
    assert {at.joint for _, at, _ in _tried("limit", CHECK, Competition(builder, present))} == {1}


class Check:
    """What the check calls.

    Args:
        trials: as :func:`_tried` gives them; bics: of the ranking, by joint.
        objection: to the best; tells: whether the held-out data do.
    """

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, trials: Any, bics: Any, *, objection: str = "", tells: bool = True
    ) -> None:
        self.refitted: list[Proposal] = []
        self.objected: list[tuple[int, Any]] = []
        self.stepped: list[Any] = []
        self.bics, self.reason = bics, objection
        monkeypatch.setattr(checking, "_tried", lambda name, *_: [(c, EffectAtJoint(name, j), v) for c, j, v in trials])
        monkeypatch.setattr(Competition, "refit", lambda _, proposal: self.refit(proposal))
        monkeypatch.setattr(
            Competition, "assess", lambda _, at, fit: candidate_of(at.effect, at.joint, bic=fit, fit=AFTER)
        )
        monkeypatch.setattr(checking, "objection", self.objection)
        monkeypatch.setattr(checking, "_held_out_tells", lambda *_: tells)
        monkeypatch.setattr(checking, "step_of", self.step_of)

    def refit(self, proposal: Proposal) -> Any:
        self.refitted.append(proposal)
        return self.bics.get(proposal.effect_at.joint)

    def objection(self, candidate: FittedCandidate, fit: Any, options: Any, *, base: Any) -> str:
        self.objected.append((candidate.effect_at.joint, base))
        return self.reason

    def step_of(self, accepted: FittedCandidate, found: Any, *_: Any) -> Any:
        from fmu_didim.discovery.selection.decide import Step

        self.stepped.append([c.effect_at.joint for c in found])
        return Step(accepted.effect_at, 1.0, 1.0, 1.0, (), {}, {}, None)


LIMIT = effect_of("limit", class_name="a limit", pre_check=CHECK)


def checked(builder: Any = None, *, white: Noise = WHITE, **options: Any) -> tuple[Any, Any, list[str], Any]:
    said: list[str] = []
    base = ramp(white)
    fit, steps = pre_check(builder or Builder(LIMIT), base, Options(**options), Progress(said.append))
    return fit, steps, said, base


@pytest.mark.parametrize(("best", "count"), [(179.9, 1), (180.0, 1), (180.1, 0)])
def test_a_promising_trial_is_fitted(monkeypatch: pytest.MonkeyPatch, best: float, count: int) -> None:
    check = Check(monkeypatch, [(best, 1, 3.0), (790.0, 2, 5.0)], {1: 50.0, 2: 20.0})
    fit, steps, said, base = checked(white=noise((2.0, 2.0)))  # 800 samples of size one: 200
    assert len(steps) == count
    assert said == ["pre-check: a limit", "added: limit on joint 1"][: 1 + count]
    assert (fit is AFTER) if count else (fit is base)
    if count:
        assert check.refitted == [
            Proposal(EffectAtJoint("limit", j), {"limit": v}, {"limit": v}) for j, v in ((1, 3.0), (2, 5.0))
        ]
        assert check.stepped == [[1, 2]] and check.objected == [(1, base)]
        assert steps[0].remark == "" and not steps[0].untested


@pytest.mark.parametrize(("size", "may"), [(1.0, False), (1.05, False), (1.06, True), (3.0, True)])
def test_only_a_gap_leaves_a_trial_something_to_explain(size: float, may: bool) -> None:
    """A residual that is so many times its noise: a tenth of its squares is not noise from 1 / sqrt(0.9) = 1.054 on."""
    base = ramp(WHITE)
    deviation = np.sqrt(np.mean(base.residual**2, axis=0)) / size
    assert may_be_promising(replace(base, noise=noise(tuple(deviation)))) is may


def test_joints_of_the_best_four_trials_are_fitted_from_their_best_value(monkeypatch: pytest.MonkeyPatch) -> None:
    trials = [(100.0, 2, 5.0), (110.0, 2, 6.0), (120.0, 1, 3.0), (130.0, 3, 4.0), (140.0, 4, 1.0)]
    check = Check(monkeypatch, trials, {1: 50.0, 2: 20.0, 3: 70.0, 4: 90.0})
    _, steps, _, _ = checked()
    assert [(p.effect_at.joint, p.values["limit"]) for p in check.refitted] == [(2, 5.0), (1, 3.0), (3, 4.0)]
    assert check.stepped == [[3, 1, 2]] and steps[0].effect_at == EffectAtJoint("limit", 3)


def test_nothing_is_found_without_trials_or_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    Check(monkeypatch, [], {})
    assert checked()[1] == []
    Check(monkeypatch, [(100.0, 1, 3.0)], {})
    assert checked()[1] == []
    Check(monkeypatch, [(100.0, 1, 3.0), (100.0, 2, 3.0)], {2: 5.0})
    assert len(checked()[1]) == 1


@pytest.mark.parametrize(
    ("reason", "tells", "count"),
    [
        ("explains 1 % of the gap", True, 0),
        ("explains 1 % of the gap", False, 0),
        ("held-out RMS ratio 1.010", True, 0),
        ("held-out RMS ratio 1.010", False, 1),
    ],
)
def test_held_out_data_that_do_not_reach_the_limit_say_nothing(
    monkeypatch: pytest.MonkeyPatch, reason: str, tells: bool, count: int
) -> None:
    Check(monkeypatch, [(100.0, 1, 3.0)], {1: 50.0}, objection=reason, tells=tells)
    _, steps, _, _ = checked()
    assert [s.untested for s in steps] == count * [True]
    assert [s.remark for s in steps] == count * [
        "limit on joint 1: the held-out experiment hardly reaches the limit and neither confirms nor contradicts it; "
        "only the estimation data decided."
    ]


def test_only_effects_with_a_check_that_are_not_forbidden(monkeypatch: pytest.MonkeyPatch) -> None:
    Check(monkeypatch, [(100.0, 1, 3.0)], {1: 50.0})
    other = effect_of("other", class_name="another limit", pre_check=CHECK)
    _, steps, said, _ = checked(Builder(effect_of("friction"), LIMIT, other))
    assert [s.effect_at.effect for s in steps] == ["limit"]  # the second looks at what the first leaves, 80
    assert said[0] == "pre-check: a limit" and "pre-check: another limit" in said
    _, steps, said, _ = checked(Builder(LIMIT), forbid=frozenset({"limit"}))
    assert (steps, said) == ([], [])


@pytest.mark.parametrize(
    ("change", "value", "low", "blocks", "tells"),
    [
        (0.6, 0.9, 0.0, 4.0, True),  # reached often enough for a judgement
        (0.6, 0.9, 0.0, 3.6, False),  # some draws of the bootstrap hold no such block
        (0.6, 1.0, 0.0, 3.6, True),  # as bad with it as without it
        (0.6, 0.9, None, 3.6, True),
        (0.59, 1.5, 0.0, 9.0, False),  # hardly reached
        (0.59, 1.5, 1.021, 1.0, True),
        (0.59, 1.5, 1.02, 9.0, False),
        (0.59, 1.5, None, 1.0, True),
    ],
)
def test_whether_held_out_data_tell(
    monkeypatch: pytest.MonkeyPatch, change: float, value: float, low: float | None, blocks: float, tells: bool
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(Competition, "change_without", lambda *_, **more: asked.append(more) or change)
    monkeypatch.setattr(checking, "held_out_ratio", lambda *_, seed: None if low is None else Ratio(value, low, 2.0))
    monkeypatch.setattr(checking, "held_out_blocks", lambda *_: blocks)
    found = _held_out_tells(candidate_of(), Competition(Builder(), table_fit(5.0)), Options())
    assert found is tells
    assert asked == [{"held_out": True}]
