"""A pool keeps the parts of a run as they are, wired and called: the next run finds them, and gives what a new one
gives."""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from fmu_didim.base.errors import SimulationError
from fmu_didim.components import Component, Instance, load_fmu
from fmu_didim.components.native import FMI2, Native, NativeFmu
from fmu_didim.cosim import Connection, InstancePool, Recording, System, simulate
from fmu_didim.cosim.execution import buffers
from fmu_didim.cosim.execution import compiled as compiled_module
from fmu_didim.cosim.execution.instance_pool import KEPT_ASSEMBLIES
from fmu_didim.data.signals import Trajectory, Variable
from fmu_didim.export import build_fmu
from tests.cosim.test_compiled_loop import assert_same, parts, ramp
from tests.helpers import PERIOD, loop, ports, reference, scara, scara_pd

KINDS = ["fmu 2", "fmu 3", "exchange 2", "model", "linear"]


def numbers(pool: InstancePool) -> tuple[int, int]:
    """Of the wired systems and of the instances that a pool holds."""
    return len(pool._assemblies), sum(len(waiting) for waiting in pool._kept.values())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("jacobi", [False, True])
def test_a_kept_run_gives_what_a_new_one_gives(kind: str, jacobi: bool) -> None:
    """With other values, ticks, bounds, references and signals to record in turn, in C and in Python."""
    plant, law = parts(kind)
    system, motions, pool = (
        replace(loop(plant, law, reference()), jacobi=jacobi),
        (reference(), later()),
        InstancePool(),
    )
    some = np.array([0, 3, 17, 90])
    wide = {"plant.q1": (-50.0, 50.0)}
    for turn, options in enumerate(
        [
            {},
            {},
            {"ticks": some},
            {"signals": ("plant.q1",)},
            {"bounds": wide},
            {"compiled": False},
            {},
            {"ticks": some},
        ]
    ):
        now = system.replace("plant", plant.with_parameters({"ZZ2": 0.3 + 0.05 * (turn % 3)}))
        for motion in motions:
            kept = simulate(now, motion, pool=pool, **options)  # type: ignore[arg-type]
            assert_same(kept, simulate(now, motion, **options))  # type: ignore[arg-type]
    assert np.ptp(kept.applied["plant.q1"]) > 0.01


def later() -> Trajectory:
    """The same columns as in the reference, another motion that begins later."""
    first = reference()
    return replace(first, time=first.time + 1.0, values=0.7 * first.values)


def test_a_second_run_wires_and_calls_what_the_first_one_has(monkeypatch: pytest.MonkeyPatch) -> None:
    plant, law = parts("fmu 2")
    system, pool, made = loop(plant, law, reference()), InstancePool(), []
    monkeypatch.setattr(compiled_module, "_part", lambda *a, make=compiled_module._part: made.append(1) or make(*a))
    for _ in range(3):
        simulate(system, reference(), pool=pool)
    assert len(made) == len(system.order)
    assert numbers(pool) == (1, 2)


def test_another_fmu_of_the_same_variables_is_not_taken_for_the_kept_one() -> None:
    """Systems in which a component was replaced are wired alike, and so share their layout."""
    plant, law = parts("fmu 2")
    other = load_fmu(build_fmu(scara().block({"ZZ2": 0.8}), fmi_version="3.0"))
    system, pool = loop(plant, law, reference()), InstancePool()
    changed = system.replace("plant", other)
    assert changed.layout(reference().names) is system.layout(reference().names)
    for each in (system, changed, system, changed):
        assert_same(simulate(each, reference(), pool=pool), simulate(each, reference()))


def test_runs_side_by_side_share_nothing() -> None:
    plant, law = parts("fmu 2")
    system, pool = loop(plant, law, reference()), InstancePool()
    systems = [system.replace("plant", plant.with_parameters({"ZZ2": 0.3 + 0.01 * i})) for i in range(24)]
    wanted = [simulate(each, reference()) for each in systems]
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda each: simulate(each, reference(), pool=pool), systems))
    for a, b in zip(found, wanted, strict=True):
        assert_same(a, b)


def test_few_wired_systems_are_kept_and_none_by_a_closed_pool() -> None:
    plant, law = parts("fmu 2")
    pool = InstancePool()
    for _ in range(KEPT_ASSEMBLIES + 3):
        simulate(loop(plant, law, reference()), reference(), ticks=np.array([3]), pool=pool)
    assert numbers(pool) == (KEPT_ASSEMBLIES, 2)
    pool.close()
    assert numbers(pool) == (0, 0)
    simulate(loop(plant, law, reference()), reference(), ticks=np.array([3]), pool=pool)
    assert numbers(pool) == (0, 0)


