"""The judgement: its verdict by what was found, and held-out data that are predicted worse."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.base.diagnostics import DOUBT, PROBLEM, REMARK, Catalogue, Diagnostic
from fmu_didim.checks.held_out import Residual, held_out_diagnostics, worse_than_fitted
from fmu_didim.checks.judgement import diagnostic_result, judgement
from fmu_didim.workflow.output.exit_codes import EXIT_CODES
from fmu_didim.workflow.reference.codes import all_codes

CODES = Catalogue()
STOP = CODES("stop", PROBLEM, rank=1, meaning="m", next_step="mend CASE.yaml")
CAUSE = CODES("cause", DOUBT, rank=10, meaning="m", next_step="fmu-didim discover CASE.yaml")
EFFECT = CODES("effect", DOUBT, rank=60, meaning="m", next_step="look")
NOTE = CODES("note", REMARK, rank=1, meaning="m", next_step="")


@pytest.mark.parametrize(
    ("codes", "settled", "verdict", "reasons", "remarks", "code"),
    [
        ([], True, "valid", [], [], 0),
        ([NOTE], True, "valid", [], ["note"], 0),
        ([NOTE, EFFECT, CAUSE], True, "doubtful", ["cause", "effect"], ["note"], 4),
        ([], False, "not_settled", [], [], 3),
        ([CAUSE], False, "not_settled", ["cause"], [], 3),
        ([CAUSE, STOP], False, "refused", ["stop", "cause"], [], 1),
    ],
)
def test_verdict(codes, settled, verdict, reasons, remarks, code):
    found = judgement([Diagnostic(c, "text") for c in codes], settled=settled)
    assert found.verdict == verdict
    assert [d.code.name for d in found.reasons] == reasons
    assert [d.code.name for d in found.remarks] == remarks
    assert EXIT_CODES[found.verdict] == code


@pytest.mark.parametrize(
    ("codes", "settled", "conditions"),
    [([], True, []), ([NOTE, NOTE], True, ["a", "b"]), ([NOTE, CAUSE], True, []), ([NOTE], False, [])],
)
def test_a_valid_verdict_alone_says_what_it_rests_on(codes, settled, conditions):
    found = [Diagnostic(c, "text", condition="ab"[k]) for k, c in enumerate(codes)]
    assert judgement([*found, Diagnostic(NOTE, "no condition")], settled=settled).conditions == conditions


def test_commands_name_the_case():
    found = diagnostic_result(Diagnostic(CAUSE, "text", "joint 1", 2.0, 1.0, "1"), "drive.yaml")
    assert found.next_step == "fmu-didim discover drive.yaml"
    assert (found.code, found.place, found.value, found.bound) == ("cause", "joint 1", 2.0, 1.0)
    assert diagnostic_result(Diagnostic(CAUSE, "text")).next_step == "fmu-didim discover CASE.yaml"


def at(residual, torque=10.0):
    return Residual(residual, np.full(2, torque))


def coloured(rng, count, rho, sigma=1.0):
    """A first-order autoregression with this standard deviation."""
    from scipy.signal import lfilter

    return sigma * np.sqrt(1 - rho**2) * lfilter([1], [1, -rho], rng.normal(size=count + 500))[500:]


@pytest.mark.gate
@pytest.mark.parametrize("rho", [0.0, 0.9])
@pytest.mark.parametrize(("fitted", "held"), [(2000, 2000), (100, 100), (2000, 60)])
def test_noise_alone_is_not_worse(rho, fitted, held):
    rng = np.random.default_rng(5)
    found = 0
    for _ in range(300):
        first, second = (np.column_stack([coloured(rng, n, rho) for _ in range(2)]) for n in (fitted, held))
        found += worse_than_fitted(at(first), at(second), count=8).size
    assert found <= 3  # 0.1 % of 300 are 0.3


@pytest.mark.parametrize(("ratio", "joints"), [(1.0, []), (1.15, []), (1.5, [1]), (3.0, [1])])
def test_a_larger_residual_of_one_joint_is_found(ratio, joints):
    rng = np.random.default_rng(1)
    first, second = rng.normal(size=(500, 2)), rng.normal(size=(500, 2)) * (1.0, ratio)
    assert list(worse_than_fitted(at(first), at(second), count=8)) == joints


@pytest.mark.parametrize(("torque", "joints"), [(10.0, [0, 1]), (5.0, [0, 1]), (30.0, [])])
def test_an_error_that_grows_with_the_torque_is_no_worse(torque, joints):
    rng = np.random.default_rng(1)
    first, second = rng.normal(size=(500, 2)), 2.5 * rng.normal(size=(500, 2))
    assert list(worse_than_fitted(at(first), at(second, torque), count=8)) == joints


def test_uncertainty_of_the_values_counts():
    rng = np.random.default_rng(1)
    first, second = rng.normal(size=(500, 2)), 2 * rng.normal(size=(500, 2))
    assert list(worse_than_fitted(at(first), at(second), count=8)) == [0, 1]
    assert list(worse_than_fitted(at(first), at(second), count=8, extra=np.array([3.0, 0.0]))) == [1]


def test_no_held_out_data_are_a_remark_and_a_failure_a_doubt():
    nothing = at(np.zeros((1, 2)))
    found = held_out_diagnostics(None, np.eye(2), nothing, {}, {})  # type: ignore[arg-type]
    assert [d.code.name for d in found] == ["no-held-out"]
    found = held_out_diagnostics(None, np.eye(2), nothing, {}, {"check": "diverged"})  # type: ignore[arg-type]
    assert [(d.code.name, d.place) for d in found] == [("held-out-not-simulated", "check")]


def test_what_one_look_settles_is_one_reason():
    at_once = next(code for code in all_codes() if code.at_once and code.severity is DOUBT)
    other = next(code for code in all_codes() if not code.at_once and code.severity is DOUBT)
    places = ["a.csv", "a.csv", "b.csv", "b.csv", "c.csv"]
    found = [Diagnostic(at_once, f"Column {k}.", place) for k, place in enumerate(places)]
    reasons = judgement([*found, Diagnostic(other, "x", "joint 1"), Diagnostic(other, "x", "joint 2")]).reasons
    assert sorted(d.code.name for d in reasons) == sorted([at_once.name, other.name, other.name])
    (one,) = [d for d in reasons if d.code is at_once]
    assert one.text == "Column 0. Column 1. b.csv: Column 2. And 2 more: b.csv, c.csv."
    assert one.place == "a.csv"
    assert judgement(found).acknowledging({at_once.name: "Checked."}).verdict == "valid"
    assert {code.name for code in all_codes() if code.at_once} == {
        "torque-unit", "unit-contradicts-file", "unit-unknown", "watch-log-not-sure", "watch-motion",
    }  # fmt: skip
