"""The competition, on signatures and laws made by hand: screening, the shortlist, starts, what a candidate is worth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import SimulationError
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.screening.catalogue import Signature
from fmu_didim.discovery.selection import competition as entries
from fmu_didim.discovery.selection.candidates import FittedCandidate, Fruitless, Outcome, ScreenedCandidate
from fmu_didim.discovery.selection.competition import Competition, _idle, foreseen, proposal_of
from fmu_didim.dynamics.effects import Search
from fmu_didim.fit.ending import Ending
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.free_parameter import FreeParameter
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.by_hand import SAMPLES, SIGNS, Catalogue, TableModel, effect_of, fit_of, noise
from tests.model.law_model import LawModel, free

WHITE = noise()
K = np.arange(SAMPLES)
BASE, OTHER, THIRD, FOURTH = (SIGNS * np.where(K // m % 2 == 0, 1.0, -1.0) for m in (2, 4, 8, 16))
"""Orthogonal columns of ones, white like noise; the base model has the first."""


def column(*parts: tuple[float, np.ndarray]) -> np.ndarray:
    """(N, 1, 1) sum of such columns."""
    return sum(a * c for a, c in parts)[:, None, None]


def signature(name: str, columns: np.ndarray, joint: int = 1, **more: Any) -> Signature:
    names = tuple(f"F{i}" for i in range(columns.shape[2]))
    return Signature(EffectAtJoint(name, joint), more.pop("shapes", {}), names, columns, {}, **more)


def base_fit(rest: np.ndarray, *effects: EffectAtJoint, white: Noise = WHITE) -> Fit:
    """A fit with the base column that leaves this residual."""
    return fit_of(TableModel(rest[:, None], {}, effects), values=[0.0], jacobian=column((1.0, BASE)), white=white)


EFFECTS = Catalogue(
    effect_of("a"), effect_of("b"), effect_of("c", class_name="a"), effect_of("gear", is_linear=False),
    effect_of("spring", is_linear=False, shows_on_neighbours=True), costs={"b": 3.0}, joints=3,
)  # fmt: skip


def screened(
    *signatures: Signature, rest: np.ndarray = 0.5 * OTHER, named: Sequence[EffectAtJoint] = (), white: Noise = WHITE
) -> list[ScreenedCandidate]:
    return Competition(EFFECTS, base_fit(rest, *named, white=white)).screen(signatures)


@pytest.mark.parametrize(("part", "found"), [(1.0, True), (0.00501, True), (0.00499, False), (0.0, False)], ids=str)
def test_a_signature_that_the_base_absorbs_is_not_screened(part: float, found: bool) -> None:
    columns = column((part, OTHER), (np.sqrt(1 - part**2), BASE))
    result = screened(signature("a", columns))
    assert bool(result) == found
    if found:
        assert result[0].surviving == pytest.approx(part, rel=1e-6)


def test_a_signature_that_is_zero_is_not_screened() -> None:
    assert screened(signature("a", column((0.0, OTHER)))) == []


def test_gain_and_coefficients_by_hand() -> None:
    # 400 independent samples, deviation 1: 0.5^2 * 400 = 100 of chi-square; a parameter costs log 400 = 5.99.
    (one,) = screened(signature("a", column((2.0, OTHER), (5.0, BASE))))
    assert one.gain == pytest.approx(100 - np.log(400), abs=1e-6)
    assert one.coefficients == pytest.approx([0.25])
    assert one.effect_at == EffectAtJoint("a", 1)


@pytest.mark.parametrize(("size", "known"), [(0.95e-8, False), (1.05e-8, True)])
def test_the_size_beside_the_largest_below_which_a_direction_has_no_coefficient(size: float, known: bool) -> None:
    tables = [column((1.0, OTHER)), size * column((1.0, THIRD))]
    (one,) = screened(signature("a", np.concatenate(tables, axis=2)), rest=0.5 * OTHER + 0.3 * THIRD)
    assert one.coefficients == pytest.approx([0.5, 0.3 / size if known else 0.0], rel=1e-6)


def test_an_effect_costs_its_parameters_but_not_idle_ones() -> None:
    tables = [column((1.0, OTHER)), column((1.0, THIRD)), 0.95e-7 * column((1.0, THIRD))]
    (three,) = screened(signature("b", np.concatenate(tables, axis=2)))
    assert three.gain == pytest.approx(100 - 2 * np.log(400), abs=1e-5)
    tables[2] = 1.05e-7 * column((1.0, SIGNS))
    (four,) = screened(signature("b", np.concatenate(tables, axis=2)))
    assert four.gain == pytest.approx(100 - 3 * np.log(400), abs=1e-5)


def test_the_best_come_first_and_each_at_its_best_shapes() -> None:
    shapes = [
        signature("a", column((1.0, OTHER), (1.0, THIRD)), shapes={"v": 1.0}),
        signature("a", column((1.0, OTHER), (0.5, THIRD)), shapes={"v": 2.0}),
        signature("b", column((1.0, OTHER)), shapes={}),
    ]
    found = screened(*shapes)
    assert [s.effect_at.effect for s in found] == ["b", "a"]
    assert found[1].signature.shapes == {"v": 2.0}
    assert found[0].others is None


def test_a_class_is_named_once_on_a_joint() -> None:
    named = [EffectAtJoint("a", 1)]
    tried = [signature(n, column((1.0, OTHER)), j) for n, j in (("a", 1), ("c", 1), ("c", 2), ("b", 1))]
    assert [(s.effect_at.effect, s.effect_at.joint) for s in screened(*tried, named=named)] == [("c", 2), ("b", 1)]


def test_a_small_residual_counts_by_the_noise() -> None:
    (one,) = screened(signature("a", column((1.0, OTHER))), white=noise([2.0]))
    assert one.gain == pytest.approx(25 - np.log(400), abs=1e-6)


def test_what_a_candidate_leaves_colours_its_prediction() -> None:
    """A missing effect as slow as the motion: hardly a sample counts before it, and all do of the white rest."""
    slow, white = 10 * np.sin(np.linspace(0, 3, 400)), np.random.default_rng(1).normal(size=400)
    left = white - BASE * (BASE @ white) / (BASE @ BASE)
    (one,) = screened(signature("a", column((1.0, slow))), rest=slow + left)
    assert one.gain < 0.1 * one.predicted
    assert one.predicted == pytest.approx(400 * np.log(np.mean((slow + left) ** 2)), rel=0.1)


def test_what_explains_most_by_its_prediction_is_fitted_in_any_case() -> None:
    """Three at most, and none that promises less than a quarter of the best."""
    tried = [replace(scored(1.0, n), predicted=p) for n, p in zip("abcde", (99.0, 26.0, 24.0, 90.0, 80.0), strict=True)]
    assert [s.effect_at.effect for s in foreseen(tried)] == ["a", "d", "e"]
    assert [s.effect_at.effect for s in foreseen(tried[:3])] == ["a", "b"]
    assert foreseen([replace(scored(1.0), predicted=-1.0)]) == []
    slow = replace(scored(1.0, "b"), predicted=99.0)
    assert slow in Competition(EFFECTS, base_fit(OTHER)).shortlist([scored(500.0), slow])


def scored(gain: float, name: str = "gear", joint: int = 1) -> ScreenedCandidate:
    return ScreenedCandidate(signature(name, column((gain, OTHER)), joint), np.array([1.0]), gain, 1.0)


def test_further_shapes_of_an_effect_outside_the_torque_balance() -> None:
    shapes = [scored(g) for g in (100.0, 76.0, 74.0, 90.0, 80.0, 78.0)]
    best = Competition(EFFECTS, base_fit(OTHER))._best(shapes)
    assert best.gain == 100.0
    assert [s.gain for s in best.others or ()] == [90.0, 80.0, 78.0]  # three at most
    alone = Competition(EFFECTS, base_fit(OTHER))._best([scored(100.0), scored(75.0), scored(75.1)])
    assert [s.gain for s in alone.others or ()] == [75.1]
    assert Competition(EFFECTS, base_fit(OTHER))._best([scored(1.0, "a"), scored(9.0, "a")]).others is None


@pytest.mark.parametrize(
    ("gains", "amounts", "chosen"),
    [
        ((100.0, 90.0), (-1.0, 1.0), 1),  # nearly as good, with an amplitude that machines have
        ((100.0, 79.0), (-1.0, 1.0), 0),  # but not where the other explains clearly more
        ((100.0, 90.0), (1.0, 1.0), 0),
        ((100.0, 90.0), (-1.0, -1.0), 0),
        ((-100.0, -90.0), (-1.0, 1.0), 1),
    ],
)
@pytest.mark.parametrize("rule", ["unusual", "impossible"])
def test_shapes_with_amplitudes_that_machines_have_come_first(
    gains: tuple[float, float], amounts: tuple[float, float], chosen: int, rule: str
) -> None:
    """A power below one and drag that falls with one above it are nearly alike beside viscous friction."""
    told = {rule: lambda values, *_: "below 0" if values["F0"] < 0 else ""}
    known = Catalogue(effect_of("a", **told))
    shapes = [replace(scored(g, "a"), coefficients=np.array([c])) for g, c in zip(gains, amounts, strict=True)]
    assert Competition(known, base_fit(OTHER))._best(shapes) is shapes[chosen]


def listed(*gains: tuple[float, str, int], **more: Any) -> list[tuple[str, int]]:
    found = Competition(EFFECTS, base_fit(OTHER)).shortlist([scored(*g) for g in gains], **more)
    return [(s.effect_at.effect, s.effect_at.joint) for s in found]


def test_the_shortlist_leaves_out_what_is_worth_little() -> None:
    assert listed((100.0, "a", 1), (25.1, "a", 2), (25.0, "a", 3)) == [("a", 1), ("a", 2)]
    assert listed((-1.0, "a", 1)) == []
    assert listed((0.0, "a", 1)) == []
    assert listed((1e-9, "a", 1)) == [("a", 1)]
    assert Competition(EFFECTS, base_fit(OTHER)).shortlist([]) == []


def test_beyond_the_shortlist_the_best_of_each_class_is_taken() -> None:
    gains = [(100.0, "a", 1), (99.0, "c", 1), (98.0, "c", 2), (97.0, "b", 1), (96.0, "b", 1)]
    assert listed(*gains, size=2) == [("a", 1), ("c", 1), ("c", 2), ("b", 1)]
    assert listed(*gains, size=1) == [("a", 1), ("c", 2), ("b", 1)]
    many = [(100.0 - i, "a", 1) for i in range(8)]
    assert len(listed(*many)) == 6


def test_a_gear_is_tried_on_all_joints() -> None:
    gains = [(100.0, "spring", 2), (50.0, "a", 1), (20.0, "spring", 1), (0.0, "spring", 3), (19.0, "gear", 1)]
    assert listed(*gains) == [("spring", 2), ("a", 1), ("spring", 1)]
    assert listed((100.0, "spring", 2), (1e-9, "spring", 3)) == [("spring", 2), ("spring", 3)]


@pytest.mark.parametrize(("small", "idle"), [(1.05e-7, 0), (0.95e-7, 1), (0.0, 1)])
def test_columns_of_rounding_are_idle(small: float, idle: int) -> None:
    columns = np.stack([3 * OTHER, -3 * small * THIRD], axis=1)
    assert _idle(columns) == idle
    assert _idle(columns[:, 1:]) == 0


# ---- fits in the closed loop: tau = M base + F shape(v) on joint 1, where v is a shape


class Builder(Catalogue):
    """Adds effects to laws: an amplitude ``F`` times a column, in a place that the shape ``v`` moves.

    Args:
        broken: smallest amplitude with which a model cannot be simulated.
    """

    def __init__(self, *effects: Any, broken: float = np.inf, absent: bool = False, **more: Any) -> None:
        super().__init__(*effects, **more)
        self.start = dict.fromkeys(plant().names[:1], 1.5)
        self.broken, self.absent, self.built = broken, absent, 0
        self.amplitudes, self.shapes = (SimpleNamespace(name="F"),), (SimpleNamespace(name="v"),)

    def build(self, model: LawModel, proposals: Sequence[Proposal]) -> LawModel:
        self.built += 1
        (proposal,) = proposals
        if self.absent:
            return model
        index, joint = len(model.added_effects), proposal.effect_at.joint
        name = f"{proposal.effect_at.effect}.F{joint}"

        def law(values: Mapping[str, float], label: str) -> np.ndarray:
            if abs(values[name]) >= self.broken:
                raise SimulationError("It diverges.", next_step="Change it.")
            shape = OTHER + values[f"{name}.v"] * THIRD
            return model.law(values, label) + values[name] * shape[:, None]

        return replace(
            model, law=law, free_parameters=(*model.free_parameters, *self._own(proposal, index)),
            added_effects=(*model.added_effects, proposal.effect_at),
        )  # fmt: skip

    def at(self, effect_at: EffectAtJoint) -> Any:
        placed = super().at(effect_at)
        placed.search, placed.free_parameters = {"v": Search(-0.4, 0.4, 3, logarithmic=False)}, self._own
        return placed

    def _own(self, proposal: Proposal, index: int) -> tuple[Any, ...]:
        joint = proposal.effect_at.joint
        name = f"{proposal.effect_at.effect}.F{joint}"
        own = (
            free(name, proposal.values["F"], -50.0, 50.0, effect=index),
            free(f"{name}.v", proposal.values.get("v", 0.0), -1.0, 1.0, effect=index, is_shape=True),
        )
        return tuple(replace(p, key=k) for p, k in zip(own, (f"F{joint}", f"v_{joint}"), strict=True))

    def without(self, model: LawModel, index: int) -> LawModel:
        names = [p.name for p in model.free_parameters if p.effect == index]

        def law(values: Mapping[str, float], label: str) -> np.ndarray:
            if label == "broken":
                raise SimulationError("It diverges.", next_step="Change it.")
            return model.law({**values, **dict.fromkeys(names, 0.0)}, label)

        return replace(
            model, law=law, free_parameters=tuple(p for p in model.free_parameters if p.effect != index),
            added_effects=tuple(a for i, a in enumerate(model.added_effects) if i != index),
        )  # fmt: skip


def plain(values: Mapping[str, float], label: str) -> np.ndarray:
    return np.asarray(values["M"] * BASE[:, None])


GEAR = EffectAtJoint("gear", 1)
DATA = (2.0 * BASE + 3.0 * (OTHER + 0.5 * THIRD))[:, None]


def plant(measured: np.ndarray = DATA, start: float = 2.0, **more: Any) -> LawModel:
    return LawModel(plain, {"one": measured}, (free("M", start),), **more)


def fitted(model: LawModel) -> Fit:
    residual = model.measured - 2.0 * BASE[:, None]
    square = float(np.sum(residual**2))
    return Fit(model, np.array([2.0]), 2.0 * BASE[:, None], column((1.0, BASE)), WHITE, np.ones(1), square)


def test_a_fit_starts_where_it_is_proposed() -> None:
    builder = Builder(effect_of("gear", is_linear=False))
    found = Competition(builder, fitted(plant(workers=3))).refit(Proposal(GEAR, {"F": 2.0, "v": 0.1}))
    assert found is not None
    assert builder.built == 1
    np.testing.assert_allclose(found.values, [2.0, 3.0, 0.5], atol=5e-3)
    assert found.model.workers == 1


def test_shapes_may_be_held() -> None:
    builder = Builder(effect_of("gear"))
    found = Competition(builder, fitted(plant())).refit(Proposal(GEAR, {"F": 2.0, "v": 0.1}), hold=True)
    assert found is not None
    assert found.values[2] == 0.1
    assert found.values[1] == pytest.approx(3 * (1 + 0.05) / (1 + 0.01), rel=1e-6)
    assert (found.model.free_parameters[1].lowest, found.model.free_parameters[0].highest) == (-50.0, np.inf)


@pytest.mark.parametrize(
    ("broken", "neutral", "starts"),
    [(9.0, {}, [10.0, 3.0]), (2.0, {}, [10.0, 3.0, 0.3]), (5.0, {"F": 4.0}, [10.0, 5.8, 4.18])],
)
def test_smaller_starts_where_the_proposed_one_cannot_be_simulated(
    monkeypatch: pytest.MonkeyPatch, broken: float, neutral: dict[str, float], starts: list[float]
) -> None:
    tried: list[float] = []
    builder = Builder(effect_of("gear", neutral=neutral), broken=broken)
    build = builder.build
    monkeypatch.setattr(builder, "build", lambda m, p: (tried.append(p[0].values["F"]), build(m, p))[1])
    Competition(builder, fitted(plant())).refit(Proposal(GEAR, {"F": 10.0, "v": 0.1}))
    assert tried == pytest.approx(starts)


def test_a_stiffness_becomes_larger_instead(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[float] = []
    builder = Builder(effect_of("gear", neutral={"F": np.inf}), broken=0.0)
    build = builder.build
    monkeypatch.setattr(builder, "build", lambda m, p: (tried.append(p[0].values["F"]), build(m, p))[1])
    assert Competition(builder, fitted(plant())).refit(Proposal(GEAR, {"F": 6.0, "v": 0.1})) is None
    assert tried == pytest.approx([6.0, 20.0, 200.0])


def test_an_effect_without_parameters_of_its_own_is_not_fitted() -> None:
    builder = Builder(effect_of("gear"), absent=True)
    assert Competition(builder, fitted(plant())).refit(Proposal(GEAR, {"F": 1.0})) is None
    assert builder.built == 1


def test_a_start_lies_within_the_limits() -> None:
    found = Competition(Builder(effect_of("gear")), fitted(plant())).refit(Proposal(GEAR, {"F": 70.0, "v": -3.0}))
    assert found is not None
    assert found.chi_square < 1e-3


def test_a_fit_that_was_given_up_is_brought_to_its_minimum() -> None:
    """A competition gives it up at once where nothing that it can reach is good enough; then it is as it began."""
    builder, before = Builder(effect_of("gear")), fitted(plant())
    proposal = Proposal(GEAR, {"F": 2.0, "v": 0.1})
    whole = Competition(builder, before).refit(proposal)
    short = Competition(builder, before).refit(proposal, give_up_above=-1e9)
    assert whole is not None and short is not None
    assert short.given_up and not whole.given_up
    assert short.chi_square > 10 * whole.chi_square
    candidate = Competition(builder, before).assess(GEAR, short)
    at_the_end = Competition(builder, before).finished(candidate)
    assert at_the_end.fit.chi_square == pytest.approx(whole.chi_square, abs=1e-6)
    assert at_the_end.delta_bic > candidate.delta_bic
    assert Competition(builder, before).finished(at_the_end) is at_the_end


def test_how_a_fit_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, Any] = {}

    def found(model: Any, noise: Any, **more: Any) -> Any:
        asked.update(more, model=model)
        return SimpleNamespace(chi_square=0.0, given_up=False)

    monkeypatch.setattr(entries, "minimise", found)
    Competition(Builder(effect_of("gear")), fitted(plant())).refit(
        Proposal(GEAR, {"F": 2.0, "v": 0.1}), give_up_above=7.0
    )
    assert asked["stopping"] == Stopping(updates=1, give_up_above=7.0, check_all=False)
    np.testing.assert_allclose(
        asked["jacobian"][:, 0], np.stack([BASE, OTHER + 0.1 * THIRD, 2.0 * THIRD], axis=1), atol=1e-6
    )
    np.testing.assert_allclose(asked["outputs"][:, 0], 2.0 * BASE + 2.0 * (OTHER + 0.1 * THIRD))


@pytest.mark.parametrize(("own", "asked"), [(0, False), (1, False), (2, True)])
def test_an_effect_with_states_of_its_own_has_steps_of_its_own(
    monkeypatch: pytest.MonkeyPatch, own: int, asked: bool
) -> None:
    """The base has one state beyond the motion; gears and bristles may be faster than what it resolves."""
    found: list[Any] = []
    monkeypatch.setattr(
        entries,
        "with_fitting_substeps",
        lambda model, *more: found.append(more) or replace(model, substeps=7),
    )
    monkeypatch.setattr(
        entries,
        "minimise",
        lambda model, noise, **more: SimpleNamespace(chi_square=0.0, given_up=False, substeps=model.substeps),
    )
    builder, before = Builder(effect_of("gear")), fitted(replace(plant(), own_states=1))
    build = builder.build
    builder.build = lambda model, proposals: replace(build(model, proposals), own_states=own)  # type: ignore[method-assign]
    fit = Competition(builder, before).refit(Proposal(GEAR, {"F": 2.0, "v": 0.1}))
    assert bool(found) is asked and fit.substeps == (7 if asked else None)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("ends", "promised", "until", "begun", "best"),
    [
        ((0.9,), 0.0, np.inf, [2.0], 0.9),
        ((1.0,), 0.0, np.inf, [2.0], 1.0),
        ((30.0, 0.8), 0.0, np.inf, [2.0, 0.6], 0.8),
        ((30.0, 20.0, 0.7), 0.0, np.inf, [2.0, 0.6, 0.06], 0.7),
        ((30.0, 40.0, 35.0), 0.0, np.inf, [2.0, 0.6, 0.06], 30.0),
        ((30.0, 0.8), 0.0, 0.0, [2.0], 30.0),
        ((0.70,), 0.4, np.inf, [2.0], 0.70),  # three quarters of what was promised
        ((0.71, 5.0, 0.6), 0.4, np.inf, [2.0, 0.6, 0.06], 0.6),
        ((0.71, 5.0, 0.8), 0.4, np.inf, [2.0, 0.6, 0.06], 0.71),
        ((-0.9,), 0.4, np.inf, [2.0], 0.9),  # given up: another is ahead
        ((-1.1, 0.65), 0.4, np.inf, [2.0, 0.6], 0.65),
    ],
)
def test_a_fit_that_is_led_astray_starts_again_with_less_of_the_effect(
    monkeypatch: pytest.MonkeyPatch, ends: Sequence[float], promised: float, until: float, begun: list[float],
    best: float,
) -> None:  # fmt: skip
    """Astray: above the model without the effect, which is one of it, or well above what was promised. Chi-square by
    that of that model, negative where a fit was given up."""
    before, left, started = fitted(plant()), list(ends), []
    whole = before.chi_square

    def found(model: LawModel, noise: Any, **more: Any) -> Any:
        started.append(round(float(model.start[1]), 9))
        end = left.pop(0)
        return SimpleNamespace(chi_square=abs(end) * whole, given_up=end < 0)

    monkeypatch.setattr(entries, "minimise", found)
    fit = Competition(Builder(effect_of("gear")), before).refit(
        Proposal(GEAR, {"F": 2.0, "v": 0.1}), until=until, promised=promised * whole
    )
    assert fit is not None
    assert (started, fit.chi_square) == (begun, pytest.approx(best * whole))


def test_a_fit_is_finished_with_one_more_sensitivity(monkeypatch: pytest.MonkeyPatch) -> None:
    builder, before, found = one_more()
    asked: dict[str, Any] = {}
    monkeypatch.setattr(entries, "minimise", lambda model, noise, **more: asked.update(more) or found)
    competition = Competition(builder, before)
    competition.finished(replace(competition.assess(GEAR, found), fit=replace(found, ending=Ending.HOPELESS)))
    assert asked["stopping"] == Stopping(updates=1, check_all=False)


def one_more(**more: Any) -> tuple[Builder, Fit, Fit]:
    """Builder, the fit without and the fit with an effect of amplitude 3."""
    builder, before = Builder(effect_of("gear"), **more), fitted(plant())
    found = Competition(builder, before).refit(Proposal(GEAR, {"F": 2.0, "v": 0.5}))
    assert found is not None
    return builder, before, found


def test_what_a_contender_is_worth() -> None:
    builder, before, found = one_more(costs={"gear": 1.5})
    one = Competition(builder, replace(before, model=replace(before.model, workers=3))).assess(GEAR, found)
    assert one.effect_at == GEAR
    assert one.cost == 1.5
    # Variances 9 * 1.25 before, and the floor of a quarter of the noise after.
    assert one.delta_bic == pytest.approx(400 * np.log(11.25 / 0.25) - 1.5 * np.log(400), rel=1e-3)
    assert one.size == pytest.approx(np.sqrt(11.25), rel=1e-4)
    assert one.share == 1.0
    assert one.change == pytest.approx(3 * np.sqrt(1.25), rel=1e-4)
    assert one.fit.model.workers == 3


def test_amplitudes_that_change_nothing_cost_nothing() -> None:
    builder, before, found = one_more(costs={"gear": 2.0})
    builder.amplitudes = (SimpleNamespace(name="F"), SimpleNamespace(name="mass"))
    assert Competition(builder, before).assess(GEAR, found).cost == 1.0
    further = FreeParameter("mass1", "kg", "plant", "mass1", 0.0, 1.0, effect=0)
    model = found.model.with_free((*found.model.free_parameters, further))
    idle = np.concatenate([found.jacobian, 1e-9 * found.jacobian[:, :, :1]], axis=2)
    whole = replace(found, model=model, jacobian=idle, values=np.append(found.values, 0.0))
    monkey = builder.without
    builder.without = lambda m, i: monkey(found.model, i)
    assert Competition(builder, before).assess(GEAR, whole).cost == 1.0


def test_only_amplitudes_of_its_own_count() -> None:
    builder, before, found = one_more(costs={"gear": 4.0})
    further = tuple(replace(free(f"N{i}", 0.0), effect=None) for i in range(2))
    model = found.model.with_free((*found.model.free_parameters, *further))
    slopes = np.concatenate([found.jacobian, column((1.0, SIGNS)), column((1.0, SIGNS))], axis=2)
    known = builder.without
    builder.without = lambda m, i: known(found.model, i)
    whole = replace(found, model=model, jacobian=slopes, values=np.append(found.values, [0.0, 0.0]))
    assert Competition(builder, before).assess(GEAR, whole).cost == 4.0


def test_the_change_of_the_torque_is_that_of_the_joint_where_it_is_largest() -> None:
    builder, _, found = one_more()
    halved = replace(found, noise=noise([0.5]))
    change = Competition(builder, halved).change_without(GEAR, halved)
    assert change == pytest.approx(6 * np.sqrt(1.25), rel=1e-4)
    two = np.hstack([DATA, DATA])
    model = replace(
        found.model,
        law=lambda v, label: np.hstack([np.ones((400, 1)) * v["gear.F1"], np.ones((400, 1))]),
        data={"one": two},
    )
    both = replace(found, model=model, outputs=model.torque(found.values), noise=noise([1.0, 0.1]))
    change = Competition(builder, both).change_without(GEAR, both)
    assert change == pytest.approx(3.0, rel=1e-4)


def test_the_change_of_the_held_out_torque() -> None:
    builder, _, found = one_more()

    def law(values: Mapping[str, float], label: str) -> np.ndarray:
        return np.full((100, 1), values["gear.F1"] * {"x": 1.0, "y": 2.0, "one": 9.0}[label])

    held = replace(found, model=replace(found.model, law=law, held_out=("x", "y")), values=np.array([2.0, 3.0, 0.5]))
    assert Competition(builder, held).change_without(GEAR, held, held_out=True) == pytest.approx(3 * np.sqrt(2.5))


def test_a_loop_that_does_not_run_without_an_effect_needs_it_most() -> None:
    builder, _, found = one_more()
    held = replace(found, model=replace(found.model, held_out=("broken",)))
    assert Competition(builder, held).change_without(GEAR, held, held_out=True) == np.inf


def test_a_contender_proposes_its_fitted_values() -> None:
    builder, before, found = one_more()
    one = Competition(builder, before).assess(GEAR, replace(found, values=np.array([2.0, 3.25, 0.75])))
    assert proposal_of(one) == Proposal(GEAR, {"F": 3.25, "v": 0.75})


def tried(gain: float, *, name: str = "gear", v: float = 0.5, others: Any = (), size: float = 3.0) -> ScreenedCandidate:
    columns = (OTHER + v * THIRD)[:, None, None]
    return ScreenedCandidate(
        Signature(EffectAtJoint(name, 1), {"v": v}, ("F",), columns, {}), np.array([size]), gain, 1.0, others
    )  # fmt: skip


@pytest.fixture
def starts(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[Proposal]]:
    """From where a candidate is fitted."""

    def of(candidate: ScreenedCandidate, builder: Builder | None = None, before: Fit | None = None) -> list[Proposal]:
        found: list[Proposal] = []
        monkeypatch.setattr(Competition, "refit", lambda _, proposal, **more: found.append(proposal))
        competition = Competition(builder or Builder(effect_of("gear")), before or fitted(plant()))
        competition.compare([candidate], progress=Progress())
        return found

    return of


def test_sizes_and_shapes_are_tried_in_the_loop_and_the_best_two_taken(starts: Callable[..., list[Proposal]]) -> None:
    found = starts(tried(100.0, others=(tried(90.0, v=-0.5),)))
    assert [p.values for p in found] == [{"v": 0.5, "F": 3.0}, {"v": 0.5, "F": 1.5}]


def test_further_shapes_are_tried_too(starts: Callable[..., list[Proposal]]) -> None:
    found = starts(tried(100.0, v=-0.9, others=(tried(90.0, v=0.5),)))
    assert [p.values["v"] for p in found] == [0.5, 0.5]


def test_sizes_that_cannot_be_simulated_are_left_out(starts: Callable[..., list[Proposal]]) -> None:
    builder = Builder(effect_of("gear"), broken=2.0)
    assert [p.values["F"] for p in starts(tried(100.0), builder)] == [1.5]
    builder.broken = 0.0
    assert [p.values["F"] for p in starts(tried(100.0), builder)] == [3.0]


def test_trial_sizes_stay_within_the_limits_and_the_base_is_fitted_along(
    starts: Callable[..., list[Proposal]],
) -> None:
    before = fitted(plant(DATA + 40.0 * BASE[:, None] + 47.0 * (OTHER + 0.5 * THIRD)[:, None]))
    assert [p.values["F"] for p in starts(tried(100.0, size=40.0), before=before)] == [80.0, 40.0]


def competing(
    *candidates: ScreenedCandidate, builder: Builder | None = None, before: Fit | None = None
) -> tuple[Any, list[str]]:
    said: list[str] = []
    competition = Competition(builder or Builder(effect_of("gear"), effect_of("a")), before or fitted(plant()))
    return competition.compare(candidates, progress=Progress(said.append)).ranking, said


def test_contenders_come_the_best_first() -> None:
    found, said = competing(tried(50.0, name="a", v=0.0, others=None, size=2.0), tried(100.0))
    assert {c.effect_at.effect for c in found} == {"a", "gear"}
    assert [c.delta_bic for c in found] == sorted((c.delta_bic for c in found), reverse=True)
    worth = {c.effect_at.effect: f"{c.delta_bic:.0f}" for c in found}
    first, last = sorted(said)
    assert first.startswith("fitting candidate 1 of 2, about ")
    assert first.endswith(f" s left: a on joint 1, BIC difference {worth['a']}")
    assert last == f"fitting candidate 2 of 2: gear on joint 1, BIC difference {worth['gear']}"


def test_one_that_cannot_be_simulated_is_left_out() -> None:
    found, said = competing(tried(100.0), builder=Builder(effect_of("gear"), broken=0.0))
    assert (found, said) == ((), ["fitting candidate 1 of 1: gear on joint 1 cannot be simulated"])
    assert competing() == ((), [])


def test_what_every_base_model_has_and_a_black_box_lacks_is_always_tried() -> None:
    """Where the base has gone astray without it, its signature tells nothing, nor what it promises."""
    builder = Builder(effect_of("gear"), effect_of("coulomb", is_base=True))
    competition = Competition(builder, fitted(plant()))
    low = [scored(-1.0, "gear"), scored(-2.0, "coulomb")]
    assert [s.effect_at.effect for s in competition.shortlist(low)] == ["coulomb"]
    weak = Signature(EffectAtJoint("coulomb", 1), {"v": 0.0}, ("F",), FOURTH[:, None, None], {})
    chosen = [tried(100.0), *(ScreenedCandidate(weak, np.array([1.0]), 50.0, 1.0, None) for _ in range(4))]
    comparison = competition.compare(chosen, progress=Progress())
    assert not comparison.unfitted
    assert Outcome.LEFT_EARLY not in [t.outcome for t in comparison.tried if t.delta_bic is None]


def test_shapes_of_missing_friction_are_held_until_all_else_is_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """From three places of its range, with the values of the base and then of the case; the best of each is set free,
    and taken where it is better."""
    builder = Builder(effect_of("coulomb", is_base=True))
    competition = Competition(builder, fitted(plant()))
    asked: list[tuple[float, float | None, bool]] = []
    refit = Competition.refit

    def counted(self: Competition, proposal: Proposal, **more: Any) -> Fit | None:
        begin = more.get("begin")
        asked.append((proposal.values["v"], None if begin is None else float(begin[0]), more.get("hold", False)))
        found = refit(self, proposal, **more)
        return found if more.get("hold") or found is None else replace(found, chi_square=1e9)

    monkeypatch.setattr(Competition, "refit", counted)
    comparison = competition.compare([tried(100.0, name="coulomb", v=0.9, others=None)], progress=Progress())
    held = [(v, start, True) for start in (None, 1.5) for v in (-0.4, 0.0, 0.4)]
    assert asked == [(0.9, None, False), *held]
    (found,) = comparison.ranking
    assert found.fit.chi_square < 1.0  # that of the data, which have no noise
    assert found.fit.values == pytest.approx([2.0, 3.0, 0.5], abs=1e-3)
    assert [(p.lowest, p.highest) for p in found.fit.model.free_parameters if p.is_shape] == [(-1.0, 1.0)]


def outcomes(progress: Progress, **more: Any) -> list[tuple[str, Outcome]]:
    """Of two candidates."""
    competition = Competition(Builder(effect_of("gear"), effect_of("a"), **more), fitted(plant()))
    candidates = [tried(100.0), tried(50.0, name="a", v=0.0, others=None, size=2.0)]
    comparison = competition.compare(candidates, progress=progress)
    assert comparison.is_cut == any(t.outcome is Outcome.NOT_TRIED for t in comparison.tried)
    assert [t.delta_bic for t in comparison.tried if t.delta_bic is not None] == [
        c.delta_bic for c in comparison.ranking
    ]
    return [(t.effect_at.effect, t.outcome) for t in comparison.tried]


def test_what_became_of_each_candidate_is_told() -> None:
    assert outcomes(Progress()) == [("gear", Outcome.FITTED), ("a", Outcome.FITTED)]
    assert outcomes(Progress(), broken=0.0) == [("gear", Outcome.NOT_SIMULABLE), ("a", Outcome.NOT_SIMULABLE)]
    assert outcomes(Progress(ends=0.0)) == [("gear", Outcome.NOT_TRIED), ("a", Outcome.NOT_TRIED)]


@pytest.mark.parametrize(("part", "left"), [(0.26, False), (0.24, True)])
def test_a_signature_tells_what_is_out_of_reach(monkeypatch: pytest.MonkeyPatch, part: float, left: bool) -> None:
    """The best has explained 3^2 * 400 * 1.25 = 4500 of chi-square: another one must promise a quarter of it. Only in
    the torque balance is a signature the slope that promises."""
    monkeypatch.setattr("fmu_didim.discovery.selection.competition.ABREAST", 1)
    slope = np.sqrt(part) * (OTHER + 0.5 * THIRD) + np.sqrt(1 - part) * np.sqrt(1.25) * FOURTH
    weak = Signature(EffectAtJoint("a", 1), {"v": 0.0}, ("F",), slope[:, None, None], {})
    candidates = [
        tried(100.0),
        ScreenedCandidate(weak, np.array([1.0]), 50.0, 1.0, None),
        ScreenedCandidate(weak, np.array([1.0]), 50.0, 1.0, ()),
    ]
    competition = Competition(Builder(effect_of("gear"), effect_of("a")), fitted(plant()))
    comparison = competition.compare(candidates, progress=Progress())
    assert [t.outcome is Outcome.LEFT_EARLY and t.delta_bic is None for t in comparison.tried] == [False, left, False]
    assert comparison.unfitted == ((candidates[1],) if left else ())
    assert not competition.compare(candidates, progress=Progress(), reach=np.inf).unfitted


@pytest.mark.parametrize(
    ("before", "reach", "left"),
    [(None, 4.0, False), (1.0, 4.0, True), (0.7, 4.0, True), (0.6, 4.0, False), (1.0, np.inf, False)],
)
def test_what_was_led_astray_is_fitted_again_where_it_promises_half_as_much_more(
    monkeypatch: pytest.MonkeyPatch, before: float | None, reach: float, left: bool
) -> None:
    """Or where all others were refused. ``before``: of what it promises now, when its fit was led astray."""
    slope = Signature(EffectAtJoint("a", 1), {"v": 0.0}, ("F",), column((1.0, OTHER)), {})
    candidate = ScreenedCandidate(slope, np.array([1.0]), 50.0, 1.0, None)
    competition = Competition(Builder(effect_of("a")), fitted(plant()))
    promised = competition._promised(candidate)
    astray = {} if before is None else {candidate.effect_at: before * promised}
    refit = Competition.refit
    for gained in (-1e9, 4.9, 5.1):  # of chi-square: less than five is nothing
        ended = partial(ending_at, competition.fit.chi_square - gained)
        monkeypatch.setattr(Competition, "refit", lambda *given, end=ended, **more: end(refit(*given, **more)))
        comparison = replace(competition, fruitless=Fruitless(astray)).compare(
            [candidate], progress=Progress(), reach=reach
        )
        assert comparison.unfitted == ((candidate,) if left else ())
        is_lost = not left and gained < 5
        assert comparison.fruitless.astray == ({candidate.effect_at: pytest.approx(promised)} if is_lost else {})


@pytest.mark.parametrize(
    ("before", "predicted", "foretold", "reach", "left"),
    [
        (1.0, 20.0, 100.0, 4.0, True),
        (0.7, 20.0, 100.0, 4.0, True),
        (0.6, 20.0, 100.0, 4.0, False),  # it promises half as much more now
        (1.0, 26.0, 100.0, 4.0, False),  # it may be more than a quarter of the best
        (1.0, 20.0, 20.0, 4.0, False),  # it is the best
        (1.0, -1.0, -1.0, 4.0, True),
        (1.0, 20.0, 100.0, np.inf, False),  # all others were refused
        (None, 20.0, 100.0, 4.0, False),
    ],
)
def test_what_was_fitted_in_vain_waits_for_what_foretells_more(
    before: float | None, predicted: float, foretold: float, reach: float, left: bool
) -> None:
    """``before``: of what it promises now, when its fit was in vain."""
    slope = Signature(EffectAtJoint("a", 1), {"v": 0.0}, ("F",), column((1.0, OTHER)), {})
    candidate = ScreenedCandidate(slope, np.array([1.0]), 50.0, 1.0, None, predicted)
    other = replace(tried(100.0), predicted=foretold)
    competition = Competition(Builder(effect_of("gear"), effect_of("a")), fitted(plant()))
    vain = {} if before is None else {candidate.effect_at: before * competition._promised(candidate)}
    comparison = replace(competition, fruitless=Fruitless(vain=vain)).compare(
        [other, candidate], progress=Progress(), reach=reach
    )
    assert comparison.unfitted == ((candidate,) if left else ())


@pytest.mark.parametrize(
    ("gained", "bic", "given_up", "astray", "vain"),
    [
        (50.0, -0.1, False, False, True),
        (50.0, 0.1, False, False, False),
        (50.0, -0.1, True, False, False),  # nobody knows where its fit would have ended
        (4.9, -5.0, False, True, False),
    ],
)
def test_a_whole_fit_that_ends_worse_by_bic_was_in_vain(
    monkeypatch: pytest.MonkeyPatch, gained: float, bic: float, given_up: bool, astray: bool, vain: bool
) -> None:
    slope = Signature(EffectAtJoint("a", 1), {"v": 0.0}, ("F",), column((1.0, OTHER)), {})
    candidate = ScreenedCandidate(slope, np.array([1.0]), 50.0, 1.0, None)
    competition = Competition(Builder(effect_of("a")), fitted(plant()))
    assess = Competition.assess

    def assessed(self: Competition, effect_at: EffectAtJoint, found: Fit) -> FittedCandidate:
        ending = Ending.HOPELESS if given_up else Ending.SETTLED
        found = replace(found, chi_square=self.fit.chi_square - gained, ending=ending)
        return replace(assess(self, effect_at, found), fit=found, delta_bic=bic)

    monkeypatch.setattr(Competition, "assess", assessed)
    comparison = competition.compare([candidate], progress=Progress())
    known = {candidate.effect_at: pytest.approx(competition._promised(candidate))}
    assert comparison.fruitless == Fruitless(known if astray else {}, known if vain else {})


def ending_at(chi_square: float, fit: Fit | None) -> Fit:
    assert fit is not None
    return replace(fit, chi_square=chi_square)


def test_the_joint_with_the_largest_gap_comes_first() -> None:
    """What concerns all joints comes before all; on one joint the order of the screening stays."""
    builder = Catalogue(effect_of("a"), effect_of("b"), effect_of("clock"), joints=3)
    of_all = builder.joints
    builder.joints = lambda name: of_all(name)[: 1 if name == "clock" else None]  # type: ignore[method-assign]
    rest = np.column_stack([1.5 * SIGNS, 3.0 * SIGNS, 2.0 * SIGNS])
    fit = fit_of(TableModel(rest), white=noise([1.0, 1.0, 1.0]))
    places = [("a", 1), ("a", 2), ("b", 3), ("clock", 1), ("b", 2), ("b", 1)]
    chosen = [replace(scored(1.0, name, joint), others=()) for name, joint in places]
    found = Competition(builder, fit).compare(chosen, progress=Progress(ends=0.0)).tried
    assert [(t.effect_at.effect, t.effect_at.joint) for t in found] == [
        ("a", 2), ("clock", 1), ("b", 2), ("b", 3), ("a", 1), ("b", 1)
    ]  # fmt: skip


def test_what_is_out_of_reach_of_the_best_is_left_early(monkeypatch: pytest.MonkeyPatch) -> None:
    refit = Competition.refit
    monkeypatch.setattr(Competition, "refit", lambda *given, **more: refit(*given, **{**more, "give_up_above": -1e9}))
    assert outcomes(Progress()) == [("gear", Outcome.FITTED), ("a", Outcome.LEFT_EARLY)]  # one starts at its minimum


def test_a_fit_in_whose_middle_the_time_ends_does_not_count() -> None:
    readings = iter([0.0, 0.0, 0.0, 2.0, 2.0, 2.0, 2.0])  # told, begin of the first, its scan, after its fit, ...
    progress = Progress(ends=1.0, now=lambda: next(readings))
    assert outcomes(progress) == [("gear", Outcome.NOT_TRIED), ("a", Outcome.NOT_TRIED)]


def test_starts_are_scanned_for_leaders_outside_the_torque_balance_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    scanned: list[float] = []
    monkeypatch.setattr(
        Competition, "_scanned", lambda self, c: scanned.append(c.gain) or [c.signature.proposal(c.coefficients)]
    )
    competing(tried(100.0), tried(75.0), tried(74.9), tried(90.0, others=None))
    assert scanned == [100.0, 75.0]


@pytest.mark.parametrize(
    ("abreast", "why", "asked"),
    [
        (1, "", [995.0, 900.0, 400.0, 400.0]),
        (2, "", [995.0, 900.0, 995.0, 400.0]),  # those of one group do not see each other, whichever ends first
        (4, "", [995.0, 900.0, 995.0, 995.0]),
        (1, "physically impossible", [995.0, 900.0, 995.0, 995.0]),
    ],
)
def test_each_fit_must_promise_more_than_the_best_so_far(
    monkeypatch: pytest.MonkeyPatch, abreast: int, why: str, asked: list[float]
) -> None:
    """The best is a plausible one of the groups before, or another start of its own."""
    seen: list[float] = []
    squares = iter([900.0, 400.0, 600.0, 300.0])
    before = fitted(plant())

    def one(self: Any, proposal: Proposal, *, give_up_above: float, until: float, promised: float) -> Fit | None:
        seen.append(give_up_above)
        square = next(squares)
        return None if square == 600.0 else replace(before, chi_square=square)

    found: list[float] = []
    monkeypatch.setattr("fmu_didim.discovery.selection.competition.ABREAST", abreast)
    monkeypatch.setattr(Competition, "refit", one)
    monkeypatch.setattr(
        Competition, "assess",
        lambda self, at, fit: found.append(fit.chi_square)
        or SimpleNamespace(effect_at=at, delta_bic=-fit.chi_square, fit=fit, share=0.0, cost=1.0, implausible=why),
    )  # fmt: skip
    monkeypatch.setattr(Competition, "_scanned", lambda *_: ["one", "two"])
    result, _ = competing(
        tried(100.0), tried(60.0, others=None), tried(61.0, others=None), before=replace(before, chi_square=1000.0)
    )
    assert seen == asked
    assert found == [400.0, 300.0]  # of two starts the better one
    assert [c.delta_bic for c in result] == [-300.0, -400.0]


def test_the_first_of_two_starts_is_kept_where_it_is_better(monkeypatch: pytest.MonkeyPatch) -> None:
    squares, before = iter([400.0, 900.0]), fitted(plant())
    monkeypatch.setattr(Competition, "refit", lambda *_, **__: replace(before, chi_square=next(squares)))
    monkeypatch.setattr(Competition, "_scanned", lambda *_: ["one", "two"])
    monkeypatch.setattr(
        Competition,
        "assess",
        lambda self, at, fit: SimpleNamespace(
            effect_at=at, delta_bic=fit.chi_square, fit=fit, share=0.0, cost=1.0, implausible=""
        ),
    )
    assert [c.delta_bic for c in competing(tried(100.0))[0]] == [400.0]


def test_shapes_held_at_all_that_were_screened() -> None:
    candidate = tried(100.0, v=0.4, others=(tried(90.0, v=0.5),))
    found = list(Competition(Builder(effect_of("gear")), fitted(plant())).with_shapes_held(candidate))
    assert [c.fit.values[2] for c in found] == [0.4, 0.5]
    assert found[1].fit.chi_square < 1e-6 < found[0].fit.chi_square
    diverging = Competition(Builder(effect_of("gear"), broken=0.0), fitted(plant()))
    assert list(diverging.with_shapes_held(replace(candidate, others=None))) == []


def test_the_best_harmonic_of_the_motor_beside_a_better_frequency() -> None:
    """A larger ripple at another frequency, too small for a name itself, would hide one of the motor."""
    known, builder = {40.0, 80.0}, Catalogue(effect_of("a"))
    placed = SimpleNamespace(cost=5.0, cost_with=lambda shapes: 2.5 if shapes["nr"] in known else 5.0)
    builder.at = lambda effect_at: placed  # type: ignore[method-assign]
    at = {
        nr: replace(shape, signature=replace(shape.signature, shapes={"nr": nr}))
        for nr, shape in ((23.0, scored(100.0, "a")), (80.0, scored(50.0, "a")), (40.0, scored(60.0, "a")))
    }
    best = Competition(builder, base_fit(OTHER))._best(list(at.values()))
    assert (best.signature.shapes, best.of_motor) == ({"nr": 23.0}, at[40.0])
    alone = Competition(builder, base_fit(OTHER))._best([at[40.0], at[80.0]])
    assert (alone.signature.shapes, alone.of_motor) == ({"nr": 40.0}, None)
    known.clear()  # no motor is stated
    assert Competition(builder, base_fit(OTHER))._best(list(at.values())).of_motor is None
