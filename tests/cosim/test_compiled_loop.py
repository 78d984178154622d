"""The compiled loop against the loop in Python: the same bits; and what only the timing of a system decides."""

from __future__ import annotations

import tracemalloc
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import control
import numpy as np
import pytest

from fmu_didim.base.errors import DivergedError, FmuDidimError, InputError, SimulationError, UnknownNameError
from fmu_didim.components import Component, ModelComponent, block_as_control, load_fmu, wrap_control
from fmu_didim.components.compiled_model import with_compiled_twin
from fmu_didim.cosim import Connection, InstancePool, Recording, System, simulate
from fmu_didim.cosim.execution import buffers
from fmu_didim.cosim.execution import compiled as compiled_module
from fmu_didim.data.signals import Trajectory, trajectory
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu
from fmu_didim.export.versions import VERSIONS
from tests.awkward.build import ARRAYS, awkward_fmu, library, pack
from tests.helpers import PERIOD, Mock, loop, on_reference, ports, reference, scara, scara_cascade, scara_pd, sledge

TIMINGS: dict[str, dict[str, Any]] = {
    "plain": {},
    "jacobi": {"jacobi": True},
    "a fraction of delay": {"delays": {"plant": 1.3}},
    "whole delays on both": {"delays": {"plant": 2, "controller": 1}},
    "a slow controller": {"every": {"controller": 3}},
    "a slow controller in Jacobi order": {"every": {"controller": 2}, "jacobi": True},
    "a slow plant with delay": {"every": {"plant": 2}, "delays": {"plant": 2.6}},
    "a fast plant": {"substeps": {"plant": 5}},
    "all at once": {"every": {"controller": 4}, "substeps": {"plant": 2}, "delays": {"plant": 0.5}},
    "commands after the step": {"after_step": frozenset({"controller"})},
}


@cache
def parts(kind: str) -> tuple[Component, Component]:
    """Plant and controller of the SCARA that compiled code can run."""
    if kind == "fmu 2":
        plant, law = (load_fmu(build_fmu(b)) for b in (scara().block(), scara_cascade()))
        return plant, law
    if kind == "fmu 3":
        plant, law = (load_fmu(build_fmu(b, fmi_version="3.0")) for b in (scara().block(), scara_cascade()))
        return plant, law
    if kind.startswith("exchange"):
        version = f"{kind[-1]}.0"
        plant = load_fmu(build_fmu(scara().block(), fmi_version=version), interface="model-exchange", substeps=4)
        return plant, load_fmu(build_fmu(scara_cascade(), fmi_version=version), interface="model-exchange")
    if kind == "model":
        return tuple(with_compiled_twin(ModelComponent(b)) for b in (scara().block(), scara_cascade()))  # type: ignore[return-value]
    return load_fmu(build_fmu(scara().block())), block_as_control(scara_pd())  # linear, native


def system_of(kind: str, **timing: Any) -> System:
    plant, law = parts(kind)
    return replace(loop(plant, law, reference()), **timing)


def assert_same(first: Recording, second: Recording) -> None:
    for group in ("applied", "inputs", "sampled"):
        mine, other = getattr(first, group), getattr(second, group)
        assert set(mine) == set(other)
        for name in mine:
            np.testing.assert_array_equal(mine[name], other[name], err_msg=f"{group}: {name}")


@pytest.mark.parametrize("kind", ["fmu 2", "fmu 3", "exchange 2", "exchange 3", "model", "linear"])
@pytest.mark.parametrize("timing", TIMINGS)
def test_both_loops_give_the_same_bits(kind: str, timing: str) -> None:
    system, ticks = system_of(kind, **TIMINGS[timing]), np.array([0, 1, 5, 40, 41, 150, 199])
    fast = simulate(system, reference(), ticks=ticks, compiled=True)
    slow = simulate(system, reference(), ticks=ticks, compiled=False)
    assert (fast.compiled, slow.compiled) == (True, False)
    assert_same(fast, slow)
    assert np.abs(fast.applied["plant.q1"]).max() > 0.1


@pytest.mark.parametrize("timing", ["plain", "a fraction of delay", "whole delays on both"])
def test_a_part_of_the_ticks_holds_the_rows_of_all(timing: str) -> None:
    system, ticks = system_of("fmu 2", **TIMINGS[timing]), np.arange(50, 120)
    every, some = (
        simulate(system, reference(), compiled=True),
        simulate(system, reference(), ticks=ticks, compiled=True),
    )
    np.testing.assert_array_equal(some.time, every.time[ticks])
    for group in ("applied", "inputs", "sampled"):
        for name, values in getattr(every, group).items():
            np.testing.assert_array_equal(getattr(some, group)[name], values[ticks], err_msg=f"{group}: {name}")


