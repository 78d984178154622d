"""Co-simulation of FMI 3.0 with events: clocks, event mode, steps that come back early."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import FmuError, SimulationError
from fmu_didim.components.fmu import load_fmu
from fmu_didim.components.fmu.isolation.isolate import IsolatedInstance
from fmu_didim.cosim import Connection, System, simulate
from fmu_didim.data.signals import trajectory
from tests.awkward.build import awkward_fmu
from tests.awkward.versions import clocked, sawtooth
from tests.helpers import advance, begin, drive

T = 0.01
U = np.random.default_rng(1).normal(size=(40, 2))


def pi_law(u: np.ndarray, *, kp: float = 3.0, ki: float = 5.0) -> np.ndarray:
    """Commands at the ticks by the law's own equations."""
    e = u[:, 0] - u[:, 1]
    return kp * e + ki * T * (np.cumsum(e) - e)


@pytest.mark.gate
@pytest.mark.parametrize("start", [0.0, 1.7])
@pytest.mark.parametrize("isolated", [False, True])
def test_a_clocked_controller_is_the_plain_one(tmp_path: Path, start: float, isolated: bool) -> None:
    made = load_fmu(clocked(tmp_path), isolated=isolated)
    assert made.event_mode and made.sample_time == T and made.describe()["event_mode"] is True
    plain = load_fmu(clocked(tmp_path, plain=True))
    assert not plain.event_mode
    got = drive(made, U, T, start)
    np.testing.assert_allclose(got[:, 0], pi_law(U), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(got, drive(plain, U, T, start))
    changed = made.with_parameters({"kp": 1.0, "ki": 0.5})
    np.testing.assert_allclose(drive(changed, U, T, start)[:, 0], pi_law(U, kp=1.0, ki=0.5), rtol=0, atol=1e-12)


@pytest.mark.parametrize("shift", [0, 3])
def test_ticks_are_counted(tmp_path: Path, shift: int) -> None:
    """Every fifth communication point is a tick, also the ten thousandth; between them the command is held."""
    interval = f'intervalDecimal="0.01" shiftDecimal="{shift * 0.002}"'
    made = load_fmu(clocked(tmp_path, variability="fixed", interval=interval))
    u = np.random.default_rng(2).normal(size=(10_001, 2))
    got = drive(made, u, 0.002)
    wanted = np.repeat(pi_law(u[shift::5]), 5)
    np.testing.assert_allclose(got[shift:, 0], wanted[: len(u) - shift], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(got[:shift, 0], 0)
    assert got[-1, 1] == (10_000 - shift) // 5 + (1 if (10_000 - shift) % 5 else 0)


def test_intervals_as_counters(tmp_path: Path) -> None:
    interval = 'supportsFraction="true" resolution="1000" intervalCounter="10" shiftCounter="0"'
    made = load_fmu(clocked(tmp_path, interval=interval))
    assert made.sample_time == T
    np.testing.assert_allclose(drive(made, U, T)[:, 0], pi_law(U), rtol=0, atol=1e-12)


def closed(law: Any, plant: Any) -> np.ndarray:
    system = System(
        components={"law": law, "plant": plant},
        connections=(
            Connection("reference.r", "law.r"), Connection("plant.y", "law.y"), Connection("law.u", "plant.u")
        ),
        order=("law", "plant"),
        step_size=T,
    )  # fmt: skip
    motion = trajectory(np.arange(100) * T, {"r": np.sin(np.arange(100) * 0.1)})
    return simulate(system, motion).table(["law.u", "plant.y"])


@pytest.mark.gate
def test_a_clocked_controller_in_the_loop(tmp_path: Path) -> None:
    plant = load_fmu(awkward_fmu(tmp_path)).with_parameters({"d": 0.0})
    found = [closed(load_fmu(clocked(tmp_path, plain=plain)), plant) for plain in (False, True)]
    np.testing.assert_array_equal(*found)
    x = integral = 0.0
    for k in range(100):
        e = np.sin(k * 0.1) - x
        u = 3 * e + 5 * integral
        np.testing.assert_allclose(found[0][k], [u, x], rtol=0, atol=1e-12)
        integral, x = integral + T * e, x + T * (u - 2 * x)


def test_clocked_fmus_are_run_again_and_keep_their_state(tmp_path: Path) -> None:
    made = load_fmu(clocked(tmp_path))
    wanted = drive(made, U, T)
    instance = made.with_parameters({"kp": 9.0}).instantiate()
    begin(instance, U[0])
    advance(instance, U[0], 0.0, T)
    assert instance.restart(made)
    assert made.describe()["reset"] == "reset"
    begin(instance, U[0])
    got = [advance(instance, U[k], k * T, T) for k in range(10)]
    state = instance.save_state()
    rest = [advance(instance, U[k], k * T, T) for k in range(10, 20)]
    np.testing.assert_array_equal(got + rest, wanted[:20])
    instance.restore_state(state)
    np.testing.assert_array_equal([advance(instance, U[k], k * T, T) for k in range(10, 20)], rest)
    instance.close()


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"variability": "triggered", "interval": ""}, r"clock 'sample'.*not supported[\s\S]*triggered interval"),
        ({"variability": "countdown", "interval": ""}, r"clock 'sample'.*not supported[\s\S]*countdown"),
        ({"variability": "changing"}, r"clock 'sample'.*not supported[\s\S]*changing"),
        ({"variability": "tunable"}, r"clock 'sample'.*not supported[\s\S]*tunable"),
        ({"interval": ""}, r"clock 'sample'.*not supported[\s\S]*not given s"),
        ({"abilities": ""}, r"clock 'sample' of the FMU needs co-simulation with event mode"),
        ({"interface": "ModelExchange"}, r"clock 'sample' of the FMU needs co-simulation with event mode"),
        ({"causality": "output", "variability": "triggered", "interval": ""}, "'r' belongs to the clock 'sample'"),
        ({"interface": "ScheduledExecution", "abilities": ""}, "scheduled-execution only"),
    ],
)  # fmt: skip
def test_other_clocks_are_refused(tmp_path: Path, options: dict[str, str], problem: str) -> None:
    with pytest.raises(FmuError, match=problem):
        load_fmu(clocked(tmp_path, **options))  # type: ignore[arg-type]


