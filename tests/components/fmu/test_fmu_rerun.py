"""FMUs run again: the way that has been seen to work is used, nothing is left over from the run before."""

from __future__ import annotations

import gc
import os
import pickle
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import FmuError, InputError, SimulationError
from fmu_didim.components import Instance
from fmu_didim.components.fmu import load_fmu, probe_fmu
from fmu_didim.components.fmu.isolation import process as process_module
from fmu_didim.components.fmu.isolation.isolate import IsolatedInstance
from fmu_didim.components.fmu.isolation.process import ProcessEndedError
from fmu_didim.components.fmu.reuse import reset as rerun_module
from fmu_didim.components.fmu.reuse.reset import TOGETHER, Facts, choose
from fmu_didim.cosim import Connection, InstancePool, System, simulate
from fmu_didim.data.signals import trajectory
from fmu_didim.export.versions import VERSIONS
from tests.awkward.build import awkward_fmu, library
from tests.awkward.versions import fmi_1
from tests.components.fmu.helpers import H, exported, slave_outputs
from tests.helpers import PERIOD, advance, begin, drive
from tests.patience import patience

U = np.random.default_rng(5).normal(size=(30, 1))


@pytest.fixture(autouse=True)
def new_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is known yet; what has been compiled stays where it is."""
    kept = rerun_module.cache_directory
    monkeypatch.setattr(rerun_module, "cache_directory", lambda: tmp_path / "known")
    library("slave")
    assert kept() != tmp_path / "known"


def run(instance: Instance, u: np.ndarray, h: float = H) -> np.ndarray:
    begin(instance, np.zeros(u.shape[1]))
    return np.array([advance(instance, row, k * h, h) for k, row in enumerate(u)])


def pid_of(instance: Instance) -> int:
    assert isinstance(instance, IsolatedInstance)
    return instance._worker._process.pid


@pytest.mark.gate
@pytest.mark.parametrize(
    ("macros", "strategy"),
    [
        ((), "reset"),
        (("RESET_KEEPS_STATE",), "state"),
        pytest.param(("RESET_KEEPS_PARAMETERS",), "state", marks=pytest.mark.slow),
        (("RESET_KEEPS_STATE", "STATE_INCOMPLETE"), "re-instantiate"),
        (("COUNTS_INSTANCES",), "fresh process"),
        (("CRASH_IN_RESET",), "state"),
        (("CRASH_IN_NEW_STATE",), "reset"),
        (("SETUP_OVERWRITES",), "reset"),
        pytest.param(("SETUP_OVERWRITES", "RESET_KEEPS_PARAMETERS"), "reset", marks=pytest.mark.slow),
        pytest.param(("SETUP_OVERWRITES", "CRASH_IN_RESET"), "state", marks=pytest.mark.slow),
        pytest.param(("PARAMETERS_UNREADABLE",), "reset", marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("isolated", [None, pytest.param(True, marks=pytest.mark.slow)])
def test_runs_again_are_as_new(tmp_path: Path, macros: tuple[str, ...], strategy: str, isolated: bool | None) -> None:
    """Parameters changed before, but not in the new component, are back at their start values."""
    made = load_fmu(awkward_fmu(tmp_path, *macros), isolated=isolated)
    assert made.describe()["reset"] == "auto"
    changed = made.with_parameters({"a": 1.0, "d": -0.3, "n": 3, "flip": True, "internal": 0.4})
    instance: Instance = changed.instantiate()
    counts = "COUNTS_INSTANCES" in macros
    for step, component in enumerate((changed, made, made.with_parameters({"d": 2.0}), made, changed, made)):
        if step and not instance.restart(component):
            instance.close()
            instance = component.instantiate()
        got = run(instance, U)
        if step and counts:  # known from now on: a new process, in which the first instance starts at 0
            assert isinstance(instance, IsolatedInstance)
        values = component.parameter_values()
        wanted = slave_outputs(U, a=values["a"], d=values["d"])
        if component is changed:
            wanted = -3 * (wanted + 0.4 * (1 - H * 1.0) ** np.arange(len(U))[:, None])
        if step or not counts:
            np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-13)
    instance.close()
    told = made.describe()
    assert told["reset"] == strategy
    assert len(told["reset_reason"]) > 10


@pytest.mark.slow
@pytest.mark.parametrize("macros", [(), ("RESET_KEEPS_STATE",), ("RESET_KEEPS_STATE", "STATE_INCOMPLETE")])
def test_isolated_instances_keep_their_process(tmp_path: Path, macros: tuple[str, ...]) -> None:
    made = load_fmu(awkward_fmu(tmp_path, *macros), isolated=True)
    instance = made.instantiate()
    pid = pid_of(instance)
    for a in (1.0, 2.0, 3.0):
        component = made.with_parameters({"a": a})
        assert instance.restart(component)
        assert pid_of(instance) == pid
        np.testing.assert_array_equal(run(instance, U), drive(component, U, H))
    instance.close()


@pytest.mark.gate
def test_a_fresh_process_for_every_run(tmp_path: Path) -> None:
    made = load_fmu(awkward_fmu(tmp_path, "COUNTS_INSTANCES"), rerun="fresh process")
    first, found = made.instantiate(), []
    for _ in range(2):
        found.append(run(first, U))
        pid = pid_of(first)
        assert not first.restart(made)
        first.close()
        first = made.instantiate()
        assert pid_of(first) != pid
    first.close()
    np.testing.assert_array_equal(found[0], found[1])
    assert made.describe()["isolated"] is True


@pytest.mark.gate
def test_a_way_that_crashes_is_not_taken(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The reset crashes in the trial's process only, and is never used: nothing keeps the FMU from running here."""
    made = load_fmu(awkward_fmu(tmp_path, "CRASH_IN_RESET"))
    instance = made.instantiate()
    assert not instance.restart(made)  # it was made without keeping its new state
    instance.close()
    instance = made.instantiate()
    assert not isinstance(instance, IsolatedInstance)
    for _ in range(2):
        np.testing.assert_allclose(run(instance, U), slave_outputs(U), rtol=0, atol=1e-13)
        assert instance.restart(made)
    instance.close()
    told = made.describe()
    assert told["reset"] == "state" and "crashed" in told["reset_reason"] and "isolated" not in told
    assert not caplog.records
    with pytest.raises(FmuError, match="crashed"):
        broken = load_fmu(made.path, isolated=True, rerun="reset")
        instance = broken.instantiate()
        run(instance, U)
        instance.restart(broken)


