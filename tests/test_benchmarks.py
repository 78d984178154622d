"""The benchmarks compare like with like: the C programs give our trajectories, and every figure is complete."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from fmu_didim.prediction.problem import drive_torque, joint_signals

from fmu_didim.master import simulate
from tests.benchmarks import scara, tx40
from tests.benchmarks.__main__ import BENCHMARKS, main
from tests.benchmarks.cheap_fmus import Slaves, reference, system
from tests.benchmarks.figure import Figure, Settings, interleaved
from tests.benchmarks.scara_loop import ours
from tests.benchmarks.tx40_simulation import pinocchio, problem

SCHEMA = {
    "type": "array",
    "minItems": 1,
    "items": {
        "type": "object",
        "additionalProperties": False,
        "required": ["name", "ratio", "goal", "sense", "met", "medians", "note"],
        "properties": {
            "name": {"type": "string", "minLength": 1},
            "ratio": {"type": ["number", "null"]},
            "goal": {"type": ["number", "null"]},
            "sense": {"enum": ["at most", "at least"]},
            "met": {"type": ["boolean", "null"]},
            "medians": {"type": "object", "additionalProperties": {"type": "number"}},
            "note": {"type": "string"},
        },
    },
}


def relative(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference in units of the largest value of its column."""
    return float((np.abs(found - expected).max(axis=0) / np.abs(expected).max(axis=0)).max())


def test_c_loop_of_fmi_calls_gives_our_trajectory() -> None:
    count = 500
    recording = simulate(system(), reference(count))
    names = ["reference.r", "a.y", "b.y"]
    found = np.hstack([recording.table(names), *(recording.inputs[n][:, None] for n in ("a.u", "a.v", "b.u"))])
    slaves = Slaves(count)
    try:
        np.testing.assert_array_equal(slaves.by_c(), found)
        np.testing.assert_array_equal(slaves.by_c(), found)  # the second run starts afresh
        np.testing.assert_array_equal(slaves.by_fmpy(count), found[:, :3])
    finally:
        slaves.close()
    assert np.abs(found[:, 2] - 1.1 * 0.9 * found[:, 0]).max() > 0.1  # the feedback acts


def test_c_program_of_the_scara_gives_our_trajectory() -> None:
    here = scara.problem()
    # Not at the nominal values, where a parameter that never arrives would not be seen.
    theta = here.parameters.nominal() * np.linspace(0.9, 1.1, here.parameters.count)
    ticks = np.arange(here.experiment.reference.time.size)
    recording = ours(here, theta, ticks)
    motion = [recording.table(joint_signals(here, name)) for name in ("q", "dq", "ddq")]
    found = np.hstack([drive_torque(here, recording), *motion])
    assert relative(found, scara.program(theta).runner(ticks)()) <= 1e-12


def test_c_program_of_the_tx40_gives_our_trajectory_and_that_of_pinocchio() -> None:
    here, _ = problem(1.0)
    ticks = np.arange(500)
    recording = simulate(here.system_with(here.parameters.nominal()), here.experiment.reference, ticks=ticks)
    motion = [recording.table(joint_signals(here, name)) for name in ("q", "dq", "ddq")]
    found = np.hstack([drive_torque(here, recording), *motion])
    expected = tx40.program(tx40.excitation(duration_s=1.0)).runner(ticks)()
    # The regrouped parameters of the problem act like the description's only to rounding.
    assert relative(found, expected) <= 1e-9
    theirs = np.hstack(pinocchio().run(here.experiment.reference, ticks.size))
    assert relative(theirs, expected) <= 1e-9


@pytest.mark.parametrize(
    ("ratio", "goal", "sense", "met"),
    [
        (1.2, 1.3, "at most", True),
        (1.4, 1.3, "at most", False),
        (60.0, 50.0, "at least", True),
        (40.0, 50.0, "at least", False),
        (None, 5.0, "at least", False),
        (2.0, None, "at most", None),
    ],
)
def test_what_is_met(ratio: float | None, goal: float | None, sense: str, met: bool | None) -> None:
    assert Figure("figure", ratio, goal, sense).met is met  # type: ignore[arg-type]


def test_times_are_interleaved() -> None:
    calls: list[str] = []
    times = interleaved({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, repeats=2)
    assert calls == ["a", "b"] * 3
    assert {name: len(values) for name, values in times.seconds.items()} == {"a": 2, "b": 2}


@pytest.mark.parametrize("name", ["master_overhead", "scara_loop", "scara_identification", "reruns", "command_start"])
def test_a_quick_run_writes_complete_figures(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "figures.json"
    main(["--quick", "--repeats", "1", "--only", name, "--json", str(file)])
    figures = json.loads(file.read_text(encoding="utf-8"))
    jsonschema.validate(figures, SCHEMA)
    shown = capfd.readouterr().out
    for figure in figures:
        assert figure["name"] in shown
        assert figure["ratio"] is not None or "absent" in figure["note"]
        assert all(np.isfinite(value) for value in figure["medians"].values())


def test_every_benchmark_can_be_chosen() -> None:
    assert isinstance(BENCHMARKS, Mapping)
    assert all(callable(run) for run in BENCHMARKS.values())
    assert Settings(quick=True).size(10, 1, 100) == 1
    assert Settings(full=True).size(10, 1, 100) == 100
    assert Settings().size(10, 1, 100) == 10
