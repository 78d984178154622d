"""The master's loop: wiring, order, time, delay, and what is recorded."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from fmu_didim.base.errors import DivergedError, InputError, SimulationError, UnknownNameError
from fmu_didim.components import ModelComponent
from fmu_didim.cosim import Connection, Recording, System, closed_loop, simulate
from fmu_didim.data.signals import Trajectory, trajectory
from fmu_didim.dynamics.robot import RobotModel
from tests.helpers import (
    KINDS,
    PERIOD,
    Mock,
    component,
    law_block,
    loop,
    ports,
    reference,
    scara,
    scara_cascade,
    scara_pd,
    sledge,
)

DELAYS = (0, 0.5, 1, 1.3, 2)
GAINS = (1.5, -0.8)
"""Drive gains, with a sign, because a drive may be mounted the other way round."""


def names(owner: str, stem: str, joints: int = 2) -> list[str]:
    return [f"{owner}.{stem}{j}" for j in range(1, joints + 1)]


def motion_of(recording: Recording, joints: int = 2, *, sampled: bool = False) -> tuple[np.ndarray, ...]:
    return tuple(recording.table(names("plant", s, joints), sampled=sampled) for s in ("q", "dq", "ddq"))


def model_torque(model: RobotModel, *motion: np.ndarray) -> np.ndarray:
    return np.asarray(model.regressor_rows(*motion) @ model.parameter_values)


@cache
def run(plant: str, controller: str, delay: float = 0.0) -> Recording:
    """The SCARA under its cascade with saturated commands and drive gains."""
    block = scara_cascade() if controller != "pd" else scara_pd()
    gains: Any = GAINS if controller != "pd" else (1.0, 1.0)
    law = component("model" if controller == "pd" else controller, block)
    if controller != "pd":
        scale = {f"{k}{j}": start_value(block, f"{k}{j}") / g for k in ("Kp", "Ki") for j, g in enumerate(gains, 1)}
        law = law.with_parameters(scale)
    system = loop(component(plant, scara().block()), law, reference(), drive_gains=gains, delay_samples=delay)
    return simulate(system, reference())


def start_value(block: Any, name: str) -> float:
    return next(float(v.start) for v in block.parameters if v.name == name)


# ---- torque and motion of a row belong together ------------------------------------------------------


@pytest.mark.gate
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("delay", DELAYS)
def test_recorded_torque_is_the_model_of_the_recorded_motion(kind: str, delay: float) -> None:
    """tau_k = W(q_k, dq_k, ddq_k) chi, when the torque of tick k acts."""
    recording = run(kind, "model", delay)
    torque = recording.table(names("controller", "command")) * np.array(GAINS)
    got = model_torque(scara(), *motion_of(recording))
    np.testing.assert_allclose(got, torque, rtol=0, atol=1e-11 * np.abs(torque).max())
    assert np.abs(torque).max(axis=0).min() > 0.5
    # Some commands are limited: the relation does not rest on a linear controller.
    assert (np.abs(recording.applied["controller.command1"]) == 10).sum() > 5


@pytest.mark.gate
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("delay", DELAYS[1:])
def test_sampled_motion_belongs_to_the_torque_that_acts_before_the_tick(kind: str, delay: float) -> None:
    recording = run(kind, "model", delay)
    torque = recording.table(names("controller", "command"), sampled=True) * np.array(GAINS)
    back = int(delay) + 1  # the torque computed so many ticks ago acts until the tick
    got = model_torque(scara(), *motion_of(recording, sampled=True))
    np.testing.assert_allclose(got[back:], torque[:-back], rtol=0, atol=1e-11 * np.abs(torque).max())


def test_a_delay_moves_the_motion() -> None:
    """The test above would not notice a delay that is ignored."""
    tracks = [run("model", "model", delay).table(["plant.q1"], sampled=True) for delay in DELAYS]
    gaps = [np.abs(other - tracks[0]).max() for other in tracks[1:]]
    assert gaps[0] > 1e-5
    assert (np.diff(gaps) > 0).all()


def test_without_delay_both_records_are_the_same() -> None:
    recording = run("model", "model")
    for name, values in recording.applied.items():
        np.testing.assert_array_equal(values, recording.sampled[name])


# ---- all kinds give the same ---------------------------------------------------------------------------


@pytest.mark.gate
@pytest.mark.parametrize("plant", KINDS)
@pytest.mark.parametrize("controller", KINDS)
@pytest.mark.parametrize("delay", [0, 1.3])
def test_every_pair_of_kinds_gives_the_same_torque(plant: str, controller: str, delay: float) -> None:
    got = run(plant, controller, delay).table(names("controller", "command"))
    wanted = run("model", "model", delay).table(names("controller", "command"))
    assert (np.abs(got - wanted).max(axis=0) < 1e-9 * np.abs(wanted).max(axis=0)).all()


# ---- the exact solution --------------------------------------------------------------------------------


def exact_loop(delay: float, viscous: float, motion: Trajectory, kp: float, kd: float) -> tuple[np.ndarray, ...]:
    """States at the ticks and when the torque acts, and the torque, of M ddq + Fv dq = u under sampled PD control."""
    augmented = np.array([[0.0, 1.0, 0.0], [0.0, -viscous / 2.0, 0.5], [0.0, 0.0, 0.0]])
    whole, part = int(delay), delay - int(delay)
    before, after = expm(augmented * part * PERIOD), expm(augmented * (1 - part) * PERIOD)
    q_ref, dq_ref = motion.select(["q1", "dq1"]).T
    x, commands, at_ticks, when_acting = np.array([q_ref[0], dq_ref[0]]), [], [], []
    for k in range(len(q_ref)):
        at_ticks.append(x)
        commands.append(kp * (q_ref[k] - x[0]) + kd * (dq_ref[k] - x[1]))
        x = before[:2, :2] @ x + before[:2, 2] * commands[max(k - whole - 1, 0)]
        when_acting.append(x)
        x = after[:2, :2] @ x + after[:2, 2] * commands[max(k - whole, 0)]
    return np.array(at_ticks), np.array(when_acting), np.array(commands)


@pytest.mark.gate
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("delay", [0, 0.3, 1, 1.5])
@pytest.mark.parametrize("viscous", [0.0, 6.0])
def test_loop_equals_the_exact_discrete_solution(kind: str, delay: float, viscous: float) -> None:
    motion = reference(joints=1)
    pd = law_block(law="pd", joints=["prismatic"], Kp=[800.0], Kd=[60.0])
    system = loop(
        component(kind, sledge(viscous).block(start_of(motion))), component("model", pd), motion,
        joints=1, delay_samples=delay,
    )  # fmt: skip
    recording = simulate(system, motion)
    at_ticks, when_acting, commands = exact_loop(delay, viscous, motion, 800.0, 60.0)
    state = ["plant.q1", "plant.dq1"]
    np.testing.assert_allclose(recording.table(state, sampled=True), at_ticks, rtol=0, atol=1e-9)
    for sampled in (False, True):
        got = recording.table(["controller.command1"], sampled=sampled)[:, 0]
        np.testing.assert_allclose(got, commands, rtol=0, atol=1e-9 * np.abs(commands).max())
    # Recorded when the torque acts: a whole delay of m samples later.
    late = int(delay)
    got = recording.table(state)[: len(commands) - late]
    np.testing.assert_allclose(got, when_acting[late:], rtol=0, atol=1e-9)
    # The loop is alive: the error of control is not zero.
    assert np.abs(at_ticks[:, 0] - motion.select(["q1"])[:, 0]).max() > 1e-4


def start_of(motion: Trajectory) -> dict[str, float]:
    return dict(zip(("q_start1", "dq_start1"), motion.select(["q1", "dq1"])[0], strict=True))


def test_a_delay_within_rounding_of_a_whole_sample_is_whole() -> None:
    motion = reference(0.1, joints=1)
    pd = component("model", law_block(law="pd", joints=["prismatic"], Kp=[800.0], Kd=[60.0]))
    plant = component("model", sledge().block())
    runs = [simulate(loop(plant, pd, motion, joints=1, delay_samples=d), motion) for d in (1.0, 1 - 1e-12, 1 + 1e-12)]
    for other in runs[1:]:
        np.testing.assert_array_equal(other.table(["plant.q1"]), runs[0].table(["plant.q1"]))


# ---- time and order, seen by components that keep a log ---------------------------------------------------


def mocked(
    *, step: float = PERIOD, order: tuple[str, ...] = ("controller", "plant"), delays: Any = None, respond: Any = None
) -> tuple[System, Mock, Mock]:
    """A controller with the outputs (1000 + tick) and a plant with the output (tick), both keeping one log."""
    log: list[tuple[Any, ...]] = []
    law = Mock("controller", ports("r", "y"), ports("u", causality="output"), lambda k, u: 1000.0 + k, log)
    plant = Mock("plant", ports("u"), ports("y", causality="output"), respond or (lambda k, u: float(k)), log)
    system = System(
        components={"plant": plant, "controller": law},
        connections=(
            Connection("reference.r", "controller.r"),
            Connection("plant.y", "controller.y"),
            Connection("controller.u", "plant.u"),
        ),
        order=order,
        step_size=step,
        delays=delays or {},
    )
    return system, law, plant


def ramp(count: int, *, step: float = PERIOD, start: float = 0.0) -> Trajectory:
    """The column r with the values 1, 2, 3 ..."""
    return trajectory(start + np.arange(count) * step, {"r": 1.0 + np.arange(count)})


def test_time_is_counted_and_never_accumulated() -> None:
    step, start, count = 0.001, 0.1, 10_001
    system, law, plant = mocked(step=step)
    recording = simulate(system, ramp(count, step=step, start=start), ticks=np.array([0, count - 1]))
    wanted = [(start + k * step, step) for k in range(count)]
    assert law.calls("step") == wanted
    assert plant.calls("step") == wanted
    summed = start
    for _ in range(count - 1):
        summed += step
    assert wanted[-1][0] != summed
    assert recording.time.tolist() == [start, start + (count - 1) * step]


def test_a_fraction_of_delay_divides_the_step() -> None:
    system, law, plant = mocked(delays={"plant": 1.3}, step=0.01)
    simulate(system, ramp(4, step=0.01, start=2.0))
    part = 1.3 - 1
    for k, (first, second) in enumerate(zip(*[iter(plant.calls("step"))] * 2, strict=True)):
        tick = 2.0 + k * 0.01
        assert first == (tick, part * 0.01)
        assert second == (tick + part * 0.01, (1 - part) * 0.01)
    assert law.calls("step")[:4] == [(2.0 + k * 0.01, 0.01) for k in range(4)]


def test_the_controller_sees_reference_and_plant_of_its_tick() -> None:
    system, law, plant = mocked()
    simulate(system, ramp(20))
    assert [tuple(u) for (u,) in law.calls("set")] == [(1.0 + k, float(k)) for k in range(20)]
    assert [tuple(u) for (u,) in plant.calls("set")] == [(1000.0 + k,) for k in range(20)]


@pytest.mark.parametrize(
    ("delay", "wanted"),
    [
        (1, [1000, 1000, 1001, 1002, 1003]),
        (3, [1000, 1000, 1000, 1000, 1001]),
        (0.5, [1000, 1000, 1000, 1001, 1001, 1002, 1002, 1003, 1003, 1004]),
        (1.5, [1000, 1000, 1000, 1000, 1000, 1001, 1001, 1002, 1002, 1003]),
    ],
)
def test_delayed_inputs_are_held_at_their_first_value(delay: float, wanted: list[int]) -> None:
    """Two values a tick for a delay with a fraction: before and after the switch."""
    system, _, plant = mocked(delays={"plant": delay})
    simulate(system, ramp(5))
    assert [int(u[0]) for (u,) in plant.calls("set")][: len(wanted)] == wanted


def test_calls_come_in_order() -> None:
    system, law, _ = mocked()
    simulate(system, ramp(3))
    calls = [entry[:2] for entry in law.log]
    first = [("controller", "begin"), ("plant", "begin"), ("controller", "end"), ("controller", "get")]
    first += [("plant", "end"), ("plant", "get")]
    assert calls[:6] == first
    tick = [("controller", "set"), ("controller", "get"), ("plant", "set"), ("plant", "get")]
    tick += [("controller", "step"), ("controller", "get"), ("plant", "step"), ("plant", "get")]
    assert calls[6:-2] == tick * 3
    assert calls[-2:] == [("controller", "close"), ("plant", "close")]


def test_another_order_is_respected() -> None:
    """With the plant first it gets the command of the tick before: a sample of delay, declared by the order."""
    system, law, plant = mocked(order=("plant", "controller"))
    simulate(system, ramp(5))
    calls = [entry[:2] for entry in law.log][6:10]
    assert calls == [("plant", "set"), ("plant", "get"), ("controller", "set"), ("controller", "get")]
    # get after step already shows the output of the next state, so u is 1000 + k here too.
    assert [float(u[0]) for (u,) in plant.calls("set")] == [1000.0 + k for k in range(5)]


def test_initialisation_passes_values_around_the_loop() -> None:
    """The controller's first inputs are the outputs of the plant's initial state, not zeros."""
    system, law, plant = mocked(respond=lambda k, u: 7.0 + k)
    simulate(system, ramp(3, start=0.5))
    assert law.calls("begin") == [(0.5,)]
    assert law.calls("end")[0][0].tolist() == [1.0, 7.0]
    assert plant.calls("end")[0][0].tolist() == [1000.0]


def test_components_are_closed_after_a_failure() -> None:
    system, law, plant = mocked(respond=lambda k, u: np.nan if k > 3 else 0.0)
    with pytest.raises(DivergedError):
        simulate(system, ramp(50))
    assert law.calls("close") == plant.calls("close") == [(), ()]  # also those of the run that finds the culprit


def test_gains_and_sums_of_connections() -> None:
    source = Mock("source", (), ports("a", "b", causality="output"), lambda k, u: [2.0, 10.0 * k])
    sink = Mock("sink", ports("x", "y"), ())
    system = System(
        components={"source": source, "sink": sink},
        connections=(
            Connection("source.a", "sink.x", 3.0),
            Connection("source.b", "sink.x", -0.5),
            Connection("reference.r", "sink.x"),
        ),
        order=("source", "sink"),
        step_size=PERIOD,
    )
    simulate(system, ramp(4))
    assert [u.tolist() for (u,) in sink.calls("set")] == [[6.0 - 5.0 * k + 1.0 + k, 0.0] for k in range(4)]


# ---- what is recorded ------------------------------------------------------------------------------------


def test_some_ticks_only() -> None:
    motion = reference()
    plant, law = component("model", scara().block()), component("model", scara_cascade())
    ticks = np.array([0, 7, 20, 33, 150])
    for delay in (0.0, 1.0, 1.3):
        system = loop(plant, law, motion, delay_samples=delay)
        every, some = simulate(system, motion), simulate(system, motion, ticks=ticks)
        np.testing.assert_array_equal(some.time, motion.time[ticks])
        for name in every.applied:
            np.testing.assert_array_equal(some.applied[name], every.applied[name][ticks])
            np.testing.assert_array_equal(some.sampled[name], every.sampled[name][ticks])


def test_recorded_reference_is_that_of_the_tick() -> None:
    motion = reference()
    recording = run("model", "model", 1.3)
    for sampled in (False, True):
        got = recording.table(["reference.q1", "reference.ddq2"], sampled=sampled)
        np.testing.assert_array_equal(got, motion.select(["q1", "ddq2"]))


def test_unknown_recorded_signals_are_refused() -> None:
    with pytest.raises(UnknownNameError, match=r"no recorded signal named 'plant\.q3'[\s\S]*Did you mean 'plant\.q"):
        run("model", "model").table(["plant.q1", "plant.q3"])


@pytest.mark.gate
def test_runs_are_reproducible() -> None:
    motion = reference()
    for kind in KINDS:
        system = loop(component(kind, scara().block()), component(kind, scara_cascade()), motion, delay_samples=0.3)
        first, second = simulate(system, motion), simulate(system, motion)
        np.testing.assert_array_equal(first.table(names("plant", "q")), second.table(names("plant", "q")))


# ---- refusals ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [0.004, 0.00501])
def test_a_reference_of_another_rate_is_refused(rate: float) -> None:
    with pytest.raises(InputError, match=r"not sampled at the control rate[\s\S]*0\.005 s"):
        simulate(mocked()[0], ramp(100, step=rate))


def test_a_reference_with_jitter_is_refused_and_rounding_is_not() -> None:
    rows = ramp(100)
    shaken = rows.time.copy()
    shaken[40] += 0.02 * PERIOD
    with pytest.raises(InputError, match="control rate"):
        simulate(mocked()[0], trajectory(shaken, {"r": rows.values[:, 0]}))
    rounded = np.round(rows.time, 5)
    simulate(mocked()[0], trajectory(rounded, {"r": rows.values[:, 0]}))


@pytest.mark.parametrize("ticks", [[0, 50], [-1, 3], [3, 3], [5, 4], []])
def test_ticks_outside_the_reference_are_refused(ticks: list[int]) -> None:
    with pytest.raises(InputError, match=r"outside the reference[\s\S]*valid: 0 to 49"):
        simulate(mocked()[0], ramp(50), ticks=np.array(ticks, dtype=np.int64))


@pytest.mark.parametrize("kind", KINDS)
def test_divergence_names_signal_and_time(kind: str) -> None:
    """Positive feedback: ddq = 100 q grows by the factor e every 0.1 s, to 1 rad after about 0.5 s."""
    motion = reference(5.0, joints=1, start=3.0)
    law = component("model", law_block(law="pd", joints=["prismatic"], Kp=[-200.0], Kd=[0.0]))
    system = loop(component(kind, sledge().block()), law, motion, joints=1)
    free = simulate(system, motion, ticks=np.arange(400))
    first = free.time[np.flatnonzero(np.abs(free.applied["plant.q1"]) > 2.0)[0]]
    with pytest.raises(DivergedError, match=r"diverged: plant\.q1 = .*, outside -2 to 2[\s\S]*got:   t = ") as caught:
        simulate(system, motion, bounds={"plant.q1": (-2.0, 2.0)})
    assert first <= caught.value.time <= first + 32 * PERIOD
    assert f"t = {caught.value.time:.6g} s" in str(caught.value)


def test_values_that_are_no_numbers_stop_the_run() -> None:
    system, _, plant = mocked(respond=lambda k, u: np.nan if k >= 70 else 1.0)
    with pytest.raises(DivergedError, match=r"^The plant failed at t = 0\.35 s: plant\.y = nan, while") as caught:
        simulate(system, ramp(1000))
    assert caught.value.time == pytest.approx(70 * PERIOD)
    assert caught.value.component == "plant"
    assert len(plant.calls("step")) < 110 + 80  # until it is noticed, and until it is found


def test_a_passing_infinity_while_initialising_is_forgotten() -> None:
    """u = 1 / y, evaluated before the plant has given its first y: infinite, but in one pass only."""
    system, law, _ = mocked(respond=lambda k, u: 4.0)
    inverse = dataclasses.replace(law, respond=lambda k, u: 1 / u[1])
    recording = simulate(system.replace("controller", inverse), ramp(5))
    assert recording.applied["controller.u"].tolist() == [0.25] * 5


def test_a_bad_signal_reaches_connected_inputs_only() -> None:
    """The plant's y does not go anywhere; its NaN is named, not those that follow from it."""
    system, _, _ = mocked(respond=lambda k, u: np.nan)
    passing = Mock("controller", ports("r", "y"), ports("u", causality="output"), lambda k, u: u[0])
    connections = tuple(c for c in system.connections if c.source != "plant.y")
    loose = dataclasses.replace(system.replace("controller", passing), connections=connections)
    with pytest.raises(DivergedError, match=r"plant\.y = nan"):
        simulate(loose, ramp(100))


