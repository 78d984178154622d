"""Blind cases: the simulator against equations written apart from it, the folders, the harness and the scoring."""

from __future__ import annotations

import builtins
import csv
import io
import json
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.integrate import solve_ivp

from fmu_didim import simulate
from fmu_didim.base.errors import InputError
from tests.tools.blind import campaign, harness
from tests.tools.blind.__main__ import main
from tests.tools.blind.campaign import PAIRS, drawn_together, make_campaign
from tests.tools.blind.harness import by_campaign, case_folders, evaluate, read_lines, reduced
from tests.tools.blind.publish import read_rows, write_rows
from tests.tools.blind.score import CLASSES, SHRINKS_SURELY, Truth, read_truth, same_class, score, text
from tests.tools.blind.simulator.design import Design, development_design, random_motion, varied_design
from tests.tools.blind.simulator.equations import base_columns, rigid_torque, root_mean_square
from tests.tools.blind.simulator.hidden import EFFECTS, HARMONIC_DRIVE, UNKNOWN
from tests.tools.blind.simulator.make import Plant, gap, instants, make_plant, noise, write_cases
from tests.tools.blind.simulator.native import SimulationFailedError, run
from tests.tools.blind.translate import translate

SMOOTHING = 1e-4
"""rad/s over which the simulator rounds the sign of dry friction."""
GEOMETRY = {"LENGTH": 0.4, "GRAVITY_X": -2.0, "GRAVITY_Y": -9.0}
ROBOT = {"ZZ1R": 1.6, "MX1": 2.5, "MY1": -0.3, "ZZ2": 0.4, "MX2": 0.8, "MY2": 0.15}
GAINS = np.array([[2800.0, 130.0, 0.0], [420.0, 18.0, 0.0]])
SIGN = np.array([1.0, -1.0])
RATE = 200


def motion(seed: int = 3, *, seconds: float = 6.0) -> tuple[np.ndarray, np.ndarray]:
    design = development_design(np.random.default_rng(seed))
    return random_motion(np.random.default_rng(seed), design).at(np.arange(seconds * RATE) / RATE)


def simulated(*joints: Mapping[str, float], **options: Any) -> Any:
    """A run without encoder step; the second joint turns clockwise."""
    own = [{"FV": 1.5, "FC": 2.0}, {"FV": 0.7, "FC": 0.9, "ROTOR": 0.12}]
    full = tuple({**base, **more} for base, more in zip(own, joints or ({}, {}), strict=True))
    values = {"gains": GAINS, "sign": SIGN, "robot": {**ROBOT, **GEOMETRY}, **options}
    return run(values.pop("reference", None) or motion(), period_s=1 / RATE, joints=full, **values)


def residual(found: Any) -> np.ndarray:
    """Command minus the torque of the links, the rotor and the base friction, in the convention of the joints."""
    q, dq, ddq = (SIGN * x for x in (found.q, found.dq, found.ddq))
    torque = SIGN * rigid_torque(
        ROBOT, q, dq, ddq, length=0.4, gravity=(GEOMETRY["GRAVITY_X"], GEOMETRY["GRAVITY_Y"])
    )  # fmt: skip
    torque[:, 1] += 0.12 * found.ddq[:, 1]
    return found.command - torque - np.array([1.5, 0.7]) * found.dq - np.array([2.0, 0.9]) * sign(found.dq)


def sign(v: np.ndarray) -> np.ndarray:
    return np.tanh(v / SMOOTHING)


# ---- the simulator ---------------------------------------------------------------------------------


def test_torque_is_that_of_the_inverse_model() -> None:
    found = simulated()
    assert root_mean_square(found.command).min() > 2.0
    assert np.abs(residual(found)).max() < 1e-9


def rates(command: np.ndarray) -> Callable[[float, np.ndarray], np.ndarray]:
    """The motion's equations in plain numpy: the mass matrix from unit accelerations of the inverse model."""
    gravity = (GEOMETRY["GRAVITY_X"], GEOMETRY["GRAVITY_Y"])

    def links(q: np.ndarray, v: np.ndarray, a: np.ndarray, g: tuple[float, float]) -> np.ndarray:
        return rigid_torque(ROBOT, q[None], v[None], a[None], length=0.4, gravity=g)[0]

    def of(t: float, state: np.ndarray) -> np.ndarray:
        q, v = SIGN * state[:2], SIGN * state[2:]
        mass = np.column_stack([links(q, 0 * v, unit, (0.0, 0.0)) for unit in np.eye(2)]) + np.diag([0.0, 0.12])
        torque = (
            SIGN * command - np.array([1.5, 0.7]) * v - np.array([2.0, 0.9]) * sign(v) - links(q, v, 0 * v, gravity)
        )
        return np.concatenate([state[2:], SIGN * np.linalg.solve(mass, torque)])

    return of


@pytest.mark.gate
def test_motion_is_that_of_another_integrator() -> None:
    """From tick to tick with an implicit method; every thirtieth tick, and those at which a joint turns round."""
    found = simulated(tolerance=1e-11)
    turning = np.flatnonzero((found.dq[:-1] * found.dq[1:] < 0).any(axis=1))
    assert turning.size >= 6
    for k in {*range(0, found.q.shape[0] - 1, 30), *turning[:6]}:
        state = np.concatenate([found.q[k], found.dq[k]])
        end = solve_ivp(rates(found.command[k]), (0, 1 / RATE), state, method="Radau", rtol=1e-9, atol=1e-12).y[:, -1]
        assert end == pytest.approx(np.concatenate([found.q[k + 1], found.dq[k + 1]]), abs=2e-7)


def test_energy_of_a_free_swing_is_kept() -> None:
    start = (np.tile([0.4, -0.3], (600, 1)), np.tile([1.0, -2.0], (600, 1)))
    found = simulated(
        {"FV": 0.0, "FC": 0.0}, {"FV": 0.0, "FC": 0.0}, gains=np.zeros((2, 3)), reference=start, tolerance=1e-10
    )
    kinetic, potential = energy(found)
    assert np.ptp(kinetic) > 5.0
    assert np.ptp(kinetic + potential) < 1e-6 * np.ptp(kinetic)


