"""What the data cannot tell apart, and whether experiments agree, by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import signal, stats

from fmu_didim.base.errors import IdentificationError
from fmu_didim.checks.agreement import AgreementResult, _judged, agreement
from fmu_didim.data.signals import Array
from fmu_didim.fit.confounding import confounded, refuse_confounded
from fmu_didim.model.experiments import Experiments


def pair(angle: float, *further: Any) -> Array:
    """Two columns of length one at a small angle, and others."""
    columns = [[np.cos(angle / 2), np.sin(angle / 2), 0, 0], [np.cos(angle / 2), -np.sin(angle / 2), 0, 0], *further]
    return np.array(columns, dtype=float).T


THIRD = [0, 0, 1, 0]
HUGE = 1e9
"""A torque beside which no parameter is unknown."""


@pytest.mark.parametrize(("factor", "found"), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize("further", [0, 1])
def test_columns_closer_than_derivatives_are_exact(factor: float, found: bool, further: int) -> None:
    """The small singular value of two columns at an angle is sqrt(2) sin(angle / 2)."""
    count = 2 + further
    angle = 2 * np.arcsin(factor * 1e-6 * np.sqrt(count) / np.sqrt(2))
    columns = pair(angle, *[THIRD][:further])
    names = ("a", "b", "c")[:count]
    assert confounded(columns, np.full(count, HUGE), names, torque=HUGE) == (("a", "b") if found else ())


@pytest.mark.parametrize(
    ("inflation", "values", "torque", "found"),
    [
        # Noise moves both by the inflation, in units of what each alone is known to.
        (20.0, (1.0, 1.0), 300.0, True),
        (20.0, (1.0, 1.0), 401.0, False),  # a twentieth of the torque is 20
        (20.0, (1.0, 1.0), 399.0, True),
        (20.0, (19.9, 19.9), 1.0, True),
        (20.0, (20.1, 20.1), 1.0, False),  # not more than its own size
        (20.0, (-20.1, 20.1), 1.0, False),
        (20.0, (20.1, 1.0), 1.0, False),  # one alone is confounded with nothing
        (10.1, (0.1, 0.1), 1.0, True),
        (9.9, (0.1, 0.1), 1.0, False),
    ],
)
def test_what_noise_moves_together(inflation: float, values: tuple[float], torque: float, found: bool) -> None:
    # |v| / s of each is (1 / sqrt 2) / (sqrt 2 sin(angle / 2)).
    columns = pair(2 * np.arcsin(1 / (2 * inflation)))
    assert confounded(columns, np.array(values), ("a", "b"), torque=torque) == (("a", "b") if found else ())


def test_values_count_by_the_length_of_their_columns() -> None:
    columns = pair(2 * np.arcsin(1 / 40)) * np.array([1.0, 100.0])
    assert confounded(columns, np.array([19.9, 0.199]), ("a", "b"), torque=1.0) == ("a", "b")
    assert confounded(columns, np.array([19.9, 0.201]), ("a", "b"), torque=1.0) == ()


@pytest.mark.parametrize(("part", "named"), [(0.11, True), (0.09, False)])
def test_who_takes_part_in_a_direction(part: float, named: bool) -> None:
    """Three columns that depend on each other as a - b + part c = 0."""
    a, c = np.array([1.0, 0, 0, 0]), np.array([0, 1.0, 0, 0])
    b = a + part * c
    scale = np.linalg.norm(b)
    columns = np.column_stack([a, b / scale, c])
    found = confounded(columns, np.full(3, HUGE), ("a", "b", "c"), torque=HUGE)
    assert found == (("a", "b", "c") if named else ("a", "b"))


def test_parameters_that_do_nothing_are_named_alone() -> None:
    columns = np.column_stack([pair(0.0), np.zeros(4)])
    assert confounded(columns, np.ones(3), ("a", "b", "c"), torque=1.0) == ("c",)


def test_independent_parameters_are_told_apart_however_unknown() -> None:
    assert confounded(np.eye(3), np.zeros(3), ("a", "b", "c"), torque=0.0) == ()


def test_a_refusal_names_them() -> None:
    with pytest.raises(IdentificationError, match="got:   a, b"):
        refuse_confounded(pair(0.0), np.ones(2), ("a", "b"), torque=1.0)
    refuse_confounded(np.eye(2), np.ones(2), ("a", "b"), torque=1.0)


# ---- experiments that were fitted together


AGREES = AgreementResult(p_value=1.0, agrees=True, differs_most="", change_in_std=0.0)


@pytest.mark.parametrize(
    ("p", "count", "agrees"), [(0.00051, 2, True), (0.00049, 2, False), (0.00026, 4, True), (0.00024, 4, False)]
)
def test_the_level_is_that_of_all_experiments(p: float, count: int, agrees: bool) -> None:
    chi_square = stats.chi2.isf(p, 1)
    slope = np.array([[4.0]])
    found = _judged(("a",), np.array([np.sqrt(chi_square * 4.0)]), slope, slope, 4.0, count)
    assert found.p_value == pytest.approx(p)
    assert found.agrees is agrees
    assert (found.differs_most, found.change_in_std) == ("a", pytest.approx(np.sqrt(chi_square)))


def test_the_parameter_that_would_change_most() -> None:
    found = _judged(("a", "b"), np.array([2.0, -9.0]), np.diag([1.0, 9.0]), np.diag([1.0, 9.0]), 9.0, 2)
    assert (found.differs_most, found.change_in_std) == ("b", pytest.approx(3.0))
    assert found.p_value == pytest.approx(stats.chi2.sf(4 + 9, 2))
    # Noise of b that moves its score four times as far: a, two standard deviations, then differs most.
    found = _judged(("a", "b"), np.array([2.0, -9.0]), np.diag([1.0, 9.0]), np.diag([1.0, 9.0 * 16]), 9.0, 2)
    assert (found.differs_most, found.change_in_std) == ("a", pytest.approx(2.0))
    assert found.p_value == pytest.approx(stats.chi2.sf(4 + 9 / 16, 2))


@pytest.mark.parametrize(("small", "rank"), [(1.1e-9, 2), (0.9e-9, 1)])
def test_directions_that_an_experiment_does_not_show(small: float, rank: int) -> None:
    slope = np.diag([1.0, small])
    found = _judged(("a", "b"), np.array([2.0, 0.0]), slope, slope, 1.0, 2)
    assert found.p_value == pytest.approx(stats.chi2.sf(4.0, rank))


def test_an_experiment_that_shows_nothing_agrees() -> None:
    assert _judged(("a",), np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1)), 0.0, 2) == AGREES


def two(means: tuple[float, float], own: str | None = None) -> dict[str, AgreementResult]:
    """Two experiments of 400 samples of a constant, and its values in each; the common fit is at zero."""
    noise = np.random.default_rng(6).normal(size=400)
    noise = 2 * (noise - noise.mean()) / noise.std(ddof=1)
    return judged(np.concatenate([m + noise for m in means])[:, None], own)


def experiments(labels: str, count: int) -> Experiments:
    return Experiments({k: SimpleNamespace(time=np.arange(count) / 50, role="estimation") for k in labels})


def judged(measured: np.ndarray, own: str | None = None) -> dict[str, AgreementResult]:
    model = SimpleNamespace(
        names=("a",), free_parameters=(SimpleNamespace(experiment=own),), experiments=experiments("xy", 400), prior=None
    )
    fit = SimpleNamespace(model=model, residual=measured, jacobian=np.ones((800, 1, 1)), deviation=np.array([2.0]))
    return dict(agreement(fit))


@pytest.mark.gate
def test_samples_that_hang_together_say_less() -> None:
    """The mean of N samples of a first-order autoregression varies by (1 + rho)/(1 - rho) / N: two logs of the same
    constant, by SciPy's filter."""
    rho, p_values, rng = 0.8, [], np.random.default_rng(2)
    for _ in range(100):
        noise = signal.lfilter([1.0], [1.0, -rho], rng.normal(size=(2, 500)), axis=1)[:, 100:].ravel()
        fitted = (noise - noise.mean())[:, None]
        p_values.append(judged(fitted)["x"].p_value)
    assert 0.4 < np.mean(p_values) < 0.6
    assert np.mean(np.array(p_values) < 0.05) < 0.14