# ---- a component that refuses a call in the initialisation ----------------------------------------------------------

_Values = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p)
_Step = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)


@dataclass(frozen=True)
class Moody(Component):
    """An output that is its input; which call returns which status is said from run to run."""

    statuses: dict[str, int]
    inputs: tuple[Variable, ...] = ports("u")
    outputs: tuple[Variable, ...] = ports("y", causality="output")
    parameters: tuple[Variable, ...] = ()
    sample_time: float | None = None

    def with_parameters(self, values: Any) -> Component:
        return self

    def with_names(self, inputs: tuple[Variable, ...], outputs: tuple[Variable, ...]) -> Component:
        return replace(self, inputs=inputs, outputs=outputs)

    def instantiate(self) -> Instance:
        return MoodyInstance(self)

    def pool_key(self) -> str:
        return "moody"

    def describe(self) -> dict[str, Any]:
        return {"kind": "moody"}


class MoodyInstance(Instance):
    def __init__(self, owner: Moody) -> None:
        self.owner, self._native = owner, None
        self.take_variables(owner.inputs, owner.outputs)
        status: Callable[[str], int] = lambda call: owner.statuses.get(call, 0)  # noqa: E731
        self._functions = (
            _Values(lambda *_: status("set")), _Values(lambda *_: status("get")), _Step(lambda *_: status("step")),
        )  # fmt: skip

    def restart(self, component: Component) -> bool:
        return True

    def begin_initialisation(self, time: float) -> None: ...

    def end_initialisation(self) -> None: ...

    def set(self) -> None:
        self.check("set", self._functions[0](None, None, 1, None))

    def get(self) -> None:
        self.check("get", self._functions[1](None, None, 1, None))

    def step(self, time: float, size: float) -> None:
        self.check("step", self._functions[2](None, time, size, 1))

    def check(self, call: str, status: int) -> None:
        if status > 1:
            raise SimulationError(f"{call} returned {status}.", next_step="Look at it.")

    def save_state(self) -> Any: ...

    def restore_state(self, state: Any) -> None: ...

    def native(self) -> Native:
        if self._native is None:
            none = (ctypes.c_uint32 * 1)()
            addresses = [ctypes.cast(f, ctypes.c_void_p).value or 0 for f in self._functions]
            self._native = NativeFmu(
                FMI2, 0, ("set", "get", "step"), *addresses, none, none, self.inputs, self.outputs,
                input_scaling=None, output_scaling=None, check=self.check,
            )  # fmt: skip
        return self._native


@pytest.mark.parametrize(("call", "status"), [("set", 3), ("get", 2), ("get", -1)])
def test_a_refusal_in_the_initialisation_of_a_kept_run_is_told(call: str, status: int) -> None:
    statuses: dict[str, int] = {}
    system = System({"plant": Moody(statuses)}, (Connection("reference.r", "plant.u"),), ("plant",), PERIOD)
    pool = InstancePool()
    for _ in range(2):
        assert simulate(system, ramp(5), pool=pool).compiled
    statuses[call] = status
    with pytest.raises(SimulationError, match="The plant failed in its initialisation") as told:
        simulate(system, ramp(5), pool=pool)
    assert told.value.component == "plant"
    assert numbers(pool) == (0, 0)  # a component that has failed is closed
    statuses.clear()
    assert simulate(system, ramp(5), pool=pool).compiled


# ---- buffers of recordings ------------------------------------------------------------------------------------------


def test_a_buffer_serves_again_when_the_last_view_of_its_recording_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    gc.collect()
    for _ in range(len(buffers._free)):
        buffers._free.pop()
    lent = len(buffers._lent)
    first = buffers.recording_buffer(buffers.SMALLEST, 2)
    place = first.ctypes.data
    view = first[3:, 1]
    del first
    assert (len(buffers._lent), len(buffers._free)) == (lent + 1, 0)
    assert buffers.recording_buffer(buffers.SMALLEST, 2).ctypes.data != place
    del view
    assert place in {each.ctypes.data for each in buffers._free} and len(buffers._lent) == lent


def finite(recording: Recording) -> bool:
    return bool(np.isfinite(recording.applied.table).all())


def test_a_run_that_diverged_leaves_nothing_in_the_next_one() -> None:
    plant, law = load_fmu(build_fmu(scara().block())), load_fmu(build_fmu(scara_pd()))
    system, pool = loop(plant, law, reference()), InstancePool()
    first = simulate(system, reference(), pool=pool)
    for _ in range(2):
        with pytest.raises(SimulationError):
            simulate(system, reference(), pool=pool, bounds={"plant.q1": (-1e-9, 1e-9)})
        assert_same(first, simulate(system, reference(), pool=pool))
    assert finite(first)