@pytest.mark.gate
def test_fmus_that_crash_in_what_every_run_does_are_isolated(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Reset and state work, but some instances after each other take the process with them; that is told once."""
    made = load_fmu(awkward_fmu(tmp_path, "CRASH_AT_THIRD"))
    assert made.find_rerun().isolated
    for _ in range(2):
        instance = made.instantiate()
        assert isinstance(instance, IsolatedInstance)
        for _ in range(4):
            np.testing.assert_allclose(run(instance, U), slave_outputs(U), rtol=0, atol=1e-13)
            assert instance.restart(made)
        instance.close()
    (record,) = caplog.records
    assert record.levelname == "WARNING"
    for part in ("crash_at_third.fmu", "by 'reset'", "several instances in one process", "costs", "'rerun'"):
        assert part in record.getMessage()
    load_fmu(made.path, isolated=True).instantiate().close()
    load_fmu(made.path, rerun="fresh process").instantiate().close()
    assert len(caplog.records) == 1  # as asked for


FINE = {"deterministic": True, "reproducible": True}
GOOD, BAD = "restores", "does not restore"


@pytest.mark.parametrize(
    ("facts", "strategy", "isolated"),
    [
        (Facts(**FINE, reset=GOOD, new_state=GOOD), "reset", False),
        (Facts(**FINE, reset=GOOD, new_state="crash", crashed=("state",)), "reset", False),
        (Facts(**FINE, reset="crash", new_state=GOOD, crashed=("reset",)), "state", False),
        (Facts(**FINE, reset="a", new_state="b", crashed=("reset", "state",)), "re-instantiate", False),
        (Facts(**FINE, reset=GOOD, new_state=BAD, crashed=(TOGETHER,)), "reset", True),
        (Facts(**FINE, reset=BAD, new_state=GOOD, crashed=("reset", "parameters",)), "state", True),
        (Facts(**FINE, reset=BAD, new_state=BAD, crashed=("parameters",)), "re-instantiate", True),
        (Facts(reproducible=True, reset=GOOD), "fresh process", True),
        (Facts(reset=GOOD), "re-instantiate", False),
        (Facts(crashed=("reset",)), "re-instantiate", False),
        (Facts(failure="why", crashed=("runs",)), "fresh process", True),
        (Facts(failure="why"), "re-instantiate", False),
        (Facts(single=True, reproducible=True, reset=GOOD, new_state=GOOD), "reset", True),
        (Facts(single=True, reproducible=True, reset=BAD, new_state=GOOD), "state", True),
        (Facts(single=True, reproducible=True, reset=BAD, new_state=BAD), "fresh process", True),
        (Facts(single=True, reset=GOOD, new_state=GOOD), "fresh process", True),
    ],
)  # fmt: skip
def test_what_is_chosen(facts: Facts, strategy: str, isolated: bool) -> None:
    found = choose(facts)
    assert (found.strategy, found.isolated) == (strategy, isolated)


@pytest.mark.gate
def test_fmus_that_never_run_are_isolated_after_a_crash(tmp_path: Path) -> None:
    made = load_fmu(awkward_fmu(tmp_path, "CRASH_IN_STEP"))
    assert made.find_rerun().strategy == "fresh process"
    assert isinstance(made.instantiate(), IsolatedInstance)


@pytest.mark.gate
@pytest.mark.parametrize(
    ("macro", "way"),
    [
        ("CRASH_AT_SECOND", "is fatal or hangs"), ("REFUSES_SECOND", "is refused"),
        pytest.param("HANG_AT_SECOND", "is fatal or hangs", marks=pytest.mark.slow),  # limits that run out
    ],
)  # fmt: skip
@pytest.mark.parametrize(
    ("further", "strategy"),
    [
        ((), "reset"),
        pytest.param(("RESET_KEEPS_STATE", "STATE_INCOMPLETE"), "fresh process", marks=pytest.mark.slow),
    ],
)
def test_one_instance_a_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, macro: str, way: str, further: tuple[str, ...], strategy: str
) -> None:
    """It is run in processes of its own, told as what it is, and not called faulty."""
    monkeypatch.setattr(rerun_module, "TIME_LIMIT", 15.0)
    made = load_fmu(awkward_fmu(tmp_path, macro, *further))
    found = made.find_rerun()
    assert (found.strategy, found.isolated) == (strategy, True)
    assert f"a second instance in one process {way}" in found.reason
    assert kept(tmp_path) == ["reruns"]  # alone it is quick: no busy machine was to blame
    system = System({"slave": made}, (Connection("reference.u", "slave.u"),), ("slave",), H)
    pool, along = InstancePool(), trajectory(np.arange(len(U)) * H, {"u": U[:, 0]})
    for values in ({}, {"a": 1.0}, {}):
        got = simulate(system.replace("slave", made.with_parameters(values)), along, pool=pool)
        np.testing.assert_allclose(got.applied["slave.y"][:, None], slave_outputs(U, **values), rtol=0, atol=1e-13)
    pool.close()


def test_the_trial_is_done_once_for_all_values(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    real = rerun_module.find_facts

    def counted(run: rerun_module.TrialRunner) -> Facts:
        asked.append(run.component)
        return real(run)

    monkeypatch.setattr(rerun_module, "find_facts", counted)
    made = load_fmu(awkward_fmu(tmp_path))
    instance = made.instantiate()
    assert not asked
    for a in (1.0, 2.0, 3.0):
        assert instance.restart(made.with_parameters({"a": a}))
    assert load_fmu(made.path).describe()["reset"] == "reset"
    monkeypatch.setattr(rerun_module, "_known", {})  # as in another process
    assert instance.restart(pickle.loads(pickle.dumps(made)))
    instance.close()
    assert len(asked) == 1


# ---- what is kept for later runs -----------------------------------------------------------------------


def failing(monkeypatch: pytest.MonkeyPatch, question: str, *, by_fmu: bool) -> None:
    """One of the trials ends its process, the first time that it is asked for."""
    real, asked_for = process_module.Worker.request, []

    def request(self: Any, what: str, function: Any, *arguments: Any, **options: Any) -> Any:
        if function is process_module.hold:
            asked_for.append(arguments[0].__name__)
            if asked_for[-1] == question and asked_for.count(question) == 1:
                error = ProcessEndedError("The process ended.", next_step="Change it.")
                error.by_fmu = by_fmu
                raise error
        return real(self, what, function, *arguments, **options)

    monkeypatch.setattr(process_module.Worker, "request", request)


def kept(tmp_path: Path) -> list[str]:
    return sorted(path.parent.name for path in (tmp_path / "known").glob("*/*.json"))


@pytest.mark.gate
@pytest.mark.parametrize("by_fmu", [False, True])
@pytest.mark.parametrize("question", ["in_turn", "once"])
def test_a_trial_that_did_not_come_to_its_end_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, question: str, by_fmu: bool
) -> None:
    """A crash is an answer of the FMU; a time limit or a process that did not start may come from the machine."""
    made = load_fmu(awkward_fmu(tmp_path))
    with monkeypatch.context() as busy:
        failing(busy, question, by_fmu=by_fmu)
        made.find_rerun()
    assert kept(tmp_path) == (["reruns"] if by_fmu else [])
    told = [record.getMessage() for record in caplog.records if "did not end" in record.getMessage()]
    assert len(told) == (not by_fmu)
    assert by_fmu or question.replace("_", " ") in told[0]
    monkeypatch.setattr(rerun_module, "_known", {})  # as in another process
    found = made.find_rerun()
    assert kept(tmp_path) == ["reruns"]
    assert (found.strategy, found.isolated) == ("reset", by_fmu and question == "in_turn")


@pytest.mark.gate
@pytest.mark.parametrize(
    "question",
    [
        "response",
        "saved_state",
        *(pytest.param(q, marks=pytest.mark.slow) for q in ("side_by_side", "parameters", "tunable")),
    ],
)
def test_a_probe_that_did_not_come_to_its_end_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, question: str
) -> None:
    made = load_fmu(awkward_fmu(tmp_path))
    for by_fmu, wanted in ((False, []), (True, ["reruns"])):
        with monkeypatch.context() as busy:
            failing(busy, question, by_fmu=by_fmu)
            probe_fmu(made)
        assert kept(tmp_path) == wanted


@pytest.mark.slow
def test_what_does_not_run_here_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A licence or a library that is missing today may be there tomorrow."""
    monkeypatch.setattr(rerun_module, "TIME_LIMIT", 0.5)
    for macro in ("CRASH_IN_STEP", "HANG_IN_STEP", "MISSING_SYMBOL"):
        made = load_fmu(awkward_fmu(tmp_path, macro))
        assert made.find_rerun() is made.find_rerun()  # in this process it is
        assert probe_fmu(made, time_limit_s=0.5).facts.failure  # a crash and a hang alike
    assert kept(tmp_path) == []


@pytest.mark.gate
@pytest.mark.parametrize(
    ("macro", "by_fmu"), [("CRASH_IN_STEP", True), ("EXIT_IN_STEP", True), ("HANG_IN_STEP", False), ("", False)]
)
def test_who_ended_the_process(tmp_path: Path, macro: str, by_fmu: bool) -> None:
    made = load_fmu(awkward_fmu(tmp_path, *([macro] if macro else [])), isolated=True, time_limit_s=patience(1.0))
    instance = made.instantiate()
    if not macro:  # as a system without memory left
        os.kill(pid_of(instance), 9)
    with pytest.raises(ProcessEndedError) as caught:
        run(instance, U)
    assert caught.value.by_fmu == by_fmu
    instance.close()


@pytest.mark.parametrize("program", ["/nowhere/python", sys.executable])
def test_a_process_that_does_not_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str) -> None:
    monkeypatch.setattr(process_module, "worker_command", lambda: [program, "-c", "import sys; sys.exit('gone')"])
    with pytest.raises(ProcessEndedError, match=r"could not be started|last words: gone") as caught:
        load_fmu(awkward_fmu(tmp_path), isolated=True).instantiate()
    assert not caught.value.by_fmu


