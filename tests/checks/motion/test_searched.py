"""Whether a residual that repeats along a joint, or comes from a stop, is told from noise, which a fit takes it for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.checks.data.checks import data_diagnostics
from fmu_didim.checks.identification import checked
from fmu_didim.checks.motion import searched
from fmu_didim.checks.motion.dependence import DEPENDS_ON_MOTION, motion_diagnostics
from fmu_didim.checks.motion.functions import at_ripples, beyond, looks_like, near
from fmu_didim.checks.motion.misfits import FittedMotions
from fmu_didim.checks.motion.searched import PLACES, Near, Stop, numbers_of_ripples, places, searched_of_fit
from fmu_didim.checks.validation import validated
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.estimators import Didim
from fmu_didim.fit.fit import point
from fmu_didim.fit.noise.weighting import NoiseOfResidual
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from tests.tools.verdict.catalogue import NOISE
from tests.tools.verdict.drawn import nameless
from tests.tools.verdict.power import along, builder, with_logs


def right_motions(robot: str, seed: int) -> FittedMotions:
    """The motions of a machine without ripple, at its true values."""
    model = along(robot, seed)
    torques = {label: model.torque(model.start, label) for label in model.experiments}
    model = with_logs(model, torques, seed, NOISE)
    motions = FittedMotions.of(point(model, NoiseOfResidual(model)))
    assert motions is not None
    return motions


def with_residual(motions: FittedMotions, residual: Array) -> FittedMotions:
    """The same with another residual (N, n)."""
    fit = motions.fit
    return replace(motions, fit=replace(fit, outputs=fit.model.measured_outputs - residual))


def logs_of(model: LoopModel, robot: str, seed: int, effect: str, joint: int, values: dict[str, float]) -> LoopModel:
    """The right model with the logs of a machine that has an effect."""
    real = builder(robot).build(model, [Proposal(EffectAtJoint(effect, joint), values)])
    return with_logs(model, {label: real.torque(real.start, label) for label in real.experiments}, seed, NOISE)


def reasons(model: LoopModel) -> list[Diagnostic]:
    """What is doubted of the answer, where the residual follows the motion."""
    before, estimate = data_diagnostics(model), Didim(start="torque").estimate(model)
    validations = validated(estimate)
    judgement = checked(estimate, validations, before=before).judgement
    assert judgement.verdict == "doubtful"
    return [d for d in judgement.reasons if d.code is DEPENDS_ON_MOTION]


def rippled(robot: str, seed: int, effect: str, joint: int, number: float, size: float) -> LoopModel:
    """The right model with the logs of a machine that has a ripple, of so much of the peak torque of a joint, or of
    what it transmits."""
    model = along(robot, seed)
    right = {label: model.torque(model.start, label) for label in model.experiments}
    peak = float(np.abs(right["estimation"][:, joint - 1]).max()) if effect == "torque_ripple" else 1.0
    names = [v.name for v in builder(robot).effects[effect].parameters(builder(robot).loop.joint_type(joint))]
    values = {"nr": number} | dict(zip(names, (0.8 * size * peak, 0.6 * size * peak), strict=True))
    return logs_of(model, robot, seed, effect, joint, values)


@pytest.mark.parametrize(
    ("robot", "effect", "joint", "number", "size"),
    [
        ("scara", "current_ripple", 2, 8, 0.06),
        ("scara", "torque_ripple", 1, 23, 0.03),
        pytest.param("arm", "torque_ripple", 2, 12, 0.03, marks=pytest.mark.gate),
        pytest.param("arm", "current_ripple", 1, 7, 0.06, marks=pytest.mark.gate),
        pytest.param("arm", "torque_ripple", 1, 36, 0.03, marks=pytest.mark.gate),
    ],
)
def test_a_ripple_is_doubted_and_told_with_its_number(
    robot: str, effect: str, joint: int, number: float, size: float
) -> None:
    told = reasons(rippled(robot, 1025, effect, joint, number, size))
    assert [d.place for d in told] == [f"joint {joint}"]
    assert f"most with the position at {number} ripples a turn, as a ripple of the torque would" in told[0].text
    assert "In the catalogue" not in told[0].text  # no suspect repeats so often


def test_a_stop_is_doubted_and_told_with_its_place() -> None:
    """It was valid at 6.2 sigma, with a residual of 3.3 times the noise."""
    values = {"qlower": -0.959, "wstop": 0.00354, "klower": 0.256}
    (told,) = reasons(logs_of(along("scara", 5067), "scara", 5067, "contact_stop_lower", 2, values))
    assert told.place == "joint 2"
    assert "most with the position below -0.958 rad, as a stop or a spring that begins there would" in told.text


@pytest.mark.parametrize(
    ("seed", "length"),
    [(1, 7.56), pytest.param(2, 2.0, marks=pytest.mark.gate), pytest.param(4, 7.56, marks=pytest.mark.gate)],
)
def test_friction_that_changes_along_the_joint_is_doubted(seed: int, length: float) -> None:
    """It was valid at 7 to 10 sigma: the model takes up the mean, and no function followed the rest."""
    values = {"v0": 0.02, "lp": length, "Fcos": 0.0754, "Fsin": 0.016}
    (told,) = reasons(logs_of(along("scara", seed), "scara", seed, "position_dependent_friction", 1, values))
    assert told.place == "joint 1"
    assert "most with the direction of motion at " in told.text
    assert "as friction that changes along the joint would" in told.text


@pytest.mark.gate
@pytest.mark.parametrize(
    ("robot", "seed", "place"),
    [
        ("scara", 4011, "joint 2: position of joint 1 near"), ("arm", 4016, "joint 2: load near"),
        pytest.param("arm", 4051, "joint 1: position near", marks=pytest.mark.slow),
        pytest.param("scara", 4058, "joint 1: velocity near", marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_a_bump_is_doubted_and_told_with_its_place(robot: str, seed: int, place: str) -> None:
    """Drawn torques without a name, which were valid at 4.5 to 7.2 sigma, with 2 to 140 times the squares of noise."""
    model = along(robot, seed)
    torque = model.torque(model.start, "estimation")
    found = nameless(np.random.default_rng([seed, 31]), model, torque, robot)
    assert found is not None
    logs = {label: found[1].torque(found[1].start, label) for label in model.experiments}
    told = reasons(with_logs(along(robot, seed), logs, seed, NOISE))
    joint, follows = place.split(": ")
    assert [d.place for d in told] == [joint]
    assert f"most with the {follows}" in told[0].text


def test_places_of_a_bump() -> None:
    """Own position, velocity, load and time, position and velocity of the neighbours; none of what stands still."""
    motion = right_motions("scara", 1).motions["estimation"]
    found = places([motion], 1, [False, False])
    assert len(found) == 6 * sum(PLACES)
    assert {one.name.partition(" near ")[0] for one in found} == {
        "position", "velocity", "load", "time", "position of joint 1", "velocity of joint 1",
    }  # fmt: skip
    still = replace(motion, q=np.zeros_like(motion.q))
    assert {one.quantity for one in places([still], 1, [False, False])} == {"velocity", "load", "time"}


def test_loads_near_a_value() -> None:
    """Two hats beside each other: between their tops they add up to one."""
    motion = right_motions("scara", 1).motions["estimation"].at(np.arange(4))
    motion = replace(motion, q=np.array([[0.0, 9.0], [0.5, 9.0], [0.75, 9.0], [2.0, 9.0]]))
    loads = np.column_stack(Near("position", 0, False, 0.5, 0.5, False).loads(motion, 1))
    np.testing.assert_allclose(loads, [[0, 0], [1, 0], [0.5, 0.5], [0, 0]])


@pytest.mark.parametrize(
    ("name", "like"),
    [
        (near("position", 0.5, slides=True), "a detent or a worn place"),
        (near("velocity", 0.5, slides=False), "friction with a peak or a resonance there"),
        (near("load", 0.5, slides=False), "a gear that changes there"),
        (near("time", 0.5, slides=False), "a push from outside"),
        (near("velocity", 0.5, slides=False, joint=2), "a cable or a hose across the joints"),
        ("velocity near standstill", "steeper friction at standstill"),
    ],
)
def test_what_a_bump_looks_like(name: str, like: str) -> None:
    assert looks_like(name) == like


@pytest.mark.parametrize(("above", "depth"), [(True, [0.0, 0.0, 0.5]), (False, [1.5, 0.5, 0.0])])
def test_loads_of_a_stop_begin_at_its_place(above: bool, depth: list[float]) -> None:
    motion = right_motions("scara", 1).motions["estimation"].at(np.arange(3))
    motion = replace(motion, q=np.array([[9.0, -1.0], [9.0, 0.0], [9.0, 1.0]]))
    np.testing.assert_allclose(Stop(0.5, above, False).loads(motion, 1), np.array([depth, np.square(depth)]))


@pytest.mark.gate
@pytest.mark.parametrize(
    ("robot", "colour"),
    [
        ("scara", (1.0,)),
        pytest.param("scara", (1.0, -0.8), marks=pytest.mark.gate),
        pytest.param("scara", (1.0, -1.2, 0.4), marks=pytest.mark.gate),
        pytest.param("arm", (1.0, -0.8), marks=pytest.mark.gate),
    ],
)
def test_noise_is_neither(robot: str, colour: tuple[float, ...]) -> None:
    """Of 60 draws at a level of one in 20, at most nine may be said to be one of them: more are so in one of 500."""
    motions = right_motions(robot, 1)
    said = 0
    for seed in range(30):
        white = np.random.default_rng(seed).normal(size=(200 + motions.fit.residual.shape[0], 2))
        noise = motions.fit.deviation * lfilter([1.0], colour, white, axis=0)[200:]
        said += sum(d.p_value < 0.05 for d in searched_of_fit(with_residual(motions, noise)))
    assert said <= 9


def test_it_does_not_depend_on_how_many_are_looked_at_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    motions = right_motions("scara", 1)
    whole = searched_of_fit(motions)
    monkeypatch.setattr(searched, "AT_ONCE", 4 * 7 * motions.motions["estimation"].q.size)
    for one, other in zip(whole, searched_of_fit(motions), strict=True):
        assert (one.most, one.joint) == (other.most, other.joint)
        assert one.p_value == pytest.approx(other.p_value, rel=1e-9)


def test_a_residual_of_nothing_or_few_samples_are_no_question() -> None:
    motions = right_motions("scara", 1)
    assert searched_of_fit(with_residual(motions, np.zeros_like(motions.fit.residual))) == []


@pytest.mark.parametrize(
    ("slides", "reach", "speed", "spacing", "first", "last", "count"),
    [
        (False, 1.0, 1.0, 0.005, 1.0, 120.0, 120),
        (False, 1.0, 5.0, 0.005, 1.0, 83.0, 83),  # three instants of loads in a ripple
        (False, 1.0, 0.0, 0.005, None, None, 0),  # it stands still
        (True, 0.25, 0.1, 0.005, 4 * np.pi, 3129.0, 249),
        (True, 2.0, 0.1, 0.005, np.pi / 2, 628.3, 400),  # the longest ones
        (True, 0.25, 1.0, 0.005, 4 * np.pi, 414.7, 33),
    ],
)  # fmt: skip
def test_which_numbers_are_tried(
    slides: bool, reach: float, speed: float, spacing: float, first: float | None, last: float | None, count: int
) -> None:
    found = numbers_of_ripples(slides=slides, reach=reach, speed=speed, spacing=spacing)
    assert found.size == count
    if count:
        assert (found[0], found[-1]) == (pytest.approx(first), pytest.approx(last, rel=1e-3))


def test_how_it_is_told() -> None:
    assert at_ripples(8.0, slides=False) == "position at 8 ripples a turn"
    assert at_ripples(1.0, slides=False) == "position at 1 ripple a turn"
    assert at_ripples(628.3, slides=True) == "position at a ripple every 10 mm"
    assert looks_like(at_ripples(8.0, slides=False)) == "a ripple of the torque"
    assert beyond(-0.9584, above=False, slides=False) == "position below -0.958 rad"
    assert beyond(0.05, above=True, slides=True) == "position above 50 mm"
    assert looks_like(beyond(0.05, above=True, slides=True)) == "a stop or a spring that begins there"
    assert motion_diagnostics(searched_of_fit(right_motions("scara", 1))) == []
