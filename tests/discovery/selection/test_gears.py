"""When an elastic gear and its error are taken together, by fits whose figures are made up."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import SimulationError
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection import gears
from fmu_didim.discovery.selection.decide import Options
from fmu_didim.discovery.selection.gears import _judged, _places, gear_with_error
from fmu_didim.dynamics.effects import Search
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.by_hand import Catalogue, candidate_of, effect_of, table_fit

GEAR, ERROR = EffectAtJoint("gear", 1), EffectAtJoint("teeth", 1)


def builder_of(joints: int = 1, **costs: float) -> Any:
    gears = (effect_of("play", elastic=True), effect_of("gear", elastic=True))
    # What has no period shows once the gear is in the model, and is not looked for together with it.
    inside = (effect_of("teeth", needs_elastic=True, frequency="number"), effect_of("hardening", needs_elastic=True))
    return Catalogue(effect_of("a"), *gears, *inside, joints=joints, costs={"play": 3.0, **costs})


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
            cost_in=builder_of(gear=2.0, teeth=5.0).cost_in, without=lambda model, index: f"without {index}",
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
    competition: Any = SimpleNamespace(fit=None)
    assert gear_with_error(competition, (), competition, Options(), Progress()) is None


class Tried:
    """Stiffnesses beside each of which an error is tried; each takes four seconds.

    Args:
        left: what each leaves alone, beside 10 without a gear.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *left: float) -> None:
        self.said, self.tried, self.now = list[str](), list[tuple[float, list[float]]](), 0.0
        shape: Any = SimpleNamespace(shapes=[SimpleNamespace(name="N")], search={"N": Search(20.0, 28.0, 9)})
        base: Any = SimpleNamespace(
            rest_of=lambda values: values, weighted=lambda values: values,
            rests_of=lambda tables: [(None, table) for table in tables],
        )  # fmt: skip
        self.competition: Any = SimpleNamespace(
            base=base, fit=self.fit(10.0), builder=SimpleNamespace(at=lambda effect_at: shape)
        )
        monkeypatch.setattr(gears, "_gears", lambda *_: [(self.fit(one), f"K{one:g}") for one in left])
        monkeypatch.setattr(gears, "SignatureCatalogue", lambda builder, fit, candidates: Shapes(self, fit))

    def fit(self, left: float) -> Any:
        return SimpleNamespace(residual=np.sqrt([left]))

    def starts(self, ends: float = np.inf) -> list[tuple[Any, float]]:
        progress = Progress(self.said.append, ends=ends, now=lambda: self.now)
        return [(s.gear, s.left) for s in gears._starts(self.competition, GEAR, ERROR, progress)]


class Shapes:
    """Errors, of which that with 23 periods explains half of what a gear leaves, that with 24 two fifths, others a
    tenth."""

    def __init__(self, of: Tried, fit: Any) -> None:
        self.of, self.fit = of, fit

    def of_shapes(self, error: Any, shapes: Any) -> list[Any]:
        numbers = [float(at["N"]) for at in shapes]
        self.of.tried.append((float(self.fit.residual[0] ** 2), numbers))
        self.of.now += 4.0
        parts = {23.0: 0.5, 24.0: 0.4}
        return [
            SimpleNamespace(
                columns=np.sqrt([parts.get(n, 0.1)]), proposal=lambda c, n=n: SimpleNamespace(values={"N": n})
            )
            for n in numbers
        ]  # fmt: skip


def explained(gear: Any, signature: Any, rest: Any, residual: Any) -> Any:
    left = float(residual[0] ** 2 * (1 - rest[0] ** 2))
    return gears._Start(left, gear, signature.proposal(None))