@pytest.mark.parametrize("size", [0.004, 0.02, 0.015])
def test_ticks_between_communication_points_are_refused(tmp_path: Path, size: float) -> None:
    with pytest.raises(
        SimulationError, match=r"clock 'sample'.*between two communication points[\s\S]*another control"
    ):
        drive(load_fmu(clocked(tmp_path)), U, size)


@pytest.mark.gate
@pytest.mark.parametrize("event_mode", [False, True])
@pytest.mark.parametrize("macros", [(), ("EARLY",), ("TIMED",)])
def test_events_and_early_returns(tmp_path: Path, event_mode: bool, macros: tuple[str, ...]) -> None:
    """x' = 1, from 1 back to 0: x = t mod 1, whoever does it and in however many pieces a step is made."""
    made = load_fmu(sawtooth(tmp_path, *macros), event_mode=event_mode)
    times = np.arange(240) * 0.013
    got = drive(made, np.ones((240, 1)), 0.013)
    np.testing.assert_allclose(got[:, 0], times % 1, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(got[:, 1], times // 1)


def test_steps_that_lead_nowhere_are_told(tmp_path: Path) -> None:
    path = sawtooth(tmp_path, "STUCK")
    for event_mode in (False, True):
        with pytest.raises(SimulationError, match="comes back early from its steps again and again"):
            drive(load_fmu(path, event_mode=event_mode), np.ones((3, 1)), T)


def test_event_mode_must_be_there(tmp_path: Path) -> None:
    for path in (sawtooth(tmp_path, events=False), awkward_fmu(tmp_path)):
        with pytest.raises(FmuError, match="has no event mode"):
            load_fmu(path, event_mode=True)
    isolated = load_fmu(sawtooth(tmp_path), event_mode=True, isolated=True).instantiate()
    assert isinstance(isolated, IsolatedInstance)
    isolated.close()