def test_a_single_value_that_is_no_number_is_seen_too() -> None:
    """Also between two looks, and when all later values are sound."""
    system, _, _ = mocked(respond=lambda k, u: np.nan if k == 37 else 1.0)
    with pytest.raises(DivergedError) as caught:
        simulate(system, ramp(100))
    assert caught.value.time == pytest.approx(37 * PERIOD)


def test_the_last_tick_is_looked_at() -> None:
    system, _, _ = mocked(respond=lambda k, u: 5.0 if k >= 9 else 1.0)
    with pytest.raises(DivergedError, match="outside 0 to 2"):
        simulate(system, ramp(10), bounds={"plant.y": (0.0, 2.0)})


def test_bounds_of_unknown_signals_are_refused() -> None:
    with pytest.raises(UnknownNameError):
        simulate(mocked()[0], ramp(10), bounds={"plant.z": (0.0, 2.0)})


def test_an_fmu_that_fails_stops_the_run() -> None:
    motion = reference()
    light = component("fmu", scara().block()).with_parameters({"ZZ2": 1e-7, "MX2": 0.0, "MY2": 0.0})
    with pytest.raises(SimulationError, match=r"^The plant failed: fmi2DoStep at t = 0 s of the[\s\S]*substeps"):
        simulate(loop(light, component("model", scara_pd()), motion), motion)


