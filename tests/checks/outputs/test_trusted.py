"""What is taken on trust of a model: which errors would not show, how far they move values, what the verdict says."""

from __future__ import annotations

import re

import numpy as np
import pytest

from fmu_didim import identify
from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.checks.judgement import CONDITIONAL, judgement
from fmu_didim.checks.outputs.residuals import OutputResiduals
from fmu_didim.checks.outputs.trusted import (
    MOVES,
    RESTED_ON,
    TENTH,
    TOLD,
    UNSEEN,
    Trusted,
    moved,
    said,
    size_of_error,
    trusted_diagnostics,
)
from fmu_didim.checks.power.statement import MovedResult
from fmu_didim.data.signals import Array, trajectory
from fmu_didim.workflow.output.result import Result
from tests.case.calibration.models import case_of

TIME = np.linspace(0, 20, 201)
TRUTH = {"J1": 1.0, "J2": 2.0, "load": 0.0, "d": 0.1}


def torque(time: Array) -> Array:
    return np.asarray(1.0 + np.sign(np.sin(2 * np.pi * time / 9)) + 0.5 * (time > 13))


def speed(**truth: float) -> Array:
    """(N,) of the shaft, whose torque is held from row to row."""
    known = TRUTH | truth
    decay = np.exp(-known["d"] * (TIME[1] - TIME[0]) / (known["J1"] + known["J2"]))
    found = [0.0]
    for u in torque(TIME)[:-1]:
        found.append(decay * found[-1] + (1 - decay) * (u - known["load"]) / known["d"])
    return np.array(found)


def fitted(*, noise: float = 0.02, seed: int = 0, parameters: tuple[str, ...] = ("J1", "d"), **truth: float) -> Result:
    """The fit of some parameters to the speed of a shaft."""
    measured = speed(**truth) + noise * np.random.default_rng(seed).normal(size=TIME.size)
    signals = {"u": trajectory(TIME, {"u": torque(TIME)}), "log": trajectory(TIME, {"w": measured})}
    return identify(
        case_of(
            "shaft", signals, inputs={"file": "u", "interpolation": "held"}, measured="log",
            identify={name: {} for name in parameters},
        )
    )  # fmt: skip


def trusted(name: str, deviations: float, error: str = "10 %") -> Trusted:
    by = (MovedResult(size=1.0, parameter="R1", deviations=deviations, percent=-2.0),) if deviations else ()
    return Trusted(name, "2 kg", error, by)


def conditions(found: list[Diagnostic]) -> list[str]:
    return judgement(found).conditions


@pytest.mark.parametrize(
    ("value", "share", "shows", "size"),
    [
        (2.0, 0.5, 0.0, 2.0 * TENTH),  # nothing of it shows at any size
        (-2.0, 0.5, 1.0, 2.0 * TENTH),
        (2.0, 0.5, 100.0, UNSEEN / 100.0),  # a tenth would show
        (0.0, 0.5, 0.0, TENTH / 0.5),
        (0.0, 0.5, 1.0, TENTH / 0.5),
        (0.0, 0.5, 1000.0, UNSEEN / 1000.0),
    ],
)
def test_the_error_that_is_asked_about(value: float, share: float, shows: float, size: float) -> None:
    assert size_of_error(value, share, shows) == pytest.approx(size)


def test_values_that_are_moved_noticeably_come_in_order() -> None:
    moves = np.array([0.9 * MOVES, -2 * MOVES, 5 * MOVES])
    found = moved(["a", "b", "c"], np.array([1.0, 4.0, 0.0]), moves, np.ones(3), 0.1)
    assert [(m.parameter, m.deviations, m.percent) for m in found] == [("c", 5.0, None), ("b", -2.0, -50.0)]


