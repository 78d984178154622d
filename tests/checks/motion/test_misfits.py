"""Misfits along a fitted motion against closed loops that have them, and what a verdict states of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fmu_didim.checks.identification import checked
from fmu_didim.checks.motion.misfits import FittedMotions, Misfit, Misfits
from fmu_didim.checks.power.statement import HOW_TO_CHECK, power_of_fit
from fmu_didim.checks.validation import validate_on, validated
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.dynamics.effects import EFFECTS, DeadZone
from fmu_didim.fit.fit import Fit, point
from fmu_didim.fit.noise.weighting import NoiseOfResidual
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from tests.checks.data.right import loaded, right
from tests.tools.verdict.catalogue import _described, _robot
from tests.tools.verdict.power import along, machine, with_logs

STATED = [name for name, effect in EFFECTS.items() if effect.stated is not None]


def at_the_truth(robot: str) -> Fit:
    model = right(robot, 1, noise=0.01)
    model = model.on("estimation").with_values(loaded(robot).start)
    return point(model, NoiseOfResidual(model))


@pytest.fixture(scope="module", params=["scara", "arm"])
def fitted(request: pytest.FixtureRequest) -> tuple[str, Fit, list[Misfit]]:
    fit = at_the_truth(request.param)
    motions = FittedMotions.of(fit)
    assert motions is not None
    return request.param, fit, list(Misfits.along(motions).stated)


def of(found: list[Misfit], name: str) -> list[Misfit]:
    return [misfit for misfit in found if misfit.load.effect == name]


@pytest.mark.gate
@pytest.mark.parametrize("name", STATED)
def test_a_signature_is_the_change_of_the_closed_loop(fitted: tuple[str, Fit, list[Misfit]], name: str) -> None:
    """Of a misfit that moves the torque by 0.3 times its noise, over all joints in units of it; a log that is late
    moves its first samples further, which are left out."""
    robot, fit, found = fitted
    noise, builder = fit.noise.deviation, LoopModelBuilder(fit.model, _robot(robot))
    for misfit in of(found, name):
        load = misfit.load
        length = np.linalg.norm(misfit.signature / noise)
        size = 0.3 * np.sqrt(np.size(misfit.signature)) / max(length, 1e-9)
        is_zero = np.linalg.norm(misfit.signature / noise) < 1e-6
        size = 0.1 if is_zero else min(size, load.stated.largest)
        effect = EFFECTS[name]
        own = {key: effect.neutral.get(key, 0.0) + size * value for key, value in load.amplitudes.items()}
        proposal = Proposal(EffectAtJoint(name, load.joint), {**effect.neutral, **load.shapes, **own})
        real = builder.build(fit.model, [proposal])
        change = (real.torque(real.start) - fit.torque) / noise
        expected = size * misfit.signature / noise
        if effect.is_of_log:
            change = change * (expected != 0)
        if is_zero:
            assert np.linalg.norm(change) < 0.1 * np.sqrt(change.size)  # a tilt out of the plane is of second order
            continue
        settled = fit.model.experiments["estimation"].time > 0.5  # a delay at the jump of the torque at the start
        assert _like(change[settled], expected[settled]) > 0.995
        assert np.linalg.norm(change[settled]) == pytest.approx(np.linalg.norm(expected[settled]), rel=0.08)


def _like(a: Array, b: Array) -> float:
    return float(np.sum(a * b) / np.linalg.norm(a) / np.linalg.norm(b))


def test_sizes_are_those_of_the_units_in_which_they_are_stated(fitted: tuple[str, Fit, list[Misfit]]) -> None:
    _, fit, found = fitted
    (payload,) = of(found, "payload_change")
    values = fit.model.parameters.values(fit.model.theta(fit.values))
    assert payload.load.joint == 2
    assert payload.load.amplitudes["dMX"] == pytest.approx(0.01 * values["MX2"])
    for misfit in of(found, "thermal_friction_drift"):
        end = misfit.load.amplitudes["Fct"] * (1 - np.exp(-1.0))  # at the end of the log
        assert end == pytest.approx(0.01 * values[f"Fc{misfit.load.joint}"])


def test_what_the_machine_is_said_to_be_is_among_them(fitted: tuple[str, Fit, list[Misfit]]) -> None:
    robot, _, found = fitted
    said = [m.load.effect for m in found if m.load.stated.what in HOW_TO_CHECK]
    gravity = ["gravity"] if robot == "arm" else []  # the SCARA's plane is horizontal
    zeros = [1, 2] if robot == "arm" else [2]  # an axis along gravity, or without it, has no zero that matters
    assert said == ["torque_scale", *gravity, "link_length", *("position_zero" for _ in zeros)]
    assert [m.load.joint for m in of(found, "position_zero")] == zeros
    assert bool(of(found, "base_tilt")) is (robot == "arm")


def test_what_the_model_has_is_not_stated() -> None:
    fit = at_the_truth("scara")
    motions = FittedMotions.of(fit)
    assert motions is not None
    said = {"torque_scale", "link_length", "position_zero"}
    assert {m.load.effect for m in Misfits.along(motions, {"coulomb": EFFECTS["coulomb"]}).stated} == said
    assert {m.load.effect for m in Misfits.along(motions, {"own": DeadZone()}).stated} == {"own", *said}


def test_a_valid_verdict_states_what_it_excludes_and_another_one_does_not() -> None:
    model = right("scara", 101, noise=0.01)
    stated, estimate = judged(model)
    assert stated is not None
    assert {s.effect for s in stated.stated} == set(STATED) - {"base_tilt"}
    assert all(s.size is None or 0 < s.size <= s.largest for s in stated.stated)
    assert {t.what for t in stated.trusted} <= set(HOW_TO_CHECK)
    doubtful = replace(estimate, integration_shift=np.array([0.5]))
    validations = [validate_on(model, estimate.value, label) for label in model.experiments]
    assert checked(doubtful, validations).power is None


def test_a_zero_that_is_off_is_the_change_of_the_closed_loop(fitted: tuple[str, Fit, list[Misfit]]) -> None:
    """Of the same robot that stands elsewhere at zero, along the same reference."""
    robot, fit, found = fitted

    def logged(turn: float, joint: int) -> Array:
        def change(content: dict[str, Any]) -> None:
            content["joints"][joint - 1]["theta"] = turn

        real = replace(_described(robot, change), experiments=fit.model.experiments).on("estimation")
        return real.torque(real.start)

    for misfit in of(found, "position_zero"):
        step = 0.1  # degrees
        change = logged(np.radians(step), misfit.load.joint) - logged(0.0, misfit.load.joint)
        expected = step * misfit.signature
        assert _like(change, expected) > 0.98
        assert np.linalg.norm(change) == pytest.approx(np.linalg.norm(expected), rel=0.05)


@pytest.mark.gate
def test_what_a_misfit_moves_is_what_it_moves() -> None:
    """An offset of the torque below the size that shows is valid, and moves a value as far as is said of it."""
    robot, seed = "arm", 300
    model = along(robot, seed)
    right_torques = {label: model.torque(model.start, label) for label in model.experiments}
    estimates = []
    (stated,) = (
        s for s in judged(with_logs(model, right_torques, seed, 0.01))[0].stated
        if s.effect == "torque_offset" and s.joint == 1
    )  # fmt: skip
    assert stated.moves is not None and abs(stated.moves.deviations) > 10
    for times in (0.0, 0.5):
        real = machine(robot, model, stated, times)
        torques = {label: real.torque(real.start, label) for label in real.experiments}
        power, estimate = judged(with_logs(model, torques, seed, 0.01))
        assert power is not None
        estimates.append(estimate)
    before, after = estimates
    at = before.names.index(stated.moves.parameter)
    moved = (after.value[at] - before.value[at]) / after.standard_deviation[at]
    assert moved == pytest.approx(0.5 * stated.moves.deviations, rel=0.1)


def judged(model: LoopModel):  # type: ignore[no-untyped-def]
    from fmu_didim.estimators import Didim

    estimate = Didim(start="torque").estimate(model)
    validations = validated(estimate)
    return checked(estimate, validations).power, estimate


def test_a_plant_whose_motion_is_not_known_states_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fmu_didim.checks.motion.misfits.simulated_motion", lambda *_: None)
    fit = at_the_truth("scara")
    assert power_of_fit(fit, Misfits.of(fit)) is None


def test_what_the_loop_makes_of_a_load_is_simulated_anew_for_each_course() -> None:
    """Slow loads, of which the answer to a load anywhere along the motion is right; two courses between the same
    instants are two runs."""
    motions = FittedMotions.of(at_the_truth("scara"))
    assert motions is not None
    response, time = motions.responses["estimation"], motions.motions["estimation"].time
    for hertz in (0.3, 0.7):
        load = np.column_stack([np.zeros(time.size), np.sin(2 * np.pi * hertz * time)])
        simulated, answered = response.simulated(load), response.at_samples(load[:, :, None])[:, :, 0]
        for j in np.flatnonzero(load.any(axis=0)):
            alone = np.where(np.arange(load.shape[1]) == j, load, 0.0)
            own = response.at_samples(alone[:, :, None])[:, j]
            np.testing.assert_allclose(response.of_joint(load[:, j, None], j), own, atol=1e-12 * np.abs(own).max())
        assert _like(simulated, answered) > 0.99  # another course has nothing of it
        assert np.linalg.norm(simulated) == pytest.approx(np.linalg.norm(answered), rel=0.02)
