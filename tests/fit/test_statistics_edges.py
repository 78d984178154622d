"""The edges of the least squares and their statistics."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim.base.errors import IdentificationError
from fmu_didim.data.signals import Array
from fmu_didim.fit.statistics import (
    bounded_interval,
    confidence_interval,
    correlation,
    least_squares,
    noise_deviation,
    output_error_percent,
    relative_deviation_percent,
    relative_error_percent,
)


def pair(condition: float) -> Array:
    """Two columns of length one, of this condition number."""
    angle = 2 * np.arctan(1 / condition)
    c, s = np.cos(angle / 2), np.sin(angle / 2)
    return np.array([[c, c], [s, -s], [0.0, 0.0]])


@pytest.mark.parametrize(("condition", "refused"), [(0.95e12, False), (1.05e12, True)])
def test_the_condition_number_beyond_which_rounding_decides(condition: float, refused: bool) -> None:
    if not refused:
        assert least_squares(pair(condition), np.ones(3)).condition_number == pytest.approx(condition, rel=0.02)
        return
    with pytest.raises(IdentificationError, match=r"cannot tell some parameters apart[\s\S]*got:   0, 1"):
        least_squares(pair(condition), np.ones(3))


def test_columns_that_are_the_same_to_the_bit() -> None:
    """Their smallest singular value is zero: nothing is divided by it."""
    with pytest.raises(IdentificationError, match=r"cannot tell some parameters apart[\s\S]*got:   0, 1"):
        least_squares(np.array([[2.0, 4.0], [0.0, 0.0], [0.0, 0.0]]), np.ones(3))


def test_columns_that_depend_on_each_other_are_named_whatever_stands_between() -> None:
    matrix = np.random.default_rng(3).normal(size=(20, 4))
    matrix[:, 3] = matrix[:, 0] * (1 + 1e-14)
    with pytest.raises(IdentificationError, match=r"cannot tell some parameters apart[\s\S]*got:   a, d\n"):
        least_squares(matrix, np.ones(20), names=("a", "b", "c", "d"))


@pytest.mark.parametrize(("rows", "refused"), [(3, False), (2, True), (1, True)])
def test_more_samples_than_parameters(rows: int, refused: bool) -> None:
    matrix = np.array([[1.0, 0.0], [0.0, 2.0], [0.0, 0.0]])[:rows]
    if refused:
        with pytest.raises(IdentificationError, match=f"{rows} samples, 2 parameters"):
            least_squares(matrix, np.ones(rows))
        return
    found = least_squares(matrix, np.array([3.0, 4.0, 5.0]))
    assert found.solution.tolist() == pytest.approx([3.0, 2.0])
    assert found.residual.tolist() == pytest.approx([0.0, 0.0, 5.0])
    assert found.leverage.tolist() == pytest.approx([1.0, 1.0, 0.0])
    assert found.condition_number == pytest.approx(1.0)


@pytest.mark.parametrize("place", ["matrix", "target"])
def test_values_that_are_not_finite(place: str) -> None:
    matrix, target = np.eye(3)[:, :2].copy(), np.ones(3)
    (matrix if place == "matrix" else target)[0] = np.nan
    with pytest.raises(IdentificationError, match="not finite"):
        least_squares(matrix, target)


def test_columns_without_names_are_counted() -> None:
    with pytest.raises(IdentificationError, match="got:   1"):
        least_squares(np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]]), np.ones(3))
    with pytest.raises(IdentificationError, match=r"cannot tell some parameters apart[\s\S]*got:   0, 1"):
        least_squares(np.ones((3, 2)), np.ones(3))


def test_noise_of_each_joint() -> None:
    residual = np.array([[3.0, 0.0], [4.0, 0.0], [0.0, 0.0]])
    leverage = np.array([[0.5, 0.0], [0.5, 0.0], [0.0, 0.0]])
    assert noise_deviation(residual, leverage, floor=np.array([0.1, 0.2])).tolist() == [np.sqrt(12.5), 0.2]
    # One degree of freedom at least.
    assert noise_deviation(residual, 0.9 * np.ones((3, 2)), floor=np.zeros(2))[0] == 5.0


@pytest.mark.parametrize(
    ("freedom", "level", "half"),
    [
        (3.0, 0.95, 3.182446),
        (1.0, 0.95, 12.706205),
        (0.5, 0.95, 12.706205),
        (1e9, 0.95, 1.959964),
        (3.0, 0.5, 0.764892),
    ],
)
def test_intervals_by_students_t(freedom: float, level: float, half: float) -> None:
    found = confidence_interval(np.array([2.0, -1.0]), np.array([0.5, 0.0]), freedom, level)
    np.testing.assert_allclose(found, [[2 - 0.5 * half, 2 + 0.5 * half], [-1, -1]], rtol=1e-6)
    if level == 0.95:
        np.testing.assert_allclose(confidence_interval(np.array([2.0, -1.0]), np.array([0.5, 0.0]), freedom), found)


def test_relative_numbers() -> None:
    assert relative_deviation_percent(np.array([-2.0, 0.0]), np.array([0.5, 0.5])).tolist() == [25.0, np.inf]
    assert correlation(np.array([[4.0, 3.0], [3.0, 9.0]])).tolist() == [[1.0, 0.5], [0.5, 1.0]]
    measured, simulated = np.array([[3.0, 0.0], [4.0, 2.0]]), np.array([[3.0, 1.0], [1.0, 2.0]])
    total, joints = relative_error_percent(measured, simulated)
    assert total == pytest.approx(100 * np.sqrt(10 / 29)) and joints.tolist() == pytest.approx([60.0, 50.0])


def test_a_joint_without_torque_has_no_relative_error_unless_the_simulation_has_torque() -> None:
    measured = np.array([[3.0, 0.0, 0.0], [4.0, 0.0, 0.0]])
    simulated = measured + np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 2.0]])
    assert relative_error_percent(measured, simulated)[1].tolist() == [20.0, 0.0, np.inf]


@pytest.mark.parametrize(
    ("freedom", "limit", "quantile"),
    [
        (1e9, -1e3, 1.6448536269514722),  # far from the limit: of the normal distribution, 95 % from one side
        (1e9, 3.0, 1.959963984540054),  # half of it is cut off: 97.5 %
        (1.0, 3.0, 12.706204736432095),  # Cauchy: tan(0.475 pi)
        (0.2, 3.0, 12.706204736432095),  # no fewer than one degree of freedom
        (1.0, 4.0, 25.451699579357079),  # Cauchy, three quarters cut off: tan(0.4875 pi)
    ],
)
def test_the_far_end_of_an_interval_above_a_limit(freedom: float, limit: float, quantile: float) -> None:
    """Of 3 with a deviation of 1."""
    assert bounded_interval(3.0, 1.0, freedom, limit) == pytest.approx(3.0 + quantile, rel=1e-6)
    assert bounded_interval(0.0, 2.0, freedom, 2 * (limit - 3.0)) == pytest.approx(2 * quantile, rel=1e-6)


def test_errors_of_outputs_are_parts_of_what_moves() -> None:
    """|y - y_s| / |y - mean(y)| of each output, wherever its zero is; one that rests has none, and does not count."""
    sign = np.array([1.0, -1.0, 1.0, -1.0])
    measured = np.column_stack([300 + 2 * sign, 5 * sign, np.full(4, 7.0)])
    simulated = measured + np.column_stack([0.2 * sign, 1.0 * sign, 0.1 * sign])
    total, each = output_error_percent(measured, simulated)
    assert each.tolist() == [pytest.approx(10.0), pytest.approx(20.0), np.inf]
    assert total == pytest.approx(np.sqrt((10.0**2 + 20.0**2) / 2))
