"""Loops with derivatives against central differences of the loops themselves, and what an identification then costs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.documents import validate
from fmu_didim.case import load_case
from fmu_didim.components import Component, FmuComponent, ModelComponent, block_as_control, load_fmu
from fmu_didim.cosim import System, insert_effect, simulate
from fmu_didim.cosim.derivatives import with_derivatives
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.estimators.starts.start import with_free_delay
from fmu_didim.export import build_fmu
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.model.loop_model import LoopModel
from tests.cases import TRUTH
from tests.helpers import (
    PERIOD,
    law_block,
    loop,
    model_of,
    reference,
    scara,
    scara_cascade,
    scara_pd,
    with_component,
)
from tests.tools.benchmarks.counting import simulated

EXAMPLE = "examples/scara/identify.yaml"
MOTION = reference(1.0)
IDENTIFIED = ("ZZ1", "Fv1", "Fc1", "ZZ2", "MX2", "MY2", "Fv2", "Fc2")


def closed(controller: Component | None = None, **options: Any) -> System:
    return loop(ModelComponent(scara().block()), controller or ModelComponent(scara_pd()), MOTION, **options)


def arm(effect: str, **parameters: float) -> System:
    """A vertical arm of two joints with an effect in the first."""
    own = {"ZZ": 1.2, "MX": 1.5, "M": 3.0, "Fv": 2.0, "Fc": 1.5}
    joints: list[Mapping[str, Any]] = [
        {"type": "revolute", "alpha": np.pi / 2, "effects": ["motor_inertia", "viscous", "coulomb", effect],
         "parameters": {**own, "Ia": 0.5, **parameters}},
        {"type": "revolute", "a": 0.4, "effects": ["viscous", "coulomb"], "parameters": own},
    ]  # fmt: skip
    robot = validate(RobotDescription, {"name": "arm", "joints": joints}, where="robot.yaml")
    gains = law_block(law="pd", joints=["revolute"] * 2, Kp=[1500, 600], Kd=[80, 40])
    return loop(ModelComponent(RobotModel(robot).block()), ModelComponent(gains), MOTION)


def torques(system: System) -> np.ndarray:
    recording = simulate(system, reference(1.0, period=system.step_size))
    return np.column_stack([recording.inputs[f"plant.tau{j}"] for j in (1, 2)])


def differences(system: System, names: tuple[str, ...], relative: float) -> np.ndarray:
    """(K, 2, p) central differences of the torques."""
    plant, columns = system.components["plant"], []
    for name in names:
        value = plant.parameter_values()[name]
        step = relative * max(abs(value), 0.01)
        pair = [torques(system.replace("plant", plant.with_parameters({name: value + s * step}))) for s in (1, -1)]
        columns.append((pair[0] - pair[1]) / (2 * step))
    return np.stack(columns, axis=2)


def derivatives(system: System, names: tuple[str, ...]) -> np.ndarray:
    """(K, 2, p) from one run."""
    varied = with_derivatives(system, [("plant", name) for name in names])
    assert varied is not None
    recording = simulate(varied, reference(1.0, period=system.step_size))
    assert recording.compiled
    return np.stack(
        [np.column_stack([recording.inputs[f"plant.tau{j}@{i}"] for i in range(len(names))]) for j in (1, 2)], axis=1
    )


LIMIT = {"stall": 2.6, "no_load_speed": 8.0}


def limited(**values: float) -> System:
    """The loop whose second joint is at its limit for a while, at several speeds, as :func:`at_limit` tells."""
    return insert_effect(closed(), EFFECTS["voltage_limit"], 2, "revolute", values=LIMIT | values)


def at_limit(system: System) -> np.ndarray:
    """(K,) whether the drive is at its limit."""
    recording = simulate(system, reference(1.0, period=system.step_size))
    return np.asarray(recording.inputs["voltage_limit2.u"] != recording.applied["voltage_limit2.y"])


LOOPS: Mapping[str, Callable[[], System]] = {
    "PD": closed,
    "python-control": lambda: closed(block_as_control(scara_pd())),
    "cascade that saturates": lambda: closed(ModelComponent(scara_cascade())),
    "delay": lambda: closed(delay_samples=1.3),
    "Jacobi": lambda: closed(jacobi=True),
    "slow controller": lambda: replace(closed(), step_size=PERIOD / 2, every={"controller": 2}),
    "substeps": lambda: replace(closed(), substeps={"plant": 3}),
    "outputs after the step": lambda: replace(closed(), after_step=frozenset({"controller"})),
    "limit that falls with the speed": lambda: limited(),
    "lag of a drive": lambda: insert_effect(closed(), EFFECTS["actuator_lag"], 2, "revolute", values={"T": 0.004}),
}


@pytest.mark.gate
@pytest.mark.parametrize("name", LOOPS)
def test_derivatives_are_those_of_the_loop(name: str) -> None:
    check(LOOPS[name](), IDENTIFIED)


@pytest.mark.gate
def test_derivatives_by_the_values_of_a_limit_are_there_where_it_is_reached() -> None:
    names, reached = ("stall", "no_load_speed"), at_limit(limited())
    assert 10 < reached.sum() < 0.9 * reached.size
    assert not at_limit(limited(stall=1e9)).any()
    for values in ({}, {"stall": 1e9}):
        system = limited(**values)
        varied = with_derivatives(system, [("voltage_limit2", name) for name in names])
        assert varied is not None
        recording = simulate(varied, reference(1.0, period=system.step_size))
        ours = np.column_stack([recording.inputs[f"plant.tau2@{i}"] for i in range(2)])
        if values:
            assert (ours == 0).all()
            continue
        part, columns = system.components["voltage_limit2"], []
        for name in names:
            step = 1e-6 * LIMIT[name]
            pair = [
                torques(system.replace("voltage_limit2", part.with_parameters({name: LIMIT[name] + s * step})))
                for s in (1, -1)
            ]
            columns.append((pair[0] - pair[1])[:, 1] / (2 * step))
        theirs = np.column_stack(columns)
        assert (np.abs(theirs[: int(np.argmax(reached))]) < 1e-9).all()  # before it is reached first
        assert np.abs(ours - theirs).max() < 1e-4 * np.abs(theirs).max()
        assert (np.abs(theirs).max(axis=0) > 1e-3).all()


EFFECTS_OF_AN_ARM: Mapping[str, tuple[dict[str, float], tuple[str, ...]]] = {
    "lugre": ({"Fz": 1.5, "Fzs": 0.8, "zs": 0.02}, ("Fz1", "Fzs1", "ZZ2")),
    "load_dependent_friction": ({"Fl": 0.12}, ("Fl1", "MX1", "ZZ2")),
    "thermal_friction_drift": ({"Fvt": -0.4, "Fct": -0.6, "Theat": 2.0}, ("Fvt1", "Fct1", "Fc2")),
    "joint_elasticity": ({"K": 2e4, "D": 50.0}, ("ZZ1", "K_1", "Fv2")),
}


@pytest.mark.gate
@pytest.mark.parametrize("name", EFFECTS_OF_AN_ARM)
def test_derivatives_with_an_effect_of_the_arm(name: str) -> None:
    """Also by shape parameters, which enter nonlinearly, and where no balance of rigid joints is known."""
    values, varied = EFFECTS_OF_AN_ARM[name]
    check(arm(name, **values), varied)


def check(system: System, names: tuple[str, ...]) -> None:
    """Against the better of two differences: short steps are rough by rounding, long ones meet limits of the law. The
    substeps are stated: where they are not, a plant without derivatives may be integrated by RK4."""
    plant = system.components["plant"]
    known = plant.equations()
    assert known is not None
    step = system.step_size * system.every.get("plant", 1) / system.substeps.get("plant", 1)
    stated = plant.with_substeps(known[0].automatic_substeps(step))
    assert stated is not None
    loose = derivatives(system, names)
    system = system.replace("plant", stated)
    found, errors = derivatives(system, names), []
    assert np.linalg.norm(found - loose) <= 1e-4 * np.linalg.norm(found)
    for relative in (1e-4, 1e-5):
        expected = differences(system, names, relative)
        errors.append(np.linalg.norm(found - expected, axis=(0, 1)) / np.linalg.norm(expected, axis=(0, 1)))
    assert (np.min(errors, axis=0) <= 1e-6).all()


def test_a_component_without_known_equations_has_no_derivatives() -> None:
    identified = [("plant", name) for name in IDENTIFIED]
    file = load_fmu(build_fmu(scara().block()))
    assert with_derivatives(loop(file, ModelComponent(scara_pd()), MOTION), identified) is None
    known = replace(file, block=scara().block())
    assert with_derivatives(loop(known, ModelComponent(scara_pd()), MOTION), identified) is not None
    assert with_derivatives(closed(), [("plant", "ZZ1"), ("plant", "unknown")]) is None
    assert with_derivatives(closed(), [("plant", "ZZ1"), ("nowhere", "ZZ1")]) is None


@pytest.fixture(scope="module")
def model() -> LoopModel:
    return model_of(EXAMPLE)


def without_equations(model: LoopModel) -> LoopModel:
    """The same with a plant FMU that might be another tool's."""
    return with_component(model, "plant", replace(model.loop.plant, block=None))  # type: ignore[call-arg]


