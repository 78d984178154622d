"""The benchmarks compare like with like: the C programs give our trajectories, and every figure is complete."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from fmu_didim.components import ModelComponent
from fmu_didim.cosim import simulate
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.prediction import drive_torque
from tests.conftest import package
from tests.helpers import ROOT
from tests.tools.benchmarks import calibration, peers, pinocchio_loop, scara, tx40, tx40_identification
from tests.tools.benchmarks.__main__ import BENCHMARKS, main, table
from tests.tools.benchmarks.cheap_fmus import Slaves, reference, system
from tests.tools.benchmarks.discovery_stages import STAGES, staged
from tests.tools.benchmarks.figure import OFF, OVER, Figure, Settings, interleaved
from tests.tools.benchmarks.master_overhead import _against
from tests.tools.benchmarks.other_masters import ecos, libcosim
from tests.tools.benchmarks.publish import Conditions, publish, record, texts
from tests.tools.benchmarks.scara_loop import ours
from tests.tools.benchmarks.tx40_simulation import model, pinocchio
from tests.tools.blind.campaign import Order, make_order
from tests.tools.blind.translate import translate

QUICK = ("master_overhead", "scara_loop", "scara_identification", "reruns", "command_start")
"""Benchmarks that take seconds with small counts."""
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


def by_runge_kutta(model: LoopModel, substeps: int | None = None) -> LoopModel:
    """The model integrated as the C programs do it."""
    known = model.loop.plant.equations()
    assert known is not None
    return model.with_loop(plant=ModelComponent(replace(known[0], implicit=None), substeps))


def test_c_program_of_the_scara_gives_our_trajectory() -> None:
    here = by_runge_kutta(scara.model())
    # Not at the nominal values, where a parameter that never arrives would not be seen.
    theta = here.start * np.linspace(0.9, 1.1, here.start.size)
    ticks = np.arange(here.experiments[here.first].reference.time.size)
    recording = ours(here, theta, ticks)
    motion = [recording.table(here.loop.joint_signals(name)) for name in ("q", "dq", "ddq")]
    found = np.hstack([drive_torque(here, recording), *motion])
    assert relative(found, scara.program(theta).runner(ticks)()) <= 1e-12


@pytest.mark.gate
def test_c_program_of_the_tx40_gives_our_trajectory_and_that_of_pinocchio() -> None:
    here = by_runge_kutta(model(1.0)[0], tx40.SUBSTEPS)
    wanted, ticks = here.experiments[here.first].reference, np.arange(500)
    recording = simulate(here.system(here.start), wanted, ticks=ticks)
    motion = [recording.table(here.loop.joint_signals(name)) for name in ("q", "dq", "ddq")]
    found = np.hstack([drive_torque(here, recording), *motion])
    expected = tx40.program(tx40.excitation(duration_s=1.0)).runner(ticks)()
    # The regrouped parameters of the model act like the description's only to rounding.
    assert relative(found, expected) <= 1e-9
    package("pinocchio")
    theirs = np.hstack(pinocchio().run(wanted, ticks.size))
    assert relative(theirs, expected) <= 1e-9


@pytest.mark.parametrize(
    ("ratio", "goal", "sense", "met"),
    [
        (1.2, 1.3, "at most", True),
        (1.4, 1.3, "at most", False),
        (60.0, 50.0, "at least", True),
        (40.0, 50.0, "at least", False),
        (None, 5.0, "at least", None),
        (2.0, None, "at most", None),
    ],
)
def test_what_is_met(ratio: float | None, goal: float | None, sense: str, met: bool | None) -> None:
    assert Figure("figure", ratio, goal, sense).met is met  # type: ignore[arg-type]


def test_an_absent_competitor_is_no_missed_goal(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ecospy", "libcosimpy", "libcosimpy.CosimExecution"):
        monkeypatch.setitem(sys.modules, name, None)  # as if it were not installed
    monkeypatch.setattr(pinocchio_loop, "pinocchio", None)
    figures = [
        *(_against(name, make(), 5, 1, 1.0, Settings()) for name, make in (("ecos", ecos), ("libcosim", libcosim))),
        *tx40_identification._against_pinocchio(Settings(quick=True)),
    ]
    assert len(figures) == 3 and all(f.met is None and "absent" in f.note for f in figures)
    shown = table(figures)
    assert shown.count("  absent\n") == 3 and "NO" not in shown


def test_what_is_run_again_takes_its_place_in_the_file(tmp_path: Path) -> None:
    file, settings, before = tmp_path / "speed.json", Settings(3), Conditions(0.5, 20.4)
    first = {"b": record([Figure("of b", 2.0, 1.0)], settings, before), "gone": record([], settings, before)}
    publish(file, first, ["a", "b", "gone"])
    publish(file, {"a": record([Figure("of a", 5.0, 4.0, "at least")], settings, Conditions(9.0, 20.4))}, ["a", "b"])
    held = json.loads(file.read_text(encoding="utf-8"))
    assert list(held["data"]) == ["a", "b"]
    assert held["figures"] == texts(held["data"], ["a", "b"])
    when = held["date"]
    assert held["figures"]["table"][2:] == [
        f"| of a | ≥ 4 | 5 | yes | {when}, 9, 20 ms |", f"| of b | ≤ 1 | 2 | **no** | {when}, 0.5, 20 ms |",
    ]  # fmt: skip
    assert (held["figures"]["missed"], held["figures"]["not_run"]) == ("of b; 1 of 2 that were measured", "none")
    assert texts(held["data"], ["a", "b", "c"])["not_run"] == "c"
    with pytest.raises(SystemExit):
        main(["--quick", "--figures", str(file)])


def test_an_absent_tool_keeps_its_last_figure_with_its_date(tmp_path: Path) -> None:
    file, settings, name = tmp_path / "speed.json", Settings(3), f"a task{OVER}another"
    medians = {"ours s": 0.5, "theirs s": 10.0, OFF: 0.25}
    there = {
        **record([Figure(name, 0.05, None, medians=medians)], settings, Conditions(0.5, 20.4)),
        "date": "2026-01-02",
    }
    publish(file, {"a": there}, ["a"])
    for _ in range(2):
        publish(
            file,
            {"a": record([Figure(name, None, None, note="absent: no uv")], settings, Conditions(0.7, 20.4))},
            ["a"],
        )
    held = json.loads(file.read_text(encoding="utf-8"))
    when = f"2026-01-02, 0.5, 20 ms; not here on {held['date']}"
    assert held["figures"]["table"][2:] == [f"| {name} | reported | 0.05 |  | {when} |"]
    assert held["figures"]["peers"][2:] == [f"| a task | another | 10 | 0.5 | 0.25 | {when} |"]
    assert held["data"]["a"]["figures"][0]["note"] == "absent: no uv"


def test_a_tool_that_cannot_be_installed_or_ends_is_absent_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*call: str, check: bool = True) -> None:
        raise subprocess.CalledProcessError(1, call, stderr="looking\nno such package")

    monkeypatch.setattr(peers, "uv", refused)
    said = peers.Peer("tool", "with_estim8.py", ("tool",)).answer({})
    assert said == "absent: tool cannot be installed here (no such package)"
    monkeypatch.setattr(peers.Peer, "_environment", lambda *_: Path(sys.executable))
    ended = peers.Peer("tool", "no_such_script.py", ()).answer({})
    assert isinstance(ended, str) and "absent: tool ended without an answer (" in ended


def test_fits_by_hand_find_what_is_found_here() -> None:
    """The batch is fitted to the same optimum; the inputs of the house are held over a step by FMPy."""
    for task, by_hand, most in (("batch", calibration.batch_by_hand, 0.01), ("house", calibration.house_by_hand, 2.0)):
        assert calibration._off(by_hand()(), calibration.ours(task)) < most


@pytest.mark.gate
def test_times_are_interleaved() -> None:
    calls: list[str] = []
    times = interleaved({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, repeats=2)
    assert calls == ["a", "b"] * 3
    assert {name: len(values) for name, values in times.seconds.items()} == {"a": 2, "b": 2}


@pytest.mark.parametrize(
    "name",
    [*(pytest.param(name, marks=pytest.mark.gate) for name in QUICK), pytest.param("growth", marks=pytest.mark.slow)],
)
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


@pytest.mark.slow
def test_an_identification_in_a_process_of_its_own_is_measured_by_phases() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.tools.benchmarks.first_identification"], cwd=ROOT, check=True,
        capture_output=True, text=True,
    )  # fmt: skip
    found = json.loads(done.stdout.splitlines()[-1])
    # What is compiled depends on what was before.
    assert set(found) - {"compile", "code generation"} == {
        "imports", "reading and building the case", "simulation", "report", "the rest",
    }  # fmt: skip
    assert all(seconds > 0 for seconds in found.values())


@pytest.mark.gate
def test_stages_of_a_discovery_are_those_that_it_tells_of(tmp_path: Path) -> None:
    make_order(Order(("torque_offset",), 1, True, ((tmp_path / "blind", 20),), 2.0, "development"))
    case = translate(tmp_path / "blind", tmp_path / "case")
    kept = {"torque_offset", "torque_saturation", "dead_zone"}
    stages, found = staged(case, forbid=[name for name in EFFECTS if name not in kept])
    assert list(stages) == ["reading", *STAGES.values()]
    assert found and found[0].startswith("torque_offset on joint")
    effects = {name: {run.effects for run in stage.runs} for name, stage in stages.items()}
    assert effects["reading"] == {()}  # the data are looked at before the search
    assert effects["base_fit"] == {()}
    assert effects["pre_check"] == {("torque_saturation",)}  # to compare, the run without it is kept from the fit
    # Those of the balance of torques follow from the motion: only the dead zone is simulated.
    assert effects["signatures"] == {(), ("dead_zone",)}
    assert ("torque_offset",) in effects["selection"]
    for stage in stages.values():
        assert sum(run.cpu_s for run in stage.runs) <= stage.cpu_s


def test_every_benchmark_can_be_chosen() -> None:
    assert isinstance(BENCHMARKS, Mapping)
    assert all(callable(run) for run in BENCHMARKS.values())
    assert Settings(quick=True).size(10, 1, 100) == 1
    assert Settings(full=True).size(10, 1, 100) == 100
    assert Settings().size(10, 1, 100) == 10
