"""The splitting experiment: on data of the proposed motion, the member that is the truth wins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

from fmu_didim.base.errors import InputError
from fmu_didim.case.document import ExperimentSource
from fmu_didim.case.runs.reference import read_reference
from fmu_didim.components import Component, ModelComponent
from fmu_didim.components.compiled_model import with_compiled_twin
from fmu_didim.controllers import read_controller
from fmu_didim.cosim import System, closed_loop, simulate
from fmu_didim.cosim.sampling import sample_operator
from fmu_didim.data.excitation import Fourier, FourierJoint
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.base_model import with_nuisances
from fmu_didim.discovery.excitation.limits import Limits, limits_of
from fmu_didim.discovery.next_experiment.design import (
    PairSeparation,
    SplittingExperiment,
    _split_line,
    design_experiment,
)
from fmu_didim.discovery.next_experiment.members import AmbiguousEffect, DesignContext, ProjectedMotion
from fmu_didim.discovery.next_experiment.motions import Space
from fmu_didim.discovery.next_experiment.programs import candidates
from fmu_didim.discovery.next_experiment.search import Search
from fmu_didim.discovery.next_experiment.separation import amplitudes, separations
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.screening.catalogue import SignatureCatalogue
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot
from fmu_didim.estimators.starts.reference_start import reference_motion
from fmu_didim.fit.noise.noise import Noise
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.experiments import Experiments
from fmu_didim.model.free_parameter import base_free_parameters
from fmu_didim.model.loop import Loop
from fmu_didim.model.loop_model import EffectAtJoint, LoopModel
from fmu_didim.model.parameters import RobotParameters
from tests.helpers import PERIOD, ROOT, on_reference

NOISE = Noise(np.array([0.3, 0.1]), np.array([0.3, 0.3]), "periods")
OFFSET = ("torque_offset", "asymmetric_coulomb")
REVERSAL = ("stribeck", "presliding")
VISCOUS = ("quadratic_viscous", "cubic_viscous")


@cache
def arm() -> RobotDescription:
    """The vertical arm with its base model."""
    return read_robot(ROOT / "fmus/arm2r/robot.yaml")


def motion(*, fundamental_hz: float, size: float) -> Trajectory:
    """A periodic motion of 20 s."""
    cosine = np.array([[0.3, 0.1, -0.05, 0.03, 0.02], [-0.3, 0.15, 0.05, -0.05, 0.02]]) * size
    sine = np.array([[0.3, -0.15, 0.05, 0.03, -0.02], [0.3, 0.1, -0.05, 0.05, 0.02]]) * size
    joints = tuple(
        FourierJoint(offset=o, cosine=tuple(c), sine=tuple(s))
        for o, c, s in zip((0.3, -0.3), cosine.tolist(), sine.tolist(), strict=True)
    )
    return Fourier(fundamental_hz=fundamental_hz, duration_s=20, joints=joints).trajectory(1 / PERIOD)


@cache
def plant(effect: str = "", values: tuple[tuple[str, float], ...] = ()) -> Component:
    """The arm, with an effect at joint 1 if one is named."""
    first, second = arm().joints
    if effect:
        first = first.model_copy(
            update={"effects": (*first.effects, effect), "parameters": {**first.parameters, **dict(values)}}
        )
    robot = arm().model_copy(update={"joints": (first, second)})
    return with_compiled_twin(ModelComponent(RobotModel(robot).block()))


@cache
def controller() -> Component:
    return with_compiled_twin(ModelComponent(read_controller(ROOT / "controllers/arm2r_pd.yaml")))


def loop(of: Component, reference: Trajectory) -> System:
    return closed_loop(
        on_reference(of, reference), controller(), joint_count=2, step_size=PERIOD, reference_names=reference.names
    )


def follow(reference: Trajectory) -> tuple[Array, Array, Array]:
    """Motion of the base model in the loop."""
    recording = simulate(loop(plant(), reference), reference)
    q, dq, ddq = (recording.table([f"plant.{name}{j}" for j in (1, 2)]) for name in ("q", "dq", "ddq"))
    return q, dq, ddq


def measured(of: Component, reference: Trajectory, rate_hz: float, seed: int) -> LoopModel:
    """The base model with the torque log of another plant: point samples with coloured noise."""
    recording = simulate(loop(of, reference), reference)
    ticks = np.arange(0, reference.time.size, round(1 / PERIOD / rate_hz))
    torque = np.column_stack([recording.inputs[f"plant.tau{j}"] for j in (1, 2)])[ticks]
    white, rho = np.random.default_rng(seed).normal(size=torque.shape), NOISE.correlation
    coloured = white.copy()
    for k in range(1, len(white)):
        coloured[k] = rho * coloured[k - 1] + np.sqrt(1 - rho**2) * white[k]
    time, model = reference.time[ticks], RobotModel(arm())
    operator = sample_operator(time, start=0.0, step=PERIOD, tick_count=reference.time.size)
    experiment = Experiment(reference, time, torque + coloured * NOISE.deviation, operator)
    system, parameters = loop(plant(), reference), RobotParameters(model, base_parameters(model))
    return LoopModel(
        Loop({"estimation": system}, parameters, system.components["plant"]), Experiments({"estimation": experiment}),
        base_free_parameters(parameters),
    )  # fmt: skip


def fitted(model: LoopModel, names: Sequence[str]) -> dict[str, FittedCandidate]:
    """Each effect at joint 1, fitted in the closed loop."""
    base = minimise(with_nuisances(model), NOISE)
    builder = LoopModelBuilder(base.model, arm())
    catalogue = SignatureCatalogue(builder, base, candidates=[EffectAtJoint(name, 1) for name in names])
    competition = Competition(builder, base)
    found = competition.compare(competition.screen(catalogue), progress=Progress(), reach=np.inf).ranking
    return {c.effect_at.effect: c for c in found}


def proposal(found: FittedCandidate) -> Proposal:
    values = {
        k.key.removesuffix("1").removesuffix("_"): k.value for k in found.fit.model.free_parameters if k.effect == 0
    }
    return Proposal(found.effect_at, values)


def design(members: Sequence[Proposal], reference: Trajectory, **options: object) -> SplittingExperiment:
    chi, rate = RobotModel(arm()).parameter_values, float(options.pop("rate_hz", 20.0))  # type: ignore[arg-type]
    search = Search(**{"evaluations": 6, "draws": 1, **options})  # type: ignore[arg-type]
    return design_experiment(arm(), chi, members, reference=reference, rate_hz=rate, noise=NOISE, search=search)


def member(effect: str, **values: float) -> Proposal:
    return Proposal(EffectAtJoint(effect, 1), values)


QUICK = {"fundamental_hz": 0.5, "size": 0.5}
SLOWER = {"fundamental_hz": 0.2, "size": 1.0}
WIDER = {"position_scale": 2.0}
DRAWS = (1, 2, 3)
FASTER = {"speed_scale": 2.0, "acceleration_scale": 2.0}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("truth", "values", "names", "rate_hz", "present", "scales"),
    [
        pytest.param(*("asymmetric_coulomb", (("Fca", 0.8),), OFFSET, 20, QUICK, WIDER), marks=pytest.mark.slow),
        pytest.param(*("torque_offset", (("offset", 2.0),), OFFSET, 20, QUICK, WIDER), marks=pytest.mark.slow),
        ("stribeck", (("Fs", 0.4), ("vs", 0.1)), REVERSAL, 50, QUICK, WIDER),
        pytest.param(*("presliding", (("Fd", 0.2), ("zs", 0.005)), REVERSAL, 50, QUICK, WIDER), marks=pytest.mark.slow),
        pytest.param(*("quadratic_viscous", (("Fq", 0.6),), VISCOUS, 100, SLOWER, FASTER), marks=pytest.mark.slow),
        pytest.param(*("cubic_viscous", (("Fcube", 0.3),), VISCOUS, 100, SLOWER, FASTER), marks=pytest.mark.slow),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_the_truth_wins_on_the_proposed_motion(
    truth: str, values: tuple[tuple[str, float], ...], names: tuple[str, str], rate_hz: float,
    present: dict[str, float], scales: dict[str, float],
) -> None:  # fmt: skip
    """Data of the proposed motion decide for the truth (BIC difference beyond 10), whatever noise is drawn, and by much
    more than those of the present motion would."""
    hidden, reference = plant(truth, values), motion(**present)
    (rival,) = set(names) - {truth}

    def by_draw(wanted: Trajectory) -> Array:
        fits = [fitted(measured(hidden, wanted, rate_hz, seed), names) for seed in DRAWS]
        return np.array([fit[truth].delta_bic - fit[rival].delta_bic for fit in fits])

    now = fitted(measured(hidden, reference, rate_hz, DRAWS[0]), names)
    limits = limits_of(reference, 2, **scales)
    found = design(
        [proposal(c) for c in now.values()], reference, rate_hz=rate_hz, limits=limits, follow=follow, evaluations=20,
        draws=3,
    )  # fmt: skip
    assert found.reference is not None
    assert limits.keeps(found.reference)
    pair = next(p for p in found.pairs if p.truth.effect == truth)
    assert pair.then > 1.1 * pair.now
    assert pair.bic_then > max(10.0, pair.bic_now)
    before, then = by_draw(reference), by_draw(found.reference)
    assert then.min() > 10
    assert then.mean() > 1.5 * before.mean()


def test_offset_and_asymmetric_coulomb_are_split_at_rest() -> None:
    reference = motion(**QUICK)
    limits = limits_of(reference, 2, position_scale=2.0)
    found = design(
        [member("torque_offset", offset=2.0), member("asymmetric_coulomb", Fca=0.8)], reference, limits=limits
    )
    assert found.reference is not None
    resting = [np.mean(np.abs(r.select(["dq1"])) < 0.01) for r in (reference, found.reference)]
    assert resting[1] > 5 * resting[0]
    assert found.separation_then > 3 * found.separation_now


PENDULUM = RobotDescription.model_validate(
    {
        "name": "pendulum", "gravity": (0, -9.81, 0),
        "joints": [{"type": "revolute", "effects": ["viscous"], "parameters": {"ZZ": 1.0, "MX": 0.5, "Fv": 0.3}}],
    }
)  # fmt: skip
"""Viscous friction only: its columns are ddq, cos q, sin q and dq."""
PENDULUM_NOISE = Noise(np.array([0.2]), np.array([0.5]), "periods")


def on_pendulum(*proposals: Proposal) -> tuple[ProjectedMotion, list[AmbiguousEffect], Array, Array]:
    """Scene at 50 Hz and members, and by hand: base columns (N, 4) and velocity (N,)."""
    reference, model = motion(**SLOWER), RobotModel(PENDULUM)
    context = DesignContext(PENDULUM, model.parameter_values, PENDULUM_NOISE, 50.0, EFFECTS)
    members = [AmbiguousEffect(p, context, model) for p in proposals]
    q, dq, ddq = (v[: reference.time.size - 1 : 4, 0] for v in reference_motion(reference, 1))
    return ProjectedMotion(context, model, reference), members, np.column_stack([ddq, np.cos(q), np.sin(q), dq]), dq


def test_separation_is_what_least_squares_leaves() -> None:
    motion_projection, members, base, dq = on_pendulum(
        member("quadratic_viscous", Fq=0.7), member("cubic_viscous", Fcube=0.4)
    )
    table = separations(motion_projection, members, amplitudes(motion_projection, members))
    quadratic, cubic = 0.7 * dq * np.abs(dq), 0.4 * dq**3
    for pair, own, other in (((0, 1), quadratic, cubic), ((1, 0), cubic, quadratic)):
        every = np.column_stack([base, other])
        rest = own - every @ np.linalg.lstsq(every, own, rcond=None)[0]
        expected, count = np.sqrt(0.5 / 1.5) / 0.2 * np.linalg.norm(rest), dq.size * 0.5 / 1.5
        assert table[pair].distance == pytest.approx(expected, rel=1e-6)
        assert table[pair].margin == pytest.approx(count * np.log1p(expected**2 / count), rel=1e-6)


def test_a_member_without_amplitudes_gets_those_of_its_likeness() -> None:
    motion_projection, members, base, dq = on_pendulum(member("quadratic_viscous", Fq=0.7), member("cubic_viscous"))
    found = amplitudes(motion_projection, members)
    both = np.column_stack([base, dq**3])
    expected = np.linalg.lstsq(both, 0.7 * dq * np.abs(dq), rcond=None)[0][-1]
    np.testing.assert_allclose([*found[0], *found[1]], [0.7, expected], rtol=1e-6)


@pytest.mark.gate
@pytest.mark.parametrize("seed", range(4))
def test_limits_are_kept(seed: int) -> None:
    """Every candidate with any design: within the limits, from rest to rest at one place, derivatives that fit."""
    rng = np.random.default_rng(seed)
    low = rng.uniform(-2, 0, size=3)
    limits = Limits(low, low + rng.uniform(0.2, 3, size=3), rng.uniform(0.3, 4, size=3), rng.uniform(1, 30, size=3))
    space = Space(limits, 12.0, PERIOD, np.array([np.nan, 0.002, np.nan]))
    for candidate in candidates(space, seed=seed):
        size = candidate.design.size
        for u in (candidate.design, np.zeros(size), np.ones(size), rng.random(size)):
            built = candidate.build(u)
            found = built if isinstance(built, Trajectory) else built.trajectory(1 / PERIOD)
            assert found.time[-1] == pytest.approx(12.0)
            q, dq, ddq = reference_motion(found, 3)
            assert (q >= limits.low).all() and (q <= limits.high).all()
            assert (np.abs(dq) <= limits.speed).all() and (np.abs(ddq) <= limits.acceleration).all()
            for table in (dq[0], dq[-1], ddq[0], q[0] - q[-1]):
                np.testing.assert_allclose(table, 0, atol=1e-9)
            # Position is the integral of velocity, by the trapezoidal rule within a jerk of one tick.
            np.testing.assert_allclose(
                np.diff(q, axis=0), (dq[1:] + dq[:-1]) / 2 * PERIOD, atol=0.3 * PERIOD**2 * limits.acceleration.max()
            )


def test_lag_and_delay_are_not_promised() -> None:
    found = design([member("actuator_lag", T=0.004), member("delay", delay=0.004)], motion(**QUICK))
    assert found.reference is None and found.excitation is None
    assert not found.is_sufficient
    assert all(p.same and p.bic_then < 1 for p in found.pairs)
    assert "torque alone cannot split them" in found.description
    assert found.advice == tuple(f"{EFFECTS[n].title}: {EFFECTS[n].experiment}" for n in ("actuator_lag", "delay"))
    with pytest.raises(InputError, match="No motion splits"):
        found.save("anywhere.csv")


@pytest.mark.gate
def test_what_can_be_split_is_split_beside_what_cannot() -> None:
    members = [member("actuator_lag", T=0.004), member("delay", delay=0.004), member("stribeck", Fs=0.5)]
    found = design(members, motion(**SLOWER), rate_hz=100.0, evaluations=20, draws=3)
    assert found.reference is not None
    same = {frozenset((p.truth.effect, p.rival.effect)) for p in found.pairs if p.same}
    assert same == {frozenset(("actuator_lag", "delay"))}
    assert found.separation_then > found.separation_now > 0
    assert not found.is_sufficient


def test_a_shifted_log_moves_the_torque_of_all_joints_and_a_lag_that_of_one() -> None:
    found = design([member("actuator_lag", T=0.004), member("log_time_shift", log_shift=-0.004)], motion(**QUICK))
    assert found.reference is not None
    assert not any(p.same for p in found.pairs)


def test_members_that_no_motion_shows_are_said_to_be_so() -> None:
    found = design([member("controller_gain", controller_gain=1.1), member("stribeck", Fs=0.5)], motion(**QUICK))
    assert found.reference is None
    assert "closed-loop simulations only" in found.description


@pytest.mark.gate
def test_the_same_seed_gives_the_same_experiment() -> None:
    members = [member("torque_offset", offset=2.0), member("asymmetric_coulomb", Fca=0.8)]
    first, second, other = (design(members, motion(**QUICK), seed=seed) for seed in (5, 5, 6))
    assert first.reference is not None and second.reference is not None and other.reference is not None
    assert first.description == second.description
    assert first.reference.digest() == second.reference.digest() != other.reference.digest()


def test_a_case_takes_the_saved_reference(tmp_path: Path) -> None:
    found = design([member("torque_offset", offset=2.0), member("asymmetric_coulomb", Fca=0.8)], motion(**QUICK))
    joints = (FourierJoint(cosine=(0.1,), sine=(0.2,)),) * 2
    series = Fourier(fundamental_hz=0.5, duration_s=4.0, joints=joints)
    smooth = replace(found, excitation=series, reference=series.trajectory(1 / PERIOD))
    table = replace(found, excitation=None)
    for experiment in (smooth, table):
        assert experiment.reference is not None
        path = experiment.save(tmp_path / "next.yaml")
        source = ExperimentSource.model_validate(yaml.safe_load(path.read_text(encoding="utf-8")))
        again = read_reference(source.reference, tmp_path, step=PERIOD, torque_units=("N.m", "N.m")).signals
        np.testing.assert_allclose(again.values, experiment.reference.values, atol=1e-7)
    with pytest.raises(InputError, match=r"\.csv, \.yaml"):
        table.save(tmp_path / "next.txt")


def test_no_worse_motion_is_proposed() -> None:
    """Within a hundredth of the range nothing separates better than the present motion."""
    reference = motion(**SLOWER)
    tight = limits_of(reference, 2, position_scale=0.01, speed_scale=0.1)
    found = design([member("quadratic_viscous", Fq=0.6), member("cubic_viscous", Fcube=0.3)], reference, limits=tight)
    assert found.reference is None and not found.is_sufficient
    assert "better than the present one" in found.description
    assert all(p.then == p.now for p in found.pairs)


def test_nothing_to_split_and_no_room() -> None:
    with pytest.raises(InputError, match="nothing to split"):
        design([member("stribeck", Fs=1.0)], motion(**QUICK))
    with pytest.raises(InputError, match="no room"):
        limits_of(motion(**QUICK), 2, speed_scale=0.0)


@pytest.mark.parametrize(
    ("then", "told"),
    [
        (0.5, "separation from 1e-14 to 0.5 times the noise, BIC difference to expect from 8 to 9."),
        (2e-14, "the same with some of its values; only that it has more parameters speaks against it, by a BIC"),
    ],
)
def test_what_splits_two_effects_is_told_as_it_is(then: float, told: str) -> None:
    """Friction by load is an efficiency that does not ask for the direction of power."""
    first, second = EffectAtJoint("load_dependent_friction", 3), EffectAtJoint("directional_efficiency", 3)
    line = _split_line(PairSeparation(first, second, 1e-14, then, 8.0, 9.0, same=False))
    assert line.startswith(
        "If load_dependent_friction on joint 3 is the truth and not directional_efficiency on joint 3"
    )
    assert told in line