def energy(found: Any, rotor: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Kinetic and potential energy of the links, less a rotor that ZZ1R holds and that turns in another way."""
    q, dq = SIGN * found.q, SIGN * found.dq
    length, g = 0.4, (GEOMETRY["GRAVITY_X"], GEOMETRY["GRAVITY_Y"])
    # M dq from the inverse model with the acceleration dq, at rest and without gravity.
    momentum = rigid_torque(ROBOT, q, 0 * dq, dq, length=length, gravity=(0.0, 0.0))
    momentum += [-rotor, 0.12] * dq
    x = ROBOT["MX1"] * np.cos(q[:, 0]) - ROBOT["MY1"] * np.sin(q[:, 0])
    y = ROBOT["MX1"] * np.sin(q[:, 0]) + ROBOT["MY1"] * np.cos(q[:, 0])
    both = q.sum(axis=1)
    x = x + ROBOT["MX2"] * np.cos(both) - ROBOT["MY2"] * np.sin(both)
    y = y + ROBOT["MX2"] * np.sin(both) + ROBOT["MY2"] * np.cos(both)
    return 0.5 * np.sum(momentum * dq, axis=1), -(g[0] * x + g[1] * y)


def test_uneven_teeth_turn_the_link_as_stated_and_lose_no_power() -> None:
    """A stiff gear of 0.04 rad at 5 periods in 2 pi, which starts at rest and without twist."""
    size, number, rotor, phase = 0.04, 5.0, 0.5, -5 * 0.4
    gear = {"GEAR_STIFFNESS": 1e6, "GEAR_DAMPING": 0.0, "ROTOR": rotor, "FV": 0.0, "FC": 0.0}
    error = {"TRANSMISSION": size, "TRANSMISSION_NUMBER": number, "TRANSMISSION_PHASE": phase}
    still = {"FV": 0.0, "FC": 0.0}
    start = (np.tile([0.4, -0.3], (600, 1)), np.tile([0.0, -2.0], (600, 1)))
    found = simulated({**gear, **error}, still, gains=np.zeros((2, 3)), reference=start, tolerance=1e-9)
    motor = found.q[:, 0].copy()
    for _ in range(50):
        motor = found.q[:, 0] - size * np.sin(number * motor + phase)
    turn = 1 + size * number * np.cos(number * motor + phase)
    kinetic, potential = energy(found, rotor)
    moved = 0.5 * rotor * (found.dq[:, 0] / turn) ** 2
    assert np.ptp(moved) > 1.0
    assert np.ptp(kinetic + moved + potential) < 0.005 * np.ptp(kinetic + moved)


@pytest.mark.parametrize(
    ("form", "torque"),
    [
        ({"GEAR_CUBIC": 0.02}, lambda linear: linear * (1 + 0.02 * linear**2)),
        (
            {"GEAR_GROWTH": 1.0, "GEAR_STEP": 1.0},
            # Corners of torque over K x: 1 at 1, and 1 + 1.5 more over 1.5 K; then 2 K.
            lambda linear: np.sign(linear) * np.interp(np.abs(linear), [0.0, 1.0, 2.0, 12.0], [0.0, 1.0, 2.5, 22.5]),
        ),
    ],
)
def test_a_gear_hardens_as_stated(form: dict[str, float], torque: Callable[[np.ndarray], np.ndarray]) -> None:
    """What moves link 2 is that function of the twist; where the motor is, a controller without damping says."""
    stiffness, stiff = 60.0, 400.0
    gear = {"GEAR_STIFFNESS": stiffness, "GEAR_DAMPING": 0.0, **form}
    found = simulated({}, gear, gains=np.array([[3000.0, 150.0, 0.0], [stiff, 0.0, 0.0]]))
    twist = motion()[0][:, 1] - found.command[:, 1] / stiff - found.q[:, 1]
    q, dq, ddq = (SIGN * x for x in (found.q, found.dq, found.ddq))
    gravity = (GEOMETRY["GRAVITY_X"], GEOMETRY["GRAVITY_Y"])
    through = (SIGN * rigid_torque(ROBOT, q, dq, ddq, length=0.4, gravity=gravity))[:, 1]
    linear = stiffness * twist
    assert np.abs(through - torque(linear)).max() < 1e-6 * np.abs(through).max()
    assert np.abs(through).max() > 1.3 * np.abs(linear).max()


def test_hardening_is_a_part_of_the_torque_of_the_gear_at_the_largest_command() -> None:
    """There the cube is a times the linear part, and both together are the command."""
    plant, path, deviation = make_plant(
        ["joint_elasticity", "gear_hardening"], np.random.default_rng(5), level=2.0, one_joint=True, reach=0.5
    )
    elasticity, hardening = plant.hidden
    assert elasticity.joint == hardening.joint and 0.0 < hardening.amplitude <= 0.5
    bare, _ = replace(plant, hidden=()).simulate(path)
    largest = np.abs(bare.command[:, hardening.joint]).max()
    linear = largest / (1 + hardening.amplitude)
    cubic = hardening.form.joint(hardening.amplitude)["GEAR_CUBIC"] * linear**3
    assert linear + cubic == pytest.approx(largest) and cubic == pytest.approx(hardening.amplitude * linear)
    assert gap(plant, path, deviation).refitted.max() > 0.5


def test_tolerance_hardly_matters() -> None:
    coarse, fine = simulated(), simulated(tolerance=1e-11)
    assert fine.steps > 1.2 * coarse.steps
    assert np.abs(coarse.command - fine.command).max() < 1e-3 * np.abs(fine.command).max()


STATIC: dict[str, tuple[dict[str, float], Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]]] = {
    "offset": ({"OFFSET": 0.7}, lambda t, q, v: 0.7 + 0 * q),
    "asymmetric dry": ({"ASYMMETRIC_DRY": 0.5}, lambda t, q, v: 0.5 * sign(v) ** 2),
    "asymmetric viscous": ({"ASYMMETRIC_VISCOUS": 0.3}, lambda t, q, v: 0.6 * np.maximum(v, 0)),
    "power": ({"POWER_GAIN": 0.4, "POWER_EXPONENT": 1.5}, lambda t, q, v: 0.4 * sign(v) * np.abs(v) ** 1.5),
    "stribeck": (
        {"STRIBECK": 0.8, "STRIBECK_VELOCITY": 0.2, "STRIBECK_EXPONENT": 1.0},
        lambda t, q, v: 0.8 * sign(v) * np.exp(-np.abs(v) / 0.2),
    ),
    "ripple": (
        {"RIPPLE_SINE": 0.3, "RIPPLE_COSINE": 0.2, "RIPPLE_NUMBER": 12.0},
        lambda t, q, v: 0.3 * np.sin(12 * q) + 0.2 * np.cos(12 * q),
    ),
    "spring": (
        {"SPRING": 1.5, "SPRING_REST": 0.2, "SPRING_CUBIC": 0.2},
        lambda t, q, v: 1.5 * (q - 0.2) * (1 + 0.2 * (q - 0.2) ** 2),
    ),
    "stop": (
        {"STOP": 60.0, "STOP_POSITION": 0.9, "STOP_DAMPING": 0.6},
        lambda t, q, v: np.where(q > 0.9, 60 * (q - 0.9) ** 2 + 0.6 * (q - 0.9) * v, 0.0),
    ),
    "drift": ({"DRIFT": 0.6, "DRIFT_TIME": 4.0}, lambda t, q, v: 0.6 * (1 - np.exp(-t / 4.0))),
    "chirp": (
        {"CHIRP": 0.5, "CHIRP_START": 0.4, "CHIRP_RATE": 0.2},
        lambda t, q, v: 0.5 * np.sin(2 * np.pi * (0.4 + 0.1 * t) * t),
    ),
}


@pytest.mark.parametrize("name", STATIC)
def test_effect_adds_the_torque_it_states(name: str) -> None:
    fields, torque = STATIC[name]
    found = simulated(fields, {})
    time = np.arange(found.q.shape[0]) / RATE
    expected = torque(time, found.q[:, 0], found.dq[:, 0])
    assert root_mean_square(expected[:, None])[0] > 0.02
    left = residual(found) - np.column_stack([expected, 0 * expected])
    assert np.abs(left).max() < 1e-9


def test_load_friction_follows_the_transmitted_torque() -> None:
    found = simulated({}, {"LOAD_SHARE": 0.1})
    turned = [SIGN * x for x in (found.q, found.dq, found.ddq)]
    links = rigid_torque(ROBOT, *turned, length=0.4, gravity=(GEOMETRY["GRAVITY_X"], GEOMETRY["GRAVITY_Y"]))
    expected = 0.1 * np.abs(links[:, 1]) * sign(found.dq[:, 1])
    assert np.abs(residual(found)[:, 1] - expected).max() < 1e-6
    assert np.abs(expected).max() > 0.3


def test_saturation_gains_and_shifted_payload_act_where_they_should() -> None:
    assert np.abs(simulated({"LIMIT": 20.0}, {}).command[:, 0]).max() == 20.0
    fallen = simulated({"STALL": 25.0, "NO_LOAD_SPEED": 4.0}, {})
    left = fallen.dq[:, 0] / 4.0
    room = np.minimum(25.0 * (1 - left) - fallen.command[:, 0], 25.0 * (1 + left) + fallen.command[:, 0])
    reached = room < 1e-9
    assert room.min() > -1e-9
    assert reached.sum() > 20 and np.ptp(np.abs(left[reached])) > 0.1
    gain = simulated({"DRIVE_GAIN": 1.25}, {})
    plain = simulated()
    assert np.abs(1.25 * gain.command - plain.command)[:, 0].max() < 0.1 * np.abs(plain.command[:, 0]).max()
    loaded = simulated(robot={**ROBOT, **GEOMETRY, "PAYLOAD": 0.5, "PAYLOAD_TIME": 3.0, "PAYLOAD_LENGTH": 0.3})
    difference = np.abs(loaded.command - plain.command)
    assert difference[: int(2.5 * RATE)].max() < 1e-3 < difference[int(3.5 * RATE) :].max()


def test_lag_delay_and_gear_change_only_what_is_between_command_and_link() -> None:
    """A slow motion: the lagging torque is the command T later, the twist of the gear follows the torque."""
    found = simulated({"LAG": 0.01, "LAG_SPLIT": 1.0}, {})
    links = found.command[:, 0] - residual(found)[:, 0]
    late = np.interp(np.arange(links.size) - 2.0, np.arange(links.size), found.command[:, 0])
    error = [np.sqrt(np.mean((links - x)[200:] ** 2)) for x in (found.command[:, 0], late)]
    assert error[1] < 0.5 * error[0]
    delayed = simulated({"DELAY": 0.0125}, {})
    links = delayed.command[:, 0] - residual(delayed)[:, 0]
    # The command of 2.5 ticks before: at a tick, that of three ticks before still acts.
    assert np.abs(links[10:] - delayed.command[7:-3, 0]).max() < 1e-9
    plain = simulated()
    stiff, soft, gap = (
        root_mean_square(simulated({}, {"GEAR_DAMPING": 1.0, **fields}).command - plain.command)[1]
        for fields in (
            {"GEAR_STIFFNESS": 800.0},
            {"GEAR_STIFFNESS": 200.0},
            {"GEAR_STIFFNESS": 800.0, "GEAR_GAP": 0.02},
        )
    )
    assert 2 * stiff < soft < 0.3 * root_mean_square(plain.command)[1]
    assert 1.5 * stiff < gap


def test_presliding_ends_as_dry_friction_and_divergence_is_an_error() -> None:
    found = simulated({"PRESLIDING_SHARE": 1.0, "PRESLIDING_LENGTH": 0.01}, {})
    left = np.abs(residual(found)[:, 0])
    assert left.max() > 0.5
    fast = np.abs(found.dq[:, 0]) > 0.5
    assert np.median(left[fast]) < 0.02
    with pytest.raises(SimulationFailedError):
        simulated(gains=np.array([[-1e5, -1e5, 0.0], [-1e5, -1e5, 0.0]]))


def test_encoder_step_is_seen_in_the_command() -> None:
    step = 1e-4
    rounded = simulated(gains=GAINS + np.array([0.0, 0.0, step]))
    assert 0.1 < root_mean_square(rounded.command - simulated().command)[0] < 10 * 130 * step * RATE


def test_base_columns_span_the_torque_of_the_base_model() -> None:
    found = simulated()
    turned = [SIGN * x for x in (found.q, found.dq, found.ddq)]
    gravity = (GEOMETRY["GRAVITY_X"], GEOMETRY["GRAVITY_Y"])
    columns = base_columns(*turned, length=0.4, gravity=gravity, smoothing=SMOOTHING)
    values = [*ROBOT.values(), 1.5, 2.0, 0.7, 0.9, 0.12]
    assert np.abs(columns @ values - SIGN * found.command).max() < 1e-9


# ---- the folders -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "effect", ["stribeck", "joint_elasticity", "delay", "torque_saturation", "voltage_limit", "unknown_push"]
)
def test_effects_reach_the_gap_that_is_asked_for(effect: str) -> None:
    plant, path, deviation = make_plant([effect], np.random.default_rng(11), level=2.0)
    size = gap(plant, path, deviation)
    assert size.refitted.max() == pytest.approx(2.0, rel=0.25)
    assert (size.plain >= 0.6 * size.refitted).all()


@pytest.mark.gate
def test_a_harmonic_drive_has_all_its_parts_on_one_joint() -> None:
    plant, path, deviation = make_plant(HARMONIC_DRIVE, np.random.default_rng(3), level=1.5)
    assert [h.effect for h in plant.hidden] == list(HARMONIC_DRIVE)
    assert len({h.joint for h in plant.hidden}) == 1
    assert gap(plant, path, deviation).refitted.max() > 1.0


@pytest.mark.gate
def test_a_plant_whose_gear_rings_is_drawn_anew(tmp_path: Path) -> None:
    """Whatever the hysteresis, the sampled controller makes this gear ring."""
    seed, what = 9812, "+".join(HARMONIC_DRIVE)
    with pytest.raises(SimulationFailedError, match="no amplitude of presliding brings its gap near 1"):
        make_plant(HARMONIC_DRIVE, np.random.default_rng([seed, zlib.crc32(what.encode())]), level=1.5)
    make_campaign(tmp_path, [what], seeds=range(seed, seed + 1), rates=[20], level=1.5)
    (truth,) = (yaml.safe_load(path.read_text()) for path in tmp_path.glob("*/truth.yaml"))
    assert max(truth["gap_after_refit_sigma_rms_per_joint"]["train"]) < 6.0


def test_what_cannot_be_simulated_keeps_no_other_plant_from_being_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A delay and an elastic gear on one joint have no stable loop."""
    made = list[str]()

    def make(order: campaign.Order) -> None:
        if len(order.effects) > 1:
            raise SimulationFailedError("no plant of 10 with delay, joint_elasticity could be simulated")
        made.append(order.folders[0][0].name)

    monkeypatch.setattr(campaign, "make_order", make)
    with pytest.raises(SimulationFailedError, match=r"b000\d_20hz: no plant of 10 with delay, joint_elasticity"):
        make_campaign(
            tmp_path, ["delay+joint_elasticity", "delay", "spring"], seeds=range(1, 2), rates=[20], level=1.5
        )  # fmt: skip
    assert len(made) == 2


@pytest.mark.gate
def test_gains_grow_beyond_their_limit_where_that_is_asked_for(tmp_path: Path) -> None:
    """By less than a half they change the torque less than what is judged."""
    sizes = []
    for reach in (1.0, 1.8):
        folder = tmp_path / str(reach)
        make_campaign(folder, ["controller_gain"], seeds=range(721, 722), rates=[20], level=1.5, reach=reach)
        (truth,) = (yaml.safe_load(path.read_text())["truth"][0] for path in folder.glob("*/truth.yaml"))
        sizes.append(truth["amplitude"])
    assert sizes[0] <= 0.45 < sizes[1] <= 1.8 * 0.45


@pytest.mark.gate
def test_two_effects_act_on_one_joint_where_that_is_asked_for(tmp_path: Path) -> None:
    for one_joint, count in ((True, 1), (False, 2)):
        folder = tmp_path / str(one_joint)
        make_campaign(folder, ["spring+torque_offset"], seeds=range(3, 4), rates=[20], level=1.5, one_joint=one_joint)
        truth = read_truth(folder / "b0001_20hz")
        assert [effect for effect, _ in truth.effects] == ["spring", "torque_offset"]
        assert len({joint for _, joint in truth.effects}) == count


@pytest.mark.gate
def test_of_three_effects_each_must_show(tmp_path: Path) -> None:
    """A case counts where the least gap that one of them makes beside the others is one that is judged."""
    (case, _) = made(tmp_path, *HARMONIC_DRIVE, robots="varied")
    content = yaml.safe_load((case / "truth.yaml").read_text())
    own = [effect["gap_beside_sigma"] for effect in content["truth"]]
    assert min(own) > 1.0
    assert read_truth(case).gap == min(own)
    content["truth"][1]["gap_beside_sigma"] = 0.7
    (case / "truth.yaml").write_text(yaml.safe_dump(content))
    assert read_truth(case).gap == 0.7
    rows = [line(case.name, *read_truth(case).effects)]
    assert counts(rows, {case.name: read_truth(case)})["all of three effects found"] == (0, 0)


@pytest.mark.gate
@pytest.mark.parametrize("first", [1, 9101])
def test_triples_are_of_the_first_seed_without_other_cases(tmp_path: Path, first: int) -> None:
    make_campaign(tmp_path, [], seeds=range(first, first), rates=[100], level=1.0, triples=1, robots="development")
    (case,) = case_folders(tmp_path)
    hidden = tuple(effect for effect, _ in read_truth(case).effects)
    assert hidden == drawn_together(1, 3, first_seed=first)[0]


@pytest.mark.gate
def test_a_plant_of_which_nothing_can_be_logged_is_drawn_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn, write = list[Plant](), campaign.write_cases

    def fails(times: int) -> None:
        def written(folders: Sequence[tuple[Path, int]], plant: Plant, *rest: Any) -> None:
            drawn.append(plant)
            if len(drawn) <= times:
                raise SimulationFailedError("no motion of twenty could be simulated")
            write(folders, plant, *rest)

        monkeypatch.setattr(campaign, "write_cases", written)

    fails(1)
    make_campaign(tmp_path / "one", ["spring"], seeds=range(3, 4), rates=[20], level=1.5, robots="development")
    assert len(drawn) == 2 and drawn[0].hidden != drawn[1].hidden
    assert read_truth(tmp_path / "one" / "b0001_20hz").effects[0][0] == "spring"
    drawn.clear()
    fails(campaign.DRAWS)
    with pytest.raises(SimulationFailedError, match=f"no plant of {campaign.DRAWS} with spring"):
        make_campaign(tmp_path / "two", ["spring"], seeds=range(3, 4), rates=[20], level=1.5, robots="development")


@pytest.mark.slow
def test_every_effect_and_pair_can_be_made() -> None:
    for i, names in enumerate([*EFFECTS, *UNKNOWN, *PAIRS]):
        plant, path, deviation = make_plant(names.split("+"), np.random.default_rng([2, i]), level=1.5)
        assert [h.effect for h in plant.hidden] == names.split("+")
        assert gap(plant, path, deviation).refitted.max() > 0.2, names


def test_three_effects_are_drawn_that_can_act_together() -> None:
    """Each of the catalogue comes up, none beside one that counts as the same, and the seed says which."""
    drawn = drawn_together(200, 3, first_seed=7)
    assert len(drawn) == 200 and all(len(set(one)) == 3 for one in drawn)
    assert {name for one in drawn for name in one} == set(EFFECTS)
    assert not any(same_class(a, b) for one in drawn for a in one for b in one if a != b)
    assert drawn == drawn_together(200, 3, first_seed=7) != drawn_together(200, 3, first_seed=8)


def test_three_effects_count_as_found_only_together_and_a_further_name_is_false() -> None:
    effects = (("spring", 1), ("stribeck", 2), ("base_tilt", None))
    truths = {name: Truth(effects, 2.0, True, 100.0) for name in ("all", "two", "more")}
    right = [("spring", 1), ("stribeck", 2), ("base_tilt", 1)]
    lines = [line("all", *right), line("two", *right[:2]), line("more", *right, ("dead_zone", 1))]
    found = {rate.name: (rate.good, rate.count) for rate in score(lines, truths).rates}
    assert found["all of three effects found"] == (2, 3)
    assert found["no false name beside three effects"] == (2, 3)
    assert found["both of two effects found"] == (0, 0)
    assert [note.split(":")[0] for note in score(lines, truths).notes] == ["two", "more"]


@pytest.mark.parametrize(
    ("findings", "sets", "good", "right", "held"),
    [
        ([("cubic_spring", 1)], {0: ["spring@1"]}, 0, 1, 1),
        ([("spring", 1), ("torque_offset", 1)], {}, 1, 1, 1),
        ([("spring", 1), ("asymmetric_coulomb", 1)], {}, 1, 1, 1),  # of the class of an offset
        ([("spring", 1), ("torque_offset", 2)], {}, 1, 0, 1),  # on the other joint there is none
        ([("cubic_spring", 2)], {0: ["spring@2"]}, 0, 0, 0),
    ],
)
def test_parts_of_a_spring_are_no_false_names_and_no_spring(
    findings: list[tuple[str, int]], sets: dict[int, list[str]], good: int, right: int, held: int
) -> None:
    others = [("stribeck", 2), ("base_tilt", 1)]
    truths = {"a": truth(("spring", 1), ("stribeck", 2), ("base_tilt", None))}
    row = line("a", *findings, *others)
    for place, names in sets.items():
        row["findings"][place]["ambiguous"] = names
    found = counts([row], truths)
    assert found["all of three effects found"] == (good, 1)
    assert found["no false name beside three effects"] == (right, 1)
    assert found["all of three effects found or in a set"] == (held, 1)


def test_noise_has_the_stated_size_and_colour() -> None:
    design = replace(development_design(np.random.default_rng(0)), periods=20)
    values = noise(np.random.default_rng(1), design, np.array([2.0, 0.5]))
    assert values.std(axis=0) == pytest.approx([2.0, 0.5], rel=0.05)
    every = values[::2]
    effective_fraction = np.mean(every[1:] * every[:-1], axis=0) / np.var(every, axis=0)
    assert effective_fraction == pytest.approx(0.75 * np.exp(-0.01 / 0.011), abs=0.05)


def made(folder: Path, *effects: str, seed: int = 5, robots: str = "development") -> list[Path]:
    """The folders of one plant, at 100 and 20 Hz."""
    rng = np.random.default_rng(seed)
    plant, path, deviation = make_plant(effects, rng, level=2.0, robots=robots)
    names = [f"{'-'.join(effects) or 'clean'}-{rate}" for rate in (100, 20)]
    write_cases(
        [(folder / name, rate) for name, rate in zip(names, (100, 20), strict=True)], plant, path, deviation, rng
    )
    return [folder / name for name in names]


def test_layout_of_a_case(tmp_path: Path) -> None:
    one, other = made(tmp_path, "stribeck")
    files = {f"{run}_{what}.csv" for run in ("train", "test") for what in ("reference", "torque")}
    assert {path.name for path in one.iterdir()} == files | {"case.yaml", "truth.yaml"}
    assert (one / "train_reference.csv").read_text().splitlines()[0] == "t,q1,q2,dq1,dq2"
    table = np.loadtxt(other / "train_torque.csv", delimiter=",", skiprows=1)
    assert table.shape == (400, 3)
    assert table[:3, 0].tolist() == [0.0, 0.05, 0.1]
    case = yaml.safe_load((one / "case.yaml").read_text())
    assert {"robot", "controller", "measurement"} <= set(case)
    assert not {"truth", "effects"} & set(case)
    truth = yaml.safe_load((one / "truth.yaml").read_text())
    assert [(item["effect"], type(item["joint"])) for item in truth["truth"]] == [("stribeck", int)]
    assert set(truth["gap_sigma_rms_per_joint"]) == {"train", "test"}


@pytest.mark.gate
def test_torque_rates_share_a_run_and_names_say_nothing(tmp_path: Path) -> None:
    count = make_campaign(tmp_path / "a", ["torque_offset"], seeds=range(1, 2), rates=[100, 20], level=2.0, clean=1)
    make_campaign(tmp_path / "b", ["torque_offset"], seeds=range(1, 2), rates=[100, 20], level=2.0, clean=1)
    folders = case_folders(tmp_path / "a")
    assert count == len(folders) == 4
    assert not any("offset" in path.name for path in folders)
    for path in folders:
        for file in path.iterdir():
            assert file.read_bytes() == (tmp_path / "b" / path.name / file.name).read_bytes()
    fast, slow = (np.loadtxt(folders[i] / "test_torque.csv", delimiter=",", skiprows=1) for i in (0, 1))
    assert np.array_equal(fast[::5], slow)
    plant, path, deviation = make_plant([], np.random.default_rng(0), level=1.0)
    with pytest.raises(ValueError, match="does not divide"):
        write_cases([(tmp_path / "c", 7)], plant, path, deviation, np.random.default_rng(0))


# ---- from a case to the project --------------------------------------------------------------------


@pytest.mark.gate
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))])
def test_translated_case_is_the_plant_that_was_simulated(tmp_path: Path, seed: int) -> None:
    """Geometry, direction of rotation, gravity and control law: the project's loop gives the same torque."""
    rng = np.random.default_rng(seed)
    design = varied_design(rng, joints=1 + (seed > 0))
    plant, path = Plant(design, clutter=False), random_motion(rng, design)
    write_cases([(tmp_path / "one", 100)], plant, path, np.full(design.count, 1e-9), rng)
    case = translate(tmp_path / "one", tmp_path / "work")
    found = simulate(case, parameters=design.true)
    expected = plant.simulate(path, quantised=False)[0].command
    error = root_mean_square(found.select([f"tau{j + 1}" for j in range(design.count)]) - expected)
    # What is left is the wider smoothing of dry friction in the project's model.
    assert (error < 0.01 * root_mean_square(expected)).all()


