"""The decisions on torques from outside, on lists of them made by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from fmu_didim.discovery import run
from fmu_didim.discovery.external_torques import findings, fit, rivals
from fmu_didim.discovery.external_torques.findings import _summary
from fmu_didim.discovery.external_torques.fit import FittedExternalTorques, find_external_torques
from fmu_didim.discovery.external_torques.rivals import rivalled
from fmu_didim.discovery.external_torques.search import _joined, _merged, _solved
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.request import Request
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.discovery.selection.decide import Options, Step
from fmu_didim.discovery.selection.rounds import Discovery, Ending
from fmu_didim.model.external_torque import ExternalTorque
from fmu_didim.model.loop_model import EffectAtJoint
from fmu_didim.results.findings import ValueFound
from tests.discovery.by_hand import Catalogue, effect_of, table_fit

TIME = np.arange(101) * 0.1


def torque(begin: float, end: float, size: float = 1.0) -> ExternalTorque:
    return ExternalTorque(1, begin, end, size, False)


# ---- steps taken for one, and joined to torques


@pytest.mark.parametrize(
    ("ticks", "sizes", "kept"),
    [
        # Steps of one sign within 5 ticks are one, at the mean of their instants by size.
        ([10, 15], [3.0, 1.0], [11]),
        ([10, 16], [3.0, 1.0], [10, 16]),
        ([10, 14, 16], [1.0, 1.0, 1.0], [12, 16]),  # from the first of a group on
        # The opposite sign ends a torque, unless it only corrects an instant: below 35 % of the other.
        ([10, 12], [1.0, -0.36], [10, 12]),
        ([10, 12], [1.0, -0.34], [9]),
        ([10, 12], [-0.34, 1.0], [13]),
        ([10, 12], [0.36, -1.0], [10, 12]),
        # The largest of a group decides, not the last.
        ([10, 11, 12], [1.0, -0.3, -0.34], [7]),
        # A twentieth of the largest step is none.
        ([10, 50], [1.0, 0.049], [10]),
        ([10, 50], [1.0, -0.051], [10, 50]),
    ],
)
def test_steps_that_belong_together(ticks: list[int], sizes: list[float], kept: list[int]) -> None:
    assert _merged(ticks, np.array(sizes), 5) == kept


def joined(ticks: list[int], *sizes: float) -> list[tuple[float, float, float]]:
    found = _joined(TIME, ticks, np.array(sizes), 2, True)
    assert all(p.joint == 2 and p.is_logged for p in found)
    return [(round(p.begin_s, 6), round(p.end_s, 6), round(p.torque, 6)) for p in found]


@pytest.mark.parametrize(
    ("ticks", "sizes", "wanted"),
    [
        ([10, 20], [2.0, -2.0], [(1.0, 2.0, 2.0)]),
        ([10, 20], [2.0, -1.32], [(1.0, 2.0, 1.66)]),  # a third of it is missing: still one torque
        ([10, 20], [2.0, -1.28], [(1.0, 2.0, 2.0), (2.0, 10.1, 0.72)]),  # more is a level that stays
        ([10, 20, 30, 40], [2.0, -2.0, -1.0, 1.0], [(1.0, 2.0, 2.0), (3.0, 4.0, -1.0)]),
        ([10, 20, 30], [1.0, 1.0, -2.0], [(1.0, 2.0, 1.0), (2.0, 3.0, 2.0)]),
        ([10], [1.0], [(1.0, 10.1, 1.0)]),
        ([10, 20, 30], [1.0, 1.0, -1.31], [(1.0, 2.0, 1.0), (2.0, 3.0, 2.0), (3.0, 10.1, 0.69)]),
        ([10, 20, 30], [1.0, 1.0, -1.6], [(1.0, 2.0, 1.0), (2.0, 3.0, 2.0)]),  # 0.4 is nothing beside 1.6
        ([], [], []),
    ],
)
def test_steps_joined_to_torques(ticks: list[int], sizes: list[float], wanted: Any) -> None:
    assert joined(ticks, *sizes) == wanted


def test_a_new_torque_begins_only_where_the_last_has_ended() -> None:
    assert joined([10, 20, 30, 40], 2.0, 1.0, -1.0, -2.0) == [(1.0, 2.0, 2.0), (2.0, 3.0, 3.0), (3.0, 4.0, 2.0)]


def test_sizes_of_steps_by_least_squares_with_idle_columns() -> None:
    table = np.array([[1e6, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
    assert _solved(table, np.array([3e6, 4.0, 9.0])).tolist() == pytest.approx([3.0, 2.0, 0.0])


# ---- the best of all experiments and joints


FITTED = SimpleNamespace(external_torques=(), share=0.9)


class Search:
    """What the search finds by experiment, joint and whether the torque is logged."""

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, shares: dict[tuple[str, int, bool], float], **more: Any
    ) -> None:
        self.shares, self.torques = shares, more.get("torques", [torque(1, 2)])
        self.silent, self.answer = more.get("silent", ()), more.get("answer", FITTED)
        self.answers: list[tuple[str, int, bool, float]] = []
        self.fitted: list[Any] = []
        monkeypatch.setattr(fit, "step_response", self.response)
        monkeypatch.setattr(fit, "linear_external_torques", self.linear)
        monkeypatch.setattr(fit, "motion_period", lambda model, label: more.get("period"))
        monkeypatch.setattr(fit, "repeating_share", lambda *_: more.get("repeats", 1.0))
        monkeypatch.setattr(fit, "_fitted", lambda *arguments: self.fitted.append(arguments) or self.answer)

    def response(self, fit: Any, label: str, joint: int) -> Any:
        return None if joint in self.silent else np.array([0.25])

    def linear(self, fit: Any, label: str, joint: int, response: Any, is_logged: bool) -> Any:
        self.answers.append((label, joint, is_logged, float(response[0])))
        share = self.shares.get((label, joint, is_logged))
        return None if share is None else (share, [replace(p, joint=joint) for p in self.torques])


def find(monkeypatch: pytest.MonkeyPatch, shares: Any, **more: Any) -> tuple[Any, Search, list[str]]:
    search, said = Search(monkeypatch, shares, **more), []
    reference = SimpleNamespace(reference=SimpleNamespace(time=TIME))
    model = SimpleNamespace(estimation_labels=("x", "y"), joint_count=2, experiments={"x": reference, "y": reference})
    found = find_external_torques(SimpleNamespace(model=model), say=said.append)
    return found, search, said


def is_refused(
    monkeypatch: pytest.MonkeyPatch, torques: list[ExternalTorque], period: float | None = None, repeats: float = 1.0
) -> bool:
    """Whether torques that explain nearly all are not even fitted."""
    found, search, said = find(monkeypatch, {("x", 1, False): 0.9}, torques=torques, period=period, repeats=repeats)
    assert (found is None) == (not search.fitted) == (not said)
    return found is None


def test_the_joint_where_most_is_explained_is_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    shares = {("x", 1, False): 0.6, ("y", 2, True): 0.9, ("y", 2, False): 0.8}
    found, search, said = find(monkeypatch, shares, torques=[torque(1, 2), torque(3, 4)])
    assert found is FITTED and said == ["2 torques from outside on joint 2"]
    ((_, label, torques),) = search.fitted
    assert label == "y" and {one.joint for one in torques} == {2}  # on none of another joint
    held: Any = SimpleNamespace(model=SimpleNamespace(experiments={"y": SimpleNamespace(external_torques=torques)}))
    assert FittedExternalTorques(held, held, "y", 1.0, 0.9).joint == 2
    # Where the log shows it, the torque itself is in the answer.
    assert search.answers[:2] == [("x", 1, False, 0.25), ("x", 1, True, 1.25)] and len(search.answers) == 8


@pytest.mark.parametrize(("share", "found"), [(0.5, True), (0.499, False)])
def test_half_of_the_gap_must_be_explained(monkeypatch: pytest.MonkeyPatch, share: float, found: bool) -> None:
    assert (find(monkeypatch, {("x", 1, False): share})[0] is FITTED) is found


def test_joints_that_cannot_be_moved_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    found, search, _ = find(monkeypatch, {("x", 1, False): 0.9, ("x", 2, False): 0.7}, silent=(1,))
    assert search.fitted[0][2][0].joint == 2 and found is FITTED
    assert find(monkeypatch, {}, silent=(1, 2))[0] is None


def test_torques_that_come_back_once_they_are_fitted_are_none(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = SimpleNamespace(external_torques=(torque(1, 2), torque(4, 5)), share=0.9)
    found, search, _ = find(monkeypatch, {("x", 1, False): 0.9}, period=3.0, answer=answer)
    assert found is None and len(search.fitted) == 1
    assert find(monkeypatch, {("x", 1, False): 0.9}, period=2.0, answer=answer)[0] is answer


# ---- what is no torque from outside


@pytest.mark.parametrize(("following", "staircase"), [(1, False), (2, True)])
def test_a_quarter_may_follow_without_a_pause(monkeypatch: pytest.MonkeyPatch, following: int, staircase: bool) -> None:
    torques = [torque(k, k + 0.5) for k in range(4)]
    for k in range(following):
        torques[k] = torque(k, k + 1)
    assert is_refused(monkeypatch, torques) is staircase
    assert not is_refused(monkeypatch, [torque(1, 2)])


@pytest.mark.parametrize(
    ("torques", "lasting"),
    [
        ([torque(1, 5.9)], False),
        ([torque(1, 6.1)], True),  # longer than half of the ten seconds
        ([torque(1, 3.4), torque(4, 6.5)], False),
        ([torque(1, 3.6), torque(4, 6.5)], True),
        # Most of the time without a visible begin or end.
        ([torque(9, 10.1)], True),
        ([torque(0, 1)], True),
        ([torque(0, 1), torque(2, 2.9)], True),
        ([torque(0, 1), torque(2, 3.1)], False),
        ([torque(9, 10.0)], False),
    ],
)
def test_torques_that_last_may_as_well_be_a_load(
    monkeypatch: pytest.MonkeyPatch, torques: list[ExternalTorque], lasting: bool
) -> None:
    assert is_refused(monkeypatch, torques) is lasting


@pytest.mark.parametrize(
    ("torques", "period", "back"),
    [
        ([torque(1, 2), torque(4, 5)], 3.0, True),
        # By overlap: edges of what follows the motion smoothly lie somewhat elsewhere in each period.
        ([torque(1, 2), torque(4.3, 5.1)], 3.0, True),
        ([torque(1, 2), torque(4.49, 5.49)], 3.0, True),
        ([torque(1, 2), torque(4.51, 5.51)], 3.0, False),
        ([torque(3.507, 5.981, 0.081), torque(11.29, 13.711, 0.078), torque(19.588, 21.527, 0.084)], 8.0, True),
        ([torque(1, 2), torque(4.3, 5.1, 0.3)], 3.0, False),  # of another size
        ([torque(1, 2), torque(4.3, 5.1, -1.0)], 3.0, False),  # of the other direction
        ([torque(1, 2), torque(4, 5)], None, False),
        ([torque(1, 2), torque(4, 5)], 2.0, False),
        # By impulse: half of it must come back.
        ([torque(1, 2), torque(4, 5), torque(6.2, 8.1)], 3.0, True),
        ([torque(1, 2), torque(4, 5), torque(7.9, 10, -1.0)], 3.0, False),
        ([torque(1, 2, -1.0), torque(4, 5, -1.0)], 3.0, True),
    ],
)
def test_a_torque_that_comes_back_belongs_to_the_machine(
    monkeypatch: pytest.MonkeyPatch, torques: list[ExternalTorque], period: float | None, back: bool
) -> None:
    assert is_refused(monkeypatch, torques, period) is back


@pytest.mark.parametrize(("repeats", "back"), [(0.91, True), (0.89, False)])
def test_overlap_counts_where_more_repeats_than_the_torques_explain(
    monkeypatch: pytest.MonkeyPatch, repeats: float, back: bool
) -> None:
    """Pulses every second overlap with themselves a period of 2.24 s later, a spring does so, too; what repeats with
    the motion is more than the windows only of the spring."""
    pulses = [torque(0.344 + k, 0.844 + k) for k in range(9)]
    assert is_refused(monkeypatch, pulses, 2.24, repeats) is back
    # Edges at the same phase are enough.
    assert is_refused(monkeypatch, [torque(1, 2), torque(4, 5)], 3.0, repeats)


def test_the_share_that_repeats() -> None:
    """A function of the phase repeats whole; an event in one period of four to a quarter; noise not at all."""
    time, rng = np.arange(800) * 0.01, np.random.default_rng(2)
    phase = np.sin(2 * np.pi * time / 2.0)
    event = np.where((time > 3.0) & (time < 3.5), 4.0, 0.0)
    for residual, share in ((phase, 1.0), (event, 0.25), (phase + event, None)):
        table = (residual + 0.2 * rng.standard_normal(time.size))[:, None]
        model = SimpleNamespace(
            experiments=type("Of", (dict,), {"rows": {"x": slice(0, 800)}})(x=SimpleNamespace(time=time))
        )
        found = SimpleNamespace(residual=table, noise=SimpleNamespace(deviation=np.array([0.2])), model=model)
        got = fit.repeating_share(found, "x", 1, 2.0)  # type: ignore[arg-type]
        assert got == pytest.approx(share, abs=0.03) if share is not None else 0.3 < got < 0.7


# ---- against what looks like them


EFFECTS = (
    effect_of("payload", is_external=False, rivals_external_torque=True),
    effect_of("presliding", is_external=False, rivals_external_torque=True),
    effect_of("viscous", is_external=False, rivals_external_torque=False),
    effect_of("force", is_external=True, rivals_external_torque=False),
)


def test_the_effect_that_names_them() -> None:
    request = Request("", None, Catalogue(*EFFECTS).effects)
    assert request.external is not None and request.external.name == "force"
    assert replace(request, options=Options(forbid=frozenset({"force"}))).external is None
    assert replace(request, effects={"viscous": request.effects["viscous"]}).external is None


@pytest.mark.parametrize(("bic", "better"), [(100.1, True), (100.0, False), (None, False)])
def test_one_effect_must_explain_more_than_all_torques(
    monkeypatch: pytest.MonkeyPatch, bic: float | None, better: bool
) -> None:
    screened = [
        SimpleNamespace(effect_at=EffectAtJoint(n, j)) for n, j in (("payload", 2), ("payload", 1), ("presliding", 1))
    ]
    seen: list[Any] = []
    monkeypatch.setattr(rivals, "SignatureCatalogue", lambda builder, base, candidates: seen.append(candidates))
    monkeypatch.setattr(Competition, "screen", lambda *_: screened)
    monkeypatch.setattr(
        Competition, "compare",
        lambda _, chosen, progress: seen.append(chosen)
        or SimpleNamespace(ranking=() if bic is None else (SimpleNamespace(delta_bic=bic),)),
    )  # fmt: skip
    fitted = FittedExternalTorques(None, None, "x", 100.0, 0.9)
    builder = Catalogue(*EFFECTS, joints=2)
    assert rivalled(fitted, table_fit(5.0), builder, progress=Progress()) is better
    assert [f"{c.effect}{c.joint}" for c in seen[0]] == ["payload1", "payload2", "presliding1", "presliding2"]
    assert seen[1] == [screened[0], screened[2]]  # each at its best joint
    del seen[:]
    rivalled(fitted, table_fit(5.0), builder, forbid=frozenset({"payload"}), progress=Progress())
    assert [c.effect for c in seen[0]] == ["presliding"] * 2


PLAY = effect_of("play", is_external=False, rivals_external_torque=True, has_minima=True)


@pytest.mark.parametrize(
    ("gains", "squares", "forbid", "asked", "better"),
    [
        ([110.0, 90.0], (5.0, 5.0), (), [1], True),  # hits of its flanks looked like pushes
        ([90.0, 110.0], (5.0, 5.0), (), [1, 2], True),  # of the joint beside
        ([90.0, None], (5.0, 5.0), (), [1, 2], False),
        ([110.0, 110.0], (5.0, 1.3), (), [1], True),
        ([90.0, 110.0], (5.0, 1.3), (), [1], False),  # a gap of 0.55 is none
        ([110.0, 110.0], (5.0, 5.0), ("play",), [], False),
    ],
)
def test_play_is_looked_for_in_the_place_of_torques_from_outside(
    monkeypatch: pytest.MonkeyPatch, gains: list[float | None], squares: tuple[float, float], forbid: tuple[str, ...],
    asked: list[int], better: bool,
) -> None:  # fmt: skip
    searched: list[int] = []

    def widely(competition: Any, effect_at: EffectAtJoint, **_: Any) -> Any:
        searched.append(effect_at.joint)
        gain = gains[effect_at.joint - 1]
        return None if gain is None else SimpleNamespace(delta_bic=gain)

    monkeypatch.setattr(rivals, "SignatureCatalogue", lambda builder, base, *, candidates: [])
    monkeypatch.setattr(rivals, "searched_widely", widely)
    monkeypatch.setattr(Competition, "screen", lambda self, catalogue: [])
    monkeypatch.setattr(Competition, "compare", lambda self, chosen, **_: SimpleNamespace(ranking=()))
    fitted: Any = FittedExternalTorques(None, None, "x", 100.0, 0.9)  # type: ignore[arg-type]
    builder: Any = Catalogue(PLAY, joints=2)
    found = rivalled(fitted, table_fit(*squares), builder, forbid=frozenset(forbid), progress=Progress())
    assert found is better and searched == asked


# ---- what is written down


def value(name: str, number: float) -> ValueFound:
    return ValueFound(name=name, unit="N", value=number, std=0.1, interval=(number - 0.2, number + 0.2))


@pytest.mark.parametrize("count", [1, 3])
def test_a_few_torques_are_all_listed(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    values = [value(f"{n}[{i}]", float(i)) for i in range(1, count + 1) for n in ("F", "t_on", "t_off")]
    monkeypatch.setattr(findings, "values_found", lambda *_: values)
    assert _summary(table_fit(1.0)) == values


def test_of_many_torques_the_mean_with_its_interval_by_students_t(monkeypatch: pytest.MonkeyPatch) -> None:
    values = [value(f"{n}[{i}]", float(i)) for i in range(1, 5) for n in ("F", "t_on", "t_off")]
    monkeypatch.setattr(findings, "values_found", lambda *_: values)
    mean, *first = _summary(table_fit(1.0))
    assert (mean.name, mean.unit, mean.value) == ("F[mean]", "N", 2.5)
    assert mean.std == pytest.approx(np.sqrt(5 / 3) / 2)
    # 3.1824: the 97.5 % quantile of Student's t with three degrees of freedom.
    assert mean.interval == pytest.approx((2.5 - 3.182446 * mean.std, 2.5 + 3.182446 * mean.std), rel=1e-6)
    # Beside the mean of all torques that of the first would look like another quantity.
    assert [v.name for v in first] == ["t_on[1]", "t_off[1]"]


@pytest.mark.parametrize(
    ("changes", "begins"),
    [
        ({}, "from the effects"),
        ({"channels": ("q",)}, "anew"),  # the fit beside the torques was one of the torque alone
        ({"superfluous": False}, ""),
        ({"torques": False}, ""),
        ({"steps": 0}, ""),  # nothing was found beside them that could stand for them
        ({"ending": Ending.TIME_UP}, ""),
    ],
)
def test_torques_that_effects_make_superfluous_are_taken_out_again(
    monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], begins: str
) -> None:
    asked = {"channels": (), "superfluous": True, "torques": True, "steps": 2, "ending": Ending.COMPLETE, **changes}
    final, begun = table_fit(1.0), list[Any]()
    noise = replace(final.noise, deviation=np.array([3.0]))
    of_base = SimpleNamespace(model=SimpleNamespace(experiments=SimpleNamespace(channels=asked["channels"])))
    of_base.noise = noise
    again = SimpleNamespace(base=of_base, found=lambda start=None: begun.append(start) or "found")
    monkeypatch.setattr(run._Search, "of", lambda *_, outside: again if not outside else None)
    told = list[str]()
    known = SimpleNamespace(superfluous_beside=lambda fit: final if asked["superfluous"] else None, joint=2)
    search = SimpleNamespace(
        torques=known if asked["torques"] else None, request=SimpleNamespace(progress=Progress()),
        asked=SimpleNamespace(noting=told.append), prepared=None, later=None,
    )  # fmt: skip
    names = ("spring", "delay")[: asked["steps"]]
    steps = tuple(Step(EffectAtJoint(n, 1), 50.0, 1.0, 0.5, (), {}, {}, None, without=final) for n in names)
    discovery = Discovery(final, final, steps, ending=asked["ending"])
    found = run._Search.without_torques(cast(run._Search, search), discovery)
    assert (found == "found") == bool(begins) == bool(told)
    assert all(text.startswith("Torques from outside on joint 2 were found first") for text in told)
    if begins == "from the effects":
        ((start, kept),) = begun
        assert start.noise is noise and start.values is final.values
        assert [s.effect_at for s in kept] == [s.effect_at for s in steps] and all(s.without is None for s in kept)
    else:
        assert begun == ([None] if begins else [])