@pytest.mark.parametrize("together", [1, 7, 4096])
@pytest.mark.parametrize("timing", ["plain", "jacobi", "a fraction of delay"])
@pytest.mark.parametrize("ticks", [None, np.arange(50, 120), np.array([0, 1, 5, 40, 41, 150, 199])])
def test_some_signals_are_recorded_as_among_all(
    timing: str, together: int, ticks: np.ndarray | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are taken from the whole some ticks at a time; where something is delayed, or in Python, all are there."""
    monkeypatch.setattr(compiled_module, "TAKEN", together)
    system, wanted = system_of("fmu 2", **TIMINGS[timing]), ("plant.tau1", "plant.q2", "controller.command1")
    every = simulate(system, reference(), ticks=ticks)
    for compiled in (True, False):
        some = simulate(system, reference(), ticks=ticks, signals=wanted, compiled=compiled)
        if compiled and timing != "a fraction of delay":
            assert {*some.applied, *some.inputs} == set(wanted)
        for group in ("applied", "inputs", "sampled"):
            for name in {*wanted} & {*getattr(every, group)}:
                np.testing.assert_array_equal(getattr(some, group)[name], getattr(every, group)[name])


def test_a_signal_that_is_not_there_cannot_be_recorded() -> None:
    with pytest.raises(UnknownNameError, match=r"plant\.tau3"):
        simulate(system_of("linear"), reference(), signals=("plant.tau1", "plant.tau3"))


def test_what_is_not_recorded_takes_no_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rest of a loop, of which a long log would hold as much, is looked at and let go."""
    monkeypatch.setattr(buffers, "LARGEST", 0)  # no memory of recordings before
    system, motion, peaks = system_of("linear"), reference(100.0), []
    for signals in (None, ("plant.tau1",)):
        simulate(system, motion, signals=signals)
        tracemalloc.start()
        kept = simulate(system, motion, signals=signals)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert kept.inputs["plant.tau1"].size > 20_000 and not kept.applied
    assert peaks[1] < peaks[0] / 3


def test_a_model_is_run_by_its_compiled_code_only_with_a_twin() -> None:
    plain = loop(ModelComponent(scara().block()), ModelComponent(scara_pd()), reference())
    assert not simulate(plain, reference()).compiled
    with pytest.raises(InputError, match="compiled code"):
        simulate(plain, reference(), compiled=True)
    fast = simulate(system_of("model"), reference())
    assert fast.compiled
    plant, law = parts("model")
    assert isinstance(plant, ModelComponent) and isinstance(law, ModelComponent)
    slow = simulate(loop(replace(plant, twin=None), replace(law, twin=None), reference()), reference())
    np.testing.assert_array_equal(fast.applied["plant.q1"], slow.applied["plant.q1"])


def test_parameters_and_names_reach_the_twin() -> None:
    plant, law = parts("model")
    heavy = simulate(loop(plant.with_parameters({"ZZ2": 3.0}), law, reference()), reference())
    light = simulate(loop(plant, law, reference()), reference())
    assert heavy.compiled and light.compiled
    assert np.abs(heavy.applied["plant.q2"] - light.applied["plant.q2"]).max() > 1e-4


@pytest.mark.parametrize("dt", [0, PERIOD, 2 * PERIOD, PERIOD / 2])
def test_linear_systems_of_any_rate(dt: float) -> None:
    """A second-order filter between the command and the plant, sampled or continuous, with feed-through."""
    matrices = ([[0.0, 1.0], [-40.0, -9.0]], [[0.0], [40.0]], [[0.9, 0.0]], [[0.1]])
    smooth = control.ss(*matrices)
    filtered = smooth if dt == 0 else control.sample_system(smooth, dt)
    component = wrap_control(filtered, initial_state=(0.2, -0.1))
    plant = load_fmu(build_fmu(sledge(6.0).block()))
    system = System(
        components={"filter": component, "plant": plant},
        connections=(
            Connection("reference.r", f"filter.{component.inputs[0].name}"),
            Connection(f"filter.{component.outputs[0].name}", "plant.tau1"),
        ),
        order=("filter", "plant"),
        step_size=PERIOD,
    )
    time = np.arange(300) * PERIOD
    motion = trajectory(time, {"r": np.sign(np.sin(9 * time))})
    fast, slow = (simulate(system, motion, compiled=c) for c in (True, False))
    assert_same(fast, slow)
    held = control.sample_system(smooth, PERIOD) if dt == 0 else None
    if held is not None:  # held inputs: the exact solution is the sampled system
        x, wanted = np.array([0.2, -0.1]), []
        for r in motion.values[:, 0]:
            wanted.append(held.C @ x + held.D[:, 0] * r)
            x = held.A @ x + held.B[:, 0] * r
        np.testing.assert_allclose(fast.inputs["plant.tau1"], np.ravel(wanted), rtol=0, atol=1e-8)


def test_divergence_is_the_same_in_both() -> None:
    plant, law = parts("fmu 2")
    system = loop(plant, law.with_parameters({"Kp1": -4000.0}), reference())
    bounds = {"plant.q1": (-2.0, 2.0)}
    told = []
    for compiled in (True, False):
        with pytest.raises(DivergedError) as caught:
            simulate(system, reference(), bounds=bounds, compiled=compiled)
        told.append(str(caught.value))
    assert told[0] == told[1]
    assert "plant.q1" in told[0]


def test_a_refused_step_is_the_same_in_both() -> None:
    """An inertia that cannot be integrated: the FMU's own message comes out of the compiled loop too."""
    plant, law = parts("fmu 2")
    system = loop(plant.with_parameters({"ZZ2": 1e-12, "MX2": 0.0, "MY2": 0.0}), law, reference())
    told = []
    for compiled in (True, False):
        with pytest.raises(SimulationError) as caught:
            simulate(system, reference(), compiled=compiled)
        told.append(str(caught.value))
    assert told[0] == told[1]
    assert "DoStep" in told[0]


def smoothing() -> Block:
    """y = x + 0.3 u, x[k+1] = 0.6 x + 0.3 u."""
    x, u, p = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("p", 0)
    return Block(
        name="smoothing",
        inputs=ports("u"),
        outputs=ports("y", causality="output"),
        states=ports("x", causality="local"),
        parameters=(),
        update=ca.Function("update", [x, u, p], [0.6 * x + 0.3 * u]),
        output=ca.Function("output", [x, u, p], [x + 0.3 * u]),
        start=ca.Function("start", [u, p], [ca.SX(0)]),
        sample_time=PERIOD,
    )


@pytest.mark.parametrize("jacobi", [False, True])
@pytest.mark.parametrize("version", VERSIONS)
def test_outputs_that_nobody_reads_are_recorded_all_the_same(version: str, jacobi: bool) -> None:
    """Filters read before their step, after it, by themselves only, and by none."""
    one = load_fmu(build_fmu(smoothing(), fmi_version=version))
    wires = (
        Connection("reference.r", "first.u"),
        Connection("last.y", "first.u", 0.2),
        Connection("first.y", "itself.u", 0.5),
        Connection("itself.y", "itself.u", -0.4),
        Connection("first.y", "last.u"),
        Connection("last.y", "unread.u", 2.0),
    )
    names = ("first", "itself", "last", "unread")
    system = System(dict.fromkeys(names, one), wires, names, PERIOD, jacobi=jacobi, algebraic_loops="previous")
    for ticks in (None, np.array([0, 31, 32, 33, 77]), np.arange(40, 80)):
        fast, slow = (simulate(system, ramp(90), ticks=ticks, compiled=c) for c in (True, False))
        assert_same(fast, slow)
        assert all(np.ptp(fast.applied[f"{name}.y"]) > 1.0 for name in names)


ONE, TWO = '<Dimension start="1"/>', '<Dimension start="2"/>'


@pytest.mark.parametrize("isolated", [False, pytest.param(True, marks=pytest.mark.gate)])
@pytest.mark.parametrize("timing", ["plain", "jacobi", "a fraction of delay"])
@pytest.mark.parametrize("dimensions", [TWO, ONE + TWO, TWO + ONE + ONE], ids=["2", "1x2", "2x1x1"])
def test_arrays_of_fmi_3(tmp_path: Path, dimensions: str, timing: str, isolated: bool) -> None:
    """The second reads the first element of the first alone; A sums and subtracts, z is the time."""
    xml = ARRAYS.replace(f"{TWO}</Float64>\n    <", f"{dimensions}</Float64>\n    <", 2)
    assert xml.count(dimensions) >= 2
    made = load_fmu(pack(tmp_path / "arrays.fmu", xml, library("arrays")), isolated=isolated)
    one = made.with_parameters({"A[1,2]": 1.0, "A[2,1]": 1.0, "A[2,2]": -1.0})
    (a, b), (y, d, _) = [v.name for v in one.inputs], [v.name for v in one.outputs]
    wires = (
        Connection("reference.r", f"controller.{a}"), Connection("reference.r", f"controller.{b}", 3.0),
        Connection(f"controller.{y}", f"plant.{a}"), Connection("reference.r", f"plant.{b}"),
    )  # fmt: skip
    system = System({"controller": one, "plant": one}, wires, ("controller", "plant"), PERIOD, **TIMINGS[timing])
    motion = ramp(50)
    fast, slow = (simulate(system, motion, compiled=c) for c in (True, False))
    assert_same(fast, slow)
    r = motion.values[:, 0]
    if timing == "plain":
        np.testing.assert_allclose(fast.applied[f"controller.{d}"], -2 * r, rtol=1e-15)
        np.testing.assert_allclose(fast.applied[f"plant.{y}"], 5 * r, rtol=1e-15)
        np.testing.assert_allclose(fast.applied[f"plant.{d}"], 3 * r, rtol=1e-15)
    np.testing.assert_allclose(fast.applied["controller.z"], fast.time, atol=1e-12)


@pytest.mark.parametrize(
    "timing", ["plain", "jacobi", "a fraction of delay", "a slow plant with delay", "a fast plant"]
)
@pytest.mark.parametrize("dependencies", ["", ' dependencies=""'], ids=["follows at once", "does not"])
def test_what_is_recorded_does_not_decide_what_happens(dependencies: str, timing: str, tmp_path: Path) -> None:
    """FMUs of other tools that go on otherwise once they were asked between inputs and step."""
    fmu = awkward_fmu(tmp_path, "READING_ACTS", dependencies=dependencies)
    plant = load_fmu(fmu, isolated=False).with_parameters({"d": 0.0})
    parts = {"controller": wrap_control(control.ss([], [], [], [[2.0, -2.0]], dt=PERIOD)), "plant": plant}
    wires = (
        Connection("reference.r", "controller.u[0]"),
        Connection("plant.y", "controller.u[1]"),
        Connection("controller.y[0]", "plant.u"),
    )
    system = System(parts, wires, ("controller", "plant"), PERIOD, algebraic_loops="previous", **TIMINGS[timing])
    every = simulate(system, ramp(90), compiled=True)
    few = np.array([0, 7, 31, 32, 77])
    for compiled in (True, False):
        found = simulate(system, ramp(90), ticks=few, compiled=compiled)
        assert (found.sampled["plant.y"] == every.sampled["plant.y"][few]).all()
    if dependencies:  # nobody asks it then
        clean = load_fmu(awkward_fmu(tmp_path), isolated=False).with_parameters({"d": 0.0})
        assert_same(every, simulate(replace(system, components={**parts, "plant": clean}), ramp(90), compiled=True))


@pytest.mark.parametrize("options", [{}, {"delays": {"amplifier": 1}}])
def test_a_recorded_value_that_is_not_finite_stops_both(options: Mapping[str, Any]) -> None:
    """At a tick between two looks at the bounds, and finite again after it."""
    amplifier = wrap_control(control.ss([], [], [], [[1e200]], inputs=["r"], outputs=["y"], dt=PERIOD))
    system = System(
        {"amplifier": amplifier}, (Connection("reference.r", "amplifier.r"),), ("amplifier",), PERIOD, **options
    )
    motion = trajectory(np.arange(80) * PERIOD, {"r": np.where(np.arange(80) == 45, 1e200, 0.0)})
    told = []
    for compiled in (True, False):
        with pytest.raises(DivergedError, match=r"amplifier\.y = inf|1e\+200, outside") as caught:
            simulate(system, motion, compiled=compiled)
        told.append(str(caught.value))
    with pytest.raises(DivergedError) as caught:  # though nobody wants to see it
        simulate(system, motion, signals=("amplifier.r",))
    assert told[0] == told[1] == str(caught.value)
    missed = simulate(system, motion, ticks=np.array([44, 46]), compiled=True)
    assert missed.applied["amplifier.y"].tolist() == [0.0, 0.0]


@pytest.mark.gate
def test_a_recording_keeps_its_values_while_others_are_made() -> None:
    """Its memory is used again only when nothing refers to it any more, not even a view of a column."""
    system, motion = system_of("linear"), reference(100.0)
    others = (system, replace(system, delays={"plant": 1}), system)
    kept = simulate(system, motion)
    assert kept.compiled and kept.time.size > 20_000
    groups = {"time": {"": kept.time}, "applied": kept.applied, "inputs": kept.inputs}
    wanted = {(group, name): x.copy() for group, columns in groups.items() for name, x in columns.items()}
    for other in others:
        simulate(other, motion)
    for (group, name), x in wanted.items():
        np.testing.assert_array_equal(groups[group][name], x)
    column = kept.applied["plant.q1"][::2]
    del kept, groups
    for other in others:
        simulate(other, motion)
    np.testing.assert_array_equal(column, wanted["applied", "plant.q1"][::2])


# ---- rates, seen by components that keep a log ---------------------------------------------------------------


def mocked(**options: Any) -> tuple[System, Mock, Mock]:
    log: list[tuple[Any, ...]] = []
    law = Mock("controller", ports("r", "y"), ports("u", causality="output"), lambda k, u: 1000.0 + k, log)
    plant = Mock("plant", ports("u"), ports("y", causality="output"), lambda k, u: float(k), log)
    wires = (
        Connection("reference.r", "controller.r"),
        Connection("plant.y", "controller.y"),
        Connection("controller.u", "plant.u"),
    )
    system = System({"plant": plant, "controller": law}, wires, ("controller", "plant"), PERIOD, **options)
    return system, law, plant


def ramp(count: int) -> Trajectory:
    return trajectory(np.arange(count) * PERIOD, {"r": 1.0 + np.arange(count)})


def test_a_slow_component_steps_over_several_ticks() -> None:
    system, law, plant = mocked(every={"controller": 3})
    recording = simulate(system, ramp(9))
    assert law.calls("step") == [(k * PERIOD, 3 * PERIOD) for k in (0, 3, 6)]
    assert [tuple(u) for (u,) in law.calls("set")] == [(1.0 + k, float(k)) for k in (0, 3, 6)]
    assert plant.calls("step") == [(k * PERIOD, PERIOD) for k in range(9)]
    # Its output is held between its communication points.
    assert recording.applied["controller.u"].tolist() == [1000.0] * 3 + [1001.0] * 3 + [1002.0] * 3


def test_a_fast_component_steps_several_times_a_tick() -> None:
    system, _, plant = mocked(substeps={"plant": 4})
    simulate(system, ramp(2))
    quarter = PERIOD / 4
    assert plant.calls("step") == [(k * PERIOD + i * quarter, quarter) for k in range(2) for i in range(4)]


def test_a_command_after_the_step_belongs_to_the_tick() -> None:
    """Without it the output of the mock counts the steps made before the tick, with it those including the tick's."""
    plain, declared = (simulate(mocked(**o)[0], ramp(4)) for o in ({}, {"after_step": frozenset({"controller"})}))
    assert plain.applied["controller.u"].tolist() == [1000.0, 1001.0, 1002.0, 1003.0]
    assert declared.applied["controller.u"].tolist() == [1001.0, 1002.0, 1003.0, 1004.0]


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"every": {"controller": 0}}, "whole number"),
        ({"every": {"controler": 2}}, "controler"),
        ({"substeps": {"plant": 1.5}}, "whole number"),
        ({"after_step": frozenset({"plnt"})}, "plnt"),
    ],
)
def test_wrong_timings_are_refused(options: Mapping[str, Any], problem: str) -> None:
    with pytest.raises(FmuDidimError, match=problem):
        mocked(**options)