def test_designs_differ_in_all_that_a_case_states() -> None:
    designs = [varied_design(np.random.default_rng(seed)) for seed in range(40)]

    def different(of: Callable[[Design], Any]) -> int:
        return len({of(design) for design in designs})

    assert different(lambda d: d.count) == 2
    assert different(lambda d: d.alpha) >= 6
    assert different(lambda d: d.rate_hz) >= 3
    assert different(lambda d: d.period_s) == 2
    assert different(lambda d: d.encoder_bits) >= 2
    assert all(np.linalg.norm(d.gravity) == pytest.approx(9.81, abs=1e-4) for d in designs)
    assert all(instants(d).size == d.period_s * d.periods * d.rate_hz for d in designs)


def test_translation_reads_other_robots_and_names(tmp_path: Path) -> None:
    (folder,) = made(tmp_path, robots="development")[:1]
    case = yaml.safe_load((folder / "case.yaml").read_text())
    case["robot"]["joints"] = [{"type": "prismatic"}, {"type": "revolute", "alpha": 1.5, "a": 0.1, "d": 0.2}] * 2
    case["robot"]["nominal_parameters_within_15_percent"] = {
        "M1R": 12.0,
        "XX2R": 0.3,
        "Ia3": 0.2,
        "Fv_4": 0.1,
        "off4": 0,
    }
    case["controller"] |= {"Kp": 5, "Kd": [1, 2, 3, 4], "Ki": 2.0, "law": "PID with measured velocity", "limit_N_m": 9}
    case["measurement"] |= {"sampling": "averages over the preceding period", "repeats": "none"}
    (folder / "case.yaml").write_text(yaml.safe_dump(case))
    path = translate(folder, tmp_path / "work", plant="fmu")
    robot = yaml.safe_load((path.parent / "robot.yaml").read_text())
    assert robot["identified"] == {"M1R": "M1", "XX2R": "XX2", "Ia3": "Ia3", "Fv_4": "Fv4", "off4": "offset4"}
    assert [joint["effects"] for joint in robot["joints"]] == [[], [], ["motor_inertia"], ["viscous", "torque_offset"]]
    law = yaml.safe_load((path.parent / "controller.yaml").read_text())
    assert (law["law"], law["velocity"], law["Ki"], law["saturation"]) == ("pid", "measured", [2.0] * 4, [9.0] * 4)
    document = yaml.safe_load(path.read_text())
    assert document["train"]["torque"]["sampling"] == "average"
    assert document["plant"] == {"kind": "fmu"}
    assert "period_s" not in document["train"]["reference"]
    case["robot"]["nominal_parameters_within_15_percent"] = {"Fz9": 1.0}
    (folder / "case.yaml").write_text(yaml.safe_dump(case))
    with pytest.raises(InputError, match="Fz9"):
        translate(folder, tmp_path / "work")


