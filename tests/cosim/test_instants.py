"""Loops whose period changes: the master steps from instant to instant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import control
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from fmu_didim.base.errors import InputError
from fmu_didim.components import Component, load_fmu, wrap_control
from fmu_didim.cosim import Connection, Instants, System, period_change, sample_operator, simulate
from fmu_didim.data.signals import Trajectory, trajectory
from fmu_didim.export import build_fmu
from tests.controllers.test_controllers import scara_torque
from tests.cosim.test_compiled_loop import TIMINGS, assert_same, system_of
from tests.helpers import PERIOD, Mock, component, law_block, loop, ports, reference, scara, scara_pd


def slowing(count: int = 200, *, start: float = 0.0) -> np.ndarray:
    """Instants of a loop that slows down from 5 ms by 30 %, with late cycles in between."""
    rng = np.random.default_rng(3)
    periods = PERIOD * (1 + 0.3 * np.linspace(0, 1, count) ** 2 + 0.1 * rng.random(count))
    return start + np.concatenate([[0.0], np.cumsum(periods[:-1])])


def along(time: np.ndarray) -> Trajectory:
    """The motion of ``reference`` at these instants."""
    t = time[:, None]
    w, a = 2 * np.pi * np.array([0.5, 1.0]), np.array([[0.5, 0.2], [-0.4, 0.25]])
    columns = {
        f"{name}{j + 1}": (a[j] * w**k * np.sin(w * t + k * np.pi / 2)).sum(axis=1)
        for k, name in enumerate(("q", "dq", "ddq"))
        for j in range(2)
    }
    return trajectory(time, columns)


def at_instants(system: System, **timing: Any) -> System:
    return replace(system, at_instants=True, **timing)


def integrated(motion: Trajectory, command: Callable[[int, np.ndarray], np.ndarray], delay_s: float) -> np.ndarray:
    """(T, 4) q and dq of the SCARA by solve_ivp, the command of t_k held from t_k + delay on."""

    def rate(_: float, x: np.ndarray, torque: np.ndarray) -> np.ndarray:
        q, dq = x[:2], x[2:]
        rest = scara_torque(q, dq, np.zeros(2))
        mass = np.column_stack([scara_torque(q, dq, unit) - rest for unit in np.eye(2)])
        return np.concatenate([dq, np.linalg.solve(mass, torque - rest)])

    x = np.concatenate([motion.select(["q1", "q2"])[0], motion.select(["dq1", "dq2"])[0]])
    states, before = [x], command(0, x)
    for k in range(motion.time.size - 1):
        torque = command(k, states[-1])
        x, size = states[-1], float(motion.time[k + 1] - motion.time[k])
        for acting, lasts in ((before, delay_s), (torque, size - delay_s)):
            if lasts > 0:
                x = solve_ivp(rate, (0, lasts), x, args=(acting,), method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
        states.append(x)
        before = torque
    return np.array(states)


@pytest.mark.parametrize("kind", ["model", "fmu"])
@pytest.mark.parametrize("delay", [0.0, 0.4])
def test_motion_is_that_of_a_direct_integration(kind: str, delay: float) -> None:
    """A fraction of a delay is a time: 0.4 of the nominal period, however long the period is."""
    motion = along(slowing(120))
    plant = component(kind, scara().block()).with_substeps(64)
    assert plant is not None
    found = simulate(at_instants(loop(plant, component(kind, scara_pd()), motion, delay_samples=delay)), motion)

    def command(k: int, x: np.ndarray) -> np.ndarray:
        wanted = motion.values[k]
        return np.array([3700, 62]) * (wanted[:2] - x[:2]) + np.array([230, 4]) * (wanted[2:4] - x[2:])

    x = integrated(motion, command, delay * PERIOD)
    got = found.table(["plant.q1", "plant.q2", "plant.dq1", "plant.dq2"], sampled=True)
    np.testing.assert_allclose(got, x, rtol=0, atol=2e-7)
    even = simulate(replace(loop(plant, component(kind, scara_pd()), motion, delay_samples=delay)), along(
        PERIOD * np.arange(120)
    ))  # fmt: skip
    assert np.abs(even.table(["plant.q1", "plant.q2"], sampled=True) - x[:, :2]).max() > 1e-2
    np.testing.assert_array_equal(found.time, motion.time)


@pytest.mark.gate
@pytest.mark.parametrize("kind", ["fmu 2", "fmu 3", "model", "linear"])
@pytest.mark.parametrize("timing", TIMINGS)
def test_both_masters_give_the_same_bits(kind: str, timing: str) -> None:
    motion, ticks = along(slowing()), np.array([0, 1, 5, 40, 41, 150, 199])
    system = at_instants(system_of(kind, **TIMINGS[timing]))
    fast = simulate(system, motion, ticks=ticks, compiled=True)
    slow = simulate(system, motion, ticks=ticks, compiled=False)
    assert (fast.compiled, slow.compiled) == (True, False)
    assert_same(fast, slow)
    np.testing.assert_array_equal(fast.time, motion.time[ticks])


@pytest.mark.parametrize("timing", TIMINGS)
def test_instants_of_one_rate_give_the_loop_of_that_rate(timing: str) -> None:
    system, motion = system_of("fmu 2", **TIMINGS[timing]), reference()
    even, named = simulate(system, motion), simulate(at_instants(system), motion)
    for name, values in even.applied.items():
        np.testing.assert_allclose(named.applied[name], values, rtol=0, atol=1e-9, err_msg=name)


def test_a_sampled_python_controller_runs_once_at_each_instant_with_its_nominal_period() -> None:
    """x[k+1] = x[k] + T e[k], y = 3 x + 2 e, by hand; T is its own period, whatever that of the loop."""
    motion = along(slowing(150))
    names = {"inputs": ["u1", "u2"], "outputs": ["command1", "command2"]}
    law = control.ss(np.eye(2), PERIOD * np.eye(2), 3 * np.eye(2), 2 * np.eye(2), PERIOD, **names)
    system = System(
        components={"law": wrap_control(law)},
        connections=tuple(Connection(f"reference.q{j}", f"law.u{j}") for j in (1, 2)),
        order=("law",), step_size=PERIOD, at_instants=True,
    )  # fmt: skip
    error = motion.select(["q1", "q2"])
    state = PERIOD * np.cumsum(np.vstack([np.zeros(2), error[:-1]]), axis=0)
    for compiled in (True, False):
        found = simulate(system, motion, compiled=compiled).table(["law.command1", "law.command2"])
        np.testing.assert_allclose(found, 3 * state + 2 * error, rtol=1e-12, atol=1e-14)


@dataclass(frozen=True)
class Divided(Mock):
    """A component that is integrated by so many substeps a step."""

    def with_substeps(self, count: int) -> Component:
        return self


@pytest.mark.parametrize("every", [1, 3])
def test_who_steps_how_far(every: int) -> None:
    """An FMU of another tool gets the actual steps, a sampled law counts, what is integrated here gets none longer."""
    time = np.array([0.0, 1.0, 2.0, 4.5, 5.4, 6.9, 7.9, 8.9, 9.9, 11.4, 12.4, 13.4]) * PERIOD
    motion, log = trajectory(time, {"q1": np.zeros(time.size)}), list[tuple[Any, ...]]()
    made = {
        name: kind(name, ports("u"), ports("y", causality="output"), log=log, sample_time=period)
        for name, kind, period in (("fmu", Mock, None), ("law", Mock, PERIOD), ("plant", Divided, None))
    }
    links = tuple(Connection("reference.q1", f"{name}.u") for name in made)
    system = System(made, links, tuple(made), PERIOD, every=dict.fromkeys(made, every), at_instants=True)
    simulate(system, motion)
    begins = time[::every]
    ends = np.append(time[every::every], 14.4 * PERIOD)
    steps = {name: np.array(part.calls("step"), dtype=float) for name, part in made.items()}
    np.testing.assert_allclose(steps["fmu"], np.column_stack([begins, ends - begins]), rtol=0, atol=1e-12)
    counted = PERIOD * every * np.arange(begins.size)
    np.testing.assert_allclose(
        steps["law"], np.column_stack([counted, np.full(begins.size, every * PERIOD)]), atol=1e-12
    )
    assert steps["plant"][:, 1].max() <= 1.01 * every * PERIOD + 1e-12
    assert len(steps["plant"]) > len(steps["fmu"])
    np.testing.assert_allclose(steps["plant"][1:, 0], np.cumsum(steps["plant"][:-1, 1]), atol=1e-12)
    assert steps["plant"][:, 1].sum() == pytest.approx(14.4 * PERIOD)


def test_a_delay_that_is_longer_than_a_period_acts_before_the_next_instant() -> None:
    time = np.concatenate([np.arange(20), 19 + 0.2 * np.arange(1, 11), 21 + np.arange(1, 20)]) * PERIOD
    motion = along(time)
    system = at_instants(system_of("fmu 2", delays={"plant": 0.7}))
    fast, slow = (simulate(system, motion, compiled=compiled) for compiled in (True, False))
    assert_same(fast, slow)
    assert np.isfinite(fast.applied["plant.q1"]).all()


def test_without_leave_uneven_instants_are_refused() -> None:
    with pytest.raises(InputError, match="not sampled at the control rate"):
        simulate(system_of("fmu 2"), along(slowing()))


# ---- the log -----------------------------------------------------------------------------------------

INSTANTS = Instants(slowing(60, start=2.0), PERIOD)


def test_positions_and_times_are_inverse() -> None:
    times = np.linspace(2.0 - 0.7 * PERIOD, INSTANTS.ends[-1] + PERIOD, 400)
    places = INSTANTS.position(times)
    np.testing.assert_allclose(INSTANTS.at(places), times, rtol=0, atol=1e-12)
    np.testing.assert_allclose(INSTANTS.position(INSTANTS.time), np.arange(60), rtol=0, atol=1e-12)
    assert (np.diff(places) > 0).all()


@pytest.mark.parametrize("window", ["preceding", "centred", "following"])
def test_an_average_is_the_mean_of_the_held_command_over_its_window(window: Any) -> None:
    values = np.random.default_rng(1).normal(size=60)

    def command(t: float) -> float:
        return float(values[int(np.searchsorted(INSTANTS.time, t, side="right")) - 1])

    times, length = 2.05 + 0.0131 * np.arange(12), 0.0131
    operator = sample_operator(
        times, start=0.0, step=PERIOD, tick_count=60, kind="average", window=window, window_s=length, instants=INSTANTS
    )
    shift = {"preceding": -1.0, "centred": -0.5, "following": 0.0}[window]
    wanted = []
    for low in times + shift * length:
        inside = INSTANTS.time[(INSTANTS.time > low) & (INSTANTS.time < low + length)]
        wanted.append(quad(command, low, low + length, points=inside)[0] / length)
    np.testing.assert_allclose(operator.apply(values[operator.ticks]), wanted, rtol=0, atol=1e-9)


def test_a_late_clock_is_a_time() -> None:
    """Points of a straight line in time, between instants, come from so much earlier."""
    late, times = 0.004, 2.06 + 0.01 * np.arange(15)
    operator = sample_operator(times, start=0.0, step=PERIOD, tick_count=60, instants=INSTANTS)
    moved = operator.stamped_later(late / PERIOD, 60)
    np.testing.assert_allclose(moved.apply(INSTANTS.time[moved.ticks]), times - late, rtol=0, atol=1e-12)
    at = operator.apply(INSTANTS.time[operator.ticks])
    assert (at <= times + 1e-12).all() and (times - at < 1.5 * PERIOD).all()


def test_a_log_beyond_the_last_period_is_refused() -> None:
    with pytest.raises(InputError, match="beyond the reference"):
        sample_operator(INSTANTS.ends[-1:] + 0.001, start=0.0, step=PERIOD, tick_count=60, instants=INSTANTS)


# ---- a period that changes -----------------------------------------------------------------------------

EVEN = PERIOD * np.arange(4000)
RNG = np.random.default_rng(8)


@pytest.mark.parametrize(
    "time",
    [
        EVEN,
        np.round(EVEN, 3),
        EVEN + 0.2 * PERIOD * RNG.normal(size=EVEN.size).clip(-2, 2),
        np.delete(EVEN, RNG.choice(EVEN.size, 900, replace=False)),
        np.cumsum(PERIOD * (1 + 0.05 * RNG.exponential(size=EVEN.size) * (RNG.random(EVEN.size) < 0.1))),
        np.cumsum(PERIOD * (1 + 0.1 * RNG.normal(size=EVEN.size))),
        EVEN[:40],
    ],
    ids=["even", "rounded", "jittered", "rows missing", "late cycles", "uneven cycles", "short"],
)
def test_one_rate_is_no_change(time: np.ndarray) -> None:
    assert period_change(np.sort(time)) is None


@pytest.mark.parametrize("grows", [True, False])
def test_a_change_is_found_with_its_size(grows: bool) -> None:
    periods = PERIOD * np.concatenate([np.ones(2000), np.linspace(1, 1.2, 2000)])
    time = np.cumsum(periods if grows else periods[::-1])
    found = period_change(time + 0.05 * PERIOD * RNG.normal(size=time.size))
    assert found is not None
    assert (found.shortest, found.longest) == pytest.approx((PERIOD, 1.2 * PERIOD), rel=0.01)
    assert found.grows is grows
    assert found.early < 10 < found.late


def test_error_difference_feels_the_error_alone() -> None:
    """With a law on the difference of the error a loop that runs late keeps following a fast motion; one that divides
    the difference of the position by its nominal period takes every velocity for too high."""
    motion, lost, plant = along(slowing(400)), {}, component("model", scara().block())
    for velocity in ("error_difference", "backward_difference"):
        law = law_block(law="pd", joints=["revolute"] * 2, Kp=[3700, 62], Kd=[230, 4], velocity=velocity)
        found = simulate(at_instants(loop(plant, component("model", law), motion)), motion)
        lost[velocity] = np.abs(found.applied["plant.q1"] - motion.column("q1")).max()
    assert lost["error_difference"] < 0.3 * lost["backward_difference"]


def test_isolated_fmus_give_the_same_bits() -> None:
    motion = along(slowing(60))
    plant, law = (load_fmu(build_fmu(block)) for block in (scara().block(), scara_pd()))
    apart = loop(replace(plant, isolated=True), replace(law, isolated=True), motion)
    found = simulate(at_instants(apart), motion)
    assert_same(found, simulate(at_instants(loop(plant, law, motion)), motion))


def test_an_average_over_a_lasting_command_does_not_move_with_a_shift() -> None:
    operator = sample_operator(
        2.1 + 0.013 * np.arange(8), start=0.0, step=PERIOD, tick_count=60, kind="average", instants=INSTANTS
    )
    moved = operator.stamped_later(0.8, 60)
    np.testing.assert_allclose(moved.apply(np.ones(moved.ticks.size)), 1.0, rtol=0, atol=1e-12)