@pytest.mark.parametrize(
    ("source", "target", "problem"),
    [
        ("reference.r", "controler.r", "no component named 'controler'"),
        ("reference.r", "controller.x", "no input named 'x'"),
        ("plnt.y", "controller.y", "no component named 'plnt'"),
        ("plant.z", "controller.y", "no output named 'z'"),
        ("controller.r", "plant.u", "no output named 'r'"),
    ],
)
def test_unknown_names_in_connections_name_both_ends(source: str, target: str, problem: str) -> None:
    system, law, plant = mocked()
    with pytest.raises(UnknownNameError, match=problem) as caught:
        System(
            components={"controller": law, "plant": plant},
            connections=(*system.connections, Connection(source, target)),
            order=system.order,
            step_size=PERIOD,
        )
    assert f"{source} -> {target}" in str(caught.value)


def test_an_unknown_column_of_the_reference_names_both_ends() -> None:
    system, _, _ = mocked()
    with pytest.raises(UnknownNameError, match=r"'reference\.r'[\s\S]*controller\.r[\s\S]*reference\.s"):
        simulate(system, trajectory(np.arange(5) * PERIOD, {"s": np.zeros(5)}))


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"step_size": 0.0}, "must be positive"),
        ({"step_size": float("nan")}, "must be positive"),
        ({"order": ("controller",)}, "name each component once"),
        ({"order": ("controller", "plant", "plant")}, "name each component once"),
        ({"delays": {"plant": -0.1}}, "between 0 and 1000"),
        ({"delays": {"plant": float("nan")}}, "between 0 and 1000"),
        ({"delays": {"plnt": 1.0}}, "no component named 'plnt'"),
    ],
)
def test_wrong_systems_are_refused(change: dict[str, Any], problem: str) -> None:
    system, law, plant = mocked()
    options = {"order": system.order, "step_size": PERIOD, "delays": {}, **change}
    with pytest.raises(InputError, match=problem):
        System(components={"controller": law, "plant": plant}, connections=system.connections, **options)


