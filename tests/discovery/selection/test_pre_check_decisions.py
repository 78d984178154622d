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
from fmu_didim.discovery.selection import decide
from fmu_didim.discovery.selection import pre_check as checking
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import Options
from fmu_didim.discovery.selection.pre_check import (
    Trial,
    _fitted,
    _held_out_tells,
    _tried,
    apart,
    lines,
    may_be_promising,
    pre_check,
)
from fmu_didim.dynamics.effects import EFFECTS, PreCheck, Search
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import Ratio
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.by_hand import Catalogue, TableModel, candidate_of, effect_of, fit_of, noise, residual, table_fit

WHITE = noise((1.0, 1.0))
CHECK = PreCheck("limit", (1.0, 0.5))
FALLING = PreCheck("stall", (0.5, 0.95, 0.998), speed="speed", speeds=Search(1.05, 8.0, 16), flattest=10.0)
AFTER = table_fit(0.1, 0.1)
LIMIT = effect_of("limit", class_name="a limit", pre_check=CHECK, title="A limit")
FALLS = effect_of("falls", class_name="a limit", pre_check=FALLING, title="A falling limit")


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
    builder, fit = Builder(LIMIT, left={(1, 3.0): 0.7, (1, 1.0): 0.9, (2, 7.98): 0.8, (2, 3.99): 0.6}), ramp()
    builder.left[1, round(float(np.quantile(np.abs(fit.model.measured[:, 0]), 0.5)), 6)] = 0.9
    found = _tried("limit", CHECK, Competition(builder, fit))
    assert [(t.square, t.effect_at.joint) for t in found] == [
        (pytest.approx(480.0), 2), (pytest.approx(560.0), 1), (pytest.approx(640.0), 2), (pytest.approx(720.0), 1)
    ]  # fmt: skip
    assert [t.values["limit"] for t in found] == pytest.approx([3.99, 3.0, 7.98, 1.0], abs=0.01)
    assert [p.effect_at for p in builder.proposed][:2] == [EffectAtJoint("limit", 1)] * 2


def test_trials_that_cannot_be_added_or_simulated_are_left_out() -> None:
    left = {(2, 7.98): None, (2, 3.99): 0.5}
    found = _tried("limit", CHECK, Competition(Builder(LIMIT, left=left, refused=[1]), ramp(noise((1.0, 2.0)))))
    assert [(t.square, t.effect_at.joint, t.values["limit"]) for t in found] == [
        (pytest.approx(250.0), 2, pytest.approx(3.99))
    ]


def test_what_the_model_has_is_not_tried_again() -> None:
    fit = ramp()
    present = replace(fit, model=replace(fit.model, added_effects=(EffectAtJoint("limit", 2),)))
    builder = Builder(LIMIT, left={(1, 3.0): 0.7, (1, 1.0): 0.9})
    builder.left[1, round(float(np.quantile(np.abs(fit.model.measured[:, 0]), 0.5)), 6)] = 0.9
    assert {t.effect_at.joint for t in _tried("limit", CHECK, Competition(builder, present))} == {1}
    other = replace(fit, model=replace(fit.model, added_effects=(EffectAtJoint("falls", 1),)))
    builder = Builder(LIMIT, FALLS, left={(2, 7.98): 0.8, (2, 3.99): 0.6})  # nor is another one of its class
    assert {t.effect_at.joint for t in _tried("limit", CHECK, Competition(builder, other))} == {2}


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
        named = trials if isinstance(trials, dict) else {"limit": trials, "other": trials}
        self.asked: dict[str, Any] = {}
        monkeypatch.setattr(
            checking, "_tried",
            lambda name, check, _, limited=(): self.asked.update({name: sorted(limited)}) or [
                Trial(c, EffectAtJoint(name, j), {check.parameter: v, **({check.speed: 9.0} if check.speed else {})})
                for c, j, v in named[name]
            ],
        )  # fmt: skip
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


# ---- a limit that falls with the speed


STALL, NO_LOAD = 10.0, 6.0


