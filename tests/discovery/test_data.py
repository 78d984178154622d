"""What is wrong with the data of a case is known before a search begins."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fmu_didim import discover
from fmu_didim.base.diagnostics import DiagnosedError, Diagnostic
from fmu_didim.case import load_case
from fmu_didim.checks.data.log import SAMPLES_MISSING
from fmu_didim.checks.data.runs import VALIDATION_WITHOUT_TORQUE
from fmu_didim.checks.data.timing import CLOCK_LATE
from fmu_didim.data.tables import read_trajectory
from fmu_didim.discovery.request import Request

SCARA = Path("examples/scara/identify.yaml")


class BegunError(Exception):
    """A search has begun."""


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The request that a search was started with; it ends there."""
    found: dict[str, Any] = {}

    def search(model: object, request: Request) -> None:
        found["doubts"] = request.doubts
        raise BegunError

    monkeypatch.setattr(sys.modules[discover.__module__], "discover_in", search)
    return found


def test_a_log_that_cannot_be_that_of_the_loop_is_refused_before_any_fit(asked: dict[str, Any]) -> None:
    log = read_trajectory(SCARA.with_name("train_10hz.csv"))
    turned = replace(log, values=-log.values)
    with pytest.raises(DiagnosedError, match="runs against"):
        discover(load_case(SCARA).with_signals({"train_10hz.csv": turned}))
    assert not asked


def test_held_out_data_that_are_none_are_doubted(asked: dict[str, Any]) -> None:
    with pytest.raises(BegunError):
        discover(load_case(SCARA).with_(validation={"torque": None}))
    assert "validation-without-torque" in [d.code.name for d in asked["doubts"]]


def test_doubts_of_the_data_are_reasons_and_all_else_is_a_note() -> None:
    """Discovery itself names a clock or a delay: only what holds whatever the model is, is a doubt."""
    diagnostics = [Diagnostic(code, "It is so.") for code in (VALIDATION_WITHOUT_TORQUE, CLOCK_LATE, SAMPLES_MISSING)]
    request = Request(name="", description=None).about_data(diagnostics)
    assert [d.code for d in request.doubts] == [VALIDATION_WITHOUT_TORQUE]
    assert request.notes == ["It is so.", "It is so."]