# ---- the harness -----------------------------------------------------------------------------------


def fake_discover(case: Path, out: Path) -> Mapping[str, Any]:
    """Answers from the training torque only, and looks at every file that a real one would."""
    document = yaml.safe_load(case.read_text())
    for name in ("robot.yaml", "controller.yaml"):
        assert (case.parent / name).is_file()
    table = np.loadtxt(document["train"]["torque"]["file"], delimiter=",", skiprows=1)
    if len(table) < 1000:
        return {"verdict": "nothing", "findings": []}
    finding = {"effect": "stribeck", "class": "stribeck", "joint": 2, "ambiguous": ["stribeck"], "parameters": {}}
    gap = {"train": [2.0, 1.0], "test": [2.0, 0.5], "ratio_interval": [0.2, 0.3], "rounds": []}
    return {"verdict": "named", "findings": [finding], "gap": gap, "other": 1}


def failing_discover(case: Path, out: Path) -> Mapping[str, Any]:
    raise RuntimeError("no answer")


def test_harness_writes_a_line_for_each_case(tmp_path: Path) -> None:
    made(tmp_path / "cases", "stribeck")
    seen: list[int] = []
    out = tmp_path / "new" / "lines.jsonl"
    lines = evaluate(
        case_folders(tmp_path / "cases"), out, tmp_path / "work", fake_discover,
        progress=lambda done, count, line: seen.append(done),
    )  # fmt: skip
    assert read_lines(out) == lines
    assert seen == [1, 2]
    named = lines[0]
    assert named["case"] == "stribeck-100"
    assert set(named) == {"case", "verdict", "judged", "findings", "gap", "curves", "seconds"}
    assert named["findings"] == [{"effect": "stribeck", "class": "stribeck", "joint": 2, "ambiguous": ["stribeck"]}]
    assert named["gap"] == {"train": [2.0, 1.0], "test": [2.0, 0.5], "ratio_interval": [0.2, 0.3]}
    assert lines[1]["verdict"] == "nothing"


