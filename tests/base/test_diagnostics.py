"""Diagnostics: their order, and codes that stay unique."""

from __future__ import annotations

import pickle

import pytest

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, PROBLEM, REMARK, Catalogue, Code, Diagnostic, by_weight

CODES = Catalogue()
CAUSE = CODES("cause", DOUBT, rank=10, meaning="m", next_step="mend it")
EFFECT = CODES("effect", DOUBT, rank=60, meaning="m", next_step="look")
STOP = CODES("stop", PROBLEM, rank=90, meaning="m", next_step="stop")
NOTE = CODES("note", REMARK, rank=1, meaning="m", next_step="")


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        ([(NOTE, 1, 1), (EFFECT, 1, 1), (CAUSE, 1, 1), (STOP, 1, 1)], ["stop", "cause", "effect", "note"]),
        ([(EFFECT, 100, 1), (CAUSE, 1.1, 1)], ["cause", "effect"]),
        ([(CAUSE, 2, 1), (CAUSE, 5, 1), (CAUSE, 0.1, 1)], [0.1, 5, 2]),
    ],
)
def test_order(found, expected):
    ordered = by_weight(Diagnostic(code, "text", value=value, bound=bound) for code, value, bound in found)
    assert [d.code.name if isinstance(expected[0], str) else d.value for d in ordered] == expected


def test_a_code_is_written_down_once():
    with pytest.raises(AssertionError, match="twice"):
        CODES("cause", DOUBT, rank=1, meaning="m", next_step="n")


def test_advice_and_text():
    assert Diagnostic(CAUSE, "text").advice == "mend it"
    assert Diagnostic(CAUSE, "text", place="train: joint 2", next_step="first").advice == "first"
    assert str(Diagnostic(CAUSE, "text", place="train: joint 2")) == "train: joint 2: text"


@pytest.mark.parametrize(
    ("value", "bound", "excess"), [(None, 1.0, 1.0), (1.0, None, 1.0), (0.0, 1.0, 1.0), (2.0, -1.0, 2.0)]
)
def test_excess(value, bound, excess):
    assert Diagnostic(CAUSE, "text", value=value, bound=bound).excess == excess


def test_a_code_is_the_same_one_in_another_process() -> None:
    """Decisions ask whether a code is this one; of a module that was not imported it is one like it."""
    for code in CATALOGUE:
        assert pickle.loads(pickle.dumps(code)) is code
    unknown = Code("no-such-code", DOUBT, 3, "It means something.", "Do it.", at_once=True)
    found = pickle.loads(pickle.dumps(Diagnostic(unknown, "text", "place", 1.0)))
    assert found == Diagnostic(unknown, "text", "place", 1.0)
    assert found.code.severity is DOUBT
