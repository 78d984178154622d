"""What is said of misfits that would not show, and how far they move which value."""

from __future__ import annotations

import pytest

from fmu_didim.checks.power.moves import NAMED, unseen_diagnostics
from fmu_didim.checks.power.statement import MovedResult, PowerResult, StatedResult, TrustResult


def moved(deviations: float, percent: float | None = 0.5) -> MovedResult:
    return MovedResult(size=1.0, parameter="MX1", deviations=deviations, percent=percent)


def stated(what: str, joint: int, moves: MovedResult | None, size: float | None = 0.3) -> StatedResult:
    return StatedResult(
        effect="any", what=what, joint=joint, place=f"joint {joint}", size=size, unit="%", largest=30.0, parameters={},
        moves=moves,
    )  # fmt: skip


def said(*found: StatedResult, trusted: tuple[TrustResult, ...] = ()) -> str:
    told = unseen_diagnostics(PowerResult(power=0.8, stated=list(found), trusted=list(trusted)))
    return told[0].text if told else ""


@pytest.mark.parametrize(
    ("moves", "text"),
    [
        (moved(15.2), "an offset (joint 1) below 0.3 %, MX1 by 15 sigma (+0.5 %)"),
        (moved(-2.04, -12.3), "an offset (joint 1) below 0.3 %, MX1 by 2.0 sigma (-12 %)"),
        (moved(2.0, None), "an offset (joint 1) below 0.3 %, MX1 by 2.0 sigma"),
        (moved(0.9), ""),
        (None, ""),
    ],
)
def test_what_moves_a_value_by_more_than_its_sigma_is_said(moves: MovedResult | None, text: str) -> None:
    assert said(stated("an offset", 1, moves)) == (f"It would not show, but move values: {text}." if text else "")


def test_the_worst_of_each_kind_comes_first_and_the_others_are_counted() -> None:
    found = [stated("an offset", 1, moved(3.0)), stated("an offset", 2, moved(-7.0)), stated("a spring", 1, moved(5.0))]
    more = [stated(f"kind {k}", 1, moved(2.0)) for k in range(NAMED)]
    text = said(*found, *more)
    assert text.index("an offset (joint 2)") < text.index("a spring (joint 1)")
    assert "an offset (joint 1)" not in text
    assert f"So would {len(found) + len(more) - NAMED} more" in text


def test_what_no_size_of_shows_is_said_by_one_unit() -> None:
    zero = TrustResult(what="a zero", place="joint 2", size=None, unit="deg", check="look", moves=moved(59.0, 15.0))
    assert "a zero (joint 2) of any size, MX1 by 59 sigma (+15 %) for each deg" in said(trusted=(zero,))


@pytest.mark.parametrize(
    ("found", "condition"),
    [
        ([], ""),
        ([stated("an offset", 1, moved(3.9))], ""),
        ([stated("an offset", 1, moved(32.1))],
         "the data do not hide an offset (joint 1) below 0.3 %, which would move MX1 by 32 sigma (+0.5 %)"),
        ([stated("an offset", 1, moved(4.1)), stated("a spring", 2, moved(-8.0)), stated("a dead zone", 1, moved(2.0))],
         "the data do not hide a spring (joint 2) below 0.3 %, which would move MX1 by 8.0 sigma (+0.5 %), nor an "
         "offset (joint 1) below 0.3 %, which would move MX1 by 4.1 sigma (+0.5 %)"),
        ([stated("an offset", 1, moved(6.0)), stated("an offset", 2, moved(5.0)), stated("a spring", 1, moved(4.5))],
         "the data do not hide an offset (joint 1) below 0.3 %, which would move MX1 by 6.0 sigma (+0.5 %), nor a "
         "spring (joint 1) below 0.3 %, which would move MX1 by 4.5 sigma (+0.5 %), nor 1 more"),
        ([stated("an offset", 1, moved(59.0), size=None), stated("a spring", 2, moved(5.0))],
         "the data do not hide a spring (joint 2) below 0.3 %, which would move MX1 by 5.0 sigma (+0.5 %)"),
    ],
)  # fmt: skip
def test_a_valid_verdict_rests_on_what_moves_a_value_farther_than_noise_could(
    found: list[StatedResult], condition: str
) -> None:
    """The worst of two kinds are named, what moves a value as far is counted; what shows at no size is not named."""
    told = unseen_diagnostics(PowerResult(power=0.8, stated=found, trusted=[]))
    assert [d.condition for d in told if d.condition] == ([f"{condition} (What valid excludes)"] if condition else [])
