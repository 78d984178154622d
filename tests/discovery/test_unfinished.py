"""What is said of a search that is not at its end."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection.candidates import Outcome, TriedCandidate
from fmu_didim.discovery.selection.rounds import Discovery, Ending
from fmu_didim.discovery.unfinished import ended_before, unfinished_search
from fmu_didim.model.loop_model import EffectAtJoint
from tests.discovery.by_hand import table_fit
from tests.report.test_discovery import document

BASE: Any = table_fit(1.0)
LAG, GEAR, *MORE = (EffectAtJoint(name, j) for j, name in enumerate(("lag", "gear", "c", "d", "e", "f"), start=1))


def tried(effect_at: EffectAtJoint, outcome: Outcome = Outcome.NOT_TRIED, bic: float | None = None) -> TriedCandidate:
    return TriedCandidate(effect_at, outcome, bic)


@pytest.mark.parametrize(
    ("comparisons", "steps", "ending", "rounds", "text"),
    [
        ([], [], Ending.RUNNING, 0,
         "The search was still running when this was written, with no effect accepted; others may follow."),
        ([[tried(LAG, Outcome.FITTED, 30.0)]], [LAG], Ending.RUNNING, 1,
         "The search was still running when this was written, with lag on joint 1 accepted; others may follow."),
        ([[tried(LAG), tried(GEAR)]], [], Ending.TIME_UP, 0,
         "The time limit of 30 s ended the search in round 1: 2 of its 2 candidates were not tried (lag on joint 1, "
         "gear on joint 2)."),
        ([[tried(LAG, Outcome.FITTED, 99.0)], [tried(a) for a in (GEAR, *MORE)]], [LAG], Ending.TIME_UP, 1,
         "The time limit of 30 s ended the search in round 2: 5 of its 5 candidates were not tried (gear on joint 2, "
         "c on joint 3, d on joint 4, e on joint 5 and 1 others)."),
        ([[tried(LAG, Outcome.FITTED, 12.4), tried(MORE[0], Outcome.LEFT_EARLY, 50.0), tried(GEAR)]], [],
         Ending.TIME_UP, 0,
         "The time limit of 30 s ended the search in round 1: 1 of its 3 candidates were not tried (gear on joint 2); "
         "of those that were, lag on joint 1 leads with a BIC difference of 12."),
        ([[tried(LAG, Outcome.FITTED, 12.4)]], [], Ending.TIME_UP, 0,
         "The time limit of 30 s ended the search in round 1, none of whose candidates was accepted, before all was "
         "tried that follows then: gears with play in the whole range of its parameters, gears with an error of their "
         "teeth, and effects two by two or in the place of others."),
    ],
)  # fmt: skip
def test_how_far_it_came(
    comparisons: list[list[TriedCandidate]], steps: list[EffectAtJoint], ending: Ending, rounds: int, text: str
) -> None:
    done: Any = tuple(SimpleNamespace(effect_at=a) for a in steps)
    told, found = unfinished_search(Discovery(BASE, BASE, done, (), tuple(map(tuple, comparisons)), ending), 30.0)
    assert told is not None
    assert found is not None
    assert told.text == found.text == text
    assert told.code.name == found.code == ("search-running" if ending is Ending.RUNNING else "search-cut")
    assert found.rounds == rounds
    last = comparisons[-1] if comparisons else []
    assert found.untried == [(t.effect_at.effect, t.effect_at.joint) for t in last if t.outcome is Outcome.NOT_TRIED]
    assert found.next_step


def test_a_search_at_its_end_is_not_unfinished() -> None:
    assert unfinished_search(Discovery(BASE, BASE, ()), 30.0) == (None, None)


def test_what_was_not_looked_for_at_the_end_makes_it_unfinished() -> None:
    """A verdict of all rounds does not hold for what they did not see."""
    found = ended_before(document(answer="nothing", findings=[], conditions=["b is right"]), 5.0, "gears")
    assert (found.answer, found.unfinished.code) == ("unfinished", "search-cut")  # type: ignore[union-attr]
    assert (found.verdict, [reason.code for reason in found.reasons]) == ("not_settled", ["search-cut"])
    assert found.conditions == [] and found.power is None, "only a valid verdict rests on something"
    assert found.unfinished.text == "The time limit of 5 s ended the search before gears were looked for."  # type: ignore[union-attr]
    again = ended_before(found, 5.0, "pushes")
    assert again.unfinished.text.endswith("before gears were looked for. Pushes were not looked for either.")  # type: ignore[union-attr]


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan")])
def test_a_limit_is_a_positive_number(limit: float) -> None:
    with pytest.raises(InputError, match="time limit"):
        Progress.limited(print, limit)


def test_the_time_begins_when_the_watch_is_made() -> None:
    assert Progress.limited(print, None).ends == float("inf")
    assert not Progress.limited(print, 1000.0).is_time_up
    assert Progress.limited(print, 1e-9).is_time_up
