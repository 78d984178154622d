"""The efficient finish: when it counts as settled, and how often it differentiates the loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fmu_didim.prediction.finish import Point, efficient_finish, evaluate
from fmu_didim.prediction.problem import Prediction, Problem

from fmu_didim.case import load_case
from fmu_didim.prediction import finish
from fmu_didim.prediction.iteration import Iteration

NEAR = np.array([3.41, 0.04, 0.81, 0.0637, 0.2455, 0.0145, 0.0127, 0.1373])


@pytest.fixture(scope="module")
def problem() -> Problem:
    found = load_case("examples/scara/identify.yaml").problem
    assert found is not None
    return found


@pytest.fixture
def points(monkeypatch: pytest.MonkeyPatch) -> list[Point]:
    """The points at which the loop is differentiated."""
    made: list[Point] = []

    def counted(*arguments: object) -> Point:
        made.append(evaluate(*arguments))  # type: ignore[arg-type]
        return made[-1]

    monkeypatch.setattr(finish, "evaluate", counted)
    return made


def silent(iteration: Iteration) -> None:
    """Progress that nobody sees."""


def test_near_the_minimum_one_sensitivity_more_is_enough(problem: Problem, points: list[Point]) -> None:
    found = efficient_finish(problem, evaluate(problem, NEAR), tolerance=1e-6, progress=silent)
    assert found.settled
    assert len(points) == 1
    # What the last sensitivity is taken at, is the minimum but for RENEW_STEP of a standard deviation.
    moved = np.abs(found.point.theta - points[0].theta) / np.sqrt(np.diag(found.point.covariance))
    assert moved.max() <= finish.RENEW_STEP


def test_the_minimum_does_not_depend_on_where_the_sensitivity_is_taken(problem: Problem) -> None:
    found = efficient_finish(problem, evaluate(problem, NEAR), tolerance=1e-6, progress=silent)
    far = efficient_finish(problem, evaluate(problem, NEAR * 1.2), tolerance=1e-6, progress=silent)
    sigma = np.sqrt(np.diag(found.point.covariance))
    assert far.settled
    assert (np.abs(far.point.theta - found.point.theta) <= 2e-5 * sigma).all()


def test_steps_that_keep_nothing_of_their_promise_have_not_settled(
    problem: Problem, points: list[Point], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error without slope, as of a simulation that is unstable; it is looked at twice if the sensitivity is old."""
    start, real, calls = evaluate(problem, NEAR), finish._search, 0

    def search(problem: Problem, theta: np.ndarray, step: object) -> tuple[np.ndarray, Prediction, str]:
        nonlocal calls
        calls += 1
        if calls == 1:
            step = replace(step, change=0.5 * step.change)  # type: ignore[type-var, attr-defined]
            return real(problem, theta, step)  # type: ignore[arg-type]
        return theta.copy(), finish.predict(problem, theta), "no smaller step lowers the error"

    monkeypatch.setattr(finish, "_search", search)
    found = efficient_finish(problem, start, tolerance=1e-6, progress=silent)
    assert not found.settled
    assert len(points) == 1
    assert calls == 2
