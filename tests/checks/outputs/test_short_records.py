"""Short records: a smooth residual is doubted, white noise is not, and what nothing can be said of is told."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim import identify
from fmu_didim.case import Case
from fmu_didim.checks.outputs.residuals import OutputResiduals
from fmu_didim.checks.outputs.succession import Succession, few_independent, successions
from fmu_didim.data.signals import Array, trajectory
from fmu_didim.fit.uncertainty import Colour
from tests.case.calibration.models import case_of, steps_of_lag


def driven(time: Array, measured: Array) -> Case:
    """x' = a x + t."""
    return case_of(
        "driven", {"u": trajectory(time, {"u": time}), "log": trajectory(time, {"x": measured})}, inputs={"file": "u"},
        measured="log", identify={"a": {}, "x0": {}},
    )  # fmt: skip


def exact(time: Array) -> Array:
    """x' = t - x, x(0) = 1."""
    return np.asarray(2 * np.exp(-time) + time - 1)


def by_euler(time: Array) -> Array:
    """The same by Euler's method with the input of the end of each step."""
    found = [1.0]
    for k in range(time.size - 1):
        found.append(found[-1] + (time[k + 1] - time[k]) * (time[k + 1] - found[-1]))
    return np.array(found)


@pytest.mark.parametrize("count", [8, 11, 16, 21, 41])
def test_data_of_a_coarse_solver_are_doubted(count: int) -> None:
    """They leave less than 0.5 % of the output, ten standard deviations beside the truth. Which test says so first is a
    matter of rounding: the residual is as slow as the motion, too."""
    time = np.linspace(0, 1, count)
    found = identify(driven(time, by_euler(time)))
    assert abs(found.parameters["a"].value + 1) > 5 * found.parameters["a"].std
    assert found.verdict == "doubtful"
    assert {reason.code for reason in found.reasons} <= {"residual-alike", "residual-follows", "residual-slow"}
    assert all(reason.next_step for reason in found.reasons)


@pytest.mark.parametrize("count", [12, 16, 20, 25, 30, 40])
def test_they_are_beside_noise_of_a_third(count: int) -> None:
    time = np.linspace(0, 1, count)
    made = by_euler(time)
    left = identify(driven(time, made)).estimate.residual
    noise = float(np.sqrt(np.mean(left**2))) / 3
    for seed in range(3):
        noisy = made + noise * np.random.default_rng(seed).normal(size=count)
        assert identify(driven(time, noisy)).verdict == "doubtful", seed


def test_too_few_samples_are_told() -> None:
    time = np.linspace(0, 1, 6)
    found = identify(driven(time, exact(time) + 0.01 * np.random.default_rng(0).normal(size=6)))
    assert [reason.code for reason in found.reasons] == ["outputs-untested"]
    assert found.reasons[0].text.startswith("4 samples")


def stepped(time: Array, rng: np.random.Generator) -> Case:
    """Two outputs of a lag after a step."""
    last = float(time[-1])
    y = steps_of_lag(time, {0.0: 1.0}, constant=last / 5, gain=2.0, start=0.0)
    log = {"y": y + 0.02 * rng.normal(size=time.size), "z": 1.5 * y + 0.05 * rng.normal(size=time.size)}
    return case_of(
        "lag", {"u": trajectory(np.array([0.0, last]), {"u": np.ones(2)}), "log": trajectory(time, log)},
        inputs={"file": "u", "interpolation": "held"}, measured="log", identify={"T": {}, "k": {}, "g": {}},
    )  # fmt: skip


@pytest.mark.gate
@pytest.mark.parametrize(
    ("kind", "count"),
    [
        ("one output", 8),
        ("two outputs", 40),
        *(
            pytest.param(kind, count, marks=pytest.mark.slow)
            for kind, counts in (("one output", (12, 16, 20, 40)), ("two outputs", (8, 12, 16, 20)))
            for count in counts
        ),
    ],
)
def test_right_models_with_white_noise_are_valid(kind: str, count: int) -> None:
    verdicts = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        if kind == "one output":
            time = np.linspace(0, 1, count)
            case = driven(time, exact(time) + 0.01 * rng.normal(size=count))
        else:
            case = stepped(np.linspace(0, 10, count), rng)
        verdicts.append(identify(case).verdict)
    assert verdicts.count("valid") >= 95, verdicts


def residuals_of(tables: list[Array]) -> list[Succession]:
    """Of records of two values each with these residuals, which their fit leaves."""
    runs, signals = {}, {}
    for k, left in enumerate(tables):
        time = np.linspace(0, 1, left.size)
        signals |= {f"u{k}": trajectory(time, {"u": time}), f"log{k}": trajectory(time, {"x": exact(time) + left})}
        runs[f"run{k}"] = {"inputs": {"file": f"u{k}"}, "measured": f"log{k}"}
    case = case_of("driven", signals, experiments=runs, identify={"a": {}, "x0": {}})
    return list(successions(OutputResiduals.of(case.estimator.estimate(case.model))))


@pytest.mark.gate
def test_white_noise_has_each_probability_as_often() -> None:
    """Of records that are judged together, too, across whose ends nothing is compared."""
    found = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        (one,) = residuals_of([0.01 * rng.normal(size=7), 0.01 * rng.normal(size=9)])
        assert one.left == pytest.approx(14)
        found.append(one.p_value)
    ranks = np.sort(found)
    assert np.abs(ranks - (np.arange(60) + 0.5) / 60).max() < 0.21  # Kolmogorov, 1 %


def test_records_that_leave_no_single_sign_together_do_not_hide_what_each_leaves() -> None:
    bend = 0.01 * np.cos(np.linspace(0, 2 * np.pi, 9))
    (one,) = residuals_of([bend, -bend])
    assert one.p_value < 1e-3


def colour(samples: float, *coefficients: float, output: int = 1) -> Colour:
    return Colour(output, 1.0, 1.0, 1.0, np.array(coefficients), 0.9, 1.0, samples)


@pytest.mark.parametrize(
    ("colours", "stated", "told"),
    [
        ([colour(3.0, 0.9)], [False], ["x"]),
        ([colour(3.0, 0.9)], [True], []),
        ([colour(3.0)], [False], []),
        ([colour(8.0, 0.9)], [False], []),
        ([colour(4.0, 0.9), colour(4.0, 0.9)], [False], []),  # two rates
        ([colour(9.0, 0.9), colour(2.0, 0.9, output=2)], [False, False], ["z"]),
    ],
)
def test_a_residual_that_is_worth_few_samples(colours: list[Colour], stated: list[bool], told: list[str]) -> None:
    assert [d.place for d in few_independent(colours, ["x", "z"][: len(stated)], stated)] == told


def test_a_single_sample_is_an_outlier_only_where_the_others_know_their_noise() -> None:
    """Six deviations by the median of eight samples are nothing; thirty of the others are something."""
    told = {}
    for away in (0.0, 0.3):
        wrong = 0
        for seed in range(20):
            time = np.linspace(0, 1, 12)
            log = exact(time) + 0.01 * np.random.default_rng(seed).normal(size=12)
            log[5] += away
            found = identify(driven(time, log))
            wrong += any("outlier" in r.code for r in found.reasons) or "lies up to" in " ".join(found.document.remarks)
        told[away] = wrong
    assert told[0.0] == 0
    assert told[0.3] == 20
