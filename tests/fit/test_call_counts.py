"""Gross regressions of speed, seen in numbers of calls instead of times."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from fmu_didim.case import load_case
from fmu_didim.cosim import InstancePool, simulate
from fmu_didim.data.signals import trajectory
from fmu_didim.model.loop_model import LoopModel
from tests.helpers import model_of
from tests.tools.benchmarks.counting import simulated

CASE = "examples/scara/identify.yaml"


@pytest.fixture(scope="module")
def model() -> LoopModel:
    return model_of(CASE)


def python_calls(model: LoopModel, ticks: int, pool: InstancePool) -> int:
    """Calls of Python and C functions in one warm run of the loop over so many ticks, the last one recorded."""
    reference, system = model.experiments[model.first].reference, model.loop.systems[model.first]
    part = trajectory(reference.time[:ticks], {n: reference.select([n])[:ticks, 0] for n in reference.names})
    recorded = np.array([ticks - 1])
    run = lambda: simulate(system, part, ticks=recorded, pool=pool)  # noqa: E731
    run()
    calls = 0

    def count(frame: object, event: str, argument: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        recording = run()
    finally:
        sys.setprofile(None)
    assert recording.compiled
    return calls


def test_calls_of_a_run_do_not_grow_with_its_ticks(model: LoopModel) -> None:
    pool = InstancePool()
    short, long = (python_calls(model, ticks, pool) for ticks in (200, 2000))
    assert long <= short + 5
    assert long < 430  # 450 where the parts are wired and called anew


def test_an_identification_takes_few_runs_of_the_loop() -> None:
    case = load_case(CASE)
    assert case.model is not None
    estimate, runs = simulated(case.model, case.estimator)
    assert estimate.status.name == "CONVERGED"
    # One an iteration, two or more where its steps are chosen or checked, one for the motion of the residual, two to
    # see whether logs start on their references: after the start that fails, and held out.
    assert len(runs.plain) <= 18
    assert len(runs.varied) <= 3  # the last where the steps have become finer


def test_a_second_run_opens_no_file(model: LoopModel) -> None:
    reference, system = model.experiments[model.first].reference, model.loop.systems[model.first]
    pool, watching, opened = InstancePool(), False, []

    def audit(event: str, arguments: tuple[object, ...]) -> None:
        if watching and event in ("open", "ctypes.dlopen", "subprocess.Popen"):
            opened.append(f"{event} {arguments[0]}")

    sys.addaudithook(audit)
    simulate(system, reference, pool=pool)
    watching = True
    simulate(system, reference, pool=pool)
    watching = False
    assert opened == []
