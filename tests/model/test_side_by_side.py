"""Simulations in threads: same numbers, and only where it is safe."""

from __future__ import annotations

import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from fmu_didim import discover, identify
from fmu_didim.base.errors import FmuDidimError, FmuError, InputError, SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.estimators import Didim
from fmu_didim.estimators.starts.start import with_free_delay
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.estimate import Status
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.workers import VARIABLE, default_workers, may_run_side_by_side, one_blas_thread, side_by_side
from tests.cases import TRUTH
from tests.helpers import component, model_of, scara, with_component, with_torque
from tests.patience import patience


@pytest.fixture(scope="module")
def model() -> LoopModel:
    return model_of("examples/scara/identify.yaml")


def test_sensitivity_is_the_same_to_the_last_bit(model: LoopModel) -> None:
    """By derivatives, and by the differences that a search takes."""
    free, values = with_free_delay(model), np.append(TRUTH, 0.0)
    torque = free.torque(values)
    for exact in (True, False):
        alone = sensitivity(replace(free, workers=1), values, torque, exact=exact)
        for workers in (2, 4):
            together = sensitivity(replace(free, workers=workers), values, torque, exact=exact)
            np.testing.assert_array_equal(together, alone)


def test_tasks_run_at_the_same_time_and_keep_their_order() -> None:
    meeting = threading.Barrier(2, timeout=patience(30))  # breaks unless two tasks wait at it together

    def task(i: int) -> int:
        meeting.wait()
        return i

    assert side_by_side([lambda i=i: task(i) for i in range(4)], 2) == [0, 1, 2, 3]
    assert side_by_side([threading.get_ident] * 3, 1) == [threading.get_ident()] * 3


@pytest.mark.parametrize(
    ("ticks", "joints", "subdivision", "threads"),
    [
        (4999, 1, 1, 1),
        (4999, 2, 1, 1),
        (5000, 2, 1, 2),
        (2500, 2, 2, 2),
        (4500, 6, 1, 2),
        (555, 6, 1, 1),
        (556, 6, 1, 2),
    ],
)  # fmt: skip
def test_threads_serve_runs_that_are_long_for_their_joints(
    ticks: int, joints: int, subdivision: int, threads: int
) -> None:
    """A tick of six joints counts as nine of two."""
    experiment = SimpleNamespace(reference=SimpleNamespace(time=np.zeros(ticks)))
    loop = SimpleNamespace(subdivision=subdivision)
    model = SimpleNamespace(experiments={"a": experiment}, loop=loop, joint_count=joints, workers=2)
    assert LoopModel.threads.fget(model) == threads  # type: ignore[attr-defined]


def test_the_error_of_a_task_is_raised() -> None:
    def broken() -> int:
        raise SimulationError("broken", next_step="Change it.")

    with pytest.raises(SimulationError, match="broken"):
        side_by_side([lambda: 1, broken, lambda: 2], 2)


@pytest.mark.slow
def test_only_compiled_loops_of_own_fmus_run_side_by_side(model: LoopModel) -> None:
    several = replace(model, workers=3)
    assert several.allowed_workers(TRUTH) == 3
    assert replace(model, workers=1).allowed_workers(TRUTH) == 1
    by_python = with_component(several, "plant", component("control", scara().block()))
    assert may_run_side_by_side(by_python.system(TRUTH))
    assert not by_python.simulation(TRUTH).record().compiled
    assert by_python.allowed_workers(TRUTH) == 1
    plant = model.loop.plant
    foreign = with_component(several, "plant", replace(plant, fmu=replace(plant.fmu, tool="Another tool")))
    assert not may_run_side_by_side(foreign.system(TRUTH))
    assert foreign.allowed_workers(TRUTH) == 1


@pytest.mark.parametrize(
    "error",
    [SimulationError("It diverges.", next_step="Change it."), FmuError("It was ended.", next_step="Ask its maker.")],
)
def test_one_runs_at_a_time_where_the_start_values_cannot_be_simulated(
    model: LoopModel, error: FmuDidimError, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(model: LoopModel, values: Array) -> int:
        raise error

    monkeypatch.setattr(LoopModel, "allowed_workers", fails)
    assert model.workers_from_start == 1
    monkeypatch.setattr(LoopModel, "allowed_workers", lambda model, values: 3)
    assert model.workers_from_start == 3


def test_the_variable_states_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "3")
    assert default_workers() == 3
    monkeypatch.setenv(VARIABLE, "many")
    with pytest.raises(InputError, match="The number of threads is not valid"):
        default_workers()


def test_the_finish_settles_without_noise_where_parameters_are_zero(model: LoopModel) -> None:
    """Such parameters have neither size nor standard deviation."""
    truth = TRUTH.copy()
    truth[[1, 5, 6]] = 0.0
    estimate = Didim(start="reference").estimate(with_torque(model, model.torque(truth)))
    assert estimate.status is Status.CONVERGED
    np.testing.assert_allclose(estimate.value, truth, rtol=1e-7, atol=1e-8)


def test_blas_keeps_to_one_thread_while_a_verb_works() -> None:
    """And the caller gets back what was set."""

    def threads() -> set[int]:
        return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}

    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        assert one_blas_thread(threads)() == {1}
        assert threads() == before
    assert identify.__wrapped__  # type: ignore[attr-defined]
    assert discover.__wrapped__  # type: ignore[attr-defined]