@pytest.mark.gate
def test_a_probe_of_one_instance_a_process(tmp_path: Path) -> None:
    lines = probe_fmu(load_fmu(awkward_fmu(tmp_path, "CRASH_AT_SECOND"))).lines()
    assert "new instances one after the other: FATAL" in lines
    assert "reset: restores" in lines
    assert "parameters: not tried, as a process can hold one instance only" in lines
    assert lines[-1].startswith("run it again by: reset (a second instance in one process is fatal or hangs")


@pytest.mark.gate
def test_a_probe_within_its_time(tmp_path: Path) -> None:
    """What is left when the time is up is said, and asked the next time."""
    made, told = load_fmu(awkward_fmu(tmp_path)), []
    found = probe_fmu(made, whole_s=0.0, say=told.append)
    assert told == ["whether it can be run again"]
    assert found.facts.reset == "restores"
    assert "half step: NOT KNOWN, the time was up" in found.lines()
    again = probe_fmu(made, say=told.append)
    assert "half step" in told
    assert again.parameters == {"a": "acts", "d": "acts", "unused": "no effect"}


@pytest.mark.gate
@pytest.mark.parametrize(
    ("macro", "line"),
    [
        ("", "half the step: changes outputs by"),
        ("OTHER_AT_HALF_STEP", "half the step: ANOTHER RESULT, y by"),
        ("REFUSED_STEP", "half step: NOT KNOWN, "),
    ],
)
def test_half_the_step(tmp_path: Path, macro: str, line: str) -> None:
    found = probe_fmu(load_fmu(awkward_fmu(tmp_path, *([macro] if macro else []))))
    (said,) = [text for text in found.lines() if text.startswith("half ")]
    assert said.startswith(line)
    assert ("Discard" in said) == (macro == "REFUSED_STEP")
    assert found.rerun.strategy == "reset"


