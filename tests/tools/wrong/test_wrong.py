"""Wrong inputs are told with a next step or change nothing, and mistakes at a machine are suspected first."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from tests.tools.wrong.__main__ import SUSPECTED, count, physical
from tests.tools.wrong.draw import draw
from tests.tools.wrong.physical import PHYSICAL, Mistake
from tests.tools.wrong.place import HARMLESS, NO_STEP, SILENT, TOLD, UNFORESEEN, Said, files, outcome


@pytest.mark.parametrize(
    ("number", "seed"),
    [pytest.param(30, 1, marks=pytest.mark.gate), *(pytest.param(300, s, marks=pytest.mark.slow) for s in (1, 2))],
)
def test_nothing_is_silent_unforeseen_or_without_a_next_step(number: int, seed: int, tmp_path: Path) -> None:
    tally, wrong = count(number, seed, tmp_path)
    assert not wrong, "\n".join(wrong)
    assert tally[TOLD] > number / 2
    assert tally[TOLD] + tally[HARMLESS] == number


@pytest.mark.parametrize("draws", [pytest.param(d, marks=pytest.mark.slow) for d in (1, 5)])
def test_the_right_thing_is_suspected_first(draws: int, tmp_path: Path) -> None:
    made, first, missed = physical(draws, 1, tmp_path)
    assert first >= SUSPECTED * made, "\n".join(missed)
    assert not [m for m in missed if m.startswith("WRONG")], "\n".join(missed)


@pytest.mark.gate
def test_draws_are_the_same_and_change_something() -> None:
    right, texts = files(), set()
    for k in range(60):
        one, other = files(), files()
        what = draw(random.Random(k), one)
        assert draw(random.Random(k), other) == what
        texts.add(what)
        assert repr(one) != repr(right), what
    assert len(texts) > 50
    assert len(PHYSICAL) > 25


def said(
    verdict: str = "", *, value: float = 1.0, std: float = 0.1, step: str = "Mend it.", text: str = "",
    moves: tuple[str, float] | None = None,
) -> Said:  # fmt: skip
    if not verdict:
        return Said(1, text)
    reasons = [] if verdict == "valid" else [{"code": "log-outliers", "next_step": step}]
    parameters = {"a": {"value": value, "std": std}, "other": {"value": 7.0, "std": 1.0}}
    result: dict[str, Any] = {"verdict": verdict, "reasons": reasons, "parameters": parameters, "advice": ""}
    if moves is not None:
        result["power"] = {"stated": [{"moves": {"parameter": moves[0], "deviations": moves[1]}}]}
    return Said(0, text, result)


@pytest.mark.parametrize(
    ("found", "what"),
    [
        (said("valid"), HARMLESS),
        (said("valid", value=1.049), HARMLESS),
        (said("valid", value=1.051), SILENT),
        (said("valid", std=0.4), SILENT),
        (said("valid", std=0.0), SILENT),
        (said("doubtful", value=9.0), TOLD),
        (said("doubtful", step=""), NO_STEP),
        (said(text="It is wrong.\n  next:  Mend it."), TOLD),
        (said(text="It is wrong."), NO_STEP),
        (said(text="unexpected error: KeyError"), UNFORESEEN),
    ],
)
def test_outcomes(found: Said, what: str) -> None:
    assert outcome(found, {"a": (1.0, 0.1)}) == what


@pytest.mark.parametrize(
    ("value", "moves", "what"),
    [
        (-39.96, None, HARMLESS),
        (-39.9, None, SILENT),
        (-39.9, ("a", -2.0), HARMLESS),
        (-39.9, ("a", 0.9), SILENT),
        (-39.9, ("other", 4.0), SILENT),
        (-39.7, ("a", 40.0), SILENT),
    ],
)
def test_what_the_result_says_that_it_does_not_exclude(
    value: float, moves: tuple[str, float] | None, what: str
) -> None:
    """One deviation is a quarter of a per cent here."""
    assert outcome(said("valid", value=value, moves=moves), {"a": (-40.0, 0.1)}) == what


@pytest.mark.parametrize(
    ("mistake", "found", "is_first"),
    [
        (Mistake(lambda rng, made: None, ("log-outliers",)), said("doubtful"), True),
        (Mistake(lambda rng, made: None, ("log-constant",)), said("doubtful"), False),
        (Mistake(lambda rng, made: None, ("log-outliers",)), said("valid"), False),
        (Mistake(lambda rng, made: None, ("log-outliers",), may_be_harmless=True), said("valid"), True),
        (Mistake(lambda rng, made: None, ("log-outliers",), may_be_harmless=True), said("valid", value=9.0), False),
        (Mistake(lambda rng, made: None, (), ("clock",)), said(text="The clock.\n  next:  Mend it."), True),
        (Mistake(lambda rng, made: None, (), ("clock",)), said(text="The gain.\n  next:  Mend it."), False),
    ],
)
def test_what_is_suspected_first(mistake: Mistake, found: Said, is_first: bool) -> None:
    assert mistake.suspects(found, {"a": (1.0, 0.1)}) is is_first
