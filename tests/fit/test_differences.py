"""Steps of central differences on torques that are formulas, with the jitter that step control would add."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.fit.derivatives.differences import DIFFERENCE_STEPS, Ladder, Step, Steps
from fmu_didim.fit.derivatives.sensitivity import sensitivity, smallest_singular_value
from tests.model.law_model import LawModel, free

COUNT = 400
T = np.linspace(0, 5, COUNT)
SIDEWAYS = np.random.default_rng(0).normal(size=COUNT)
COLUMNS = np.column_stack([np.sin(3 * T), np.cos(2 * T), np.sin(3 * T) + 0.003 * SIDEWAYS])
"""Two of them nearly the same: unit columns have the smallest singular value 0.003."""


def slopes(values: Array) -> Array:
    """(N, p) of the torque without jitter."""
    a, b, c = values
    return np.asarray(COLUMNS * np.array([np.exp(2 * a - 2), 1 + 0.2 * b, 1 / np.cos(c / 2) ** 2]))


TRUTH = slopes(np.ones(3))
INSIDE = 3 * np.cos(7 * SIDEWAYS)


def smooth(v: Mapping[str, float]) -> Array:
    return np.asarray(
        COLUMNS @ np.array([np.exp(2 * v["a"] - 2) / 2, v["b"] + 0.1 * v["b"] ** 2, 2 * np.tan(v["c"] / 2)])
    )


def jitter(value: float, width: float) -> Array:
    """Torque (N,) that is another one in each piece of this width, and smooth, with a slope of its own, inside."""
    piece = np.floor(value / width)
    return np.random.default_rng(int(abs(piece))).normal(size=COUNT) + INSIDE * (value / width - piece)


def law_model(size: float = 0.0, width: float = 1e-9, **more: Any) -> LawModel:
    def law(v: Mapping[str, float], label: str) -> Array:
        torque = smooth(v)
        if size:
            torque = torque + size * sum(jitter(value, width) for value in v.values())
        return torque[:, None]

    parameters = tuple(free(name, 1.0) for name in "abc")
    return LawModel(law, {"one": np.zeros((COUNT, 1))}, parameters, can_refine=False, **more)


def columns(model: LawModel, steps: Steps | None = None, **more: Any) -> Array:
    torque = model.torque(model.start)
    del model.calls[:]
    return sensitivity(model, model.start, torque, steps=steps, **more)[:, 0, :]  # type: ignore[arg-type]


def deviations(table: Array) -> Array:
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(table.T @ table))))


@pytest.mark.parametrize(
    ("size", "width"),
    [
        (0.0, 1.0),
        (1e-10, 1e-12),  # rounding, or a step control that is hardly seen
        (1e-7, 1e-12),
        (1e-5, 1e-9),
        (1e-6, 2e-8),  # short steps stay inside a piece, whose slope is another one
        (1e-5, 3e-5),  # and so does the step that is tried first
    ],
)
def test_deviations_of_nearly_collinear_columns_hold_with_jitter(size: float, width: float) -> None:
    """The one of 1e-5 makes a column by steps of 1e-4 wrong by far more than the smallest singular value."""
    found = columns(law_model(size, width))
    np.testing.assert_allclose(deviations(found), deviations(TRUTH), rtol=0.1)


@pytest.mark.parametrize(("size", "width"), [(1e-7, 1e-9), (1e-6, 2e-8), (1e-5, 3e-5), (1e-4, 1e-9)])
def test_the_error_that_a_difference_knows_is_that_which_it_has(size: float, width: float) -> None:
    """Of the columns at 20 points 19 of 20, within a third."""
    shares = []
    for point in 1 + 0.02 * np.random.default_rng(1).normal(size=(20, 3)):
        steps: Steps = {}
        one, truth = law_model(size, width).with_values(point), slopes(point)
        truly = np.linalg.norm(columns(one, steps) - truth, axis=0) / np.linalg.norm(truth, axis=0)
        shares += [truly[i] / steps["one", i].error for i in range(3)]
    assert np.mean([0.75 <= share <= 1.33 for share in shares]) >= 0.95


def test_curvature_is_no_error() -> None:
    """The exponential of a: second differences show curvature of the step's size, truncation is of its square."""
    steps: Steps = {}
    found = columns(law_model(1e-6, 2e-8), steps)
    place = steps["one", 0].place
    assert DIFFERENCE_STEPS[place] == 1e-2 and steps["one", 0].curved > 10
    assert np.linalg.norm(found[:, 0] - TRUTH[:, 0]) < 3e-4 * np.linalg.norm(TRUTH[:, 0])
    assert 1e-6 < steps["one", 0].jitter[0] < 3e-6


@pytest.mark.parametrize(
    ("now", "error", "curved", "jitter"),
    [
        (Step(7, 0.006), 2e-4, 30.0, (1.0,)),  # the same step, by its second difference alone
        (Step(7, 3e-4, (2.0,), curved=20.0), 3e-4, 20.0, (2.0,)),  # looked for anew, beside a longer one
        (Step(6, 0.001, (3.0,)), 0.001, 1.0, (3.0,)),
    ],
)
def test_what_a_kept_step_knows(now: Step, error: float, curved: float, jitter: tuple[float, ...]) -> None:
    found = now.after(Step(7, 1e-4, (1.0,), sought=1e-3, curved=30.0), 1e-5)
    assert (found.error, found.curved, found.jitter, found.sought) == (pytest.approx(error), curved, jitter, 1e-5)