def test_both_ways_give_the_same_sensitivity(model: LoopModel) -> None:
    """Within the truncation error of the forward differences; the delay is a difference in both."""
    model = with_free_delay(model)
    values = np.append(TRUTH, 0.0)
    torque = model.torque(values)
    found = sensitivity(model, values, torque)
    expected = sensitivity(without_equations(model), values, torque)
    size = np.linalg.norm(expected, axis=(0, 1))
    assert (np.linalg.norm(found - expected, axis=(0, 1)) <= 1e-4 * size).all()
    np.testing.assert_array_equal(found[:, :, -1], expected[:, :, -1])


def test_both_ways_give_the_same_estimate(model: LoopModel) -> None:
    estimator = load_case(EXAMPLE).estimator
    plant = model.loop.plant.with_substeps(8)
    assert plant is not None
    model = model.with_loop(plant=plant)  # as chosen by the one that has no equations
    found, runs = simulated(model, estimator)
    expected, before = simulated(without_equations(model), estimator)
    assert (np.abs(found.value - expected.value) <= 1e-3 * expected.standard_deviation).all()
    # The start diverges. Two sensitivities: at the end of DIDIM and near the minimum; one run checks the integration,
    # one whether the held-out log starts on its reference.
    assert (len(runs.plain), len(runs.varied)) == (9, 2)
    assert (len(before.plain), len(before.varied)) == (25, 0)


