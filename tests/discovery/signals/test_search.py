"""The decisions of the search for what a model alone lacks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from fmu_didim.case import load_case
from fmu_didim.discovery.signals.candidates import Candidate, candidates
from fmu_didim.discovery.signals.kinds import KINDS, PARAMETER, Measures
from fmu_didim.discovery.signals.search import FittedSignal, fitted, preferred, quick_noise, simulated_outputs
from fmu_didim.fit.fit import Fit
from fmu_didim.model.free_parameter import PLANT, FreeParameter
from tests.discovery.signals.hidden import crane, room

NO_FIT = cast(Fit, None)
SIZES = Measures((0.0, 1.0), 1.0, 1.0, 100.0)


def candidate(kind: str, signal: str = "y") -> Candidate:
    """One of an output, or a parameter of the model."""
    if kind == "parameter":
        known = FreeParameter(signal, "1", PLANT, signal, 1.0, 1.0)
        return Candidate(PARAMETER, "parameter", signal, "1", SIZES, ("a",), known)
    return Candidate(next(k for k in KINDS if k.name == kind), "output", signal, "1", SIZES, ("a",))


def gaining(kind: str, gain: float, signal: str = "y") -> FittedSignal:
    """A fitted candidate that gains so much."""
    return FittedSignal(candidate(kind, signal), NO_FIT, gain, 0.5)


@pytest.mark.parametrize(
    ("best", "rivals", "chosen", "left"),
    [
        (("lag", 50), [], "lag of y", []),
        (("lag", 50), [("delay", 45)], "lag of y", ["delay of y"]),
        # what decays from the start is the parameter of the model that does the same with fewer
        (("transient", 50), [("parameter", 48)], "parameter y", []),
        (("parameter", 50), [("transient", 48)], "parameter y", []),
        (("transient", 50), [("parameter", 48), ("lag", 45)], "parameter y", ["lag of y"]),
        (("transient", 50), [("offset", 45)], "transient of y", ["offset of y"]),
        (("parameter", 50), [("scale", 48)], "parameter y", ["scale of y"]),
    ],
)
def test_what_is_added_and_what_it_is_not_told_from(
    best: tuple[str, float], rivals: list[tuple[str, float]], chosen: str, left: list[str]
) -> None:
    found, others = preferred(gaining(*best), [gaining(*rival) for rival in rivals])
    assert (found.candidate.name, [f.candidate.name for f in others]) == (chosen, left)


@dataclass(frozen=True)
class OneBlock:
    """As much of a fit as the noise needs."""

    residual: Any

    @property
    def model(self) -> OneBlock:
        return self

    @property
    def experiments(self) -> OneBlock:
        return self

    def blocks(self, table: Any) -> list[tuple[slice, Any]]:
        return [(slice(0, table.shape[1]), table)]


def test_the_quick_noise_sees_through_what_is_slow_and_never_exceeds_the_residual() -> None:
    rng, time = np.random.default_rng(3), np.linspace(0, 1, 4000)
    noise = rng.normal(0, 0.2, 4000)
    table = np.column_stack([noise + 5 * np.sin(7 * time), 0.1 * (-1.0) ** np.arange(4000)])
    found = quick_noise(cast(Fit, OneBlock(table))).deviation
    assert found[0] == pytest.approx(0.2, rel=0.05)
    assert found[1] == pytest.approx(0.1)


def test_candidates_are_those_of_signals_that_can_have_them(tmp_path: Path) -> None:
    model = load_case(room(tmp_path, count=60)).model
    found = {c.name for c in candidates(model, simulated_outputs(fitted(model, until=np.inf)))}
    kinds = ("scale", "offset", "lag", "delay", "drift", "upper limit", "lower limit")
    assert found == {
        *(f"{kind} of {signal}" for kind in kinds for signal in ("Ti1", "Ti2", "T")), "transient of T",
        "parameter R2", "parameter C", "parameter T0",
    }  # fmt: skip


def test_an_input_that_rests_has_an_offset_and_a_drift_alone(tmp_path: Path) -> None:
    path = room(tmp_path, count=60)
    table = np.loadtxt(tmp_path / "inputs.csv", delimiter=",", skiprows=1)
    table[:, 1] = 5.0
    np.savetxt(tmp_path / "inputs.csv", table, delimiter=",", header="t,Ti1,Ti2", comments="")
    model = load_case(path).model
    found = candidates(model, simulated_outputs(fitted(model, until=np.inf)), forbid=["drift"])
    assert [c.name for c in found if c.signal == "Ti1"] == ["offset of Ti1"]


def test_a_neutral_output_path_changes_nothing_where_steps_are_divided(tmp_path: Path) -> None:
    model = load_case(crane(tmp_path, count=60)).model.with_loop(subdivision=4)
    base = model.outputs(model.start)
    for kind in ("scale", "lag", "delay"):
        one = next(c for c in candidates(model, {"phi": base[:, 0]}) if c.name == f"{kind} of phi")
        larger = model.with_free((*model.free_parameters, *one.free({}, 0)))
        assert larger.outputs(larger.start) == pytest.approx(base, abs=1e-12)
    late = model.with_free((*model.free_parameters, *one.free({"delay": 0.05}, 0)))  # a row
    assert late.outputs(late.start)[1:, 0] == pytest.approx(base[:-1, 0], abs=1e-9)
    assert late.outputs(late.start)[:, 1] == pytest.approx(base[:, 1])