@pytest.mark.parametrize(
    ("found", "condition"),
    [
        ([], []),
        ([trusted("C", 0.0)], []),
        ([trusted("C", 0.9 * CONDITIONAL)], []),
        ([trusted("C", -12.3)], ["the data do not hide an error of 10 % of C (2 kg), which would move R1 by 12 sigma "
                                 "(-2 %)"]),
        ([trusted("C", 5.0), trusted("D", 7.0, "0.3 K"), trusted("E", 2.0)],
         ["the data do not hide an error of 0.3 K of D (2 kg), which would move R1 by 7.0 sigma (-2 %), nor one of 10 "
          "% of C (2 kg), which would move R1 by 5.0 sigma (-2 %)"]),
    ],
)  # fmt: skip
def test_a_valid_verdict_rests_on_the_worst(found: list[Trusted], condition: list[str]) -> None:
    assert conditions(said(found)) == condition


def test_the_worst_few_are_named_and_the_rest_is_counted() -> None:
    found = said([trusted(f"p{k}", 5.0 + k) for k in range(TOLD + 2)], untried=7)
    assert [d.place for d in found[:TOLD]] == [f"p{k}" for k in range(TOLD + 1, 1, -1)]
    assert found[TOLD - 1].text.endswith("So would errors of 2 more: p1, p0.")
    assert found[TOLD].text == "7 further parameters are taken on trust and were not tried."
    (condition,) = conditions(found)
    assert condition.count("which would move") == RESTED_ON
    assert condition.endswith(f", nor one of {TOLD + 2 - RESTED_ON} more")


@pytest.mark.parametrize("inertia", [1.6, 2.0, 2.5])
def test_a_constant_that_the_data_cannot_show_is_said_below_the_verdict(inertia: float) -> None:
    """J1 + J2 alone acts: right or wrong, the answer looks the same. Wrong by a fifth it is dozens of sigma off."""
    found = fitted(J2=inertia)
    off = (found.parameters["J1"].value - TRUTH["J1"]) / found.parameters["J1"].std
    assert off == pytest.approx((inertia - 2.0) / found.parameters["J1"].std, abs=4)
    assert found.verdict == "valid", found.reasons
    (condition,) = found.document.conditions
    by = re.match(r"the data do not hide an error of 10 % of J2 \(2\), which would move J1 by (\d+) sigma", condition)
    assert by is not None, condition
    assert float(by[1]) == pytest.approx(0.2 / found.parameters["J1"].std, rel=0.02)


def test_it_is_found_beside_data_that_tell_the_sum_to_a_hundred_thousandth() -> None:
    """The error of a tenth moves J1 by thousands of sigma: what is curved in it would show, were it there."""
    found = fitted(noise=1e-5)
    assert re.search(r"10 % of J2 \(2\), which would move J1 by \d{4,} sigma", found.document.conditions[0])


def test_a_constant_that_is_zero_is_asked_about_by_what_it_moves() -> None:
    """A load is taken for a smaller torque: it is seen as far as the torque is no constant."""
    found = fitted(parameters=("J1", "d"))
    (told,) = [r for r in found.document.remarks if r.startswith("load: 0 is taken on trust: an error of ")]
    size = float(told.split(" an error of ")[1].split()[0])
    moves = re.search(r"d by ([\d.]+) sigma", told)
    assert moves is not None
    biased = fitted(parameters=("J1", "d"), load=size, seed=0)
    right = found.parameters["d"]
    assert abs(biased.parameters["d"].value - right.value) / right.std == pytest.approx(float(moves[1]), rel=0.2)


def test_constants_that_do_nothing_are_not_named() -> None:
    """No output shows phi0; b enters by its cube, so that the first step hardly shows."""
    told = " ".join(fitted().document.remarks)
    assert "phi0" not in told
    assert re.search(r"\bb: 0 is taken on trust: an error of 0\.\d+ would", told)


def test_a_library_model_has_more_parameters_than_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    found = fitted().estimate
    monkeypatch.setattr("fmu_didim.checks.outputs.trusted.TRIED", 2)
    told = trusted_diagnostics(OutputResiduals.of(found), found.standard_deviation)
    assert told[-1].text == "3 further parameters are taken on trust and were not tried."
