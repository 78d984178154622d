"""Recordings that are kept: the same run is not made twice, and any other one is."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fmu_didim.cosim import Columns, KeptRecordings, Recording, System
from fmu_didim.model import loop_model
from fmu_didim.model.external_torque import ExternalTorque
from fmu_didim.model.loop_model import LoopModel
from tests.helpers import model_of


def recording(rows: int, value: float = 0.0) -> Recording:
    table = np.full((rows, 2), value)
    outputs, inputs = Columns({"plant.q1": 0}, table), Columns({"plant.tau1": 1}, table)
    return Recording(np.arange(rows), 0.0, 0.1, outputs, inputs, outputs)


def test_the_recordings_asked_for_longest_ago_leave_first() -> None:
    kept = KeptRecordings(most=3 * 4 * 10)  # three of ten rows, with their ticks
    for name in "abc":
        kept.keep(name, recording(10))
    assert kept.find("a") is not None
    kept.keep("d", recording(10))
    assert kept.find("b") is None
    assert all(kept.find(name) is not None for name in "acd")
    kept.keep("large", recording(100))
    assert len(kept) == 0


def test_a_recording_that_is_kept_cannot_be_changed() -> None:
    kept, mine = KeptRecordings(), recording(3)
    kept.keep("a", mine)
    with pytest.raises(ValueError, match="read-only"):
        mine.applied["plant.q1"][0] = 1.0


def test_another_process_gets_none_of_them() -> None:
    kept = KeptRecordings(most=7)
    kept.keep("a", recording(1))
    assert len(pickle.loads(pickle.dumps(kept))) == 0


@pytest.fixture
def arm(monkeypatch: pytest.MonkeyPatch) -> tuple[LoopModel, list[int]]:
    """The SCARA as a model of ours, and the number of its simulations."""
    model = model_of("examples/scara/identify.yaml")
    runs, run = [0], loop_model.simulate

    def counted(*arguments: object, **options: object) -> Recording:
        runs[0] += 1
        return run(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(loop_model, "simulate", counted)
    return model, runs


def _with(model: LoopModel, system: System) -> LoopModel:
    return model.with_loop(systems={model.first: system})


OTHERS: dict[str, Callable[[LoopModel], LoopModel]] = {
    "delay": lambda m: _with(m, m.loop.systems[m.first].with_delay(m.loop.plant_name, 1.0)),
    "substeps": lambda m: m.with_loop(substeps=7),
    "subdivision": lambda m: m.with_loop(subdivision=2),
    "torque from outside": lambda m: m.pushed(m.first, (ExternalTorque(1, 0.2, 0.6, 3.0),)),
    "controller": lambda m: _with(
        m, m.loop.systems[m.first].replace("controller", _faster(m.loop.systems[m.first].components))
    ),
}


def _faster(components: object) -> object:
    controller = components["controller"]  # type: ignore[index]
    name, value = next((n, v) for n, v in controller.parameter_values().items() if v > 0)
    return controller.with_parameters({name: 1.1 * value})


def test_the_same_run_is_made_once(arm: tuple[LoopModel, list[int]]) -> None:
    model, runs = arm
    first = model.torque(model.start)
    again = replace(model).torque(model.start.copy())
    np.testing.assert_array_equal(first, again)
    assert runs == [1]


@pytest.mark.parametrize("other", OTHERS)
def test_whatever_changes_the_answer_makes_another_run(arm: tuple[LoopModel, list[int]], other: str) -> None:
    model, runs = arm
    first = model.torque(model.start)
    changed = OTHERS[other](model)
    found = changed.torque(model.start)
    assert runs == [2]
    np.testing.assert_array_equal(found, replace(changed, recordings=KeptRecordings()).torque(model.start))
    if other not in ("substeps", "subdivision"):  # the answer may be the same to the last digit
        assert np.abs(found - first).max() > 1e-9


def test_every_value_counts(arm: tuple[LoopModel, list[int]]) -> None:
    model, runs = arm
    for i in range(model.start.size):
        values = model.start.copy()
        values[i] *= 1.0 + 1e-12
        model.torque(values)
    assert runs == [model.start.size]