# ---- wiring by names -----------------------------------------------------------------------------------------


def wired(**options: Any) -> System:
    plant, law = ModelComponent(scara().block()), ModelComponent(scara_pd())
    columns = ("q1", "q2", "dq1", "dq2", "test")
    return closed_loop(plant, law, **{"joint_count": 2, "reference_names": columns, **options})


def test_loops_are_wired_by_the_names_of_the_signals() -> None:
    got = {(c.source, c.target, c.gain) for c in wired(drive_gains=[2.0, 3.0]).connections}
    wanted = {(f"reference.{n}{j}", f"controller.{n}_ref{j}", 1.0) for n in ("q", "dq") for j in (1, 2)}
    wanted |= {(f"plant.{n}{j}", f"controller.{n}{j}", 1.0) for n in ("q", "dq") for j in (1, 2)}
    wanted |= {("controller.command1", "plant.tau1", 2.0), ("controller.command2", "plant.tau2", 3.0)}
    assert got == wanted
    assert wired().order == ("controller", "plant")
    assert wired().step_size == PERIOD
    assert wired(delay_samples=0.5).delays == {"plant": 0.5}


def test_test_signals_are_added_to_the_command() -> None:
    """tau = g (command + injected)."""
    got = [c for c in wired(drive_gains=[2.0, 3.0], injections={"command2": "test"}).connections if "tau2" in c.target]
    assert got == [
        Connection("controller.command2", "plant.tau2", 3.0),
        Connection("reference.test", "plant.tau2", 3.0),
    ]


