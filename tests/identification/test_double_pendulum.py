"""A real robot, parts of its log at several rates: values that its makers published, torque that was not fitted."""

from __future__ import annotations

from typing import Any

import pytest

from fmu_didim import Result, identify
from fmu_didim.case.files import data_folder
from tests.helpers import ROOT

EXAMPLE = ROOT / "examples/double_pendulum"
PUBLISHED = {"MX1R": 0.349, "MX2": 0.111, "ZZ1R": 0.111, "ZZ2": 0.0239}
FULL = data_folder(ROOT) / "double_pendulum"
needs_full_log = pytest.mark.skipif(
    not (FULL / "log.csv").is_file(),
    reason=f"needs all 75 s of the log: put the files that SOURCE.md of the example names into {FULL}, as log.csv and "
    "reference.csv",
)


def case(train: dict[str, Any], **more: Any) -> dict[str, Any]:
    robot, controller = str(EXAMPLE / "robot.yaml"), str(EXAMPLE / "controller.yaml")
    return {
        "schema": 1, "name": "double pendulum", "robot": robot, "plant": {"kind": "fmu"},
        "controller": {"kind": "fmu", "source": controller}, "train": train, **more,
    }  # fmt: skip


def part(first: float, last: float, rate_hz: float, **more: Any) -> dict[str, Any]:
    log, reference = str(EXAMPLE / "log.parquet"), str(EXAMPLE / "reference.parquet")
    begin = {"from_s": first} if first else {}
    return {
        "reference": {"file": reference},
        "torque": {"file": log, "rate_hz": rate_hz},
        "to_s": last,
        **begin,
        **more,
    }


def assert_as_published(found: Result) -> None:
    assert found.document.status == "converged"
    assert found.document.verdict == "doubtful"  # friction grows with the load of the gear
    for name in ("MX1R", "MX2"):
        assert found.parameters[name].value == pytest.approx(PUBLISHED[name], rel=0.07)
    for name in ("ZZ1R", "ZZ2"):
        assert abs(found.parameters[name].value - PUBLISHED[name]) < 2 * found.parameters[name].std
    reasons = {reason.code for reason in found.document.reasons}
    assert reasons & {"residual-depends-on-motion", "friction-negative"}


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [100, 50, 20, 10])
@pytest.mark.parametrize("last", [30, 48])
def test_from_made_up_values(last: float, rate_hz: float) -> None:
    held_out = {"validation": part(34, 48, rate_hz)} if last == 30 else {}
    found = identify(case(part(0, last, rate_hz), **held_out))
    assert_as_published(found)
    if held_out:
        assert found.document.relative_error_percent["validation"].total <= 10  # type: ignore[operator]


@pytest.mark.slow
def test_positions_beside_the_torque() -> None:
    """They agree with what the torque says, and do not show the inertias better: what limits both is the model."""
    measured = {"file": str(EXAMPLE / "log.parquet"), "offset_s": 0.0033}
    alone, both = (
        identify(case(part(0, 34, 50, **more), validation=part(34, 48, 50, **more)))
        for more in ({}, {"measured": measured})
    )
    assert_as_published(both)
    for name in PUBLISHED:
        one, other = alone.parameters[name], both.parameters[name]
        assert abs(one.value - other.value) < 2 * one.std


@pytest.mark.slow
@needs_full_log
def test_a_loop_that_slows_down() -> None:
    """By the instants of the log as well as before; without them, what happens is told."""
    file = str(FULL / "log.csv")
    columns = {"q1": "pos1", "q2": "pos2", "dq1": "vel1", "dq2": "vel2"}
    train = {
        "reference": {"file": str(FULL / "reference.csv"), "time": "time", "columns": columns},
        "torque": {"file": file, "time": "time", "rate_hz": 50, "columns": {"tau1": "tau1", "tau2": "tau2"}},
        "from_s": 48.0, "to_s": 75.0,
    }  # fmt: skip
    followed = identify(case({**train, "instants": {"file": file, "time": "time"}}))
    assert_as_published(followed)
    assert "period-changes" not in {reason.code for reason in followed.document.reasons}
    told = identify(case(train))
    assert told.document.reasons[0].code == "period-changes"
