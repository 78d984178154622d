"""What is made of the points of an iteration: a table of decisions."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.estimators.descent import Descent

NAN = float("nan")


@pytest.mark.parametrize(
    ("points", "expected", "best"),
    [
        ([(2.0, ""), (1.0, ""), (1.2, "")], ["taken", "taken", "taken"], 1.0),
        ([(2.0, ""), (1.0, ""), (1.6, "")], ["taken", "taken", "halved"], 1.0),
        ([(0.448, ""), (0.6, ""), (0.65, ""), (0.9, "")], ["taken", "taken", "taken", "halved"], 0.448),
        ([(2.0, ""), (NAN, "M")], ["taken", "halved"], 2.0),
        ([(NAN, "M")], ["failed"], np.inf),
        ([(80.0, ""), (70.0, "")], ["taken", "failed"], 80.0),
        ([(80.0, ""), (20.0, "")], ["taken", "taken"], 20.0),
        ([(2.0, ""), *[(NAN, "M")] * 7], ["taken", *["halved"] * 6, "over"], 2.0),
    ],
    ids=["falls", "grows", "wanders", "fails", "no begin", "useless", "recovers", "nothing better"],
)
def test_points_are_judged_against_the_best(points: list[tuple[float, str]], expected: list[str], best: float) -> None:
    path = Descent(is_last=False)
    assert [path.judged(np.zeros(1), error, failure) for error, failure in points] == expected
    assert path.best[1] == best
    assert path.count == len(points)


def test_the_only_start_is_not_given_up() -> None:
    path = Descent(is_last=True)
    assert [path.judged(np.zeros(1), error, "") for error in (80.0, 70.0)] == ["taken", "taken"]


def test_first_point_is_not_steady() -> None:
    path = Descent(is_last=False)
    path.judged(np.zeros(1), 1.0, "")
    assert not path.steady(1.0, 0.025)
    path.judged(np.zeros(1), 1.01, "")
    assert path.steady(1.01, 0.025)
    assert path.rises == 1