def test_missing_sources_and_steps_are_refused() -> None:
    with pytest.raises(InputError, match=r"'dq_ref1'[\s\S]*q1, q2"):
        wired(reference_names=("q1", "q2"))
    with pytest.raises(InputError, match="One drive gain is needed for each joint"):
        wired(drive_gains=[1.0])
    fmu = dataclasses.replace(component("fmu", scara_pd()), sample_time=None)
    with pytest.raises(InputError, match=r"sample time of the loop is unknown[\s\S]*rate_hz"):
        closed_loop(ModelComponent(scara().block()), fmu, joint_count=2, reference_names=reference().names)


def test_unknown_injections_are_refused() -> None:
    with pytest.raises(InputError):
        wired(injections={"comand1": "test"})


def test_replacing_a_component_leaves_the_rest_alone() -> None:
    system = wired(delay_samples=1.0)
    other = ModelComponent(scara().block({"ZZ1": 5.0}))
    changed = system.replace("plant", other)
    assert changed.components["plant"] is other
    assert changed.components["controller"] is system.components["controller"]
    assert system.components["plant"] is not other
    assert (changed.connections, changed.order, changed.delays) == (system.connections, system.order, system.delays)
    with pytest.raises(UnknownNameError, match="Did you mean 'plant'"):
        system.replace("plnt", other)
    assert system.with_delay("plant", 2.5).delays == {"plant": 2.5}