def limited(
    *, noise_of: float = 0.0, places: Sequence[float] = (0.1, 0.4, 0.7), stall: float = STALL, speed: float = NO_LOAD
) -> tuple[Any, Any, Any]:
    """Measured and simulated torque, and velocity, of a joint that meets its limit at parts of its largest speed, 3."""
    t = np.linspace(0.0, 10.0, 2000)
    velocity = 3.0 * np.sin(1.3 * t)
    simulated = 5.0 * np.cos(3.1 * t)
    for part in places:
        near = np.abs(velocity - 3.0 * part) < 0.05
        simulated = np.where(near, 1.2 * stall * (1 - velocity / speed), simulated)
    clipped = np.clip(simulated, -stall * (1 + velocity / speed), stall * (1 - velocity / speed))
    return clipped + noise_of * np.random.default_rng(3).normal(size=t.size), simulated, velocity


@pytest.mark.parametrize("noise_of", [0.0, 0.02, 0.1])
def test_lines_lie_along_what_the_drive_has_left(noise_of: float) -> None:
    measured, simulated, velocity = limited(noise_of=noise_of)
    found = lines(FALLING, measured, simulated, velocity, deviation=max(noise_of, 0.02), least=1.0)
    assert 4 <= len(found) <= 8
    nearest = min(found, key=lambda values: abs(values["speed"] - NO_LOAD))
    assert nearest["speed"] == pytest.approx(NO_LOAD, rel=0.1)
    assert nearest["stall"] == pytest.approx(STALL, rel=0.05)
    assert len({values["speed"] for values in found}) == len(found)


@pytest.mark.parametrize(
    ("simulated_too_large", "least", "count"),
    [
        (1.0, 1e-6, False),  # no drive is at a limit: clipping takes nothing away
        (1.01, 50.0, False),  # by less than what is worth a simulation
        (1.0, -np.inf, True),  # beside a constant limit that is promising it is tried in any case
    ],
)
def test_lines_are_tried_where_they_promise_something(simulated_too_large: float, least: float, count: bool) -> None:
    _, simulated, velocity = limited(places=())
    found = lines(FALLING, simulated, simulated_too_large * simulated, velocity, deviation=0.02, least=least)
    assert bool(found) is count


def test_a_joint_that_stands_still_has_no_lines() -> None:
    measured, simulated, velocity = limited()
    assert lines(FALLING, measured, simulated, 0 * velocity, deviation=0.02, least=-np.inf) == []


def test_braking_as_a_generator_may_take_more_than_the_stall_torque() -> None:
    """The line of the other side: samples beyond the stall torque that brake contradict no limit."""
    measured, simulated, velocity = limited()
    t = np.linspace(0.0, 10.0, 2000)
    brakes = np.abs(velocity + 2.4) < 0.05
    strong = np.where(brakes, 1.3 * STALL, 0.0)
    found = lines(FALLING, measured + strong, simulated + strong, velocity, deviation=0.02, least=1.0)
    assert t.size == velocity.size and any(
        values["speed"] == pytest.approx(NO_LOAD, rel=0.1) and values["stall"] == pytest.approx(STALL, rel=0.05)
        for values in found
    )


def test_the_shipped_check_tries_the_line() -> None:
    shipped = EFFECTS["voltage_limit"].pre_check
    assert shipped is not None
    measured, simulated, velocity = limited(noise_of=0.02)
    found = lines(shipped, measured, simulated, velocity, deviation=0.02, least=1.0)
    assert any(values["no_load_speed"] == pytest.approx(NO_LOAD, rel=0.1) for values in found)
    assert shipped.speeds is not None and shipped.flattest > shipped.speeds.highest


def test_starts_are_apart() -> None:
    at = EffectAtJoint("falls", 1)
    trials = [Trial(float(i), at, {"speed": v}) for i, v in enumerate((6.0, 6.9, 5.2, 8.0, 4.0, 20.0, 1.0))]
    assert [t.values["speed"] for t in apart(trials, "speed")] == [6.0, 8.0, 4.0, 20.0]