# ---- algebraic loops ---------------------------------------------------------------------------------------------


def gain_loop(first: float, second: float, **options: Any) -> System:
    """y = first * (r - z), z = second * y, both static: y = first r / (1 + first second)."""
    amplifier = wrap_control(control.ss([], [], [], [[first, -first]], inputs=["r", "z"], outputs=["y"], dt=PERIOD))
    feedback = wrap_control(control.ss([], [], [], [[second]], inputs=["y"], outputs=["z"], dt=PERIOD))
    wires = (
        Connection("reference.r", "amplifier.r"),
        Connection("feedback.z", "amplifier.z"),
        Connection("amplifier.y", "feedback.y"),
    )
    names = ("amplifier", "feedback")
    return System(dict(zip(names, (amplifier, feedback), strict=True)), wires, names, PERIOD, **options)


def test_an_algebraic_loop_is_refused_with_its_path() -> None:
    with pytest.raises(InputError, match=r"amplifier\.y.*feedback\.z") as caught:
        simulate(gain_loop(3.0, 2.0), ramp(5))
    assert "iterate" in str(caught.value)


@pytest.mark.parametrize(("first", "second"), [(0.5, 0.5), (3.0, 2.0), (-4.0, 0.7)])
def test_an_algebraic_loop_is_solved_on_request(first: float, second: float) -> None:
    """Also where passing the values around does not settle (gain above 1)."""
    got = simulate(gain_loop(first, second, algebraic_loops="iterate"), ramp(20))
    wanted = first * (1.0 + np.arange(20)) / (1 + first * second)
    np.testing.assert_allclose(got.applied["amplifier.y"], wanted, rtol=1e-10)


