"""Which scales that the data suggest stay when they are asked again along the motion of a fit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.data import checks, timing
from fmu_didim.checks.data.robot import TORQUE_SCALE
from fmu_didim.checks.data.timing import CLOCK_LATE, COMMAND_DELAY, SAMPLING_KIND, kind_is_clear
from tests.checks.data.right import loaded

SCALE, CLOCK = Diagnostic(TORQUE_SCALE, "twice"), Diagnostic(CLOCK_LATE, "late")
DELAY, KIND = Diagnostic(COMMAND_DELAY, "a period later"), Diagnostic(SAMPLING_KIND, "averages")


@pytest.mark.parametrize(("again", "left"), [([], [CLOCK]), ([SCALE], [SCALE, CLOCK]), ([CLOCK], [CLOCK])])
def test_a_scale_stays_only_if_it_explains_something_there(
    again: list[Diagnostic], left: list[Diagnostic], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checks, "motion_with_regressor", lambda run: run)
    monkeypatch.setattr(checks, "_still_explained", lambda fitted, asked: again)
    monkeypatch.setattr(checks, "kind_is_clear", lambda fitted: True)
    assert checks.confirmed(loaded("scara"), [SCALE, CLOCK]) == left


@pytest.mark.parametrize(
    ("again", "left"), [([], []), ([DELAY], [DELAY]), ([CLOCK], [DELAY]), ([SCALE], [])]
)  # fmt: skip
def test_a_delay_stays_where_another_timing_explains_something_there(
    again: list[Diagnostic], left: list[Diagnostic], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a TX40 at 20 Hz a start that was far off looked like a delay, in one of 20 right models."""
    monkeypatch.setattr(checks, "motion_with_regressor", lambda run: run)
    monkeypatch.setattr(checks, "_still_explained", lambda fitted, asked: again)
    monkeypatch.setattr(checks, "kind_is_clear", lambda fitted: True)
    assert checks.confirmed(loaded("scara"), [DELAY]) == left


@pytest.mark.parametrize(
    ("again", "clear", "left"), [([], True, []), ([], False, [KIND]), ([KIND], True, [KIND]), ([CLOCK], True, [])]
)  # fmt: skip
def test_a_kind_of_sampling_goes_only_where_the_case_explains_the_log_clearly_better(
    again: list[Diagnostic], clear: bool, left: list[Diagnostic], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A TX40 at 1 kHz that started far off looked like averages; after the fit those left 1.8 times the residual."""
    monkeypatch.setattr(checks, "motion_with_regressor", lambda run: run)
    monkeypatch.setattr(checks, "_still_explained", lambda fitted, asked: again)
    monkeypatch.setattr(checks, "kind_is_clear", lambda fitted: clear)
    assert checks.confirmed(loaded("scara"), [KIND]) == left


@dataclass(frozen=True)
class Offering:
    """A motion along which only what is offered under these codes explains anything."""

    explains: frozenset[str]
    samples: float = 100.0

    @property
    def run(self) -> Any:
        return SimpleNamespace(model=SimpleNamespace(threads=1))

    def best(self, offered: Iterable[Diagnostic]) -> list[Diagnostic]:
        return [one for one in offered if one.code.name in self.explains]


@pytest.mark.parametrize(
    ("asked", "explains", "found", "computed"),
    [
        (KIND, set(), [], ["timing"]), (SCALE, set(), [], ["robot"]), (KIND, {"torque-scale"}, [], ["timing"]),
        (KIND, {"sampling-kind", "torque-scale"}, [KIND, SCALE], ["timing", "timing", "robot"]),
        (SCALE, {"torque-scale"}, [SCALE], ["robot", "timing", "robot"]),
    ],
)  # fmt: skip
def test_other_kinds_of_explanations_are_computed_only_as_rivals(
    asked: Diagnostic, explains: set[str], found: list[Diagnostic], computed: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    of_timing, of_robot, order = [KIND], [SCALE], list[str]()
    ways = [lambda: iter(order.append("timing") or of_timing)]
    monkeypatch.setattr(checks, "timings", lambda fitted, clock_alone=False: list(ways))
    monkeypatch.setattr(checks, "another_robot", lambda fitted: order.append("robot") or of_robot)
    motion = Offering(frozenset(explains))
    assert checks._still_explained(motion, {asked.code}) == found  # type: ignore[arg-type]
    assert order == computed


@dataclass(frozen=True)
class Sampled:
    """A motion of which the other kinds of sampling have these misfits, of 100 samples."""

    misfits: list[float]

    def gain(self, misfit: float, parameters: float) -> float:
        return -100 * np.log(misfit)


@pytest.mark.parametrize(
    ("misfits", "clear"), [([2.0, 3.0], True), ([2.0, 1.1], False), ([0.9, 3.0], False), ([], True)]
)  # fmt: skip
def test_a_kind_is_clear_where_every_other_one_is_clearly_worse(
    misfits: list[float], clear: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(timing, "_other_kinds", lambda fitted: [(m, "average", "centred", None) for m in misfits])
    assert kind_is_clear(Sampled(misfits)) == clear  # type: ignore[arg-type]


def test_where_the_fit_cannot_be_simulated_nothing_is_cleared_up(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(run: object) -> None:
        raise SimulationError("it diverged", next_step="Change it.")

    monkeypatch.setattr(checks, "motion_with_regressor", fails)
    assert checks.confirmed(loaded("scara"), [SCALE, CLOCK]) == [SCALE, CLOCK]