@pytest.mark.slow
def test_harness_in_processes_and_with_failures(tmp_path: Path) -> None:
    made(tmp_path / "cases", "stribeck")
    folders = case_folders(tmp_path / "cases")
    two = evaluate(folders, tmp_path / "a.jsonl", tmp_path / "a", fake_discover, jobs=2)
    assert [line["verdict"] for line in two] == ["named", "nothing"]
    bad = evaluate(folders[:1], tmp_path / "b.jsonl", tmp_path / "b", failing_discover)
    assert bad[0]["verdict"] == "error"
    assert bad[0]["error"] == "RuntimeError: no answer"
    with pytest.raises(FileNotFoundError, match="dev99"):
        case_folders(tmp_path / "cases", ["dev99"])
    with pytest.raises(ValueError, match="maybe"):
        reduced({"verdict": "maybe"})
    with pytest.raises(ValueError, match="without effect"):
        reduced({"verdict": "named", "findings": [{"joint": 1}]})


def test_evaluation_goes_on_where_it_stopped(tmp_path: Path) -> None:
    made(tmp_path / "cases", "stribeck")
    folders = case_folders(tmp_path / "cases")
    out = tmp_path / "a.jsonl"
    first = evaluate(folders[:1], out, tmp_path / "a", fake_discover)
    both = evaluate(folders, out, tmp_path / "a", failing_discover, resume=True)
    assert both[0] == first[0]
    assert [row["verdict"] for row in both] == ["named", "error"]
    assert read_lines(out) == both