def test_an_algebraic_loop_without_solution_is_an_error() -> None:
    with pytest.raises(SimulationError, match="algebraic loop"):
        simulate(gain_loop(2.0, -0.5, algebraic_loops="iterate"), ramp(5))


def test_previous_values_a_delay_or_jacobi_order_break_the_loop() -> None:
    r = 1.0 + np.arange(6)
    y = simulate(gain_loop(0.5, 0.5, algebraic_loops="previous"), ramp(6)).applied["amplifier.y"]
    np.testing.assert_allclose(y[1:], 0.5 * (r[1:] - 0.5 * y[:-1]), rtol=1e-14)
    delayed = simulate(gain_loop(0.5, 0.5, delays={"feedback": 1}), ramp(6)).sampled["amplifier.y"]
    assert np.isfinite(delayed).all()
    assert np.isfinite(simulate(gain_loop(0.5, 0.5, jacobi=True), ramp(6)).applied["amplifier.y"]).all()


def test_acceleration_feedback_is_an_algebraic_loop_and_position_feedback_is_none() -> None:
    plant = on_reference(ModelComponent(sledge(2.0).block()), reference(joints=1), 1)
    law = wrap_control(control.ss([], [], [], [[50.0, -50.0, -0.5]], inputs=["r", "q", "a"], outputs=["u"], dt=PERIOD))
    wires = [
        Connection("reference.q1", "law.r"),
        Connection("plant.q1", "law.q"),
        Connection("law.u", "plant.tau1"),
    ]
    motion = reference(joints=1)
    simulate(System({"law": law, "plant": plant}, tuple(wires), ("law", "plant"), PERIOD), motion)
    wires.append(Connection("plant.ddq1", "law.a"))
    system = System({"law": law, "plant": plant}, tuple(wires), ("law", "plant"), PERIOD)
    with pytest.raises(InputError, match=r"plant\.ddq1"):
        simulate(system, motion)
    solved = simulate(replace(system, algebraic_loops="iterate"), motion)
    # u = 50 (r - q) - 0.5 a and 2 a + 2 v = u hold together at every tick.
    u, a, v, q = (solved.applied[n] for n in ("law.u", "plant.ddq1", "plant.dq1", "plant.q1"))
    np.testing.assert_allclose(u, 50 * (solved.applied["reference.q1"] - q) - 0.5 * a, rtol=0, atol=1e-9)
    np.testing.assert_allclose(2 * a + 2 * v, u, rtol=0, atol=1e-9)


