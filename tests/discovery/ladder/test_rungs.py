"""The decisions of the evidence ladder, as tables: what a run says, what a rung says, what comes next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import date
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmu_didim.checks.judgement import judgement
from fmu_didim.discovery.ladder import ladders
from fmu_didim.discovery.ladder.evidence import Evidence
from fmu_didim.discovery.ladder.facts import RunFacts
from fmu_didim.discovery.ladder.rungs import ladder_of
from fmu_didim.discovery.selection.held_out import Amplitude
from fmu_didim.fit.gap import Ratio
from fmu_didim.model.loop_model import EffectAtJoint
from fmu_didim.results.findings import RungResult, next_rung

BETTER, SAME, WORSE = Ratio(0.8, 0.7, 0.9), Ratio(0.99, 0.9, 1.05), Ratio(1.2, 1.1, 1.3)


def amplitude(value: float = 1.0, half: float = 0.2, size: float = 1.0) -> Amplitude:
    return Amplitude(value, value - half, value + half, size)


@pytest.mark.parametrize(
    ("ratio", "shown", "says"),
    [
        (BETTER, amplitude(), "yes"),
        (SAME, amplitude(), "yes"),  # the other parameters drifted, as of one that is confirmed by its size alone
        (BETTER, amplitude(0.5, 0.2), "yes"),  # there for certain, and the prediction better for certain
        (SAME, amplitude(0.5, 0.2), "undecided"),
        (SAME, amplitude(0.5, 0.8), "undecided"),
        (SAME, amplitude(0.1, 0.2), "no"),
        (WORSE, amplitude(), "no"),
        (BETTER, amplitude(size=0.19), "hardly excited"),  # better by what other parameters do
        (WORSE, amplitude(size=0.19), "hardly excited"),
        (BETTER, None, "hardly excited"),
        (None, None, "not run"),
    ],
)
def test_what_a_run_says(ratio: Ratio | None, shown: Amplitude | None, says: str) -> None:
    assert Evidence(ratio, shown).says == says


def test_a_model_that_cannot_be_run_with_the_effect_speaks_against_it() -> None:
    one = Evidence(None, None, failure="It diverges.")
    assert one.says == "no"
    assert one.text == "the model with it cannot be run there: It diverges."


@pytest.mark.parametrize(
    ("value", "half", "deviation", "differs"),
    [(0.79, 0.08, 0.0, True), (0.79, 0.08, 0.1, False), (0.79, 0.3, 0.0, False), (1.5, 0.1, 0.05, True)],
)
def test_another_size_is_told_beyond_both_deviations(
    value: float, half: float, deviation: float, differs: bool
) -> None:
    one = Evidence(BETTER, amplitude(value, half), deviation)
    assert one.differs is differs
    assert ("another size than in the fit" in one.text) is differs


YES, NO = Evidence(BETTER, amplitude()), Evidence(WORSE, amplitude(0.0, 0.1))
WEAK, OPEN = Evidence(SAME, amplitude(size=0.1)), Evidence(SAME, amplitude(0.5, 0.8))


def run(**changes: Any) -> RunFacts:
    base = RunFacts("validation", 20.0, speed=np.array([1.0, 1.0]), load=np.zeros(2))
    return replace(base, **changes)


FITTED = run(role="estimation")


def ladder(facts: Mapping[str, RunFacts], evidence: Mapping[str, Evidence], **more: Any) -> dict[str, RungResult]:
    found = ladder_of("it gains 100 in BIC", {"fit": FITTED, **facts}, {"fit": YES, **evidence}, **{"joint": 1, **more})
    assert [rung.rung for rung in found] == ["fit", "held_out", "load", "gain", "speed", "unit", "day"]
    assert [rung.level for rung in found] == [1, 2, 3, 3, 3, 4, 4]
    return {rung.rung: rung for rung in found}


@pytest.mark.parametrize(
    ("facts", "evidence", "state", "told"),
    [
        ({}, {}, "open", "no run is held out"),
        ({"a": run()}, {"a": YES}, "climbed", "a (held out): it has 1.00"),
        ({"a": run()}, {"a": NO}, "contradicted", "a (held out): it has 0.00"),
        ({"a": run()}, {"a": WEAK}, "open", "hardly excited: what only it can make is 0.1 of the noise, and 0.2"),
        ({"a": run()}, {"a": OPEN}, "open", "it has 0.50 (-0.30 to 1.30)"),
        ({"a": run(new=0.2)}, {"a": YES}, "open", "a repeats the motion of a fitted run in 80 % of its time"),
        ({"a": run(new=0.0, injected=("pulse1",))}, {"a": YES}, "open", "of a fitted run, with pulse1 added, in 100 %"),
        ({"a": run(new=0.0)}, {"a": NO}, "contradicted", "a repeats the motion"),
        ({"a": run(), "b": run()}, {"a": YES, "b": NO}, "contradicted", "b (held out)"),
        ({"a": run(), "b": run(new=0.0)}, {"a": YES, "b": NO}, "contradicted", "b repeats"),
        ({"a": run(), "b": run()}, {"a": YES, "b": WEAK}, "climbed", "b (held out): hardly excited"),
        ({"a": run()}, {}, "open", "no run is held out"),
        (
            {"a": run(new=0.0, is_copied=True)},
            {"a": YES},
            "open",
            "the log of a is that of a fitted run, or a part of it",
        ),
        ({"a": run(is_copied=True), "b": run()}, {"a": NO, "b": YES}, "climbed", "b (held out)"),
    ],
)
def test_the_rung_of_another_motion(
    facts: Mapping[str, RunFacts], evidence: Mapping[str, Evidence], state: str, told: str
) -> None:
    rung = ladder(facts, evidence)["held_out"]
    assert rung.state == state
    assert told in rung.text
    assert (rung.next_step == "") == (state == "climbed")


def test_that_the_held_out_run_chose_is_told() -> None:
    text = ladder({"a": run()}, {"a": YES}, candidates=9)["held_out"].text
    assert text.endswith("9 candidates had to pass this test, so that it is no blind one")
    assert "blind" not in ladder({}, {}, candidates=9)["held_out"].text
    assert "blind" not in ladder({"a": run()}, {"a": WEAK}, candidates=9)["held_out"].text  # it could not choose


@pytest.mark.parametrize(
    ("rung", "facts", "state", "told"),
    [
        ("load", run(load=np.array([0.2, 0.0])), "climbed", "a (held out)"),
        ("load", run(load=np.array([0.03, 0.5])), "open", "by 3 % at most, less than 10 %"),  # of its own joint
        ("load", run(), "open", "no run carries another load"),
        ("gain", run(gains={"controller.Kp1": 1.5}), "climbed", "a (held out)"),
        ("gain", run(), "open", "all runs have the same controller"),
        ("speed", run(speed=np.array([1.6, 1.0])), "climbed", "a (held out)"),
        ("speed", run(speed=np.array([0.6, 1.0])), "climbed", "a (held out)"),
        ("speed", run(speed=np.array([1.2, 3.0])), "open", "(1.2 times at most)"),
        ("speed", run(speed=np.array([np.nan, 1.0])), "open", "no other run that moves joint 1"),
        ("unit", run(unit="SN2"), "climbed", "a (held out)"),
        ("unit", run(unit="SN1"), "open", "all runs are of SN1"),
        ("unit", run(), "open", "the case does not say of which unit a is (unit:)"),
        ("day", run(day=date(2024, 6, 1)), "climbed", "a (held out)"),
        ("day", run(day=date(2024, 5, 31)), "open", "all runs are of 2024-05-31"),
        ("day", run(), "open", "the case does not say of which day a is (date:)"),
    ],
)
def test_the_rungs_of_other_conditions(rung: str, facts: RunFacts, state: str, told: str) -> None:
    first = replace(FITTED, unit="SN1", day=date(2024, 5, 31))
    found = ladder_of("", {"fit": first, "a": facts}, {"fit": YES, "a": YES}, joint=1)
    (own,) = (one for one in found if one.rung == rung)
    assert own.state == state
    assert told in own.text
    assert [one.experiment for one in own.evidence] == (["a"] if state == "climbed" else [])


def test_an_unknown_unit_is_no_other_one() -> None:
    """Neither of a run, nor of the first one."""
    assert ladder({"a": run(unit="SN2", day=date(2024, 6, 1))}, {"a": YES})["unit"].state == "open"


def test_a_copied_log_is_no_other_day() -> None:
    facts = {"fit": replace(FITTED, day=date(2024, 5, 31)), "a": run(is_copied=True, day=date(2024, 6, 1))}
    found = ladder_of("", facts, {"fit": YES, "a": YES}, joint=1)
    assert [rung.state for rung in found] == ["climbed", *["open"] * 6]


def test_a_fitted_run_counts_for_other_conditions_but_not_as_held_out() -> None:
    found = ladder({"b": run(role="estimation", load=np.array([0.4, 0.4]))}, {"b": YES})
    assert found["load"].state == "climbed"
    assert found["load"].text.startswith("b (fitted)")
    assert found["held_out"].state == "open"
    assert "b: it has 1.00" in found["fit"].text  # that one of two fitted runs shows nothing would be told


@pytest.mark.parametrize(("other", "state"), [(YES, "climbed"), (NO, "contradicted"), (WEAK, "climbed")])
def test_one_of_several_fitted_runs_may_contradict(other: Evidence, state: str) -> None:
    rung = ladder({"b": run(role="estimation")}, {"b": other})["fit"]
    assert rung.state == state
    assert ("Look at what differs in b," in rung.next_step) == (state == "contradicted")
    assert ladder({}, {"fit": NO})["fit"].state == "climbed"  # of a single run the information criterion has decided


def test_a_rung_with_a_run_that_hardly_excites_says_so() -> None:
    rung = ladder({"a": run(speed=np.array([2.0, 1.0]))}, {"a": WEAK})["speed"]
    assert rung.state == "open"
    assert rung.next_step.startswith("Excite it there: at least 0.2 of the noise")


def test_of_the_whole_log_all_joints_count() -> None:
    facts = {"a": run(speed=np.array([2.0, 1.3]), load=np.array([0.05, 0.3]))}
    found = ladder(facts, {"a": YES}, joint=None)
    assert found["speed"].state == found["load"].state == "climbed"
    assert ladder({"a": run(speed=np.array([2.0, 0.9]))}, {"a": YES}, joint=None)["speed"].state == "open"


@pytest.mark.parametrize(
    ("states", "rung"),
    [
        ({}, "held_out"),
        ({"held_out": "climbed"}, "speed"),
        ({"held_out": "climbed", "load": "climbed"}, "day"),
        ({"speed": "climbed"}, "held_out"),
        ({"held_out": "climbed", "load": "contradicted"}, "load"),
        ({"held_out": "climbed", "gain": "climbed", "unit": "climbed"}, None),
    ],
)
def test_what_is_climbed_next(states: Mapping[str, str], rung: str | None) -> None:
    rungs = [one.model_copy(update={"state": states.get(one.rung, one.state)}) for one in ladder({}, {}).values()]
    found = next_rung(rungs)
    assert (found.rung if found else None) == rung


@pytest.mark.parametrize(("is_time_up", "why"), [(True, "the time was up"), (False, "cannot be run")])
def test_what_was_not_looked_at_is_open(monkeypatch: pytest.MonkeyPatch, is_time_up: bool, why: str) -> None:
    monkeypatch.setattr(ladders, "fit_without", lambda *_: None)
    effect = SimpleNamespace(is_of_log=False, neutral={})
    step = SimpleNamespace(effect_at=EffectAtJoint("stribeck", 1), delta_bic=100.0, share=0.5)
    found = ladders._of_step(
        step, SimpleNamespace(final=None), SimpleNamespace(effect=lambda _: effect),  # type: ignore[arg-type]
        SimpleNamespace(progress=SimpleNamespace(is_time_up=is_time_up)), {"fit": FITTED, "a": run()}, 9,  # type: ignore[arg-type]
    )  # fmt: skip
    assert [one.state for one in found] == ["climbed", *["open"] * 6]
    assert all(why in one.text and one.next_step for one in found[1:])


def test_nothing_is_next_without_a_ladder() -> None:
    assert next_rung([]) is None


@pytest.mark.parametrize(("differs", "told"), [(False, []), (True, ["0.70 times as large in a"])])
def test_a_valid_verdict_rests_on_the_motion_where_the_size_is_another_one(differs: bool, told: list[str]) -> None:
    one = Evidence(BETTER, amplitude(0.7, 0.05), deviation=0.02 if differs else 0.2)
    found = ladder_of("seen", {"fit": RunFacts("estimation", 10.0), "a": run()}, {"a": one}, joint=1)
    step = SimpleNamespace(effect_at=EffectAtJoint("stribeck", 1))
    remarks = ladders.of_other_size(SimpleNamespace(refitted=[], steps=[step]), [found])  # type: ignore[arg-type]
    judged = judgement(remarks)
    assert judged.verdict == "valid"
    assert [condition.partition("(")[2].rstrip(")") for condition in judged.conditions] == told
