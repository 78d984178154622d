"""A torque log whose clock is late or early: named as that, and told from a lag in the loop."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from fmu_didim import discover, simulate
from fmu_didim.case import load_case
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.dynamics.robot import read_robot
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.model.free_parameter import LOG
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from fmu_didim.results.findings import FindingsDocument
from tests.discovery.helpers import RATE, arm_case

SHIFT = EffectAtJoint("log_time_shift", 1)


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, FindingsDocument]:
    """Two joints, the log stamped 17 ms late: folder and findings."""
    folder = tmp_path_factory.mktemp("late")
    return folder / "out", discover(arm_case(folder, joints=2, rate_hz=50.0, late_s=0.017), folder / "out")


def assert_only_shift(document: FindingsDocument, seconds: float) -> None:
    assert document.answer == "named"
    assert [(f.effect, f.class_, f.joint) for f in document.findings] == [("log_time_shift", "lag", 1)]
    (value,) = document.findings[0].parameters
    assert (value.name, value.unit) == ("log_shift", "s")
    assert value.interval[0] < seconds < value.interval[1]  # type: ignore[operator]
    assert value.std < 0.02 * abs(seconds)  # type: ignore[operator]


@pytest.mark.gate
def test_late_log_is_named_with_its_shift(late: tuple[Path, FindingsDocument]) -> None:
    _, document = late
    assert_only_shift(document, 0.017)
    assert document.gap["estimation"].after < 0.1 * document.gap["estimation"].before  # type: ignore[operator]
    assert document.gap["validation"].after < 0.1 * document.gap["validation"].before  # type: ignore[operator]
    assert document.findings[0].ambiguous == [], "no lag is negative"


@pytest.mark.gate
def test_augmented_case_states_the_shift(late: tuple[Path, FindingsDocument]) -> None:
    out, document = late
    (note,) = [n for n in document.notes if "augmented case" in n]
    assert float(re.search(r"to (\S+) of its peak", note)[1]) < 2e-3  # type: ignore[index]
    content = yaml.safe_load((out / document.files["case"]).read_text(encoding="utf-8"))
    (value,) = document.findings[0].parameters
    assert [content[which]["torque"]["log_shift_s"] for which in ("train", "validation")] == [value.value] * 2
    assert all("log_time_shift" not in joint.effects for joint in read_robot(out / document.files["robot"]).joints)


@pytest.mark.gate
def test_report_says_that_it_is_the_whole_log(late: tuple[Path, FindingsDocument]) -> None:
    page = (late[0] / "discovery.html").read_text(encoding="utf-8")
    assert "Time shift of the torque log, whole log" in page
    assert "Time shift of the torque log, joint" not in page


@pytest.mark.slow
def test_early_log_is_named_though_a_lag_of_the_drives_resembles_it(tmp_path: Path) -> None:
    """The command of one joint would lead by the lag of its drive; both joints lead alike."""
    assert_only_shift(discover(arm_case(tmp_path, joints=2, late_s=-0.017)), -0.017)


@pytest.mark.slow
def test_what_is_left_of_a_stated_shift_is_named(tmp_path: Path) -> None:
    case = arm_case(tmp_path, late_s=0.017)
    content = yaml.safe_load(case.read_text(encoding="utf-8"))
    for which in ("train", "validation"):
        content[which]["torque"]["log_shift_s"] = 0.005
    case.write_text(yaml.safe_dump(content), encoding="utf-8")
    document = discover(case, tmp_path / "out")
    assert_only_shift(document, 0.012)
    augmented = yaml.safe_load((tmp_path / "out" / document.files["case"]).read_text(encoding="utf-8"))
    found = document.findings[0].parameters[0].value
    assert augmented["train"]["torque"]["log_shift_s"] == pytest.approx(0.005 + found, abs=1e-15)
    (note,) = [n for n in document.notes if "augmented case" in n]
    assert float(re.search(r"to (\S+) of its peak", note)[1]) < 2e-3  # type: ignore[index]


@pytest.mark.slow
def test_lag_of_a_drive_keeps_its_name(tmp_path: Path) -> None:
    document = discover(arm_case(tmp_path, {"actuator_lag": {"T": 0.008}}, joints=2))
    first = document.findings[0]
    assert (first.class_, first.joint) == ("lag", 1)
    assert first.effect in ("actuator_lag", "delay")
    assert "log_time_shift" not in {r.effect for r in first.ambiguous}, "joint 2 tells them apart"


# ---- the loop with a shifted log -------------------------------------------------------------------


@pytest.fixture(scope="module")
def shifted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, LoopModel, LoopModel]:
    """The arm's case, its loop, and the same with the shift as a free parameter."""
    folder = tmp_path_factory.mktemp("model")
    case = arm_case(folder, joints=2)
    loaded = load_case(case)
    assert loaded.model is not None
    base = replace(loaded.model, workers=1)
    builder = LoopModelBuilder(base, loaded.parameters.model.description)  # type: ignore[attr-defined]
    assert builder.joints("log_time_shift") == (1,)
    assert builder.joints("actuator_lag") == (1, 2)
    return case, base, builder.build(base, [Proposal(SHIFT, {"log_shift": 0.0072})])


@pytest.mark.gate
def test_knob_shifts_every_experiment_and_nothing_else(shifted: tuple[Path, LoopModel, LoopModel]) -> None:
    case, base, model = shifted
    assert [(k.name, k.owner, k.value) for k in model.free_parameters if k.effect == 0] == [("log_shift", LOG, 0.0072)]
    assert model.loop.plant is base.loop.plant
    for label, experiment in model.experiments.items():
        assert model.loop.systems[label] is base.loop.systems[label]
        every = simulate(case, experiment=label)
        command = every.select(["tau1", "tau2"])
        wanted = np.column_stack([np.interp(experiment.time - 0.0072, every.time, c) for c in command.T])
        torque = model.torque(model.start, label)
        np.testing.assert_allclose(torque, wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.gate
def test_a_shift_costs_no_more_than_its_simulation_records(shifted: tuple[Path, LoopModel, LoopModel]) -> None:
    model = shifted[-1]
    run = model.simulation(model.start)
    ticks = run.operator.ticks
    samples = model.measured.shape[0]
    assert ticks.size <= 2 * samples
    assert run.record().time.size == ticks.size


@pytest.mark.gate
def test_sensitivity_to_the_shift_is_the_rate_of_the_torque(shifted: tuple[Path, LoopModel, LoopModel]) -> None:
    model = shifted[-1]
    torque = model.torque(model.start)
    index = model.names.index("log_shift")
    slope = sensitivity(model, model.start, torque, only=[index])[:, :, 0]
    # 7.2 ms is 1.44 periods: all samples lie between the same two ticks before their stamps.
    far = model.start.copy()
    far[index] = 1.0 / RATE
    near = far.copy()
    near[index] = 2.0 / RATE
    np.testing.assert_allclose(slope, (model.torque(near) - model.torque(far)) * RATE, atol=1e-6 * np.abs(slope).max())
