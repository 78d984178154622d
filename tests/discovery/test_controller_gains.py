"""A controller with other gains than its description: each found by its own factor, and only where it is there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.stats import binomtest

from fmu_didim import discover
from fmu_didim.case import load_case
from fmu_didim.data.signals import trajectory, write_csv
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.gains import found_gains, gain_notes
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.document import values_found
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.dynamics.robot import read_robot
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from tests.discovery.helpers import GAINS, arm_case, arm_model, coloured, with_torque

GAINS_OF_1 = EffectAtJoint("controller_gains", 1)
FACTORS = {"position_gain": 0.6, "velocity_gain": 1.3}
REPEATED = 60
"""[logs] Of which the intervals are counted."""


def with_other_gains(case: Path, position: float, velocity: float, **more: Any) -> Path:
    """The case with a controller description of which these factors on joint 1 make the true one."""
    path = case.parent / "controller.yaml"
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["Kp"][0], content["Kd"][0] = content["Kp"][0] / position, content["Kd"][0] / velocity
    path.write_text(yaml.safe_dump({**content, **more}, sort_keys=False), encoding="utf-8")
    return case


def model_of(case: Path, **changes: Any) -> LoopModel:
    """Of a case on disk, with other entries."""
    content = yaml.safe_load(case.read_text(encoding="utf-8"))
    case.write_text(yaml.safe_dump({**content, **changes}, sort_keys=False), encoding="utf-8")
    model = load_case(case).model
    assert model is not None
    return model


def with_factors(model: LoopModel, folder: Path, **factors: float) -> LoopModel:
    builder = LoopModelBuilder(model, read_robot(folder / "robot.yaml"))
    return builder.build(model, [Proposal(GAINS_OF_1, factors)])


@pytest.fixture
def case(tmp_path: Path) -> Path:
    arm_model(tmp_path, seconds=4.0)
    return tmp_path / "case.yaml"


class TestInTheLoop:
    @pytest.mark.parametrize("kind", ["model", "fmu", "control"])
    def test_factors_are_other_gains(self, case: Path, kind: str) -> None:
        """Whatever runs the controller."""
        controller = {"kind": kind, "source": "controller.yaml"}
        assumed = model_of(with_other_gains(case, 0.6, 1.3), controller=controller)
        changed = with_factors(assumed, case.parent, **FACTORS)
        true = model_of(with_other_gains(case, 1 / 0.6, 1 / 1.3), controller=controller)
        torque, wanted = changed.torque(changed.start), true.torque(true.start)
        assert np.abs(torque - wanted).max() < 1e-9 * np.abs(wanted).max()
        assert np.abs(torque - assumed.torque(assumed.start)).max() > 1e-3 * np.abs(wanted).max()

    def test_derivatives_are_those_of_the_factors(self, case: Path) -> None:
        """Not of the gains, which are thousands of times as large."""
        model = with_factors(model_of(case), case.parent, **FACTORS)
        places = [i for i, p in enumerate(model.free_parameters) if p.effect == 0]
        assert [model.names[i] for i in places] == ["position_gain_1", "velocity_gain_1"]
        exact = sensitivity(model, model.start, model.outputs(model.start), only=places)
        for k, i in enumerate(places):
            step = np.where(np.arange(model.start.size) == i, 1e-6, 0.0)
            by_difference = (model.torque(model.start + step) - model.torque(model.start - step)) / 2e-6
            assert np.abs(exact[:, :, k] - by_difference).max() < 1e-4 * np.abs(by_difference).max()

    def test_they_multiply_what_a_run_states(self, case: Path) -> None:
        content = yaml.safe_load(case.read_text(encoding="utf-8"))
        stiff = {**content["train"], "gains": {"Kp1": 9000.0}}
        model = with_factors(model_of(case, validation=stiff), case.parent, **FACTORS)
        assert {
            label: model.system(model.start, label).components["controller"].parameter_values()["Kp1"]
            for label in ("estimation", "validation")
        } == {"estimation": pytest.approx(0.6 * GAINS[0][0]), "validation": pytest.approx(0.6 * 9000.0)}

    @pytest.mark.parametrize(
        ("controller", "identify", "gains"),
        [
            ({}, {}, ["Kd1", "Kp1"]),
            ({}, {"Kp1": {"of": "controller"}}, []),  # which is free already: one factor alone is left
            ({"law": "pid", "Ki": [500.0]}, {}, ["Kd1", "Ki1", "Kp1"]),
            ({"law": "pid", "Ki": [0.0]}, {}, ["Kd1", "Kp1"]),
            ({"law": "pid", "Ki": [500.0]}, {"Ki1": {"of": "controller"}}, ["Kd1", "Kp1"]),
        ],
    )
    def test_what_is_offered(
        self, case: Path, controller: dict[str, Any], identify: dict[str, Any], gains: list[str]
    ) -> None:
        model = model_of(with_other_gains(case, 1.0, 1.0, **controller), identify=identify)
        placed = LoopModelBuilder(model, read_robot(case.parent / "robot.yaml")).at(GAINS_OF_1)
        assert placed.can_be_added == bool(gains)
        if gains:
            assert sorted(key for _, key in placed.gains.values()) == gains  # type: ignore[attr-defined]
            assert len(placed.amplitudes) == placed.cost == len(gains)


@pytest.mark.gate
def test_two_gains_are_found_and_stated(tmp_path: Path) -> None:
    document = discover(with_other_gains(arm_case(tmp_path), 0.6, 1.3), tmp_path / "out")
    assert (document.answer, document.verdict) == ("named", "valid")
    (finding,) = document.findings
    assert (finding.effect, finding.class_, finding.joint) == ("controller_gains", "controller_gain", 1)
    assert finding.place == "controller" and finding.ambiguous == []
    for value, true in zip(finding.parameters, FACTORS.values(), strict=True):
        assert value.std is not None and abs(value.value - true) < 3 * value.std < 0.2 * true
    case = yaml.safe_load((tmp_path / "out/case_augmented.yaml").read_text(encoding="utf-8"))
    for run in ("train", "validation"):
        assert case[run]["gains"] == {"Kp1": pytest.approx(3000.0, rel=0.1), "Kd1": pytest.approx(150.0, rel=0.1)}
    (note,) = [note for note in document.notes if note.startswith("To change the controller of joint 1: ")]
    assert "controller.Kp1 = " in note and "instead of 5000, controller.Kd1 = " in note
    (rerun,) = [note for note in document.notes if "augmented case, run" in note]
    assert float(rerun.split(" of its peak")[0].rpartition(" ")[2]) < 2e-3
    assert all("controller_gains" not in j.effects for j in read_robot(tmp_path / "out/robot_augmented.yaml").joints)


@pytest.mark.gate
def test_one_factor_of_all_gains_is_one_parameter(tmp_path: Path) -> None:
    """Two would explain as much; they are told as its rival."""
    document = discover(with_other_gains(arm_case(tmp_path), 0.6, 0.6))
    assert document.answer == "named"
    (finding,) = document.findings
    assert finding.effect == "controller_gain" and [rival.effect for rival in finding.ambiguous] == ["controller_gains"]
    (note,) = [note for note in document.notes if note.startswith("To change the controller of joint 1: ")]
    assert "is 0.6" in note or "is 0.59" in note


@pytest.mark.slow
@pytest.mark.parametrize(
    ("added", "allowed"),
    [
        ({}, set()),
        ({"actuator_lag": {"T": 0.004}}, {"actuator_lag", "delay", "log_time_shift"}),
        ({"delay": {"delay": 0.004}}, {"actuator_lag", "delay", "log_time_shift"}),
        ({"spring": {"k": 8.0}}, {"spring", "cubic_spring"}),
        ({"quadratic_viscous": {"Fq": 0.8}}, {"quadratic_viscous", "cubic_viscous", "power_viscous"}),
    ],
)
def test_what_looks_like_other_gains_is_not_called_so(tmp_path: Path, added: dict[str, Any], allowed: set[str]) -> None:
    """A lower gain of the position is a softer gear, one of the velocity a lag and a drag."""
    document = discover(arm_case(tmp_path, added))
    assert {finding.effect for finding in document.findings} <= allowed
    assert bool(document.findings) == bool(allowed)


@pytest.mark.slow
@pytest.mark.parametrize("off", [0.02, -0.05])
def test_a_start_off_the_reference_is_no_gain(tmp_path: Path, off: float) -> None:
    """Its transient is that of a loop with other gains, but what follows has the stated ones."""
    case = arm_case(tmp_path)
    model = model_of(case)
    content = yaml.safe_load(case.read_text(encoding="utf-8"))
    rng = np.random.default_rng(1)
    for key, label in (("train", "estimation"), ("validation", "validation")):
        experiment = model.experiments[label]
        begin = float(experiment.reference.column("q1")[0]) + off
        start = replace(experiment.initial_state, values={"q1": begin})
        run = model.with_experiment(label, replace(experiment, initial_state=start)).simulation(model.start, label)
        torque = run.torque()[:, 0] + 0.1 * rng.normal(size=experiment.time.size)
        write_csv(trajectory(experiment.time, {"tau1": torque}), tmp_path / content[key]["torque"]["file"])
    document = discover(case)
    assert not {"controller_gain", "controller_gains"} & {finding.effect for finding in document.findings}


def test_notes_name_the_joint_and_the_way(case: Path) -> None:
    """Of two factors and of one."""
    model = with_torque(base := model_of(case), base.measured)
    builder = LoopModelBuilder(model, read_robot(case.parent / "robot.yaml"))
    one = EffectAtJoint("controller_gain", 1)
    proposals = [Proposal(GAINS_OF_1, FACTORS), Proposal(one, {"controller_gain": 0.8})]
    built = builder.build(model, proposals)
    fit: Any = type("Fitted", (), {"model": built, "values": built.start})()
    assert found_gains(fit, "estimation") == {
        "controller.Kp1": (3000.0, pytest.approx(1800.0)), "controller.Kd1": (150.0, pytest.approx(195.0)),
    }  # fmt: skip
    first, second = gain_notes(fit, builder)
    assert "joint 1: controller.Kp1 = 1800 instead of 3000, controller.Kd1 = 195 instead of 150." in first
    assert "its command is 0.8 times that of its law" in second
    assert EFFECTS[one.effect].class_name == EFFECTS[GAINS_OF_1.effect].class_name


@pytest.mark.slow
def test_intervals_of_gains_hold_the_true_ones_beside_what_no_effect_explains(tmp_path: Path) -> None:
    """Beside model error as large as half of the noise, which stays on one side for a quarter of a second: 95 % of them
    should. By the noise alone fewer do."""
    arm_model(tmp_path)
    rng, model = np.random.default_rng(5), model_of(tmp_path / "case.yaml")
    builder = LoopModelBuilder(model, read_robot(tmp_path / "robot.yaml"))
    true = builder.build(model, [Proposal(GAINS_OF_1, FACTORS)])
    torque, noise = true.torque(true.start), Noise(np.array([0.2]), np.zeros(1), "residual")
    held = {False: 0, True: 0}
    for _ in range(REPEATED):
        rest = coloured(rng, torque.shape, rho=0.96, sigma=0.1) + 0.2 * rng.normal(size=torque.shape)
        fit = minimise(with_torque(true, torque + rest), noise, stopping=Stopping(exact=True))
        for with_rest in held:
            values = values_found(fit, lambda parameter: parameter.effect == 0, with_rest=with_rest)
            truth = zip(values, FACTORS.values(), strict=True)
            held[with_rest] += sum(v.interval[0] <= t <= v.interval[1] for v, t in truth if v.interval)
    count = 2 * REPEATED
    assert binomtest(held[True], count, 0.95).pvalue > 0.01, held
    assert binomtest(held[False], count, 0.95).pvalue < 0.01, held


def test_intervals_of_what_the_case_states_are_never_shorter_than_by_noise(case: Path) -> None:
    """Where nothing but noise is left they are the same but for chance; they count what is left where that is more."""
    model = model_of(case)
    builder = LoopModelBuilder(model, read_robot(case.parent / "robot.yaml"))
    true = builder.build(model, [Proposal(GAINS_OF_1, FACTORS)])
    torque, rng = true.torque(true.start), np.random.default_rng(2)
    noise = Noise(np.array([0.2]), np.zeros(1), "residual")
    ratios = []
    for slow in (0.0, 0.4):
        rest = coloured(rng, torque.shape, rho=0.96, sigma=slow) + 0.2 * rng.normal(size=torque.shape)
        fit = minimise(with_torque(true, torque + rest), noise, stopping=Stopping(exact=True))
        by_noise, with_rest = (
            np.array([v.std for v in values_found(fit, lambda p: p.effect == 0, with_rest=w)], float)
            for w in (False, True)
        )  # fmt: skip
        ratios.append(with_rest / by_noise)
    assert (ratios[0] >= 1).all() and (ratios[0] < 1.2).all() and (ratios[1] > 1.5).all()
