"""A start that leads nowhere gives way to the next one, and the answer says why."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import IdentificationError, SimulationError
from fmu_didim.case import load_case
from fmu_didim.estimators import didim
from fmu_didim.estimators.didim import ASTRAY, BEST, IMPOSSIBLE, NO_FINISH, Didim, RefusedError
from fmu_didim.fit.estimate import Estimate, Status
from fmu_didim.model.loop_model import LoopModel

pytestmark = pytest.mark.gate


@cache
def model() -> LoopModel:
    return load_case("examples/scara/identify.yaml").model


@cache
def undisturbed() -> Estimate:
    return Didim(start="reference").estimate(model())


def failing(function: Callable[..., Any], error: Exception, times: float = 1) -> Callable[..., Any]:
    """A function that raises an error the first times."""
    calls: list[None] = []

    def called(*arguments: Any, **options: Any) -> Any:
        calls.append(None)
        if len(calls) <= times:
            raise error
        return function(*arguments, **options)

    return called


def told(estimate: Estimate, reason: str) -> None:
    """The second start gave the answer, its first remark says why, and the history where it began."""
    assert estimate.remarks[0].startswith("Started from ")
    assert reason in estimate.remarks[0]
    np.testing.assert_allclose(estimate.value, undisturbed().value, atol=0.05 * undisturbed().standard_deviation.min())


def test_rank_that_is_lost_at_one_start(monkeypatch: pytest.MonkeyPatch) -> None:
    lost = IdentificationError("The data cannot tell some parameters apart.", got="ZZ1R, ZZ2", next_step="Change it.")
    monkeypatch.setattr(Didim, "_iterate", failing(Didim._iterate, lost))
    told(Didim().estimate(model()), "The data cannot tell some parameters apart. (ZZ1R, ZZ2)")


def test_rank_that_is_lost_at_all_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    lost = IdentificationError("The data cannot tell some parameters apart.", got="ZZ1R, ZZ2", next_step="Change it.")
    monkeypatch.setattr(Didim, "_iterate", failing(Didim._iterate, lost, np.inf))
    with pytest.raises(IdentificationError) as caught:
        Didim().estimate(model())
    assert caught.value is lost


def test_a_finish_that_cannot_be_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = SimulationError("The component stopped.", got="t = 1 s", next_step="Change it.")
    monkeypatch.setattr(didim, "finish_by_colour", failing(didim.finish_by_colour, broken))
    estimate = Didim().estimate(model())
    told(estimate, f"{NO_FINISH}: The component stopped. t = 1 s")
    (last,) = [iteration for iteration in estimate.iterations if iteration.restarts]
    assert NO_FINISH in last.note


def test_no_finish_that_can_be_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = SimulationError("The component stopped.", next_step="Change it.")
    monkeypatch.setattr(didim, "finish_by_colour", failing(didim.finish_by_colour, broken, np.inf))
    with pytest.raises(RefusedError, match=f"{NO_FINISH}: The component stopped"):
        Didim().estimate(model())


def test_the_history_says_where_a_start_that_is_astray_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    answers, errors = iter([ASTRAY]), iter([1.0, 2.0])  # the second answer is better
    monkeypatch.setattr(didim, "_astray", lambda estimate: next(answers, ""))
    monkeypatch.setattr(didim, "_error", lambda estimate: next(errors))
    estimate = Didim().estimate(model())
    told(estimate, ASTRAY)
    assert sum(iteration.restarts for iteration in estimate.iterations) == 1


@pytest.mark.parametrize(
    ("note", "status", "beyond", "reason"),
    [
        ("", Status.MAXIMUM_ITERATIONS, None, ""),  # the iterations have settled
        ("", Status.CONVERGED, 9.0, ""),
        (BEST, Status.MAXIMUM_ITERATIONS, None, ASTRAY),
        (BEST, Status.CONVERGED, None, ""),
        (BEST, Status.CONVERGED, 3.2, ""),  # standard deviations: 0.14 % by chance
        (BEST, Status.CONVERGED, 3.4, IMPOSSIBLE),
    ],
)
def test_when_another_start_may_do_better(note: str, status: Status, beyond: float | None, reason: str) -> None:
    found = undisturbed()
    deviation = np.zeros(found.value.size)
    deviation[0] = 0.0 if beyond is None else beyond
    root = np.linalg.cholesky(found.covariance)
    made = replace(
        found, status=status, unlimited=None if beyond is None else found.value - root @ deviation,
        iterations=tuple(replace(one, note=note) for one in found.iterations),
    )  # fmt: skip
    assert didim._astray(made) == reason
