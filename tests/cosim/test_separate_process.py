"""Loops in a process of their own: what an FMU does to its process does not reach this one."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmu_didim.base.cache import cache_directory
from fmu_didim.base.errors import DivergedError, FmuError, InputError, SimulationError
from fmu_didim.components import FmuComponent, Instance, load_fmu, wrap_control
from fmu_didim.components.fmu.isolation import trust
from fmu_didim.components.fmu.isolation.isolate import IsolatedInstance
from fmu_didim.cosim import Connection, InstancePool, Recording, System, simulate
from fmu_didim.cosim.execution import separate_process
from fmu_didim.data.signals import Trajectory, trajectory
from fmu_didim.export import build_fmu
from tests.awkward.build import awkward_fmu
from tests.components.fmu.helpers import H, slave_outputs
from tests.discovery.drive import drive
from tests.patience import patience

COUNT = 60
U = np.sin(np.arange(COUNT) * 0.3)[:, None]


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Proofs and strategies of one test are none of another; libraries are compiled anew only once."""
    awkward_fmu(tmp_path)  # compiled where it is kept
    (tmp_path / "cache").mkdir()
    for name in ("awkward", "loop", "zig"):
        (tmp_path / "cache" / name).symlink_to(cache_directory() / name)
    monkeypatch.setenv("FMU_DIDIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(trust, "_marks", {})


def along(values: np.ndarray = U) -> Trajectory:
    return trajectory(np.arange(len(values)) * H, {"u": values[:, 0]})


def loop_of(made: FmuComponent, **further: FmuComponent) -> System:
    """The FMU, and others behind it, fed by the reference."""
    parts = {"slave": made, **further}
    links = tuple(Connection("reference.u", f"{name}.u") for name in parts)
    return System(parts, links, tuple(parts), H)


def result(recording: Recording, name: str = "slave") -> np.ndarray:
    return recording.applied[f"{name}.y"][:, None]


def wanted(**values: float) -> np.ndarray:
    """Outputs at the ticks."""
    return slave_outputs(U, **values)


@pytest.mark.gate
def test_an_fmu_runs_apart_until_it_is_proven(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    made = load_fmu(awkward_fmu(tmp_path))
    assert made.needs_own_process()
    pool = InstancePool()
    for values in ({}, {"a": 1.0}, {}):
        found = simulate(loop_of(made.with_parameters(values)), along(), pool=pool)
        np.testing.assert_allclose(result(found), wanted(**values), rtol=0, atol=1e-13)
        assert found.compiled
        assert made.needs_own_process()  # nobody knows yet how it ends
    pool.close()
    assert not made.needs_own_process()
    assert sum("has not run on this machine before" in r.getMessage() for r in caplog.records) == 1
    here = simulate(loop_of(made), along())
    assert np.array_equal(result(here), result(simulate(loop_of(replace(made, isolated=True)), along())))


@pytest.mark.gate
def test_a_proof_is_taken_back_when_a_process_died(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    made = load_fmu(awkward_fmu(tmp_path))
    simulate(loop_of(made), along())
    assert not made.needs_own_process()
    code = (
        "import os, sys; from tests.cosim.test_separate_process import *; made = load_fmu(sys.argv[1]); "
        "assert not made.needs_own_process(); simulate(loop_of(made), along()); os._exit(int(sys.argv[2]))"
    )
    simulate(loop_of(made), along())  # it runs in this process, which lives
    assert not made.needs_own_process()
    subprocess.run([sys.executable, "-c", code, str(made.path), "0"], check=True)
    trust._marks.clear()
    assert made.needs_own_process()
    assert "ended abruptly" in caplog.text
    simulate(loop_of(made), along())
    assert not made.needs_own_process()


FATAL = {
    "CRASH_IN_STEP": "crashed its process (SIGSEGV",
    "EXIT_IN_STEP": "ended its process (exit status 7)",
    "EXIT_WELL_IN_STEP": "ended its process (exit status 0)",
    "HANG_IN_STEP": "no answer within {limit:g} s",
}


@pytest.mark.gate
@pytest.mark.parametrize(
    "macro", [pytest.param(macro, marks=pytest.mark.slow if "HANG" in macro else ()) for macro in FATAL]
)
def test_what_ends_a_process_is_named_with_its_call_and_time(macro: str, tmp_path: Path) -> None:
    good = load_fmu(awkward_fmu(tmp_path), isolated=False)
    limit = patience(1.0)
    made = load_fmu(awkward_fmu(tmp_path, macro), time_limit_s=limit)
    for pool in (None, InstancePool()):
        with pytest.raises(FmuError) as caught:
            simulate(loop_of(good, bad=made), along(), pool=pool)
        for part in (FATAL[macro].format(limit=limit), str(made.path), "step", "t = 0.03 s"):
            assert part in str(caught.value)
    assert made.needs_own_process()


@pytest.mark.gate
def test_an_interrupt_ends_a_loop_that_hangs(tmp_path: Path) -> None:
    limit = patience(100.0)
    made = load_fmu(awkward_fmu(tmp_path, "HANG_IN_STEP"), time_limit_s=limit)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell in the background ignores interrupts
    try:
        threading.Timer(3.0, os.kill, (os.getpid(), signal.SIGINT)).start()
        begin = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            simulate(loop_of(made), along())
        assert time.monotonic() - begin < limit / 2
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("isolated", [None, False])
def test_the_current_folder_stays(isolated: bool | None, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    here = Path.cwd()
    made = load_fmu(awkward_fmu(tmp_path, "CHDIR_IN_STEP"), isolated=isolated)
    np.testing.assert_allclose(result(simulate(loop_of(made), along())), wanted(), rtol=0, atol=1e-13)
    assert Path.cwd() == here
    assert ("changed the current folder" in caplog.text) is (isolated is False)


def test_errors_of_the_run_arrive_as_they_are(tmp_path: Path) -> None:
    made = load_fmu(awkward_fmu(tmp_path), isolated=True)
    with pytest.raises(DivergedError) as caught:
        simulate(loop_of(made), along(), bounds={"slave.y": (-1e-3, 1e-3)})
    assert caught.value.time > 0
    with pytest.raises(InputError, match="not sampled at the control rate"):
        simulate(loop_of(made), trajectory(np.arange(5) * 0.02, {"u": np.zeros(5)}))


def test_who_failed_first_is_the_same_there(tmp_path: Path) -> None:
    """A plant whose equations have no solution for its values."""
    block = drive().with_parameters({"inertia.J": 0.0})
    plant = load_fmu(build_fmu(block)).built_from(block)
    told = []
    for isolated in (False, True):
        made = load_fmu(awkward_fmu(tmp_path), isolated=isolated)
        links = (Connection("reference.u", "slave.u"), Connection("slave.y", "plant.tau"))
        with pytest.raises(SimulationError) as caught:
            simulate(System({"slave": made, "plant": plant}, links, ("slave", "plant"), H), along())
        told.append((str(caught.value), caught.value.component))
    assert told[0] == told[1]
    assert told[0][1] == "plant"


class Sums:
    """An observer that can travel."""

    def __init__(self) -> None:
        self.total = 0.0

    def __call__(self, row: int, instances: Mapping[str, Instance]) -> None:
        self.total += float(instances["slave"].outputs[0])


@pytest.mark.gate
def test_an_observer_comes_back(tmp_path: Path) -> None:
    observer = Sums()
    simulate(loop_of(load_fmu(awkward_fmu(tmp_path), isolated=True)), along(), observe=observer)
    assert observer.total == pytest.approx(float(wanted().sum()), rel=1e-12)


@pytest.mark.gate
def test_what_cannot_travel_is_told_and_runs_here(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    import control

    made = load_fmu(awkward_fmu(tmp_path))
    gain = wrap_control(
        control.nlsys(None, lambda t, x, u, params: 2 * u, inputs=["u"], outputs=["y"], name="gain"), origin="here"
    )
    system = System(
        {"gain": gain, "slave": made},
        (Connection("reference.u", "gain.u"), Connection("gain.y", "slave.u")), ("gain", "slave"), H,
    )  # fmt: skip
    pool = InstancePool()
    for _ in range(2):
        found = simulate(system, along(), pool=pool)
        np.testing.assert_allclose(result(found), 2 * wanted(), rtol=0, atol=1e-13)
    pool.close()
    assert "cannot be sent to another process" in caplog.text
    assert not made.needs_own_process()  # it was seen to run and to end alone


@pytest.mark.gate
def test_fmus_that_do_not_stand_each_other_get_a_process_each(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two instances in one process are fatal to this one."""
    made = load_fmu(awkward_fmu(tmp_path, "CRASH_AT_SECOND"))
    pool, count = InstancePool(), []
    held = IsolatedInstance.__init__
    monkeypatch.setattr(IsolatedInstance, "__init__", lambda self, *a, **k: (count.append(1), held(self, *a, **k))[1])
    for _ in range(2):
        found = simulate(loop_of(made, other=made.with_parameters({"a": 1.0})), along(), pool=pool)
        np.testing.assert_allclose(result(found), wanted(), rtol=0, atol=1e-13)
        np.testing.assert_allclose(result(found, "other"), wanted(a=1.0), rtol=0, atol=1e-13)
    assert len(count) >= 2
    assert "perhaps they cannot share a process" in caplog.text
    pool.close()
    assert not made.needs_own_process()  # one of it does no harm
    assert made.needs_own_process(2)


@pytest.mark.gate
def test_a_process_that_was_killed_from_outside_is_no_fault_of_the_fmu(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = load_fmu(awkward_fmu(tmp_path, "HANG_IN_STEP"), time_limit_s=patience(100.0))
    begun = separate_process.Worker.__init__

    def init(self: separate_process.Worker, where: str, limit: float) -> None:
        begun(self, where, limit)
        threading.Timer(3.0, self.kill).start()

    monkeypatch.setattr(separate_process.Worker, "__init__", init)
    with pytest.raises(FmuError, match="SIGKILL"):
        simulate(loop_of(made), along())
