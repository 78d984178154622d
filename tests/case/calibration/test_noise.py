"""Error models of outputs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import InputError
from fmu_didim.case import Case
from fmu_didim.data.signals import Array, trajectory
from fmu_didim.estimators.clie import Clie
from fmu_didim.fit.estimate import Estimate, Status
from fmu_didim.fit.noise.error_models import Student, student_noise
from fmu_didim.model.signals.error_model import ErrorModel
from tests.case.calibration.models import case_of

TIME = np.linspace(0, 10, 61)
TRUTH = np.array([0.3, 0.2])
X = TRUTH[1] * np.exp(TRUTH[0] * TIME)
KINDS: Mapping[str, Mapping[str, Any]] = {
    "absolute": {},
    "stated": {"std": 0.03},
    "relative": {"relative_std": 0.1},
    "both": {"std": 0.05, "relative_std": 0.1},
    "logarithmic": {"log_normal": True},
    "robust": {"robust": True},
    "robust, stated": {"robust": 3, "std": 0.03},
}


def drawn(kind: str, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=TIME.size)
    if kind.startswith("robust"):
        return X + 0.03 * rng.standard_t(3, size=TIME.size)
    if kind == "logarithmic":
        return X * np.exp(0.1 * normal)
    scale = {"relative": 0.1 * X, "both": np.hypot(0.05, 0.1 * X)}.get(kind, np.full(TIME.size, 0.03))
    return np.asarray(X + scale * normal)


def case_with(noise: Mapping[str, Any], values: Array, **entries: Any) -> Case:
    measured = {"file": "log", "columns": {"X": dict(noise)}}
    return case_of("growth", {"log": trajectory(TIME, {"X": values})}, measured=measured,
                   identify={"mu": {}, "X0": {}}, **entries)  # fmt: skip


def estimated(noise: Mapping[str, Any], values: Array) -> Estimate:
    case = case_with(noise, values)
    return case.estimator.estimate(case.model)


@pytest.mark.parametrize("kind", KINDS)
def test_values_lie_within_their_deviations(kind: str) -> None:
    found = estimated(KINDS[kind], drawn(kind, 3))
    assert found.status is Status.CONVERGED
    assert (np.abs(found.value - TRUTH) < 4 * found.standard_deviation).all()


@pytest.mark.gate
@pytest.mark.parametrize(
    "kind", [k if k == "robust, stated" else pytest.param(k, marks=pytest.mark.slow) for k in KINDS]
)
def test_intervals_hold_as_often_as_they_say(kind: str) -> None:
    draws = 100
    found = [estimated(KINDS[kind], drawn(kind, 1000 + seed)) for seed in range(draws)]
    values, deviation = (np.array([getattr(one, what) for one in found]) for what in ("value", "standard_deviation"))
    hits = [(low < TRUTH) & (high > TRUTH) for low, high in (one.interval().T for one in found)]
    # 95 of 100 +- 2.2; five of these.
    assert (np.mean(hits, axis=0) > 0.84).all()
    ratio = values.std(axis=0) / deviation.mean(axis=0)
    assert ((ratio > 0.7) & (ratio < 1.3)).all()  # known to 7 % from 100 draws
    bias = np.mean((values - TRUTH) / deviation, axis=0)
    assert (np.abs(bias) < 0.4).all()  # +- 0.1


def test_weights_by_what_is_simulated_have_no_bias_that_weights_by_the_samples_have() -> None:
    """Of a constant with noise of a fifth, weights 1 / y^2 give the mean of 1 / y over that of 1 / y^2: 4 % less."""
    rng, time = np.random.default_rng(0), np.linspace(0, 1, 4000)
    values = 1 + 0.2 * rng.normal(size=time.size)
    case = case_of("growth", {"log": trajectory(time, {"X": values})},
                   measured={"file": "log", "columns": {"X": {"relative_std": 0.2}}}, identify={"X0": {"start": 0.8}},
                   )  # fmt: skip
    case = case.with_(model={"parameters": {"mu": 0.0}})
    found = case.estimator.estimate(case.model)
    assert found.value[0] == pytest.approx(1.0, abs=4 * 0.2 / np.sqrt(time.size))
    assert np.sum(1 / values) / np.sum(1 / values**2) < 0.97


def test_logarithms_are_fitted() -> None:
    """Least squares of log X on a straight line is the answer."""
    values = drawn("logarithmic", 5)
    found = estimated({"log_normal": True}, values)
    slope, first = np.polyfit(TIME, np.log(values), 1)
    np.testing.assert_allclose(found.value, [slope, np.exp(first)], atol=0.02 * found.standard_deviation.min())


def test_a_robust_fit_ignores_what_a_plain_one_follows() -> None:
    values = X + 0.01 * np.random.default_rng(2).normal(size=TIME.size)
    values[[10, 30, 50]] += 1.0
    plain, robust = estimated({}, values), estimated({"robust": True}, values)
    assert np.abs((plain.value - TRUTH) / TRUTH).max() > 0.1
    assert (np.abs(robust.value - TRUTH) < 4 * robust.standard_deviation).all()
    assert (robust.standard_deviation < plain.standard_deviation / 5).all()
    told = next(remark for remark in robust.remarks if "Student" in remark)
    for instant in TIME[[10, 30, 50]]:
        assert f"{instant:g} s" in told


def test_robust_noise_without_outliers_changes_nothing() -> None:
    values = X + 0.03 * np.random.default_rng(4).uniform(-1, 1, size=TIME.size)  # tails shorter than normal ones
    plain, robust = estimated({}, values), estimated({"robust": True}, values)
    np.testing.assert_allclose(robust.value, plain.value, atol=0.2 * plain.standard_deviation.min())
    assert any("no more outliers than normal noise" in remark for remark in robust.remarks)


@pytest.mark.parametrize(("stated", "holds"), [(0.1, True), (0.03, False)])
def test_chi_square_says_whether_a_stated_relative_deviation_holds(stated: float, holds: bool) -> None:
    found = estimated({"relative_std": stated}, drawn("relative", 6))
    (colour,) = found.colours
    ratio = colour.residual_variance / stated**2
    assert (0.6 < ratio < 1.5) == holds
    assert found.noise_is_stated
    if not holds:  # the larger deviation counts
        assert (
            found.standard_deviation[0]
            > 2 * estimated({"relative_std": 0.1}, drawn("relative", 6)).standard_deviation[0] / 3
        )


def test_what_is_reported_is_in_the_unit_of_the_output() -> None:
    values = drawn("relative", 7)
    found = estimated({"relative_std": 0.1}, values)
    np.testing.assert_allclose(found.measured[:, 0], values)
    assert np.abs(found.residual[:, 0] / X).std() < 0.1
    assert found.noise[0] == pytest.approx(0.1 * np.sqrt(np.mean(X**2)), rel=0.1)


@pytest.mark.parametrize(
    ("noise", "change", "said"),
    [
        ({"log_normal": True}, {5: -0.1}, r"no logarithms[\s\S]*1 samples, the first one -0\.1 at t ="),
        ({"relative_std": 0.1}, {5: 0.0}, r"comes close to zero[\s\S]*std: \.\.\., relative_std"),
        ({"relative_std": 0.1, "log_normal": True}, {}, "give log_normal or relative_std, not both"),
        ({"robust": 0.5}, {}, "robust"),
    ],
)
def test_noise_that_cannot_be(noise: Mapping[str, Any], change: Mapping[int, float], said: str) -> None:
    values = X.copy()
    values[list(change)] = list(change.values())
    with pytest.raises(InputError, match=said):
        case_with(noise, values)


def test_deviations_of_experiments_are_their_own_and_their_kinds_are_not() -> None:
    rng = np.random.default_rng(8)
    signals = {name: trajectory(TIME, {"X": X + by * rng.normal(size=TIME.size)}) for name, by in
               (("fine", 0.01), ("coarse", 0.2))}  # fmt: skip

    def case(fine: Mapping[str, Any], coarse: Mapping[str, Any]) -> Case:
        runs = {name: {"measured": {"file": name, "columns": {"X": dict(noise)}}} for name, noise in
                (("fine", fine), ("coarse", coarse))}  # fmt: skip
        return case_of("growth", signals, experiments=runs, identify={"mu": {}, "X0": {}})

    both = case({"std": 0.01}, {"std": 0.2})
    found = both.estimator.estimate(both.model)
    alone = estimated({"std": 0.01}, signals["fine"].column("X"))
    # The coarse one adds 1 / 400 of what is known, and equal weights would lose nearly all.
    np.testing.assert_allclose(found.standard_deviation, alone.standard_deviation, rtol=0.01)
    assert len(found.iterations) < 12
    with pytest.raises(InputError, match=r"stated differently[\s\S]*fine: std 0\.01; coarse: log_normal"):
        case({"std": 0.01}, {"log_normal": True})


def test_the_noise_of_student_is_found() -> None:
    draws = np.random.default_rng(0).standard_t(4, size=20_000) * 0.3
    found = student_noise(draws, ErrorModel(is_robust=True))
    assert found.freedom == pytest.approx(4, rel=0.15)
    assert found.scale == pytest.approx(0.3, rel=0.02)
    stated = student_noise(draws, ErrorModel(0.3, is_robust=True, freedom=4.0))
    assert stated == Student(0.3, 4.0)
    # Fisher's information of a location, by the variance of the modified residuals.
    assert np.var(stated.modified(draws)) == pytest.approx(0.3**2 / stated.information, rel=0.03)


def test_weights_that_do_not_settle_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fmu_didim.estimators.reweighted.ROUNDS", 1)
    case = case_with({"robust": 1}, drawn("robust", 3))
    found = Clie().estimate(case.model)
    assert found.status is Status.MAXIMUM_ITERATIONS
    assert "weights of the error models had not settled" in found.advice