def test_errors_are_tried_beside_each_stiffness_that_is_not_far_too_soft(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every second number first, then those between around the best, beside the best stiffness alone."""
    monkeypatch.setattr(gears, "_start", explained)
    tried = Tried(monkeypatch, 31.0, 29.0, 8.0, 12.0)
    found = tried.starts()
    first = [20.0, 22.0, 24.0, 26.0, 28.0]
    assert tried.tried == [(pytest.approx(29.0), first), (pytest.approx(8.0), first), (pytest.approx(12.0), first),
                           (pytest.approx(8.0), [23.0, 25.0])]  # fmt: skip
    assert min(found, key=lambda f: f[1]) == ("K8", pytest.approx(4.0))
    assert tried.said == [
        "gear with teeth on joint 1",
        "gear with teeth on joint 1: stiffness 2 of 3, about 4 s left",
    ]


@pytest.mark.parametrize(("ends", "count"), [(13.0, 4), (11.0, 4), (8.0, 2), (7.0, 2), (4.0, 1), (0.0, 0)])
def test_no_gear_is_begun_when_the_time_is_up(monkeypatch: pytest.MonkeyPatch, ends: float, count: int) -> None:
    """A start of some of the stiffnesses would not be the best of all."""
    monkeypatch.setattr(gears, "_start", explained)
    tried = Tried(monkeypatch, 29.0, 8.0, 12.0)
    assert bool(tried.starts(ends)) == (count == 4)
    assert len(tried.tried) == count


@pytest.mark.parametrize(("resolves", "wanted"), [(1, 4), (2, 8)])
def test_a_stiffness_is_tried_with_no_finer_steps_than_resolve_its_resonance(
    monkeypatch: pytest.MonkeyPatch, resolves: int, wanted: int
) -> None:
    asked: list[Any] = []

    def chosen(model: Any, values: Any, deviation: Any, *, times_fewest: int) -> Any:
        asked.append(deviation)
        return SimpleNamespace(**{**vars(model), "substeps": times_fewest * resolves})

    monkeypatch.setattr(gears, "with_fitting_substeps", chosen)
    monkeypatch.setattr(gears, "replace", lambda fit, **more: SimpleNamespace(**more))
    placed = SimpleNamespace(amplitudes=[SimpleNamespace(name="K")], shapes=[], search={"K": Search(1.0, 256.0, 2)})
    builder = SimpleNamespace(
        at=lambda a: placed, effect=lambda a: SimpleNamespace(neutral={"K": np.inf}),
        build=lambda model, proposals: SimpleNamespace(start=proposals[0].values["K"], outputs=lambda values: values),
    )  # fmt: skip
    fit = SimpleNamespace(model=None, noise=SimpleNamespace(deviation="noise"))
    competition: Any = SimpleNamespace(builder=builder, fit=fit)
    found = list(gears._gears(competition, GEAR))
    assert [there.model.substeps for there, _ in found] == 7 * [wanted] and asked == 7 * ["noise"]
    assert [there.outputs for there, _ in found] == pytest.approx([2.0**i for i in range(1, 8)])


@pytest.mark.parametrize(
    ("ends", "wanted"),
    [
        ([(5.0, False), (4.0, False)], 4.0),
        ([(4.0, False), (5.0, False)], 4.0),
        ([(3.0, True), (5.0, False)], 5.0),  # given up: not at its minimum, whatever it came to
        ([(3.0, True), (4.0, True)], None),
        ([(None, False), (5.0, False)], 5.0),
        ([], None),
    ],
)
def test_the_best_fit_counts_that_was_not_given_up(
    monkeypatch: pytest.MonkeyPatch, ends: list[tuple[float | None, bool]], wanted: float | None
) -> None:
    """A gear that rings where the data do not costs minutes, and never comes below the model without it."""
    left, asked = list(ends), list[Any]()

    def minimise(model: Any, noise: Any, *, stopping: Any) -> Any:
        asked.append((stopping.exact, stopping.give_up_above, stopping.until))
        chi_square, given_up = left.pop(0)
        if chi_square is None:
            raise SimulationError("It fell over.", where="here", next_step="Stand.")
        return SimpleNamespace(chi_square=chi_square, given_up=given_up)

    monkeypatch.setattr(gears, "minimise", minimise)
    monkeypatch.setattr(gears, "with_fitting_substeps", lambda model, values, deviation: model)
    limits = SimpleNamespace(limits=(np.zeros(1), np.ones(1)))
    model: Any = SimpleNamespace(start=np.ones(1), free_parameters=limits, with_values=lambda values: model)
    fit = SimpleNamespace(model=None, chi_square=9.0, noise=SimpleNamespace(deviation=None))
    competition: Any = SimpleNamespace(fit=fit, builder=SimpleNamespace(build=lambda *_: model))
    starts = [("gear", "error") for _ in ends]
    found = gears._fitted(competition, starts, until=7.0)
    assert (None if found is None else found.chi_square) == wanted
    assert asked == len(ends) * [(True, 9.0, 7.0)]


def catalogue() -> Any:
    """An elastic gear of a stiffness, play of a gap and a damping besides, and what acts in either."""
    found = Catalogue(
        effect_of("elastic", elastic=True, neutral={"K": np.inf}, confounded_with=("play",)),
        effect_of("play", elastic=True, neutral={"K": np.inf}, confounded_with=("elastic",)),
        effect_of("hard", needs_elastic=True, confounded_with=("play",)),
        effect_of("teeth", needs_elastic=True, frequency="number"),
        costs={"elastic": 1.0, "play": 3.0},
    )  # fmt: skip
    found.amplitudes = (SimpleNamespace(name="K"),)
    found.search = {
        "elastic": {"K": Search(50.0, 5e4, 10)},
        "play": {"gap": Search(0.001, 0.01, 2), "K": Search(50.0, 5e4, 4), "D": Search(2.0, 8.0, 2)},
        "hard": {"K_cubic": Search(1e3, 1e5, 3)},
    }
    return found


class Fitted:
    """Fits of gears, whose misfits are as large as the gap, the damping and K_cubic say; which starts were fitted."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, builder: Any) -> None:
        self.builder, self.started, self.chi_square = builder, list[Any](), 5.0
        self.fit: Any = SimpleNamespace(model=SimpleNamespace(added_effects=()), noise=None)
        monkeypatch.setattr(gears, "fitted_proposal", lambda fit, a: Proposal(a, fit.values[a.effect]))
        monkeypatch.setattr(gears, "_fitted", self._fitted)

    def misfit(self, *proposals: Proposal) -> float:
        values = {name: value for p in proposals for name, value in p.values.items()}
        best = {"gap": 0.01, "D": 8.0, "K_cubic": 1e4}
        return sum(abs(values[name] - value) for name, value in best.items() if name in values)

    def _fitted(self, competition: Any, starts: Any, *, until: float) -> Any:
        self.started.append([{p.effect_at.effect: dict(p.values) for p in proposals} for proposals in starts])
        return SimpleNamespace(chi_square=self.chi_square, model=self.fit.model, noise=None)

    def assess(self, effect_at: EffectAtJoint, fit: Any) -> Any:
        return candidate_of(effect_at.effect, fit=fit)


def fit_with(**values: dict[str, float]) -> Any:
    effects = tuple(EffectAtJoint(name, 1) for name in values)
    return SimpleNamespace(model=SimpleNamespace(added_effects=effects), values=values)


@pytest.mark.parametrize(
    ("named", "wanted"),
    [
        # Play without a width, or a damping that the log does not show, is left out; all that acts in the gear stays.
        (
            {"play": {"gap": 0.0, "K": 300.0, "D": 0.0}, "hard": {"K_cubic": 7e4}},
            [{"elastic": {"K": 300.0}, "hard": {"K_cubic": 7e4}}],
        ),
        # Its gap and damping come from the grid, the best first.
        (
            {"elastic": {"K": 300.0}, "hard": {"K_cubic": 1e4}},
            [
                {"play": {"gap": 0.01, "K": 300.0, "D": 8.0}, "hard": {"K_cubic": 1e4}},
                {"play": {"gap": 0.001, "K": 300.0, "D": 8.0}, "hard": {"K_cubic": 1e4}},
            ],
        ),
    ],
)  # fmt: skip
def test_another_gear_is_fitted_from_where_the_one_that_is_named_is(
    monkeypatch: pytest.MonkeyPatch, named: dict[str, dict[str, float]], wanted: list[Any]
) -> None:
    beside: Any = Fitted(monkeypatch, catalogue())
    gear = EffectAtJoint(next(iter(named)), 1)
    (found,) = gears.other_gears(beside, fit_with(**named), gear, Options(), Progress())
    assert beside.started == [wanted] and found.effect_at.effect == next(iter(wanted[0]))
    forbid = Options(forbid=frozenset({found.effect_at.effect}))
    assert gears.other_gears(beside, fit_with(**named), gear, forbid, Progress()) == []
    assert gears.other_gears(beside, fit_with(**named), gear, Options(), Progress(ends=0.0)) == []


def test_a_gear_that_hardens_is_fitted_from_softer_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """An error of its teeth, which repeats, is looked for in another way."""
    beside: Any = Fitted(monkeypatch, catalogue())
    monkeypatch.setattr(gears, "Competition", lambda builder, fit: beside)
    gear, fit = EffectAtJoint("elastic", 1), fit_with(elastic={"K": 400.0})
    found = gears.hardened(beside, fit, gear, Options(), Progress())
    assert found is not None and found.effect_at == EffectAtJoint("hard", 1)
    assert beside.started == [[{"elastic": {"K": k}, "hard": {"K_cubic": pytest.approx(1e4)}} for k in (400.0, 200.0)]]
    assert gears.hardened(beside, fit, gear, Options(forbid=frozenset({"hard"})), Progress()) is None


@pytest.mark.parametrize(
    ("gain", "objected", "prefer", "wanted"),
    [
        (111.0, "", (), ["elastic", "hard"]),  # ahead of the 100 of play by more than decides nothing
        (110.0, "", (), []),
        (500.0, "physically impossible: K_cubic below 0", (), []),
        (500.0, "held-out RMS ratio 1.1", (), []),
        (500.0, "", ("play",), []),
    ],
)
def test_when_a_gear_that_hardens_takes_the_place_of_play(
    monkeypatch: pytest.MonkeyPatch, gain: float, objected: str, prefer: tuple[str, ...], wanted: list[str]
) -> None:
    beside: Any = Fitted(monkeypatch, catalogue())
    by_held_out = objected.startswith("held-out")
    monkeypatch.setattr(gears, "Competition", lambda builder, fit: beside)
    monkeypatch.setattr(gears, "harder", lambda *_: candidate_of("hard"))
    monkeypatch.setattr(gears, "bic_gain", lambda *_: gain)
    monkeypatch.setattr(gears, "objection", lambda *_, **__: "" if by_held_out else objected)
    monkeypatch.setattr(gears, "held_out_objection", lambda *_, **__: objected if by_held_out else "")
    named = candidate_of("play", cost=3.0, fit=fit_with(play={"gap": 0.002, "K": 600.0, "D": 3.0}))
    found = gears.hardening_instead(beside, named, table_fit(9.0), Options(prefer=prefer), Progress())
    assert [part.candidate.effect_at.effect for part in found] == wanted
    assert beside.started == ([] if prefer else [[{"elastic": {"K": 600.0}}, {"elastic": {"K": 300.0}}]])


@pytest.mark.parametrize(
    ("rival", "added", "forbid", "wanted"),
    [
        ("play", ("elastic",), (), ["hard"]),
        ("elastic", ("play",), (), []),  # what hardens looks like play, not like a gear of one stiffness
        ("play", ("elastic", "hard"), (), []),
        ("play", ("elastic",), ("hard",), []),
    ],
)
def test_what_may_act_in_a_gear_and_look_like_another_one(
    monkeypatch: pytest.MonkeyPatch, rival: str, added: tuple[str, ...], forbid: tuple[str, ...], wanted: list[str]
) -> None:
    asked = list[EffectAtJoint]()

    def signatures(builder: Any, fit: Any, *, candidates: list[EffectAtJoint], progress: Any) -> str:
        asked.extend(candidates)
        return "signatures"

    monkeypatch.setattr(gears, "SignatureCatalogue", signatures)
    ranking = [candidate_of("hard", bic=50.0)]
    competition: Any = SimpleNamespace(
        builder=catalogue(), fit=fit_with(**{name: {} for name in added}), screen=lambda found: found,
        compare=lambda screened, **_: SimpleNamespace(ranking=ranking), finished=lambda candidate: candidate,
    )  # fmt: skip
    options = Options(forbid=frozenset(forbid))
    found = gears.harder(competition, EffectAtJoint(added[0], 1), EffectAtJoint(rival, 1), options, Progress())
    assert [a.effect for a in asked] == wanted and (found is None) == (not wanted)
    ranking.clear()
    assert gears.harder(competition, EffectAtJoint(added[0], 1), EffectAtJoint(rival, 1), options, Progress()) is None
