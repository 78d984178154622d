"""Something hidden on a signal is named with an interval that holds it, or told among what data do not tell apart."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from fmu_didim import Discovered, discover
from fmu_didim.results.findings import FindingResult
from tests.discovery.signals.hidden import Hidden, crane, room

pytestmark = pytest.mark.gate

WORDS = {"upper": "upper limit", "lower": "lower limit"}
"""Name of what is hidden -> of what is found, where they differ."""


def found_in(
    make: Callable[..., Path], folder: Path, on: Mapping[str, Mapping[str, float]], **more: object
) -> Discovered:
    """The discovery beside data in which something is hidden."""
    return discover(make(folder, Hidden(on), **more))


def only(found: Discovered) -> FindingResult:
    """The one thing that was named."""
    assert (found.answer, found.verdict) == ("named", "valid"), found.summary()
    (one,) = found.findings
    assert one.ambiguous == []
    return one


NAMED = [
    pytest.param(make, signal, kind, value, marks=() if value == values[-1] and gate else pytest.mark.slow)
    for gate, make, signal, kind, values in [
        (False, room, "Ti1", "scale", (1.2, 1.05)),
        (True, room, "T", "scale", (1.1, 1.05)),
        (True, room, "T", "offset", (1.0, 0.5)),
        (False, room, "Ti1", "lag", (300.0, 150.0)),
        (True, room, "T", "lag", (300.0, 120.0)),
        (True, room, "Ti1", "delay", (180.0, 90.0)),
        (False, room, "T", "delay", (120.0, 90.0)),
        (True, room, "Ti1", "upper", (8.0, 10.0)),
        (False, room, "T", "lower", (9.0, 8.0)),
        (False, crane, "u", "scale", (1.2, 1.03)),
        (False, crane, "phi", "offset", (0.02, 0.004)),
        (True, crane, "u", "offset", (0.02, 0.004)),
        (False, crane, "u", "lag", (0.2, 0.1)),
        (False, crane, "phi", "delay", (0.2, 0.1)),
        (True, crane, "phi", "drift", (0.05, 0.01)),
        (False, crane, "u", "upper", (0.6, 0.5)),
    ]
    for value in values
]
"""In the gate the last size, the harder one of most, of each kind once, of a room or of a crane."""


def slowly(*row: object) -> Any:
    """A row of a table that the gate leaves out."""
    return pytest.param(*row, marks=pytest.mark.slow)


@pytest.mark.parametrize(("make", "signal", "kind", "value"), NAMED)
def test_what_is_hidden_is_named(
    tmp_path: Path, make: Callable[..., Path], signal: str, kind: str, value: float
) -> None:
    found = discover(make(tmp_path, Hidden({signal: {kind: value}})))
    one = only(found)
    assert (one.effect, one.signal) == (WORDS.get(kind, kind), signal)
    (parameter,) = one.parameters
    length = 249 * 0.05 if make is crane else (400 - 1 / 20) * 60.0
    truth = value / length if kind == "drift" else value
    room_for_chance = 0.5 * parameter.std  # two in a hundred draws lie farther out than the interval and this
    assert parameter.interval[0] - room_for_chance < truth < parameter.interval[1] + room_for_chance
    assert found.gap["validation"].after < 0.5 * found.gap["validation"].before


@pytest.mark.parametrize(
    ("make", "size", "fades"), [slowly(room, 3.0, 1000.0), (room, 1.0, 1000.0), (crane, 0.05, 2.0)]
)
def test_an_initial_transient_is_named(tmp_path: Path, make: Callable[..., Path], size: float, fades: float) -> None:
    signal = "phi" if make is crane else "T"
    one = only(discover(make(tmp_path, Hidden({signal: {"transient": size, "fades": fades}}))))
    assert (one.effect, one.signal) == ("transient", signal)
    for parameter, truth in zip(one.parameters, (size, fades), strict=True):
        assert abs(parameter.value - truth) < 3 * parameter.std


@pytest.mark.parametrize("value", [slowly(22.0), 21.0])
def test_another_start_of_the_model_is_named_as_its_parameter(tmp_path: Path, value: float) -> None:
    one = only(discover(room(tmp_path, Hidden(parameters={"T0": value}))))
    assert (one.effect, one.signal) == ("parameter", "T0")
    (parameter,) = one.parameters
    assert abs(parameter.value - value) < 3 * parameter.std


UNDECIDED = [
    # a constant flow of heat: from either side
    (room, {"Ti1": {"offset": 1.0}}, {}, {"offset Ti1", "offset Ti2"}),
    # slow beside the room, so that it is the same on all sides
    (room, {"T": {"drift": 1.0}}, {}, {"drift T", "drift Ti1", "drift Ti2"}),
    slowly(room, {"Ti1": {"drift": 3.0}}, {}, {"drift T", "drift Ti1", "drift Ti2"}),
    # with both resistances free, only their ratio to the capacity shows
    (room, {"Ti1": {"scale": 1.2}}, {"identify": ("R1", "R2")}, {"scale Ti1", "scale Ti2"}),
    # swings of a small angle: gravity over a length that is identified
    slowly(crane, {"phi": {"scale": 1.03}}, {}, {"scale phi", "parameter g"}),
]


@pytest.mark.parametrize(("make", "on", "more", "wanted"), UNDECIDED)
def test_what_data_do_not_tell_apart_is_told_and_not_named(
    tmp_path: Path, make: Callable[..., Path], on: Mapping[str, Mapping[str, float]], more: Mapping[str, object],
    wanted: set[str],
) -> None:  # fmt: skip
    found = discover(make(tmp_path, Hidden(on), **more))
    assert (found.answer, found.verdict) == ("undecided", "doubtful")
    (one,) = found.findings
    assert (one.effect, one.signal, one.parameters) == ("undecided", "", [])
    assert {f"{rival.effect} {rival.signal}" for rival in one.ambiguous} == wanted
    assert [reason.code for reason in found.reasons] == ["effects-undecided"]
    ((signal, hidden),) = on.items()
    ((kind, value),) = hidden.items()
    true = next(rival for rival in one.ambiguous if (rival.effect, rival.signal) == (kind, signal))
    if kind != "drift":
        assert abs(true.parameters[0].value - value) < 3 * (true.parameters[0].std or 0.0)


LAGS_BESIDE_A_CAPACITY = [
    # truth, and what else the data may be taken for: the room and its sensor exchanged
    slowly(1, 300.0, 0.25), (2, 60.0, 0.25), slowly(1, 120.0, 0.5),
]  # fmt: skip


@pytest.mark.parametrize(("seed", "lag", "beside"), LAGS_BESIDE_A_CAPACITY)
def test_a_sensor_that_may_be_exchanged_with_the_room_is_not_valid(
    tmp_path: Path, seed: int, lag: float, beside: float
) -> None:
    """(1 + a s) (1 + b s) is the same with a and b exchanged: which of them is the lag, the data do not say."""
    data = Hidden({"T": {"lag": lag}}, {"R2": beside})
    found = discover(room(tmp_path, data, seed=seed, identify=("R1", "C")))
    assert (found.answer, found.verdict) == ("named", "doubtful"), found.summary()
    (one,) = found.findings
    assert (one.effect, one.signal) == ("lag", "T")
    (told,) = [reason.text for reason in found.reasons if reason.code == "minima-alike"]
    other = float(told.partition("lag of T = ")[2].split()[0].strip(","))
    own = one.parameters[0].value
    assert min(abs(own / lag - 1), abs(other / lag - 1)) < 0.2 < abs(own / other - 1)


@pytest.mark.slow
def test_a_lag_as_slow_as_the_room_is_no_delay(tmp_path: Path) -> None:
    """There the two are so alike that a covariance knows neither; without a lag the data are not explained."""
    data = Hidden({"T": {"lag": 120.0}}, {"R2": 0.3})
    found = discover(room(tmp_path, data, seed=2, identify=("R1", "C")))
    (one,) = found.findings
    assert (one.effect, one.signal, one.ambiguous) == ("lag", "T", []), found.summary()
    assert found.verdict != "valid"
    (parameter,) = one.parameters
    assert parameter.interval[0] < 120.0 < parameter.interval[1]


BESIDE_A_RESISTANCE = [
    row if row == (1, ("R1", "C"), 0.125, 300.0) else slowly(*row)
    for row in itertools.product((1, 2), (("R1",), ("R1", "C")), (0.125, 0.3, 0.5), (60.0, 300.0))
]


@pytest.mark.parametrize(("seed", "identify", "beside", "lag"), BESIDE_A_RESISTANCE)
def test_a_lag_beside_a_wrong_resistance_is_told_with_what_it_rests_on(
    tmp_path: Path, seed: int, identify: tuple[str, ...], beside: float, lag: float
) -> None:
    data = Hidden({"T": {"lag": lag}}, {"R2": beside})  # the case has 0.25
    found = discover(room(tmp_path, data, seed=seed, identify=identify))
    named = [(one.effect, one.signal) for one in found.findings if not one.ambiguous]
    sets = [{(r.effect, r.signal) for r in one.ambiguous} for one in found.findings if one.ambiguous]
    assert set(named) <= {("lag", "T")}, found.summary()
    assert all(("lag", "T") in found_set or ("parameter", "R2") in found_set for found_set in sets)
    assert named or sets
    if found.verdict == "valid":
        assert any("of R2 (0.25 K/W)" in condition for condition in found.document.conditions)


def test_values_of_what_is_not_decided_are_those_beside_all_that_was_found(tmp_path: Path) -> None:
    data = Hidden({"T": {"lag": 60.0}}, {"R2": 0.125})
    found = discover(room(tmp_path, data, seed=1))
    (several,) = [one for one in found.findings if one.ambiguous]
    values = {r.signal: r.parameters[0] for r in several.ambiguous}
    assert set(values) == {"R2", "C"}
    # half the resistance, or half the capacity with twice as much of R1
    assert abs(values["R2"].value - 0.125) < 3 * (values["R2"].std or 0.0), values["R2"]
    # of C there are two minima, the room and its sensor exchanged: the truth is shown, or named as the other one
    own, std = values["C"].value, values["C"].std or 0.0
    told = [reason.text for reason in found.reasons if reason.code == "minima-alike"]
    others = [float(text.partition(" C = ")[2].split()[0].strip(",")) for text in told]
    assert abs(own - 1000.0) < 3 * std or any(abs(other / 1000.0 - 1) < 0.2 for other in others), (own, others)
    assert found.answer == "undecided"


def test_another_value_of_a_parameter_is_not_taken_for_that_of_a_signal(tmp_path: Path) -> None:
    found = discover(room(tmp_path, Hidden(parameters={"R2": 0.3})))
    assert found.answer == "undecided"
    (one,) = found.findings
    assert {f"{rival.effect} {rival.signal}" for rival in one.ambiguous} == {"parameter R2", "parameter C"}


@pytest.mark.parametrize("seed", [2, *map(slowly, range(3, 7))])
@pytest.mark.parametrize("identify", [("R1",), ("R1", "R2")])
def test_nothing_is_named_in_a_room_that_lacks_nothing(tmp_path: Path, seed: int, identify: tuple[str, ...]) -> None:
    found = discover(room(tmp_path, seed=seed, identify=identify))
    assert (found.answer, found.verdict, found.findings) == ("nothing", "valid", [])


@pytest.mark.parametrize("seed", [2, *map(slowly, (3, 4))])
def test_nothing_is_named_on_a_crane_that_lacks_nothing(tmp_path: Path, seed: int) -> None:
    found = discover(crane(tmp_path, seed=seed))
    assert (found.answer, found.verdict, found.findings) == ("nothing", "valid", [])


@pytest.mark.parametrize("seed", [2, *map(slowly, range(3, 7))])
def test_slow_noise_is_no_name_and_not_called_valid(tmp_path: Path, seed: int) -> None:
    found = discover(room(tmp_path, seed=seed, colour=0.8))
    assert (found.answer, found.verdict, found.findings) == ("unknown", "doubtful", [])
    assert "slow" in found.text
