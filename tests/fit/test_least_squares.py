"""The solver: when it counts as settled, how often it differentiates the loop, damping, limits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from fmu_didim.base.errors import DivergedError
from fmu_didim.estimators.finish import Minimum, efficient_finish
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.fit import Fit, point
from fmu_didim.fit.iteration import Iteration
from fmu_didim.fit.linear_problem import LinearProblem
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.fit.noise.weighting import NoiseOfResidual
from fmu_didim.fit.region import Region
from fmu_didim.fit.solver import least_squares
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import STALE, Stopping
from fmu_didim.model.loop_model import LoopModel
from tests.cases import scara_case
from tests.helpers import model_of

NEAR = np.array([3.41, 0.04, 0.81, 0.0637, 0.2455, 0.0145, 0.0127, 0.1373])
FAR = NEAR * np.array([1, 100, 10, 1, 1, 1, 100, 10])
"""So much friction that a whole step from here leads to an inertia matrix that is not positive definite."""
SETTLE = Stopping(40, tolerance=1e-6, updates=None, check_all=False, exact=True)


@pytest.fixture(scope="module")
def model() -> LoopModel:
    return model_of("examples/scara/identify.yaml")


@pytest.fixture
def differentiated(monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """The values at which the solver differentiates the loop."""
    made: list[np.ndarray] = []

    def counted(model: LoopModel, values: np.ndarray, *rest: Any, **options: Any) -> np.ndarray:
        made.append(values.copy())
        return sensitivity(model, values, *rest, **options)

    monkeypatch.setattr(least_squares, "sensitivity", counted)
    return made


def at(model: LoopModel, values: np.ndarray) -> Fit:
    return point(model.with_values(values), NoiseOfResidual(model))


def silent(iteration: Iteration) -> None:
    """Progress that nobody sees."""


def finished(start: Fit) -> Minimum:
    return efficient_finish(start, tolerance=1e-6, progress=silent)


def noise_of(model: LoopModel) -> Noise:
    """White noise of 5 % of the torque."""
    deviation = 0.05 * np.sqrt((model.measured**2).mean(axis=0))
    return Noise(deviation, np.zeros(2), "residual")


def cost(model: LoopModel, values: np.ndarray) -> float:
    return float(np.sum((model.residual(values) / noise_of(model).deviation) ** 2))


def test_an_undamped_step_is_solved_for_once(model: LoopModel, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cone program where machines limit it; another one only with damping."""
    solved, whole = list[float](), LinearProblem.step

    def step(self: LinearProblem, values: np.ndarray, region: Region, damping: float) -> tuple[np.ndarray, float]:
        solved.append(damping)
        return whole(self, values, region, damping)

    monkeypatch.setattr(LinearProblem, "step", step)
    minimise(model.with_values(NEAR), noise_of(model), stopping=Stopping(1))
    assert solved == [0.0]
    solved.clear()
    minimise(model.with_values(FAR), noise_of(model), stopping=Stopping(1))
    assert solved.count(0.0) == 1 and len(solved) > 1 and sorted(solved) == solved


def test_near_the_minimum_one_sensitivity_more_is_enough(model: LoopModel, differentiated: list[np.ndarray]) -> None:
    start = at(model, NEAR)
    differentiated.clear()
    found = finished(start)
    assert found.fit.settled
    assert len(differentiated) == 1
    # Where the last sensitivity was taken is the minimum but for STALE of a standard deviation.
    moved = np.abs(found.fit.values - differentiated[0]) / np.sqrt(np.diag(found.fit.covariance))
    assert moved.max() <= STALE


def test_the_minimum_does_not_depend_on_where_the_sensitivity_is_taken(model: LoopModel) -> None:
    found, far = finished(at(model, NEAR)), finished(at(model, 1.2 * NEAR))
    assert found.fit.settled
    assert far.fit.settled
    sigma = np.sqrt(np.diag(found.fit.covariance))
    assert (np.abs(far.fit.values - found.fit.values) <= 2e-5 * sigma).all()


def test_at_the_minimum_the_gradient_vanishes(model: LoopModel) -> None:
    """By central differences of the cost, which the solver never looks at."""
    known = replace(model, torque_deviation=noise_of(model).deviation)
    fit = finished(at(known, NEAR)).fit
    sigma = np.sqrt(np.diag(fit.covariance))
    assert fit.chi_square == pytest.approx(cost(model, fit.values), rel=1e-9)
    for i in range(NEAR.size):
        step = np.zeros(NEAR.size)
        step[i] = 0.1 * sigma[i]
        slope = (cost(model, fit.values + step) - cost(model, fit.values - step)) / 0.2
        # In standard deviations: a cost of one lies one of them away from the minimum.
        assert abs(slope) <= 2e-3
        assert cost(model, fit.values + step) > fit.chi_square