@pytest.mark.gate
@pytest.mark.parametrize(("macro", "told"), [("", False), ("READING_ACTS", True), ("ROUGH_BETWEEN_STEPS", False)])
def test_reading_between_inputs_and_step(tmp_path: Path, macro: str, told: bool) -> None:
    found = probe_fmu(load_fmu(awkward_fmu(tmp_path, *([macro] if macro else []))))
    said = [text for text in found.lines() if "CHANGE WHAT FOLLOWS, y by" in text]
    assert bool(said) == told
    assert found.reading is not None


@pytest.mark.gate
@pytest.mark.parametrize(("dependencies", "d", "told"), [("", 0.5, False), (' dependencies=""', 0.5, True),
                                                        (' dependencies=""', 0.0, False)])  # fmt: skip
def test_outputs_that_follow_against_the_description(tmp_path: Path, dependencies: str, d: float, told: bool) -> None:
    """A loop would take them a step late without a word."""
    made = load_fmu(awkward_fmu(tmp_path, dependencies=dependencies)).with_parameters({"d": d})
    said = [text for text in probe_fmu(made).lines() if "AGAINST THE FMU'S OWN DESCRIPTION" in text]
    assert [text.endswith(": y") for text in said] == [True] * told


@pytest.mark.gate
def test_a_probe_is_a_trial_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = load_fmu(awkward_fmu(tmp_path, "RESET_KEEPS_STATE"))
    found = probe_fmu(made)
    assert made.describe()["reset"] == found.rerun.strategy == "state"
    monkeypatch.delattr(rerun_module, "find_facts")
    instance = made.instantiate()
    wanted = run(instance, U)
    assert instance.restart(made)
    np.testing.assert_array_equal(run(instance, U), wanted)
    instance.close()


