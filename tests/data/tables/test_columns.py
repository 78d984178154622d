"""How columns become signals: units, scale, sign, gear, and instants; what is told of it, what is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydantic import ValidationError

from fmu_didim.base.errors import InputError
from fmu_didim.data.tables import Column, Selected, SignalTable, TimeColumn, instants, selected

ARM, AXIS = ("N.m", "N.m"), ("N",)
ROWS = np.array([1.0, 2.0, -4.0])


def made(column: Any, signal: str = "q1", *, unit: str = "", units: tuple[str, ...] = ARM, **options: Any) -> Selected:
    name = column if isinstance(column, str) else column["name"]
    table = SignalTable({"t": np.arange(3.0), name: ROWS}, {name: unit} if unit else {}, source="log.csv")
    return selected(table, columns={signal: Column.model_validate(column)}, torque_units=units, **options)


def codes(found: Selected) -> list[str]:
    return [d.code.name for d in found.told]


@pytest.mark.parametrize(
    ("column", "signal", "unit", "units", "factor", "told"),
    [
        ("x", "q1", "", ARM, 1.0, []),
        ("x", "q1", "rad", ARM, 1.0, []),
        ("x", "q1", "deg", ARM, math.pi / 180, ["unit-from-file"]),
        ("x [°]", "q1", "", ARM, math.pi / 180, ["unit-from-file"]),
        ({"name": "x", "unit": "deg", "scale": 0.01, "sign": -1}, "q1", "", ARM, -math.pi / 18000, []),
        ({"name": "x", "unit": "rpm"}, "dq2", "", ARM, 2 * math.pi / 60, []),
        ({"name": "x", "unit": "U/min", "gear_ratio": 100}, "dq2", "", ARM, 2 * math.pi / 6000, []),
        ({"name": "x", "unit": "deg/s^2", "gear_ratio": 2}, "ddq1", "", ARM, math.pi / 360, []),
        ({"name": "x", "unit": "mm"}, "q1", "", AXIS, 1e-3, []),
        # A spindle of 10 mm: 2 pi rad of the motor for 10 mm.
        ({"name": "x", "unit": "deg", "gear_ratio": 200 * math.pi}, "q1", "", AXIS, 0.01 / 360, []),
        ({"name": "x", "unit": "Nm", "gear_ratio": 200 * math.pi}, "tau1", "", AXIS, 200 * math.pi, []),
        ({"name": "x", "unit": "Nm", "gear_ratio": 80}, "tau1", "", ARM, 80.0, []),
        ({"name": "x", "unit": "mA", "torque_constant": 0.35, "gear_ratio": 80}, "tau1", "", ARM, 0.028, []),
        ({"name": "x", "torque_constant": 0.35}, "tau1", "A", ARM, 0.35, []),
        ({"name": "x", "unit": "kN"}, "tau1", "", AXIS, 1e3, []),
        # The case overrules the file, and it is told.
        ({"name": "x", "unit": "rad"}, "q1", "deg", ARM, 1.0, ["unit-contradicts-file"]),
        ({"name": "x", "unit": "deg"}, "q1", "°", ARM, math.pi / 180, []),
        # A unit in the file that nobody knows.
        ("x", "q1", "Inc", ARM, 1.0, ["unit-unknown"]),
        ({"name": "x", "unit": "deg", "scale": 0.1}, "q1", "Inc", ARM, math.pi / 1800, []),
        # Other columns are of any kind.
        ("x", "excitation", "mV", ARM, 1e-3, ["unit-from-file"]),
    ],
)  # fmt: skip
def test_conversion(
    column: Any, signal: str, unit: str, units: tuple[str, ...], factor: float, told: list[str]
) -> None:
    found = made(column, signal, unit=unit, units=units)
    assert_allclose(found.signals.column(signal), factor * ROWS, rtol=1e-14)
    assert codes(found) == told


@pytest.mark.parametrize(
    ("column", "signal", "unit", "units", "problem"),
    [
        (
            {"name": "x", "unit": "deg"},
            "q1",
            "",
            AXIS,
            r"unit of q1[\s\S]*log\.csv, column x[\s\S]*deg[\s\S]*valid: m\n",
        ),
        ("x", "q1", "mm", ARM, r"mm[\s\S]*valid: rad\n"),
        ("x", "tau1", "A", ARM, r"valid: N\.m[\s\S]*torque_constant[\s\S]*quantity: command"),
        ({"name": "x", "unit": "N", "torque_constant": 1.0}, "tau1", "", ARM, r"valid: A"),
        ("x", "tau1", "%", ARM, r"rated torque"),
        ("x", "dq1", "1/min", ARM, r"turns or radians[\s\S]*rpm"),
        ("x", "dq1", "deg", ARM, r"valid: rad/s"),
        ({"name": "x", "unit": "1"}, "q1", "", ARM, r"encoder"),
        ({"name": "x", "unit": "mm", "gear_ratio": 2}, "q1", "", AXIS, r"valid: rad\n"),
        ("x", "q1", "degC", ARM, r"A unit with an offset"),
        ("absent", "q1", "", ARM, "absent"),
    ],
)
def test_units_that_are_none_of_the_signal(
    column: Any, signal: str, unit: str, units: tuple[str, ...], problem: str
) -> None:
    if column == "absent":
        with pytest.raises(InputError, match=r"no column named 'y'[\s\S]*log\.csv"):
            selected(SignalTable({"t": ROWS, "x": ROWS}, source="log.csv"), columns={"q1": Column(name="y")})
        return
    with pytest.raises(InputError, match=problem):
        made(column, signal, unit=unit, units=units)


@pytest.mark.parametrize(
    ("column", "signal", "expected"),
    [
        # The axis stands at zero where its encoder shows 90 degrees, and counts the other way round.
        ({"unit": "deg", "zero": 90.0, "sign": -1}, "q1", lambda x: -np.deg2rad(x - 90)),
        # Hundredths of a degree: the offset is in degrees.
        ({"unit": "deg", "scale": 0.01, "zero": 1.5}, "q1", lambda x: np.deg2rad(0.01 * x - 1.5)),
        # Behind a gear the offset is that of the motor, and becomes a joint's.
        ({"unit": "deg", "zero": 10.0, "gear_ratio": 50}, "q1", lambda x: np.deg2rad(x - 10) / 50),
        # A current sensor that shows 0.1 A at rest.
        ({"unit": "A", "zero": 0.1, "torque_constant": 0.2, "gear_ratio": 50}, "tau1", lambda x: (x - 0.1) * 10),
    ],
)
def test_offsets(column: dict[str, Any], signal: str, expected: Callable[[Any], Any]) -> None:
    assert_allclose(made({"name": "x", **column}, signal).signals.column(signal), expected(ROWS), rtol=1e-14)


def test_command_is_of_any_unit() -> None:
    found = made({"name": "x", "unit": "mV"}, "tau1", is_command=True)
    assert_allclose(found.signals.column("tau1"), 1e-3 * ROWS)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ({"name": "x", "unit": "Grad"}, "two things"),
        ({"name": "x", "unit": "g"}, "two things"),
        ({"name": "x", "unit": "foo"}, "not known"),
        ({"name": "x", "scale": 0}, "zero"),
        ({"name": "x", "scale": float("nan")}, "finite"),
        ({"name": "x", "sign": 2}, "1 or -1"),
        ({"name": "x", "gear_ratio": -3}, "greater than 0"),
    ],
)
def test_columns_that_are_none(content: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        Column.model_validate(content)


def table(stamps: Any = None, name: str = "t", **more: Any) -> SignalTable:
    columns = {"q1": np.arange(100.0)}
    return SignalTable(({} if stamps is None else {name: np.asarray(stamps)}) | columns, source="log.csv", **more)


GRID = np.arange(100) * 0.005
ROUNDED = np.rint(1000 * np.arange(100) * 0.0052) / 1000
"""Stamps of 5.2 ms on a clock that counts milliseconds."""


@pytest.mark.parametrize(
    ("given", "time", "expected", "told"),
    [
        (table(GRID), {}, GRID, []),
        (table(GRID, "Zeit"), {}, GRID, []),
        (table(1000 * GRID, "Time [ms]"), {}, GRID, []),
        (table(1000 * GRID), {"unit": "ms"}, GRID, []),
        (table(1000 * GRID, "x"), {"name": "x", "unit": "ms"}, GRID, []),
        # Dates need no name to be known as the clock.
        (table(GRID, "Stempel", calendar=("Stempel",), units={"Stempel": "s"}), {}, GRID, []),
        (table(), {"rate_hz": 200, "start_s": 1.0}, 1 + GRID, ["time-counted"]),
        (table(GRID), {"rate_hz": 200}, GRID, ["time-counted"]),
        (table(GRID), {"rate_hz": 100}, 2 * GRID, ["time-contradicts-file"]),
        (table(ROUNDED), {"name": "t", "rate_hz": 1 / 0.0052}, np.arange(100) * 0.0052, ["stamps-on-grid"]),
        (table(ROUNDED), {"jittered": True, "rate_hz": 1 / 0.0052}, np.arange(100) * 0.0052, ["stamps-rebuilt"]),
        (table(ROUNDED), {"name": "t", "jittered": True}, np.arange(100) * 0.0052, ["stamps-rebuilt"]),
    ],
)
def test_instants(given: SignalTable, time: dict[str, Any], expected: Any, told: list[str]) -> None:
    found = selected(given, time=TimeColumn.model_validate(time))
    by_stamps = told in (["stamps-on-grid"], ["stamps-rebuilt"])
    assert_allclose(found.signals.time, expected, atol=6e-4 if by_stamps else 1e-12)
    if by_stamps:
        assert np.ptp(np.diff(found.signals.time)) < 1e-9
    assert codes(found) == told


def test_a_file_of_jittered_stamps_alone_is_put_right() -> None:
    """As one that has the instants of the controller: no other column shows whether rows were read again."""
    time = TimeColumn(name="t", jittered=True)
    found, told = instants(SignalTable({"t": ROUNDED}, source="log.csv"), time, "t", ROUNDED.size)
    assert_allclose(found, np.arange(100) * 0.0052, atol=6e-4)
    assert [one.code.name for one in told] == ["stamps-rebuilt"]


@pytest.mark.parametrize(
    ("given", "time", "problem"),
    [
        (table(), {}, r"no time column[\s\S]*log\.csv[\s\S]*valid: t, time[\s\S]*rate_hz"),
        (table(GRID), {"name": "x"}, r"no column named 'x'"),
        (table(GRID, "t [V]"), {}, r"not a unit of time[\s\S]*V"),
        (table(GRID, "T"), {}, r"no time column"),  # a temperature
        (table(GRID), {"name": "t", "rate_hz": 150}, r"do not lie near[\s\S]*come at 200 Hz"),
        (table(GRID[:50]), {"name": "t"}, r"no signal of its length"),
        (table(GRID[::-1]), {"name": "t"}, r"does not increase[\s\S]*jittered"),
        (table(GRID + 0.005 * (GRID > 0.3)), {"name": "t", "jittered": True}, r"not jittered[\s\S]*lacking near row 6"),
        (table(GRID), {"name": "t", "jittered": True, "rate_hz": 190}, r"not jittered[\s\S]*200 Hz fits best"),
        (table(GRID, calendar=("t",), units={"t": "s"}), {"name": "t", "unit": "ms"}, r"no unit[\s\S]*Leave out unit"),
    ],
)
def test_instants_that_cannot_be(given: SignalTable, time: dict[str, Any], problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        selected(given, time=TimeColumn.model_validate(time))


def test_dropped_rows_stay_dropped() -> None:
    """Rounded stamps are brought to their grid; what the logger lost is not papered over."""
    kept = np.delete(np.arange(100), [40, 41])
    found = selected(
        SignalTable({"t": ROUNDED[kept], "q1": kept.astype(float)}, source="log.csv"),
        time=TimeColumn(name="t", rate_hz=1 / 0.0052),
    )
    assert found.signals.time.size == 98
    assert_allclose(np.diff(found.signals.time)[39], 3 * 0.0052)
    assert "2 rows are missing" in found.told[0].text


def test_columns_of_other_lengths_are_named() -> None:
    given = SignalTable({"t": GRID, "tau": np.zeros(50)}, source="log.csv")
    with pytest.raises(InputError, match=r"different lengths[\s\S]*t: 100, tau: 50"):
        selected(given, columns={"tau1": Column(name="tau")})


def test_instants_of_another_group_are_refused() -> None:
    """Of the same length, so that nothing else would tell."""
    given = table(GRID, times={"q1": "time 0"})
    with pytest.raises(InputError, match=r"different instants[\s\S]*t: 100 rows, time 0"):
        selected(given, columns={"q1": Column(name="q1")}, time=TimeColumn(name="t"))


def test_file_without_header_is_told() -> None:
    given = SignalTable({"1": GRID, "2": GRID}, source="log.csv", has_header=False)
    with pytest.raises(InputError, match=r"no time column[\s\S]*its number"):
        selected(given)
    with pytest.raises(InputError, match=r"log\.csv \(it has no header line: its columns are numbered from 1\)"):
        selected(given, columns={"q1": Column(name="q1")}, time=TimeColumn(name="1"))
    found = selected(given, columns={"q1": Column.model_validate(2)}, time=TimeColumn.model_validate(1))
    assert found.signals.names == ("q1",)