def test_a_smooth_loop_costs_two_simulations_a_column_and_more_only_where_columns_are_alike() -> None:
    one, steps = law_model(), {}
    found = columns(one, steps)
    # The step of the exponential, whose curvature might be an error, is tried shorter.
    assert len(one.calls) == 2 * 3 + 2
    np.testing.assert_allclose(found, TRUTH, rtol=1e-7, atol=1e-9)
    assert [steps["one", i].place for i in range(3)] == [4, 5, 5]


@pytest.mark.parametrize(("size", "width"), [(0.0, 1.0), (1e-6, 2e-8), (1e-5, 1e-9), (1e-4, 1e-9)])
def test_steps_are_kept(size: float, width: float) -> None:
    one, steps = law_model(size, width), {}
    first = columns(one, steps)
    before = dict(steps)
    again = columns(one, steps)
    assert len(one.calls) == 2 * 3
    assert {key: step.place for key, step in steps.items()} == {key: step.place for key, step in before.items()}
    np.testing.assert_array_equal(again, first)


def test_a_kept_step_that_serves_no_more_is_looked_for_anew() -> None:
    steps: Steps = {("one", i): Step(1, 1e-6, sought=1e-6) for i in range(3)}
    found = columns(law_model(1e-6, 1e-12), steps)
    np.testing.assert_allclose(deviations(found), deviations(TRUTH), rtol=0.1)
    assert all(step.place > 5 for step in steps.values())


def test_a_search_among_models_takes_less_care() -> None:
    one = law_model(1e-6, 1e-9)
    columns(one, exact=False)
    assert len(one.calls) == 2 * 3


# ---- one parameter


def ladder(law: Callable[[float], Array], start: float = 1.0) -> Ladder:
    one = LawModel(lambda v, _: law(v["a"])[:, None], {"one": np.zeros((COUNT, 1))}, (free("a", start),))
    run = one.simulation(np.array([start]), "one")
    return Ladder(run, run.torque(), 0, 1.0)


@pytest.mark.parametrize("wanted", [1e-3, 1e-6])
def test_steps_that_are_seen_to_suffice_are_taken(wanted: float) -> None:
    found = ladder(lambda a: np.exp(a - 1) * np.cos(T)).best(wanted)
    assert found.step is not None and found.step.error <= wanted
    np.testing.assert_allclose(found.column[:, 0], np.cos(T), rtol=1e-6)


def test_a_slope_inside_a_piece_is_no_slope() -> None:
    """Steps of 1e-9 to 1e-8 are the smoothest ones, and wrong by a factor of thousands."""
    law = ladder(lambda a: a * np.cos(T) + 1e-3 * jitter(a, 1e-7), start=1.00000005)
    inside = law.at(0)
    assert inside is not None and inside.step is not None
    assert inside.step.error < 1e-3 and np.linalg.norm(inside.column[:, 0]) > 1e3 * np.linalg.norm(np.cos(T))
    found = law.best(1e-6)
    np.testing.assert_allclose(found.column[:, 0], np.cos(T), atol=0.05)


def test_a_step_of_the_torque_far_away_does_not_count() -> None:
    def law(a: float) -> Array:
        return np.asarray(a * np.cos(T) + 1e-4 * (a > 1 + 2e-5))

    found = ladder(law).best(1e-4)
    assert found.step is not None
    assert DIFFERENCE_STEPS[found.step.place] == 1e-5
    np.testing.assert_allclose(found.column[:, 0], np.cos(T), atol=1e-6)


def test_a_quantised_parameter_needs_long_steps() -> None:
    found = ladder(lambda a: 1e-3 * np.round(a / 1e-3) * np.cos(T)).best(0.05)
    np.testing.assert_allclose(found.column[:, 0], np.cos(T), atol=0.1)


def test_an_idle_parameter_has_a_column_of_zeros() -> None:
    assert not ladder(lambda a: np.cos(T)).best(1e-3).column.any()


def test_steps_that_cannot_be_simulated_are_left_out() -> None:
    def law(a: float) -> Array:
        if abs(a - 1) > 2e-6:
            raise SimulationError("It diverges.", next_step="Change it.")
        return np.asarray(a**2 * np.cos(T))

    found = ladder(law).best(1e-3)
    np.testing.assert_allclose(found.column[:, 0], 2 * np.cos(T), rtol=1e-6)


def test_a_parameter_that_cannot_be_varied_is_named() -> None:
    def law(a: float) -> Array:
        if a != 1:
            raise SimulationError("It diverges.", next_step="Change it.")
        return np.cos(T)

    with pytest.raises(SimulationError, match="parameter 'a' cannot be varied"):
        ladder(law).best(1e-3)


def test_smallest_singular_value() -> None:
    table = np.zeros((4, 1, 3))
    table[0, 0, 0], table[:2, 0, 1] = 5.0, (3.0, 4.0)
    # Unit columns (1, 0) and (0.6, 0.8): singular values sqrt(1 +- 0.6).
    assert smallest_singular_value(table) == pytest.approx(np.sqrt(0.4))
    assert smallest_singular_value(np.zeros((4, 1, 2))) == 1.0