@pytest.mark.parametrize("updates", [None, 0])
def test_steps_that_keep_nothing_of_their_promise_have_not_settled(
    model: LoopModel, monkeypatch: pytest.MonkeyPatch, updates: int | None
) -> None:
    """Slopes that the loop does not have, as of an unstable simulation; an old sensitivity is looked at again."""
    start, taken = at(model, NEAR), []

    def wrong(*arguments: Any, **options: Any) -> np.ndarray:
        taken.append(arguments[1])
        return -start.jacobian

    monkeypatch.setattr(least_squares, "sensitivity", wrong)
    notes: list[str] = []
    fit = minimise(
        start.model, NoiseOfResidual(model), stopping=replace(SETTLE, updates=updates), jacobian=-start.jacobian,
        outputs=start.outputs, progress=lambda it: notes.append(it.note),
    )  # fmt: skip
    assert not fit.settled
    np.testing.assert_array_equal(fit.values, NEAR)
    assert len(taken) == (1 if updates is None else 0)
    assert notes == ["no step lowers the error"] * (1 + len(taken))


@pytest.mark.parametrize("near", [0.02, 0.3])
def test_a_small_step_that_a_rough_torque_hides_settles(
    model: LoopModel, monkeypatch: pytest.MonkeyPatch, near: float
) -> None:
    """As of a foreign solver whose steps come out otherwise at every value: all but the shortest steps are uphill
    there, wherever one is. Far below a standard deviation that is the end; not farther away."""
    smooth = finished(at(model, NEAR)).fit
    sigma = np.sqrt(np.diag(smooth.covariance))
    real, taken = LoopModel.torque, [smooth.values + near * sigma]

    def torque(self: LoopModel, values: np.ndarray, label: str | None = None) -> np.ndarray:
        found = real(self, values, label)
        rough = np.max(np.abs(values - taken[-1]) / sigma) > 0.02 * near
        return found - rough * 0.1 * (self.measured - found)  # a residual that is larger by 10 %

    def taken_anew(model: LoopModel, values: np.ndarray, *rest: Any, **options: Any) -> np.ndarray:
        taken.append(values)
        return sensitivity(model, values, real(model, values), exact=True)

    monkeypatch.setattr(LoopModel, "torque", torque)
    monkeypatch.setattr(least_squares, "sensitivity", taken_anew)
    moved: list[Iteration] = []
    start = model.with_values(taken[0])
    fit = minimise(start, noise_of(model), stopping=replace(SETTLE, iterations=6), progress=moved.append)
    assert fit.settled == (near < 0.1)
    assert (len(moved) == 1) == fit.settled
    assert (np.abs(fit.values - taken[0]) <= 0.1 * near * sigma).all()


@pytest.mark.gate
def test_from_an_impossible_arm_each_step_leads_to_a_machine(model: LoopModel) -> None:
    seen: list[Iteration] = []
    fit = minimise(model.with_values(FAR), NoiseOfResidual(model), stopping=SETTLE, progress=seen.append)
    assert fit.settled
    assert not [it.note for it in seen if "inertia matrix" in it.note]
    assert not any(mass_matrix_problem(model, it.parameters) for it in seen)
    sigma = np.sqrt(np.diag(fit.covariance))
    assert (np.abs(fit.values - finished(at(model, NEAR)).fit.values) <= 2e-5 * sigma).all()


def test_a_gain_that_noise_nearly_hides_settles(tmp_path: Path) -> None:
    """Second derivatives times the residual are as large here as the slopes squared: whole steps go to and fro around
    the minimum for long."""
    path = scara_case(tmp_path)
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["identify"] = {"gain": {"of": "controller", "parameter": "Kp1", "start": 3000.0}}
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    model = model_of(path)
    assert model.names[-1] == "gain"
    seen: list[Iteration] = []
    start = model.with_values(np.append(NEAR, 3000.0))
    known = noise_of(model)
    fit = minimise(start, known, stopping=replace(SETTLE, iterations=10), progress=seen.append)
    assert fit.settled
    assert any(it.note == "step shortened" for it in seen)
    sigma = np.sqrt(np.diag(fit.covariance))
    for i in range(fit.values.size):
        step = np.zeros(fit.values.size)
        step[i] = 0.1 * sigma[i]
        costs = [cost(model, fit.values + s * step) for s in (1, -1)]
        # Of a parabola through both the least value is no farther away than STALE.
        curvature = (sum(costs) - 2 * fit.chi_square) / 0.1**2
        assert abs(costs[0] - costs[1]) / 0.2 <= STALE * curvature