def test_a_limit_that_falls_is_fitted_from_several_starts_to_the_end_of_its_valley(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    at, ends = EffectAtJoint("falls", 1), {6.0: 50.0, 3.0: 40.0, 12.0: 45.0, 24.0: None}
    asked: list[float] = []

    def refit(_: Any, proposal: Proposal) -> Any:
        asked.append(proposal.values["speed"])
        square = ends[proposal.values["speed"]]
        return None if square is None else SimpleNamespace(chi_square=square, model=square)

    monkeypatch.setattr(Competition, "refit", refit)
    walked = {40.0: 39.0, 45.0: 20.0}  # the two best go on
    monkeypatch.setattr(
        checking, "minimise", lambda model, noise, stopping: SimpleNamespace(chi_square=walked[model], model=model)
    )
    trials = [Trial(1.0, at, {"stall": 1.0, "speed": v}) for v in ends]
    found: Any = _fitted(at, trials, Competition(Builder(FALLS), ramp()))
    assert asked == [6.0, 3.0, 12.0, 24.0] and found.chi_square == 20.0


Told = tuple[str | None, list[str], bool]


@pytest.mark.parametrize(
    ("constant", "falling", "ratio", "objections", "told"),
    [
        # Both explain as much: met at one speed only, the simpler one stands and the set holds both.
        (100.0, 105.0, None, {}, ("limit", ["falls"], False)),
        (2000.0, 2039.0, None, {}, ("limit", ["falls"], False)),
        # Beyond what is ambiguous the one that falls is named, and the set holds it alone.
        (100.0, 111.0, None, {}, ("falls", [], False)),
        (2000.0, 2050.0, None, {}, ("falls", [], False)),
        (105.0, 90.0, None, {}, ("limit", [], False)),
        # Held-out data that are worse with it speak for the constant one.
        (100.0, 200.0, (1.05, 1.01, 1.1), {}, ("limit", ["falls"], False)),
        # A held-out motion that does not tell them apart is told.
        (100.0, 200.0, (1.0, 0.99, 1.01), {}, ("falls", [], True)),
        (100.0, 200.0, (0.8, 0.7, 0.9), {}, ("falls", [], False)),
        # What is refused gives way to what is not.
        (100.0, 200.0, None, {"falls": "explains 1 % of the gap"}, ("limit", ["falls"], False)),
        (100.0, 105.0, None, {"limit": "explains 1 % of the gap"}, ("falls", ["limit"], False)),
        (100.0, 105.0, None, {"limit": "explains 1 %", "falls": "explains 1 %"}, (None, [], False)),
        # A constant one that the fitted data prefer is confirmed as the other one is, where nothing tells them apart.
        (111.0, 100.0, (0.8, 0.5, 1.2), {"limit": "held-out RMS ratio 1.035"}, ("limit", ["falls"], True)),
        (111.0, 100.0, None, {"limit": "held-out RMS ratio 1.035"}, ("limit", ["falls"], True)),
        (109.0, 100.0, (0.8, 0.5, 1.2), {"limit": "held-out RMS ratio 1.035"}, ("falls", ["limit"], False)),
        (111.0, 100.0, (0.8, 0.7, 0.9), {"limit": "held-out RMS ratio 1.035"}, ("falls", ["limit"], False)),
        (111.0, 100.0, (0.8, 0.5, 1.2), {"limit": "explains 1 % of the gap"}, ("falls", ["limit"], False)),
    ],
)
def test_which_limit_is_named(
    monkeypatch: pytest.MonkeyPatch, constant: float, falling: float, ratio: Any, objections: dict[str, str], told: Told
) -> None:
    """The set is that of the step: members of the class that were fitted are in it only where they are as good."""
    check = Check(monkeypatch, {"limit": [(100.0, 1, 3.0)], "falls": [(90.0, 1, 4.0)]}, {})
    bics = {"limit": constant, "falls": falling}
    monkeypatch.setattr(Competition, "refit", lambda _, proposal: bics[proposal.effect_at.effect])
    monkeypatch.setattr(checking, "_fitted", lambda at, *_: bics[at.effect])
    monkeypatch.setattr(
        Competition, "assess",
        lambda _, at, bic: candidate_of(at.effect, at.joint, bic=bic, cost=2.0 if at.effect == "falls" else 1.0),
    )  # fmt: skip
    monkeypatch.setattr(checking, "objection", lambda c, *_, **__: objections.get(c.effect_at.effect, ""))
    monkeypatch.setattr(checking, "step_of", decide.step_of)
    monkeypatch.setattr(decide, "held_out_ratio", lambda *_, **__: None)
    monkeypatch.setattr(decide, "_remark", lambda *_: "")
    monkeypatch.setattr(checking, "held_out_ratio", lambda *_, seed: None if ratio is None else Ratio(*ratio))
    _, steps, _, _ = checked(Builder(LIMIT, FALLS))
    name, ambiguous, remarked = told
    assert [s.effect_at.effect for s in steps] == ([] if name is None else [name])
    assert [a.effect for s in steps for a, _ in s.ambiguous] == ambiguous
    assert [bool(s.remark) for s in steps] == ([] if name is None else [remarked])
    said = "held-out data do not tell it from" if name == "falls" else "they do not tell it; the fitted data prefer"
    assert not remarked or said in steps[0].remark
    assert check.asked["falls"] == [1]  # where a constant limit is promising it is tried in any case


def test_a_limit_that_was_not_fitted_stays_in_the_set(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where it could not be simulated: nothing tells it then."""
    Check(monkeypatch, {"limit": [(100.0, 1, 3.0)], "falls": []}, {1: 50.0})
    monkeypatch.setattr(checking, "step_of", decide.step_of)
    monkeypatch.setattr(decide, "held_out_ratio", lambda *_, **__: None)
    monkeypatch.setattr(decide, "_remark", lambda *_: "")
    monkeypatch.setattr(Competition, "assess", lambda _, at, bic: candidate_of(at.effect, at.joint, bic=bic))
    _, steps, _, _ = checked(Builder(LIMIT, FALLS))
    assert [a.effect for a, _ in steps[0].ambiguous] == ["falls"]


def test_the_constant_limit_is_fitted_where_one_that_falls_is_promising(monkeypatch: pytest.MonkeyPatch) -> None:
    trials = {"limit": [(795.0, 1, 3.0), (796.0, 2, 3.0)], "falls": [(90.0, 2, 4.0)]}
    Check(monkeypatch, trials, {1: 50.0, 2: 50.0})
    fitted: list[tuple[str, int]] = []
    monkeypatch.setattr(checking, "_fitted", lambda at, *_: fitted.append((at.effect, at.joint)) or 50.0)
    checked(Builder(LIMIT, FALLS))
    assert fitted == [("limit", 2), ("falls", 2)]


def test_limits_that_fall_are_tried_along_the_motion_of_the_joint(monkeypatch: pytest.MonkeyPatch) -> None:
    fit = ramp()
    velocities = np.column_stack([np.linspace(-1, 1, 400), np.linspace(0, 2, 400)])
    monkeypatch.setattr(checking, "_velocities", lambda _: velocities)
    seen: list[Any] = []

    def tried(check: PreCheck, measured: Any, simulated: Any, velocity: Any, *, deviation: float, least: float) -> Any:
        seen.append((velocity[-1], deviation, least))
        return [{"limit": 1.0}] if np.isinf(least) else []

    monkeypatch.setattr(checking, "lines", tried)
    builder = Builder(FALLS, left={(2, 1.0): 0.5})
    found = _tried("falls", FALLING, Competition(builder, fit), {2})
    assert [(t.effect_at.joint, t.values) for t in found] == [(2, {"limit": 1.0})]
    assert [row[0] for row in seen] == [1.0, 2.0] and seen[1][2] == -np.inf
    assert seen[0][2] == pytest.approx(checking.WORTH_A_TRIAL * 800.0)
