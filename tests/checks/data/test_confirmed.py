"""Which scales that the data suggest stay when they are asked again along the motion of a fit."""

from __future__ import annotations

import pytest

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.data import checks
from fmu_didim.checks.data.robot import TORQUE_SCALE
from fmu_didim.checks.data.timing import CLOCK_LATE, COMMAND_DELAY
from tests.checks.data.right import loaded

SCALE, CLOCK = Diagnostic(TORQUE_SCALE, "twice"), Diagnostic(CLOCK_LATE, "late")
DELAY = Diagnostic(COMMAND_DELAY, "a period later")


@pytest.mark.parametrize(("again", "left"), [([], [CLOCK]), ([SCALE], [SCALE, CLOCK]), ([CLOCK], [CLOCK])])
def test_a_scale_stays_only_if_it_explains_something_there(
    again: list[Diagnostic], left: list[Diagnostic], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checks, "motion_with_regressor", lambda run: run)
    monkeypatch.setattr(checks, "_explained", lambda fitted: again)
    assert checks.confirmed(loaded("scara"), [SCALE, CLOCK]) == left


@pytest.mark.parametrize(
    ("again", "left"), [([], []), ([DELAY], [DELAY]), ([CLOCK], [DELAY]), ([SCALE], [])]
)  # fmt: skip
def test_a_delay_stays_where_another_timing_explains_something_there(
    again: list[Diagnostic], left: list[Diagnostic], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a TX40 at 20 Hz a start that was far off looked like a delay, in one of 20 right models."""
    monkeypatch.setattr(checks, "motion_with_regressor", lambda run: run)
    monkeypatch.setattr(checks, "_explained", lambda fitted: again)
    assert checks.confirmed(loaded("scara"), [DELAY]) == left


def test_where_the_fit_cannot_be_simulated_nothing_is_cleared_up(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(run: object) -> None:
        raise SimulationError("it diverged", next_step="Change it.")

    monkeypatch.setattr(checks, "motion_with_regressor", fails)
    assert checks.confirmed(loaded("scara"), [SCALE, CLOCK]) == [SCALE, CLOCK]
