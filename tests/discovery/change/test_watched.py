"""The history of a machine, and all that could mislead about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from typing import Any

import numpy as np
import pytest

from fmu_didim import InputError
from fmu_didim.discovery.change.answers import Answer
from fmu_didim.discovery.change.watched import Entry, watched
from fmu_didim.results.watch import WatchDocument
from tests.discovery.change.pairs import answer, identified, log_of

RATE = 20.0


@pytest.fixture(scope="module")
def full() -> Answer:
    return answer("one", identified(log_of(RATE, 1)))


@pytest.fixture(scope="module")
def one(full: Answer) -> Answer:
    """Without its torque, so that others made of it are other logs."""
    return replace(full, validations=())


def like(one: Answer, seed: int, *, between: float = 0.0, **moved: float) -> Answer:
    """Another log of the same machine, drawn from the covariance, with values moved by so many deviations."""
    rng = np.random.default_rng(seed)
    names = list(one.document.parameters)
    value, covariance = one.values_of(names)
    drawn = rng.multivariate_normal(value, covariance) + between * np.sqrt(np.diag(covariance)) * rng.normal(
        size=len(names)
    )
    found = {
        name: p.model_copy(update={"value": drawn[k] + moved.get(name, 0.0) * p.std})
        for k, (name, p) in enumerate(one.document.parameters.items())
    }
    noise = [size * (1 + 0.03 * rng.normal()) for size in one.document.noise_std if size is not None]
    return replace(one, document=one.document.model_copy(update={"parameters": found, "noise_std": noise}))


def changed_document(one: Answer, **changes: Any) -> Answer:
    return replace(one, document=one.document.model_copy(update=changes))


def why(answer: Answer | None) -> str:
    return "" if answer else "it is damaged"


def entries(answers: Sequence[Answer | None], reference: int) -> list[Entry]:
    return [
        Entry(f"log{k}", datetime(2024, 1, 1) + timedelta(days=k), str(k), k < reference, True, a, why(a))
        for k, a in enumerate(answers)
    ]  # fmt: skip


def history(one: Answer, later: Sequence[Answer | None], *, count: int = 10, between: float = 0.0) -> WatchDocument:
    reference = [like(one, k, between=between) for k in range(count)]
    return watched("arm", entries([*reference, *later], count), order="date")


def codes(document: WatchDocument) -> set[str]:
    return {reason.code for reason in document.reasons}


def test_nothing_has_changed(one: Answer) -> None:
    found = history(one, [like(one, 100 + k) for k in range(5)])
    assert (found.answer, found.verdict, found.onset) == ("unchanged", "valid", None)
    assert [log.state for log in found.logs] == ["reference"] * 10 + ["unchanged"] * 5
    assert found.text == "none of 5 logs is changed: 5 unchanged"
    assert any("of the 5 here, no more than 0.005 are expected" in remark for remark in found.remarks)


def test_a_lasting_change_is_named_with_its_first_log(one: Answer) -> None:
    found = history(one, [*(like(one, 100 + k) for k in range(3)), *(like(one, 200 + k, Fc2=40) for k in range(3))])
    assert [log.state for log in found.logs[10:]] == ["unchanged"] * 3 + ["changed"] * 3
    assert [log.moved for log in found.logs[13:]] == [["Fc2"]] * 3
    assert [log.causes for log in found.logs[13:]] == [["friction of joint 2"]] * 3
    assert found.onset is not None
    assert (found.onset.kind, found.onset.log, found.onset.earliest, found.onset.latest) == (
        "step",
        "log13",
        "log13",
        "log13",
    )
    assert "a lasting change, first in log13" in found.text


def test_a_single_log_and_the_last_one_are_told_as_such(one: Answer) -> None:
    far = like(one, 200, Fc2=40)
    same = [like(one, 100 + k) for k in range(4)]
    found = history(one, [*same[:2], far, *same[2:]])
    assert found.onset is not None
    assert "a single log, log12, and those after it are as before" in found.onset.text
    last = history(one, [*same, far]).onset
    assert last is not None
    assert "no later one tells whether it lasts" in last.text


@pytest.mark.gate
def test_a_drift_is_told_as_a_drift(one: Answer) -> None:
    found = history(one, [like(one, 200 + k, Fc2=6.0 * (k + 1)) for k in range(12)])
    assert found.onset is not None
    assert (found.onset.kind, found.onset.log) == ("drift", "log10")
    assert "a drift that began with log10" in found.text
    assert [log.state for log in found.logs[10:]][-6:] == ["changed"] * 6


@pytest.mark.gate
def test_the_spread_between_reference_logs_is_allowed_for_and_told(one: Answer) -> None:
    later = [like(one, 100 + k, between=6.0) for k in range(4)]
    found = history(one, later, between=6.0)
    assert found.answer == "unchanged"
    assert any("Logs of the reference differ by more than their noise" in remark for remark in found.remarks)
    assert any("not a change among them" in condition for condition in found.conditions)
    assert history(one, later[:1]).answer == "changed"  # a reference without that spread


def test_a_reference_that_contains_the_change_is_doubted(one: Answer) -> None:
    step = [like(one, k, **({"Fc2": 40.0} if k >= 5 else {})) for k in range(10)]
    later = [like(one, 100 + k, Fc2=40) for k in range(3)]
    found = watched("arm", entries([*step, *later], 10), order="date")
    assert found.answer == "unchanged"
    assert "watch-reference-changed" in codes(found)
    assert "most clearly with log5" in found.reasons[0].text


def test_one_log_of_the_reference_that_is_far_from_the_others_is_doubted(one: Answer) -> None:
    reference = [like(one, k, **({"Fc2": 200.0} if k == 4 else {})) for k in range(10)]
    found = watched("arm", entries([*reference, like(one, 100)], 10), order="date")
    assert [r.place for r in found.reasons if r.code == "watch-reference-changed"] == ["log4"]


@pytest.mark.parametrize("count", [1, 3])
def test_too_few_reference_logs_are_doubted(one: Answer, count: int) -> None:
    found = history(one, [like(one, 100)], count=count)
    assert (found.verdict, codes(found)) == ("doubtful", {"watch-few-references"})
    assert {value.between for value in found.values.values()} == {None}
    assert history(one, [like(one, 100, Fc2=40)], count=count).answer == "changed"


def with_experiment(one: Answer, **changes: Any) -> Answer:
    record = dict(one.document.provenance)
    record["experiments"] = {label: {**e, **changes} for label, e in record["experiments"].items()}
    return changed_document(one, provenance=record)


def test_values_that_differ_along_another_motion_are_no_change_but_a_doubt(one: Answer) -> None:
    other = with_experiment(like(one, 100, Fc2=40), reference_sha256="other")
    found = history(one, [like(one, 101), other, like(one, 102)])
    assert found.answer == "unchanged"
    assert found.logs[11].state == "doubtful"
    assert "recorded along another motion" in found.logs[11].text
    assert "watch-motion" in codes(found)
    same = history(one, [with_experiment(like(one, 100), reference_sha256="other")])
    assert same.logs[-1].state == "unchanged"
    assert codes(same) == {"watch-motion"}


def test_another_rate_is_told(one: Answer) -> None:
    found = history(one, [with_experiment(like(one, 100), torque_rate_hz=50.0)])
    assert any("At another rate than the reference: log10" in remark for remark in found.remarks)
    assert found.logs[-1].notes == ["at another rate (50 Hz; reference 20)"]


@pytest.mark.parametrize("far", [0.0, 40.0])
def test_a_doubtful_log_is_never_unchanged(one: Answer, far: float) -> None:
    found = history(one, [changed_document(like(one, 100, Fc2=far), verdict="doubtful")])
    assert found.logs[-1].state == ("changed" if far else "doubtful")
    assert "its identification is doubtful" in found.logs[-1].text
    assert far or codes(found) == {"watch-log-not-sure"}


def test_a_log_without_values_is_a_line_of_its_own(one: Answer) -> None:
    refused = changed_document(like(one, 100), verdict="refused", parameters={})
    found = history(one, [None, refused, like(one, 101)])
    assert [log.state for log in found.logs[10:]] == ["not_judged", "not_judged", "unchanged"]
    assert [log.text for log in found.logs[10:12]] == ["it is damaged", "its identification is refused"]
    assert codes(found) == {"watch-log-not-sure"}


def test_values_of_another_model_or_without_one_of_them_are_not_judged(one: Answer) -> None:
    base = like(one, 100)
    lacking = {name: p for name, p in base.document.parameters.items() if name != "Fv1"}
    keep = [k for k, name in enumerate(base.document.parameters) if name != "Fv1"]
    covariance = np.array(base.document.covariance)[np.ix_(keep, keep)].tolist()
    other = changed_document(base, regrouping=["ZZ1R = ZZ1 + Ia1"])
    found = history(one, [changed_document(base, parameters=lacking, covariance=covariance), other])
    assert [log.state for log in found.logs[10:]] == ["not_judged"] * 2
    assert "it does not determine Fv1" in found.logs[10].text
    assert "another model" in found.logs[11].text


def test_the_same_log_twice_counts_once(one: Answer, full: Answer) -> None:
    listed = entries([like(one, 0), like(one, 1), full, full], 2)
    found = watched("arm", listed, order="date")
    assert (found.logs[3].state, found.logs[3].text) == ("not_judged", "it is the same log as log2")
    twin = replace(listed[2], digest=listed[1].digest, name="copy", answer=like(one, 5))
    found = watched("arm", [*listed[:2], twin], order="date")
    assert found.logs[2].text == "it is the same log as log1"


def test_a_residual_that_grew_is_doubted_though_no_value_moved(one: Answer) -> None:
    loud = like(one, 100)
    sizes = [1.8 * size for size in loud.document.noise_std if size is not None]
    found = history(one, [changed_document(loud, noise_std=sizes)])
    assert found.logs[-1].state == "doubtful"
    assert "times that of the reference" in found.logs[-1].text


def test_a_doubtful_log_in_the_reference_is_told(one: Answer) -> None:
    reference = [like(one, k) for k in range(10)]
    reference[3] = changed_document(reference[3], verdict="doubtful")
    listed = entries([*reference, like(one, 100)], 10)
    listed[5] = replace(listed[5], answer=None, why="it could not be identified")
    found = watched("arm", listed, order="date")
    assert {r.place for r in found.reasons if r.code == "watch-reference-doubted"} == {"log3", "log5"}
    assert "log5" not in found.reference
    assert found.logs[5].state == "not_judged"


def test_a_reference_without_any_values_is_refused(one: Answer) -> None:
    with pytest.raises(InputError, match="No log of the reference gives values") as error:
        watched("arm", entries([None, None, like(one, 1)], 2), order="date")
    assert "log0: it is damaged" in str(error.value.got)