def test_stated_substeps_are_raised_where_they_would_be_unstable(model: LoopModel) -> None:
    """Explicit integration of friction that is too fast for its step wanders about: an error surface without slope."""
    plant = model.loop.plant.with_substeps(4)
    assert isinstance(plant, FmuComponent) and plant.block is not None
    explicit = replace(plant, block=replace(plant.block, implicit=None))
    stated, implicit = model.with_loop(plant=explicit), model.with_loop(plant=plant)
    light = TRUTH * np.array([1, 1, 1, 0.02, 0.02, 0.02, 1, 20])

    def substeps(model: LoopModel, values: np.ndarray) -> int | None:
        return model.system(values).components["plant"].stated_substeps

    assert substeps(stated, TRUTH) == 4
    assert substeps(stated, light) > 8
    assert substeps(implicit, light) == 4  # stable as it is
    assert substeps(implicit.with_loop(substep_factor=2), TRUTH) == 8
    assert substeps(model, light) is None  # chosen by the plant itself


def test_a_loop_with_derivatives_is_made_again_for_other_equations_alone() -> None:
    """With other values it is wired as before and gives what a new one gives, to the bit; another link: another one."""
    system = closed()
    plant, names = system.components["plant"], [("plant", name) for name in IDENTIFIED]
    first = with_derivatives(system, names)
    moved = system.replace("plant", plant.with_parameters({"ZZ1": 1.1 * plant.parameter_values()["ZZ1"]}))
    again, alone = with_derivatives(moved, names), replace(moved)
    assert first is not None and again is not None and again.connections is first.connections
    assert (derivatives(moved, IDENTIFIED) == derivatives(alone, IDENTIFIED)).all()
    robot = scara().description
    joints = tuple(joint.model_copy(update={"a": 1.2 * joint.a}) for joint in robot.joints)
    longer = ModelComponent(RobotModel(robot.model_copy(update={"joints": joints})).block())
    other = system.replace("plant", longer.with_parameters(plant.parameter_values()))
    assert (derivatives(other, IDENTIFIED) == derivatives(replace(other), IDENTIFIED)).all()
    assert (derivatives(other, IDENTIFIED) != derivatives(system, IDENTIFIED)).any()
