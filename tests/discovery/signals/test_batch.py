"""Models without inputs, outputs with instants of their own, and a search that runs out of time."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim import discover
from fmu_didim.case import Case
from fmu_didim.data.signals import Array, trajectory
from tests.case.calibration.models import case_of, noisy, steps_of_lag

pytestmark = pytest.mark.gate

TIME = np.linspace(0, 10, 101)
GROWN = 0.1 * np.exp(0.3 * TIME)


def growing(measured: Array, seed: int, *names: str) -> Case:
    """A batch that grows from X0 = 0.1, of which these are identified."""
    log = noisy(TIME, {"X": measured}, 0.01, seed)
    return case_of("growth", {"log": log}, measured="log", identify={name: {} for name in names})


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("size", [0.2, 0.06])
def test_an_offset_of_a_batch_is_named(seed: int, size: float) -> None:
    found = discover(growing(GROWN + size, seed, "mu", "X0"))
    assert (found.answer, found.verdict) == ("named", "valid")
    (one,) = found.findings
    assert (one.effect, one.side, one.signal) == ("offset", "output", "X")
    assert abs(one.parameters[0].value - size) < 3 * (one.parameters[0].std or 0.0)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("limit", [1.2, 1.5])
def test_a_limit_of_a_batch_is_named_and_is_no_clock_that_is_early(seed: int, limit: float) -> None:
    found = discover(growing(np.minimum(GROWN, limit), seed, "mu", "X0"))
    assert (found.answer, found.verdict) == ("named", "valid")
    (one,) = found.findings
    assert (one.effect, one.signal) == ("upper limit", "X")
    assert abs(one.parameters[0].value - limit) < 3 * (one.parameters[0].std or 0.0)


@pytest.mark.parametrize("seed", range(3))
def test_the_scale_of_the_only_output_and_the_start_that_scales_it_are_not_told_apart(seed: int) -> None:
    found = discover(growing(1.2 * GROWN, seed, "mu"))
    assert (found.answer, found.verdict) == ("undecided", "doubtful")
    (one,) = found.findings
    told = {f"{rival.effect} {rival.signal}": rival.parameters[0].value for rival in one.ambiguous}
    assert {"scale X", "parameter X0"} <= set(told) <= {"scale X", "parameter X0", "delay X"}
    assert told["scale X"] == pytest.approx(1.2, rel=0.02)
    assert told["parameter X0"] == pytest.approx(0.12, rel=0.02)
    table = found.to_frame().set_index("parameter")
    assert "parameter X0" in table.loc["scale of X", "ambiguous"]
    assert repr(found) == "Discovered('growth', undecided: undecided)"
    (axes, *_) = found.plot().axes
    assert "X" in axes.get_ylabel()


@pytest.mark.parametrize("seed", range(5))
def test_nothing_is_named_where_a_batch_lacks_nothing_and_what_cannot_show_is_told(seed: int) -> None:
    found = discover(growing(GROWN, seed, "mu", "X0"))
    assert (found.answer, found.verdict) == ("nothing", "valid")
    (note,) = [note for note in found.notes if note.startswith("Not looked for")]
    assert "Scale of the output X" in note


def two_outputs(offset: float) -> Case:
    """A lag whose outputs are measured at instants of their own, the second one with an offset."""
    first, second = np.linspace(0, 20, 81), np.linspace(0.1, 19.9, 57)
    y, z = (
        steps_of_lag(time, {0.0: 1.0, 6.0: -1.0, 13.0: 0.5}, constant=1.5, gain=2.0, start=0.0)
        for time in (first, second)
    )
    driven = trajectory(np.array([0.0, 6.0, 13.0, 20.0]), {"u": np.array([1.0, -1.0, 0.5, 0.5])})
    signals = {
        "u": driven, "y": noisy(first, {"y": y}, 0.02, 1), "z": noisy(second, {"z": z + offset}, 0.02, 2)
    }  # fmt: skip
    return case_of(
        "lag", signals, inputs={"file": "u", "interpolation": "held"}, measured=[{"file": "y"}, {"file": "z"}],
        identify={"T": {"start": 1.0}, "k": {}},
    )  # fmt: skip


def test_an_offset_is_named_on_the_output_that_has_it() -> None:
    found = discover(two_outputs(0.1))
    assert (found.answer, found.verdict) == ("named", "valid")
    (one,) = found.findings
    assert (one.effect, one.signal) == ("offset", "z")
    low, high = one.parameters[0].interval
    assert low is not None
    assert high is not None
    assert low < 0.1 < high
    gap = found.document.channels["z"].gap["estimation"]
    assert gap.before is not None
    assert gap.before > 4
    assert gap.after == pytest.approx(0.0, abs=0.1)
    assert "gap of y on estimation data stays" in found.summary().replace("\n  ", " ")


def test_a_search_out_of_time_is_not_settled() -> None:
    found = discover(two_outputs(0.1), time_limit=0.05)
    assert (found.answer, found.verdict, found.exit_code) == ("unfinished", "not_settled", 3)
    assert "were not tried" in found.summary().replace("\n  ", " ")