def test_campaigns_are_published_with_their_failures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made(tmp_path / "cases", "stribeck")
    names = [folder.name for folder in case_folders(tmp_path / "cases")]
    out = tmp_path / "lines.jsonl"
    joint = read_truth(tmp_path / "cases" / names[0]).effects[0][1]
    assert joint is not None
    rows = [line(names[0], ("stribeck", joint)), line(names[1], ("dead_zone", joint))]
    out.write_text("".join(json.dumps(row) + "\n" for row in rows))
    table = tmp_path / "matrix.csv"
    assert main(["publish", str(table), str(tmp_path / "cases"), str(out)]) == 0
    with table.open() as stream:
        first, second = csv.DictReader(stream)
    assert (first["hidden"], first["right"], first["named"]) == (f"stribeck@{joint}", "1", f"stribeck@{joint}")
    assert (second["right"], second["campaign"], second["test_after"]) == ("0", "cases", "0.500")
    shown = capsys.readouterr().out
    assert "| stribeck | stribeck 1 | dead zone 1 |" in shown
    assert "| right class, below 50 Hz | 0.0 % | 0 of 1 | 0.0 to 97.5 % | ≥ 85 % |" in shown
    file = tmp_path / "figures.json"
    assert main(["publish", str(table), "--figures", str(file)]) == 0  # from the table alone
    assert capsys.readouterr().out == shown
    held = json.loads(file.read_text(encoding="utf-8"))["figures"]
    assert (held["cases"], held["fast"], held["exact_cases"]) == ("2", "100.0 %", "1 of 2")
    assert (held["wrong.stribeck"], held["wrong.stribeck.slow"]) == ("1 of 2", "1")
    with pytest.raises(SystemExit):
        main(["publish", str(table), str(tmp_path / "cases")])