@pytest.mark.parametrize("strategy", ["reset", "state", "re-instantiate"])
def test_the_strategy_can_be_chosen(tmp_path: Path, strategy: str) -> None:
    made = load_fmu(awkward_fmu(tmp_path), rerun=strategy)
    instance = made.instantiate()
    wanted = run(instance, U)
    assert instance.restart(made) == (strategy != "re-instantiate")
    if strategy != "re-instantiate":
        np.testing.assert_array_equal(run(instance, U), wanted)
    instance.close()
    assert made.describe()["reset"] == strategy


def test_strategies_are_checked(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"got:   again[\s\S]*valid: auto, reset, state"):
        load_fmu(awkward_fmu(tmp_path), rerun="again")
    with pytest.raises(InputError, match="cannot save its state"):
        load_fmu(fmi_1(tmp_path), rerun="state")


@pytest.mark.parametrize("name", ["scara", "cascade", "pd"])
@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("interface", ["co-simulation", "model-exchange"])
@pytest.mark.parametrize("strategy", ["auto", "state"])
def test_own_fmus_are_exactly_as_new(name: str, version: str, interface: str, strategy: str) -> None:
    """This is why they are reset without a trial."""
    made = load_fmu(exported(name, version), interface=interface, rerun=strategy)
    u = np.sin(np.arange(20)[:, None] * 0.1 + np.arange(len(made.inputs)))
    other = made.with_parameters({n: 1.3 * v + 0.1 for n, v in made.parameter_values().items()})
    wanted = [drive(component, u, PERIOD) for component in (made, other)]
    assert not np.array_equal(*wanted)
    instance = other.instantiate()
    for component, expected in ((other, wanted[1]), (made, wanted[0]), (other, wanted[1]), (made, wanted[0])):
        assert instance.restart(component)
        begin(instance, u[0])
        got = [advance(instance, row, k * PERIOD, PERIOD) for k, row in enumerate(u)]
        np.testing.assert_array_equal(got, expected)
    instance.close()
    assert made.describe()["reset"] == ("reset" if strategy == "auto" else "state")