def test_two_experiments_by_hand() -> None:
    found = two((0.3, -0.3))
    # A_e = 400 / 4 = 100 each: 100 - 100 / 200 * 100 = 50; g = 0.3 * 100: gain 900 / 50.
    assert found["x"].p_value == pytest.approx(stats.chi2.sf(18.0, 1))
    assert found["x"].change_in_std == pytest.approx(np.sqrt(18.0))
    assert not found["x"].agrees and found["y"].p_value == pytest.approx(found["x"].p_value)
    assert "Experiment x does not agree" in found["x"].warning("x") and "own: [a]" in found["x"].warning("x")
    assert two((0.1, -0.1))["x"].agrees


@pytest.mark.parametrize(("moved", "agrees"), [(0.0, True), (60.0, False)])
def test_what_an_experiment_hardly_shows_is_not_told_of_it(moved: float, agrees: bool) -> None:
    """Of two parameters by far too little for a value of its own: as where one joint moves and others stand. The score
    of what it shows, by hand: a alone, in noise of deviation 2."""
    rng = np.random.default_rng(11)
    table = rng.normal(size=(800, 1, 4))
    table[:400, :, 0] *= 0.01
    table[400:, :, 1:] *= [2.5e-5, 1e-6, 0.0]
    measured = 2 * rng.normal(size=800)
    measured[400:] += moved * table[400:, 0, 0]
    left = measured - table[:, 0] @ np.linalg.lstsq(table[:, 0], measured, rcond=None)[0]
    model = SimpleNamespace(
        names=tuple("abcd"), free_parameters=(SimpleNamespace(experiment=None),) * 4,
        experiments=experiments("xy", 400), prior=None,
    )  # fmt: skip
    fit = SimpleNamespace(model=model, residual=left[:, None], jacobian=table, deviation=np.array([2.0]))
    found = dict(agreement(fit))["y"]
    assert found.agrees is agrees
    values = [np.linalg.lstsq(part, of, rcond=None) for part, of in zip(
        (table[:400, 0], table[400:, 0, :1]), (measured[:400], measured[400:]), strict=True)]  # fmt: skip
    alone = np.sqrt(sum(np.linalg.inv(part.T @ part)[0, 0] for part in (table[:400, 0], table[400:, 0, :1]))) * 2
    by_hand = abs(values[0][0][0] - values[1][0][0]) / alone
    assert (found.differs_most, found.change_in_std) == ("a", pytest.approx(by_hand, rel=0.1))


def test_what_an_experiment_has_for_itself_need_not_agree() -> None:
    assert two((3.0, -3.0), own="x")["x"] == AGREES


def test_one_experiment_agrees_with_itself() -> None:
    assert agreement(SimpleNamespace(model=SimpleNamespace(experiments=experiments("x", 2)))) == {}
