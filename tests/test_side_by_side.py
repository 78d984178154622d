"""Simulations in threads: same numbers, and only where it is safe."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest
from fmu_didim.prediction.plant_sensitivity import sensitivity
from fmu_didim.prediction.problem import Problem, predict, predict_torque

from fmu_didim.case import load_case
from fmu_didim.errors import InputError, SimulationError
from fmu_didim.estimators import Didim
from fmu_didim.identification.estimate import Status
from fmu_didim.prediction.workers import VARIABLE, allowed_workers, default_workers, side_by_side

TRUTH = np.array([3.43, 0.03, 0.82, 0.063, 0.241, 0.014, 0.013, 0.137])


@pytest.fixture(scope="module")
def problem() -> Problem:
    found = load_case("examples/scara/identify.yaml").problem
    assert found is not None
    return found


def test_sensitivity_is_the_same_to_the_last_bit(problem: Problem) -> None:
    prediction = predict(problem, TRUTH)
    alone = sensitivity(replace(problem, workers=1), TRUTH, prediction, with_delay=True)
    for workers in (2, 4):
        together = sensitivity(replace(problem, workers=workers), TRUTH, prediction, with_delay=True)
        np.testing.assert_array_equal(together, alone)


def test_tasks_run_at_the_same_time_and_keep_their_order() -> None:
    meeting = threading.Barrier(2, timeout=30)  # breaks unless two tasks wait at it together

    def task(i: int) -> int:
        meeting.wait()
        return i

    assert side_by_side([lambda i=i: task(i) for i in range(4)], 2) == [0, 1, 2, 3]
    assert side_by_side([threading.get_ident] * 3, 1) == [threading.get_ident()] * 3


def test_the_error_of_a_task_is_raised() -> None:
    def broken() -> int:
        raise SimulationError("broken")

    with pytest.raises(SimulationError, match="broken"):
        side_by_side([lambda: 1, broken, lambda: 2], 2)


def test_only_compiled_loops_of_own_fmus_run_side_by_side(problem: Problem) -> None:
    recording = predict_torque(problem, TRUTH)[1]
    assert allowed_workers(3, problem.system, recording) == 3
    assert allowed_workers(3, problem.system, replace(recording, compiled=False)) == 1
    plant = problem.system.components["plant"]
    foreign = replace(plant, fmu=replace(plant.fmu, tool="Another tool"))
    assert allowed_workers(3, problem.system.replace("plant", foreign), recording) == 1


def test_the_variable_states_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "3")
    assert default_workers() == 3
    monkeypatch.setenv(VARIABLE, "many")
    with pytest.raises(InputError, match="The number of threads is not valid"):
        default_workers()


def test_the_finish_settles_without_noise_where_parameters_are_zero(problem: Problem) -> None:
    """Such parameters have neither size nor standard deviation."""
    truth = TRUTH.copy()
    truth[[1, 5, 6]] = 0.0
    clean = problem.on(replace(problem.experiment, torque=predict_torque(problem, truth)[0]))
    estimate = Didim(start="reference").estimate(clean)
    assert estimate.status is Status.CONVERGED
    np.testing.assert_allclose(estimate.value, truth, rtol=1e-7, atol=1e-8)