def test_a_table_holds_all_that_the_score_needs(tmp_path: Path) -> None:
    """Clutter, sets, joints that are not judged and cases that are not right come back from it."""
    truths = {
        "x/a": truth(("spring", 1)),
        "x/b": truth(("spring", 1), clutter=False),
        "x/c": truth(("drive_gain", None), gap=0.5),
        "x/d": truth(),
        "x/e": truth(("stribeck", 1), ("backlash", 2), rate_hz=20.0),
        "x/f": truth(("unknown_push", 1)),
        "x/g": truth(("spring", 1), ("stribeck", 2), ("base_tilt", None)),
        "x/h": truth(("spring", 1), ("stribeck", 2), ("base_tilt", None)),
    }
    lines = [
        line("x/a", ("torque_ripple", 2), ("torque_offset", 1)),
        line("x/b", ("torque_ripple", 1)),
        line("x/c", ("drive_gain", 2)),
        line("x/d", ("torque_ripple", 1)),
        line("x/e", ("stribeck", 1)),
        line("x/f", verdict="unknown"),
        line("x/g", ("cubic_spring", 1), ("stribeck", 2), ("base_tilt", 2)),
        line("x/h", ("cubic_spring", 1), ("stribeck", 2), ("base_tilt", 2)),
    ]
    lines[0]["findings"][1]["ambiguous"] = ["gravity_compensator"]
    lines[6]["findings"][0]["ambiguous"] = ["spring@1"]
    write_rows(tmp_path / "all.csv", lines, truths)
    again = score(*read_rows(tmp_path / "all.csv"))
    before = score(lines, truths)
    assert again.matrix == before.matrix
    assert again.notes == before.notes
    assert again.shrinks == before.shrinks
    rates = [[r for r in found.rates if r.name != SHRINKS_SURELY] for found in (again, before)]
    assert rates[0] == rates[1]
    assert dict(counts(lines, truths))["right class within the reported set"] == (1, 2)
    assert dict(counts(lines, truths))["all of three effects found or in a set"] == (1, 2)


def test_truth_is_not_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made(tmp_path / "cases", "stribeck")
    opened: list[str] = []
    original = io.open

    def watched(file: Any, *arguments: Any, **options: Any) -> Any:
        opened.append(str(file))
        if str(file).endswith("truth.yaml"):
            raise AssertionError("the truth was opened")
        return original(file, *arguments, **options)

    monkeypatch.setattr(builtins, "open", watched)
    monkeypatch.setattr(io, "open", watched)  # what pathlib calls
    lines = evaluate(case_folders(tmp_path / "cases"), tmp_path / "a.jsonl", tmp_path / "work", fake_discover)
    assert [line["verdict"] for line in lines] == ["named", "nothing"]
    assert any("case.yaml" in name for name in opened)
    with pytest.raises(AssertionError, match="truth"):
        read_truth(tmp_path / "cases" / "stribeck-100")
    monkeypatch.undo()
    written = " ".join(path.read_text() for path in (tmp_path / "work").rglob("*.yaml"))
    assert "truth.yaml" not in written


# ---- the scoring -----------------------------------------------------------------------------------


def line(case: str, *findings: tuple[str, int], verdict: str = "named", **more: Any) -> dict[str, Any]:
    items = [{"effect": effect, "class": effect, "joint": joint, "ambiguous": []} for effect, joint in findings]
    gap = {"train": [2.0, 0.5], "test": [2.0, 0.5], "ratio_interval": [0.2, 0.3]}
    return {"case": case, "verdict": verdict, "findings": items, "gap": gap, "seconds": 1.0, **more}


def truth(*effects: tuple[str, int | None], gap: float = 2.0, clutter: bool = True, rate_hz: float = 100.0) -> Truth:
    return Truth(effects, gap, clutter, rate_hz)


def counts(lines: list[dict[str, Any]], truths: dict[str, Truth]) -> dict[str, tuple[int, int]]:
    return {rate.name.strip().split(",")[0]: (rate.good, rate.count) for rate in score(lines, truths).rates}


