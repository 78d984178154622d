"""Which single error of a case, or effect that the model lacks, is suspected first where a fit does not explain its
data."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from fmu_didim.base.diagnostics import DOUBT, REMARK, Code, Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.data.checks import data_diagnostics
from fmu_didim.checks.identification import checked
from fmu_didim.checks.motion.suspects import ByValues, Suspect, Tried, chosen, said
from fmu_didim.checks.validation import validate_on
from fmu_didim.estimators import Didim
from fmu_didim.fit.fit import Fit
from tests.tools.verdict.catalogue import CATALOGUE

NOTHING = np.zeros((0, 1))


def suspect(name: str, *, of_case: bool = True) -> Suspect:
    code = Code(name, DOUBT, rank=21, meaning="", next_step="")
    told = (lambda a, s: Diagnostic(code, f"It is {name}.")) if of_case else (lambda a, s: None)
    return Suspect(name, lambda values, a: NOTHING, told, 1.0)


def tried(name: str, explained: float, *, sigmas: float = 10.0, of_case: bool = True) -> Tried:
    return Tried(suspect(name, of_case=of_case), sigmas, 1.0, NOTHING, NOTHING, explained)


@pytest.mark.parametrize(
    ("found", "follows", "names"),
    [
        ([tried("clock", 50), tried("scale", 100)], 0.0, ["scale"]),
        ([tried("clock", 91), tried("scale", 100)], 0.0, ["scale", "clock"]),  # as well
        ([tried("clock", 89), tried("scale", 100)], 0.0, ["scale"]),
        ([tried("clock", 50), tried("scale", 100)], 66.0, ["scale"]),  # most of 166
        ([tried("clock", 50), tried("scale", 100)], 67.0, []),  # what it leaves follows the motion
        ([tried("clock", 50), tried("scale", 100, sigmas=4.1)], 0.0, ["scale"]),
        ([tried("clock", 50), tried("scale", 100, sigmas=3.9)], 0.0, ["clock"]),  # it may be none at all
        ([tried("clock", 50), tried("scale", 100, sigmas=-9)], 0.0, ["scale"]),
        ([tried("clock", -1)], 0.0, []),
        ([], 0.0, []),
    ],
)
def test_which_are_likely(found: list[Tried], follows: float, names: list[str]) -> None:
    assert [one.suspect.name for one in chosen(found, lambda one: follows)] == names


def test_what_is_said_names_those_that_explain_it_as_well() -> None:
    told = said([tried("scale", 75), tried("clock", 70), tried("a spring", 69, of_case=False)], 100.0)
    assert [d.code.name for d in told] == ["scale", "clock"]
    assert told[0].text == (
        "It is scale. With that in the loop, the residual falls to 50 % of its size; clock and a spring would explain "
        "it as well."
    )
    assert told[0].weight > told[1].weight
    alone = said([tried("scale", 36)], 100.0)
    assert alone[0].text.endswith("falls to 80 % of its size.")


def test_where_an_effect_explains_most_no_error_of_the_case_is_named() -> None:
    assert said([tried("a spring", 75, of_case=False), tried("clock", 70)], 100.0) == []


def test_no_more_than_three_are_named() -> None:
    assert len(said([tried(name, 100 - k) for k, name in enumerate("abcde")], 200.0)) == 3


@cache
def reasons(name: str, robot: str, seed: int) -> list[Diagnostic]:
    """What is doubted of an entry of the catalogue."""
    (wrong,) = (one for one in CATALOGUE if one.name == name)
    model = wrong.make(robot, seed)
    before, estimate = data_diagnostics(model), Didim(start="torque").estimate(model)
    validations = [validate_on(estimate.model, estimate.value, label) for label in estimate.model.experiments]
    found = checked(estimate, validations, before=before).judgement
    assert found.verdict == "doubtful"
    assert all(d.code.severity is not REMARK for d in found.reasons)
    return list(found.reasons)


def test_a_scale_of_all_torques_is_told_with_its_size() -> None:
    """Nothing along one motion shows it: clocks and averages were suspected."""
    first, *others = reasons("scale: torque x 1.2", "scara", 71)
    assert first.code.name == "torque-scale"
    assert first.value == pytest.approx(1.2, abs=0.05)
    assert "the gains of the controller" in first.text
    assert {d.code.name for d in others} == {"residual-depends-on-motion"}


@pytest.mark.gate
@pytest.mark.parametrize("seed", [71, 72])
@pytest.mark.parametrize(
    ("name", "robot", "codes", "value"),
    [
        ("scale: torque x 1.2", "arm", {"torque-scale"}, 1.2),
        ("scale: torque / 1.2", "arm", {"torque-scale"}, 1 / 1.2),
        ("scale: torque / 1.2", "scara", {"torque-scale"}, 1 / 1.2),
        ("scale: joint 1 x 2", "scara", {"torque-scale"}, 2.0),
        ("scale: joint 2 x 0.5", "arm", {"torque-scale"}, 0.5),
        ("controller: gains +20 %", "arm", {"torque-scale"}, 1.2),
        ("timing: half a sample of delay", "scara", {"command-delay", "clock-early"}, 0.5),
        ("timing: half a sample of delay", "arm", {"command-delay", "clock-early"}, 0.5),
        ("timing: clock 8 ms late", "arm", {"clock-late", "sampling-kind"}, None),
        ("timing: clock 12 ms early", "scara", {"clock-early"}, -12.0),
        ("model: gravity 30 % too small", "arm", {"gravity", "link-length"}, None),
        ("model: link 20 % too long", "arm", {"gravity", "link-length"}, None),
    ],
)
def test_the_right_suspect_is_named_first(
    name: str, robot: str, codes: set[str], value: float | None, seed: int
) -> None:
    first, *_ = found = reasons(name, robot, seed)
    of_case = {d.code.name for d in found if d.weight}
    assert first.code.name in codes
    assert of_case <= codes
    if value is not None:
        assert first.value == pytest.approx(value, rel=0.1)


@pytest.mark.gate
@pytest.mark.parametrize(
    ("name", "robot", "words"),
    [
        ("machine: spring on joint 1 of arm", "arm", "a spring (joint 1) explains it best"),
        ("machine: torque_offset on joint 2 of arm", "arm", "an offset of the torque (joint 2) explains it best"),
        ("machine: stribeck on joint 1 of scara", "scara", "Stribeck friction (joint 1) explains it best"),
    ],
)
def test_an_effect_is_named_where_it_explains_most(name: str, robot: str, words: str) -> None:
    """And no scale or clock that follows from it."""
    first, *_ = found = reasons(name, robot, 71)
    assert first.code.name == "residual-depends-on-motion"
    assert words in first.text
    assert not [d for d in found if d.weight]


def suspect_of(slope: np.ndarray | None, residual: np.ndarray) -> Suspect:
    """One that changes a residual (N, n) along a slope, or gives it as it is."""
    if slope is None:
        return Suspect("way", lambda values, amount: residual, lambda amount, deviation: None, None)
    return Suspect("slope", lambda values, amount: residual - amount * slope, lambda amount, deviation: None, 0.5)


@pytest.mark.parametrize("kind", ["of its own", "made by the values", "nothing", "a way"])
def test_what_a_suspect_would_leave_is_that_of_least_squares(kind: str) -> None:
    rng = np.random.default_rng(3)
    jacobian, residual = rng.normal(size=(40, 2, 5)), rng.normal(size=(40, 2))
    jacobian[:, :, 4] = jacobian[:, :, 0] - 2 * jacobian[:, :, 1]
    deviation = np.array([1.0, 0.05])
    slope = {
        "of its own": rng.normal(size=(40, 2)), "made by the values": jacobian @ np.arange(5.0),
        "nothing": np.zeros((40, 2)), "a way": None,
    }[kind]  # fmt: skip
    fit = SimpleNamespace(jacobian=jacobian, residual=residual, deviation=deviation, values=np.zeros(5))
    columns = jacobian if slope is None else np.concatenate([jacobian, slope[:, :, None]], axis=2)
    table = (columns / deviation[None, :, None]).reshape(80, -1)
    target = (residual / deviation).reshape(-1)
    rest = target - table @ np.linalg.lstsq(table, target, rcond=1e-9)[0]
    assert ByValues(cast(Fit, fit)).left_with(suspect_of(slope, residual)) == pytest.approx(rest @ rest, rel=1e-9)


def test_what_cannot_be_simulated_promises_nothing() -> None:
    def fails(values: np.ndarray, amount: float) -> np.ndarray:
        raise SimulationError("The loop diverged.", next_step="Lower the gains.")

    fit = SimpleNamespace(
        jacobian=np.ones((4, 1, 1)), residual=np.ones((4, 1)), deviation=np.ones(1), values=np.ones(1)
    )
    one = Suspect("one", fails, lambda amount, deviation: None, 1.0)
    assert ByValues(cast(Fit, fit)).left_with(one) == np.inf