def test_a_failed_run_can_be_followed_by_another(tmp_path: Path) -> None:
    made = load_fmu(awkward_fmu(tmp_path, "REFUSED_STEP"))
    instance = made.instantiate()
    with pytest.raises(SimulationError, match="Discard"):
        run(instance, U, 0.001)
    assert instance.restart(made)
    np.testing.assert_array_equal(run(instance, U), drive(made, U, H))
    instance.close()


def _resident() -> float:
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


@pytest.mark.gate
@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="counts in /proc")
@pytest.mark.parametrize(
    ("interface", "solver", "strategy"),
    [
        ("co-simulation", "rk4", "auto"), ("model-exchange", "cvode", "auto"), ("co-simulation", "rk4", "state"),
        pytest.param("model-exchange", "rk4", "auto", marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_a_thousand_runs_leave_nothing(
    interface: str, solver: str, strategy: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A place of its own: other processes of the tests leave and take away files in the common one.
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    made = load_fmu(exported("scara", "3.0"), interface=interface, solver=solver, rerun=strategy, substeps=None)
    instance = made.instantiate()
    names = [v.name for v in made.parameters][:3]

    def runs(count: int) -> None:
        for k in range(count):
            changed = made.with_parameters(dict.fromkeys(names, 1.0 + 0.001 * k))
            assert instance.restart(changed)
            begin(instance, np.zeros(2))
            instance.save_state()
            advance(instance, np.zeros(2), 0.0, PERIOD)

    runs(100)
    gc.collect()  # what earlier tests left, which may go at any moment
    handles, memory = len(os.listdir("/proc/self/fd")), _resident()  # noqa: PTH208
    folders = set(tmp_path.iterdir())
    runs(1000)
    assert len(os.listdir("/proc/self/fd")) == handles  # noqa: PTH208
    assert _resident() - memory < 4.0
    assert set(tmp_path.iterdir()) <= folders
    instance.close()