def test_values_lie_where_they_lay_unless_the_variables_are_others() -> None:
    system, columns = wired(), ("q1", "q2", "dq1", "dq2", "ddq1", "ddq2")
    layout = system.layout(columns)
    assert layout.values[: len(layout.signals)] == layout.signals
    controller = system.components["controller"]
    assert layout.values[layout.places["controller"].inputs] == tuple(f"controller.{v.name}" for v in controller.inputs)
    plant = ModelComponent(scara().block({"ZZ1": 5.0}))
    assert system.replace("plant", plant).layout(columns) is layout  # only values are others
    moved = controller.with_names(
        tuple(dataclasses.replace(v, start=1.5) for v in controller.inputs), controller.outputs
    )
    other = system.replace("controller", moved).layout(columns)
    assert (other.places["controller"].starts == 1.5).all()
    assert (layout.places["controller"].starts == 0.0).all()
    assert system.with_delay("plant", 1.0).layout(columns) is not layout
    assert system.layout((*columns, "further")).signals[6] == "reference.further"


def test_description_tells_order_delay_and_hold() -> None:
    text = wired(delay_samples=1.5).describe()
    assert text["order"] == ["controller", "plant"]
    assert text["delay_samples"] == {"controller": 0.0, "plant": 1.5}
    assert text["step_size_s"] == PERIOD
    assert "plant.tau1 <- 1 * controller.command1" in text["connections"]
    assert text["components"]["plant"]["kind"] == "model"