def test_score_of_a_perfect_evaluation() -> None:
    truths = {
        "a": truth(("torque_offset", 1)),
        "b": truth(("actuator_lag", 2), rate_hz=20.0),
        "c": truth(),
        "d": truth(("unknown_push", 1)),
        "e": truth(("stribeck", 1), ("backlash", 2)),
        "f": truth(("unknown_chirp", 1)),
        "g": truth(("drive_gain", None)),
    }
    lines = [
        line("a", ("asymmetric_coulomb", 1)),
        line("b", ("delay", 2)),
        line("c", verdict="nothing"),
        line("d", ("external_force_window", 1)),
        line("e", ("backlash", 2), ("stribeck", 1)),
        line("f", verdict="unknown"),
        line("g", ("torque_ripple", 1), ("drive_gain", 2)),
    ]
    found = score(lines, truths)
    assert found.passed
    assert not found.notes
    assert found.matrix["torque_offset", "asymmetric_coulomb"] == 1
    assert counts(lines, truths)["right class within the reported set"] == (3, 3)
    assert "FAIL" not in text(found)
    assert found.shrinks == pytest.approx([0.75] * 5)


def test_score_sees_each_kind_of_failure() -> None:
    truths = {
        "joint": truth(("stribeck", 1), clutter=False),
        "class": truth(("spring", 1)),
        "set": truth(("spring", 1)),
        "none": truth(("spring", 1)),
        "small": truth(("spring", 1), gap=0.5),
        "clean": truth(),
        "clutter": truth(),
        "forced": truth(("unknown_chirp", 1)),
        "half": truth(("spring", 1), ("backlash", 2)),
        "broken": truth(clutter=False),
    }
    lines = [
        line("joint", ("stribeck", 2)),
        line("class", ("dead_zone", 1)),
        line("set", ("torque_offset", 1)),
        line("none", ("stribeck", 1)),
        line("small", ("dead_zone", 1)),
        line("clean", ("dead_zone", 1)),
        line("clutter", ("torque_ripple", 2)),
        line("forced", ("delay", 1), verdict="named_with_remainder"),
        line("half", ("spring", 1)),
        line("broken", verdict="error", gap={}),
    ]
    lines[2]["findings"][0]["ambiguous"] = ["torque_offset@1", {"effect": "spring", "joint": 1}]
    lines[1]["gap"] = {"train": [2, 2], "test": [[2.0, 2.0], [1.0, 1.0]], "ratio_interval": [0.4, 1.1]}
    found = counts(lines, truths)
    assert found["right class"] == (0, 0)  # below 50 Hz: the last of the two rates
    assert score(lines, truths).rates[0].good == 1
    assert score(lines, truths).rates[0].count == 4
    assert found["right class within the reported set"] == (2, 4)
    assert found["right joint of a right class"] == (0, 1)
    assert found["effect outside the catalogue refused"] == (0, 1)
    assert found["a name on a clean plant"] == (2, 3)
    assert found["clean plants with another answer than *nothing*"] == (3, 3)
    assert found["both of two effects found"] == (0, 1)
    assert found["nothing named though an effect was there"] == (1, 4)
    assert found["shrinks by 60 % with its interval below 1"] == (5, 6)
    result = score(lines, truths)
    assert not result.passed
    assert [note.split(":")[0] for note in result.notes] == [
        "joint", "class", "set", "none", "clean", "forced", "half", "broken",
    ]  # fmt: skip
    assert "FAIL" in text(result)
    assert "clutter only 1" in text(result)


def test_classes_do_not_overlap() -> None:
    names = [name for group in CLASSES for name in group]
    assert len(names) == len(set(names))
    assert same_class("lugre", "presliding")
    assert same_class("spring", "spring")
    assert same_class("controller_gain", "controller_gains")
    assert not same_class("spring", "torque_offset")


def test_command_line_scores_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["make", str(tmp_path / "cases"), "--seeds", "1", "--rates", "100", "--effects", "base_tilt",
                 "--clean", "1", "--robots", "development"]) == 0  # fmt: skip
    assert "2 cases" in capsys.readouterr().out
    folders = case_folders(tmp_path / "cases")
    hidden = {folder.name: read_truth(folder).effects for folder in folders}
    assert sorted(hidden.values()) == [(), (("base_tilt", None),)]
    lines = [
        line(name, ("base_tilt", 1)) if effects else line(name, verdict="nothing") for name, effects in hidden.items()
    ]
    out = tmp_path / "lines.jsonl"
    out.write_text("".join(json.dumps(row) + "\n" for row in lines))
    command = [str(tmp_path / "cases"), "--out", str(out), "--no-run", "--score"]
    assert main(command) == 0
    assert "base_tilt 1" in capsys.readouterr().out
    out.write_text(out.read_text().replace('"base_tilt"', '"dead_zone"'))
    assert main(command) == 1
    assert main(command[:-1]) == 0
    with pytest.raises(SystemExit):
        main(["make", str(tmp_path), "--effects", "gremlins"])


def test_lines_of_a_campaign_are_those_of_single_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a campaign keeps of a discovery holds its answer; the verdict stands beside it."""
    gap = {label: {"before": 2.0, "after": 0.5} for label in ("estimation", "validation")}
    item = {"effect": "backlash", "class": "backlash", "joint": 2, "ambiguous": [{"effect": "joint_elasticity"}]}
    kept = json.dumps({"answer": "named", "findings": [item], "gap": gap, "ratio_interval": [0.4, 0.6], "curves": []})
    frame = pd.DataFrame({
        "label.case": ["b2", "b1"], "seconds": [1.0, 2.0], "findings": [kept, None], "verdict": ["doubtful", None],
        "message": [None, "The loop diverged."],
    })  # fmt: skip
    results = SimpleNamespace(to_frame=lambda **_: frame)
    monkeypatch.setattr(harness, "translate", lambda folder, work, plant: work)
    monkeypatch.setattr(harness, "campaign", lambda *_: SimpleNamespace(run=lambda **_: results))
    lines = by_campaign(
        [tmp_path / "b1", tmp_path / "b2"], tmp_path / "out", tmp_path, jobs=1, plant="model", files=False
    )
    assert [line["case"] for line in lines] == ["b1", "b2"] and lines == read_lines(tmp_path / "out")
    assert lines[0]["verdict"] == "error" and lines[0]["error"] == "The loop diverged."
    assert (lines[1]["verdict"], lines[1]["judged"]) == ("named", "doubtful")
    assert lines[1]["findings"][0]["ambiguous"] == ["joint_elasticity"]