def test_no_step_leads_uphill_and_the_last_point_is_the_best(model: LoopModel) -> None:
    seen: list[Iteration] = []
    known = noise_of(model)
    fit = minimise(model.with_values(FAR), known, stopping=replace(SETTLE, iterations=4), progress=seen.append)
    assert not fit.settled
    costs = [cost(model, FAR), *(cost(model, it.parameters) for it in seen)]
    assert len(costs) == 5
    assert (np.diff(costs) < 0).all()
    assert fit.chi_square == pytest.approx(costs[-1], rel=1e-9)
    np.testing.assert_array_equal(fit.values, seen[-1].parameters)


def test_at_a_limit_the_others_go_on(model: LoopModel) -> None:
    """The minimum with a limit in its way is that with this parameter known to be there."""
    free = list(model.free_parameters)
    i = model.names.index("Fc1")
    free[i] = replace(free[i], value=0.7, highest=0.75)
    limited = model.with_free(tuple(free))
    fit = minimise(limited, NoiseOfResidual(model), stopping=SETTLE)
    assert fit.settled
    assert fit.values[i] == 0.75
    assert fit.values[i] < finished(at(model, NEAR)).fit.values[i]

    def torque(others: np.ndarray) -> np.ndarray:
        return model.torque(np.insert(others, i, 0.75))

    # Of all others the slope vanishes.
    others = np.delete(fit.values, i)
    sigma = np.sqrt(np.diag(np.linalg.inv(np.delete(np.delete(np.linalg.inv(fit.covariance), i, 0), i, 1))))
    for k in range(others.size):
        step = np.zeros(others.size)
        step[k] = 0.1 * sigma[k]
        sums = [np.sum(((model.measured - torque(others + s * step)) / fit.deviation) ** 2) for s in (1, -1)]
        assert abs(sums[0] - sums[1]) / 0.2 <= 2e-3


def test_a_search_stops_where_little_is_promised_or_too_little_can_be_had(
    model: LoopModel, differentiated: list[np.ndarray]
) -> None:
    start = at(model, NEAR)
    differentiated.clear()
    known, moved = noise_of(model), []
    options: dict[str, Any] = {"jacobian": start.jacobian, "outputs": start.outputs, "progress": moved.append}
    unpromising = minimise(start.model, known, stopping=Stopping(promise=1e9), **options)
    late = minimise(start.model, known, stopping=Stopping(until=0.0), **options)
    assert late.given_up and late.chi_square == pytest.approx(cost(model, NEAR))
    hopeless = minimise(start.model, known, stopping=Stopping(give_up_above=0.5 * cost(model, NEAR)), **options)
    for fit in (unpromising, hopeless):
        np.testing.assert_array_equal(fit.values, NEAR)
        assert fit.simulations == 0
    assert moved == []
    searched = minimise(start.model, known, stopping=Stopping(promise=0.02, updates=0), **options)
    assert moved != []
    assert searched.chi_square < cost(model, NEAR) - 0.02
    assert differentiated == []


@pytest.mark.gate
def test_a_search_keeps_held_out_experiments_simulable(model: LoopModel, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that only simulates near the start; the measured torque there plays no part."""
    real = LoopModel.torque

    def torque(self: LoopModel, values: np.ndarray, label: str | None = None) -> np.ndarray:
        if label == "validation" and values[0] < 1.15 * NEAR[0]:
            raise DivergedError("The simulation diverged.", time=0.0, next_step="Change it.")
        return real(self, values, label)

    monkeypatch.setattr(LoopModel, "torque", torque)
    start, known = model.with_values(1.2 * NEAR), noise_of(model)
    searched = minimise(start, known, stopping=Stopping(check_all=True))
    assert searched.values[0] >= 1.15 * NEAR[0]
    assert searched.chi_square < cost(model, 1.2 * NEAR)
    free = minimise(start, known, stopping=Stopping(check_all=False))
    assert free.values[0] < 1.1 * NEAR[0]