# ---- re-runs -----------------------------------------------------------------------------------------------------


def test_a_pool_gives_instances_back_as_new() -> None:
    plant, law = parts("fmu 2")
    pool = InstancePool()
    first = simulate(loop(plant, law, reference()), reference(), pool=pool)
    changed = simulate(loop(plant.with_parameters({"ZZ2": 0.5}), law, reference()), reference(), pool=pool)
    again = simulate(loop(plant, law, reference()), reference(), pool=pool)
    assert_same(first, again)
    assert np.abs(changed.applied["plant.q2"] - first.applied["plant.q2"]).max() > 1e-6
    pool.close()


def test_a_pool_closes_what_it_keeps() -> None:
    class Counted(Mock):
        def pool_key(self) -> Any:
            return self.name

    log: list[tuple[Any, ...]] = []
    plant = Counted("plant", ports("u"), ports("y", causality="output"), lambda k, u: float(k), log)
    system = System({"plant": plant}, (Connection("reference.r", "plant.u"),), ("plant",), PERIOD)
    pool = InstancePool()
    simulate(system, ramp(3), pool=pool)
    assert plant.calls("close") == []
    simulate(system, ramp(3), pool=pool)  # a mock cannot be restarted: closed, and a new one made
    assert len(plant.calls("close")) == 1
    pool.close()
    assert len(plant.calls("close")) == 2
