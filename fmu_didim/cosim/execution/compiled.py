"""The loop over the ticks in C, for components that are C code themselves.

``loop.c`` is compiled once on a machine and kept in the cache; it releases Python's lock, so several
threads run loops side by side.
"""

from __future__ import annotations

import ctypes
import hashlib
import time as clock
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.base.cache import cached_folder
from fmu_didim.base.errors import BuildError, InputError, SimulationError
from fmu_didim.components.native import EXCHANGE, FMI2, LINEAR, ExchangeEquations, Native, NativeFmu, NativeLinear
from fmu_didim.cosim.execution.running import CHECK_INTERVAL, LATEST, LoopRun, Part
from fmu_didim.data.signals import Array
from fmu_didim.export.build import compile_shared_library, find_compiler

_DONE, _FAILED, _STOPPED = 0, 1, 2
_STEP = 2  # of the calls set, get, step
CHUNK = 200_000
"""[1] Ticks in one call of the compiled loop at most; an interrupt is noticed between two calls."""
TAKEN = 4096
"""[ticks] The same where some signals are taken from what was recorded after each call."""
CHUNK_SECONDS = 0.1
"""[s] Duration of such a call, about, where beats are expected."""

_void, _int32, _int64, _double = ctypes.c_void_p, ctypes.c_int32, ctypes.c_int64, ctypes.c_double


def _members(**kinds: str) -> list[tuple[str, Any]]:
    """Fields of a structure by type, in the order of the C declaration."""
    table = {"i": _int32, "q": _int64, "d": _double, "p": _void}
    return [(name, table[kind]) for name, kind in kinds.items()]


class _Linear(ctypes.Structure):
    _fields_ = _members(
        states="q", inputs="q", outputs="q", a="p", b="p", c="p", d="p", x="p", held="p", work="p", period="d",
        start="d", count="q", substeps="q", live="i", padding="i",
    )  # fmt: skip


class _Exchange(ctypes.Structure):
    _fields_ = _members(
        version="i", completes="i", solver="i", has_next="i", self="p", set_time="p", set_states="p", get_states="p",
        derive="p", indicators="p", completed="p", enter_event="p", enter_continuous="p", update="p", states="q",
        indicator_count="q", substeps="q", x="p", dx="p", stage="p", total="p", z="p", z_before="p", next_event="d",
        slopes="p", held="p", begin="d", memory="p", vector="p", advance="p", restart="p", stop="p", array_of="p",
        part="p", worst="q",
    )  # fmt: skip


class _Part(ctypes.Structure):
    _fields_ = _members(
        kind="i", after_step="i", self="p", set="p", get="p", step="p", input_references="p", output_references="p",
        input_reference_count="q", output_reference_count="q", input_count="q", output_count="q", inputs="p",
        outputs="p", own_inputs="p", own_outputs="p", input_factor="p", input_offset="p", output_factor="p",
        output_offset="p", linear="p", wire_count="q", wires="p", single="q", every="q", substeps="q", whole="q",
        part="d", line="p", line_capacity="q", line_count="q", first_input="q", first_output="q", next_row="q",
        read_before="q", read_between="q", read_after="q", instants="p", longest="d", exchange="p", ramps="p",
        ramp_count="q",
    )  # fmt: skip


class _Loop(ctypes.Structure):
    _fields_ = _members(
        parts="p", part_count="q", jacobi="q", delayed="q", values="p", signal_count="q", value_count="q", table="p",
        table_rows="q", table_columns="q", start="d", step="d", recorded="p", first_recorded="q", recorded_count="q",
        next_row="q", applied="p", sampled="p", sound_rows="q", unsound="q", lowest="p", highest="p",
        check_interval="q", ticks="q", next_check="q", failed_part="q", failed_call="q", status="q", failed_tick="q",
        failed_signal="q", failed_time="d", instants="p", latest="d", first_row="q",
    )  # fmt: skip


_DOUBLE = ctypes.sizeof(_double)
_RAMP = np.dtype([("input", np.int64), ("column", np.int64), ("gain", np.float64)])
_SOURCES = ("loop.c", "exchange.h")


@cache
def loop_library() -> Any:
    """The compiled loop; None where it cannot be built, so that Python runs it.

    Returns:
        The library, with the functions ``run_loop`` and ``pass_values`` and the callbacks of CVode.
    """
    try:
        compiler = find_compiler()
        folder = files("fmu_didim.cosim.execution")
        sources = {name: folder.joinpath(name).read_text(encoding="utf-8") for name in _SOURCES}
        key = hashlib.sha256(repr((sources, compiler.flags, compiler.version)).encode()).hexdigest()[:32]

        def fill(folder: Path) -> None:
            for name, source in sources.items():
                (folder / name).write_text(source, encoding="utf-8")
            compile_shared_library(folder, folder / "loop.library", main="loop.c", compiler=compiler)

        library = ctypes.CDLL(str(cached_folder("loop", key, fill) / "loop.library"))
    except (BuildError, InputError, OSError):
        return None
    library.run_loop.argtypes, library.run_loop.restype = (_void, _int64, _int64, _int64), ctypes.c_int
    library.pass_values.argtypes, library.pass_values.restype = (_void, _void), ctypes.c_int
    return library


def fits(native: Native, part: Part) -> bool:
    """Whether the compiled loop does all that this part needs: equal substeps on both sides of a fraction of delay."""
    if not isinstance(native, NativeLinear) or native.period > 0 or native.substeps:
        return True
    return len({native.choose(size) for size in part.step_sizes()}) == 1


def run_compiled(run: LoopRun, natives: list[Native]) -> None:
    """Run all ticks by compiled code and fill the recording of the run.

    Args:
        run: initialised and prepared.
        natives: how each part is called, in the order of the parts.

    Raises:
        DivergedError: a signal left its bounds.
        SimulationError: a component refused a step.
    """
    function, end = loop_library().run_loop, run.end
    calls, keep = _calls(run, natives), list[Any]()
    loop, longest = _loop(run, calls, keep), CHUNK if run.columns is None else TAKEN
    taken = None if run.columns is None else np.empty((TAKEN, run.values.size))
    if taken is not None:
        loop.applied = loop.sampled = _address(taken, keep)
    first, count = 0, longest if run.beat is None else 1
    while first < end:
        last, began = min(first + count, end), clock.perf_counter()
        result = function(ctypes.byref(loop), first, last, last == end)
        if result != _DONE:
            raise _error(run, loop, result, natives)
        first = last
        if taken is not None:
            run.take(taken[: loop.next_row - loop.first_row], loop.first_row)
            loop.first_row = loop.next_row
        if run.beat is not None:
            run.beat()
            took = clock.perf_counter() - began
            count = min(4 * count, longest) if took < CHUNK_SECONDS / 4 else max(count // 2, 1)
    run.finite = not loop.unsound


@dataclass(frozen=True)
class _Calls:
    """How compiled code calls the parts of an assembly.

    Attributes:
        natives: of the parts; columns: of the recording.
        values: address of the values; parts: structures of C; before: memory for the signals; kept: what must live as
            long.
    """

    natives: list[Native]
    columns: list[int] | None
    values: int
    parts: Any
    before: Array
    kept: list[Any]

    def serve(self, run: LoopRun, natives: list[Native]) -> bool:
        """Whether another run finds them as it would make them, what is read for its recording aside: FMUs that are
        what they were, called at each tick."""
        return (
            len(natives) == len(self.natives)
            and all(a is b for a, b in zip(natives, self.natives, strict=True))
            and all(isinstance(n, NativeFmu) and n.exchange is None for n in natives)
            and not any(p.delayed or p.ramps or p.between is not None or p.instants is not None for p in run.parts)
        )


def _calls(run: LoopRun, natives: list[Native]) -> _Calls:
    """How compiled code calls the parts: as in the last run of the same assembly where that serves."""
    known: _Calls | None = run.assembly.calls
    if known is not None and known.columns == run.columns and known.serve(run, natives):
        return known
    keep: list[Any] = []
    values = _address(run.values, keep) or 0
    parts = (_Part * len(run.parts))(*(_part(run, i, native, values, keep) for i, native in enumerate(natives)))
    for part in parts:
        if part.exchange:
            _Exchange.from_address(part.exchange).part = ctypes.addressof(part)
    run.assembly.calls = made = _Calls(natives, run.columns, values, parts, np.zeros(run.signals.size), keep)
    return made


def pass_values(run: LoopRun) -> bool:
    """Let values pass around a run that is being initialised, by the calls of its last run; whether that was possible.

    Raises:
        SimulationError: a component refused a value.
    """
    calls: _Calls | None = run.assembly.calls
    if calls is None:
        return False
    natives = [native for part in run.parts if (native := part.instance.native()) is not None]
    if not calls.serve(run, natives):
        return False
    loop = _Loop(
        parts=ctypes.addressof(calls.parts), part_count=len(run.parts), values=calls.values,
        signal_count=run.signals.size, start=run.start,
    )  # fmt: skip
    if loop_library().pass_values(ctypes.byref(loop), calls.before.ctypes.data) != _DONE:
        raise _refusal(run, loop, natives, None)
    return True


def _address(array: Any, keep: list[Any]) -> int | None:
    """Address of an array that lives as long as the run; None for an empty one."""
    if array is None:
        return None
    keep.append(array)
    if array.size and array.flags.carray:  # this way takes a third of the time of what NumPy offers for all arrays
        return ctypes.addressof(ctypes.c_char.from_buffer(array))
    return int(array.ctypes.data)


def _loop(run: LoopRun, calls: _Calls, keep: list[Any]) -> _Loop:
    table, ticks = np.ascontiguousarray(run.table), np.ascontiguousarray(run.ticks, dtype=np.int64)
    gapless = ticks[-1] - ticks[0] + 1 == ticks.size
    return _Loop(
        parts=ctypes.addressof(calls.parts), part_count=len(run.parts), jacobi=run.system.jacobi, delayed=run.delayed,
        values=calls.values, signal_count=run.signals.size, value_count=run.values.size,
        table=_address(table, keep), table_rows=table.shape[0], table_columns=table.shape[1], start=run.start,
        step=run.system.step_size, recorded=None if gapless else _address(ticks, keep), first_recorded=ticks[0],
        recorded_count=ticks.size, applied=_address(run.record, keep), sampled=_address(run.sampled, keep),
        lowest=_address(run.lowest, keep), highest=_address(run.highest, keep), check_interval=CHECK_INTERVAL,
        ticks=run.end, instants=_address(run.instants, keep), latest=LATEST,
    )  # fmt: skip


def _part(run: LoopRun, index: int, native: Native, values: int, keep: list[Any]) -> _Part:
    part = run.parts[index]
    wiring, capacity = part.wiring, part.whole + 2
    output_count = part.place.stop - part.place.start
    read_before, read_between, read_after = _reads(run, index)
    result = _Part(
        after_step=part.after_step, input_count=part.inputs.size, output_count=output_count,
        inputs=values + _DOUBLE * part.given.start, outputs=values + _DOUBLE * part.place.start,
        wire_count=wiring.targets.size, wires=_address(wiring.table, keep), single=wiring.single,
        every=part.every, substeps=part.substeps, whole=part.whole, part=part.part,
        line_capacity=capacity, first_input=part.given.start,
        line=_address(np.zeros((capacity, max(part.inputs.size, 1))), keep) if part.delayed else None,
        first_output=part.place.start, read_before=read_before, read_between=read_between,
        read_after=read_after, instants=_address(part.instants, keep), longest=part.longest,
    )  # fmt: skip
    if part.ramps:
        ramps = np.array(list(part.ramps), dtype=_RAMP)
        result.ramps, result.ramp_count = _address(ramps, keep), ramps.size
    if isinstance(native, NativeLinear):
        linear = _linear(native, part, keep)
        result.kind, result.linear = LINEAR, ctypes.addressof(linear)
        return result
    result.kind, result.self = native.kind, native.self_address
    if native.exchange is not None:
        exchange = _exchange(native, native.exchange, part, keep)
        result.exchange = ctypes.addressof(exchange)
    result.set, result.get, result.step = native.set_address, native.get_address, native.step_address
    keep += [native.input_references, native.output_references]
    result.input_reference_count = len(native.input_references)
    result.output_reference_count = len(native.output_references)
    result.input_references = ctypes.addressof(native.input_references)
    result.output_references = ctypes.addressof(native.output_references)
    result.own_inputs, result.own_outputs = result.inputs, result.outputs
    if native.input_scaling:
        result.own_inputs = _address(native.own_inputs, keep)
        result.input_factor, result.input_offset = (_address(a, keep) for a in native.input_scaling)
    if native.output_scaling:
        result.own_outputs = _address(native.own_outputs, keep)
        result.output_factor, result.output_offset = (_address(a, keep) for a in native.output_scaling)
    return result


def _exchange(native: NativeFmu, equations: ExchangeEquations, part: Part, keep: list[Any]) -> _Exchange:
    states, signs = equations.states, equations.indicators
    arrays = {name: _address(np.zeros(max(states, 1)), keep) for name in ("x", "dx", "stage", "total")}
    arrays |= {name: _address(np.zeros(max(signs, 1)), keep) for name in ("z", "z_before")}
    if part.ramps:
        arrays |= {name: _address(np.zeros(part.inputs.size), keep) for name in ("slopes", "held")}
    result = _Exchange(
        version=2 if native.kind == EXCHANGE[FMI2] else 3, completes=equations.completes, self=native.self_address,
        states=states, indicator_count=signs, substeps=equations.substeps, **arrays, **equations.functions,
    )  # fmt: skip
    keep.append(result)
    if equations.solver is not None and states:
        library = loop_library()
        rhs, roots = (ctypes.cast(f, _void).value or 0 for f in (library.exchange_rhs, library.exchange_roots))
        solver = equations.solver(rhs, roots, ctypes.addressof(result))
        keep.append(solver)
        result.solver = 1
        for name, address in solver.addresses.items():
            setattr(result, name, address)
    return result


def _reads(run: LoopRun, index: int) -> tuple[int, int, int]:
    """Counts of the first outputs of a part: those that others read between its inputs and its step, those read there
    for the recording and the bounds, and those that others read between its step and its next inputs.

    Unused outputs need not be computed, but for the recording and the bounds: of the plant, which the controller has
    asked before, at each tick that is not recorded, and its accelerations; of the controller after each step. Where
    some signals are recorded, outputs behind them are not computed for the recording either.
    """
    part = run.parts[index]
    count = part.place.stop - part.place.start
    if part.between is not None and not part.after_step:
        between = count if part.between else 0
        return between, between, count
    if run.delayed or part.after_step or part.every > 1:
        return count, count, count
    before, after = part.readers
    if run.columns is None:
        return before, count, after
    own = range(part.place.start, part.place.stop)
    recorded = max((column - own.start + 1 for column in run.columns if column in own), default=0)
    return before, max(before, recorded), after


def _linear(native: NativeLinear, part: Part, keep: list[Any]) -> _Linear:
    a, b, c, d = (_address(m, keep) for m in native.matrices)
    states = native.state.size
    linear = _Linear(
        states=states, inputs=part.inputs.size, outputs=part.place.stop - part.place.start, a=a, b=b, c=c, d=d,
        x=_address(native.state, keep), held=_address(native.held, keep),
        work=_address(np.zeros(5 * max(states, 1)), keep), period=native.period, start=native.start, count=0,
        substeps=native.substeps or (0 if native.period > 0 else native.choose(part.step_sizes()[-1])), live=1,
    )  # fmt: skip
    keep.append(linear)
    return linear


def _error(run: LoopRun, loop: _Loop, result: int, natives: list[Native]) -> Exception:
    time = float(loop.failed_time)
    if result not in (_FAILED, _STOPPED):
        return run.diverged(int(loop.failed_signal), time)
    name = run.parts[loop.failed_part].name
    native = natives[loop.failed_part]
    if isinstance(native, NativeFmu) and native.exchange is not None and loop.status < 0:
        return native.exchange.explain(int(loop.status), time).in_component(name, time)
    if result == _STOPPED or isinstance(native, NativeLinear):
        return SimulationError(
            "The FMU ended the simulation.", where=name,
            next_step="Check its parameters and its stop time; fmu-didim fmu check FILE tries it alone.",
        ).in_component(name, time)  # fmt: skip
    return _refusal(run, loop, natives, time)


def _refusal(run: LoopRun, loop: _Loop, natives: list[Native], time: float | None) -> SimulationError:
    """The error of a component that refused a call at a time in s; None: in its initialisation."""
    name, native = run.parts[loop.failed_part].name, natives[loop.failed_part]
    assert isinstance(native, NativeFmu)
    try:
        at = f" at t = {time:.6g} s" if loop.failed_call == _STEP else ""
        native.check(native.calls[loop.failed_call] + at, int(loop.status))
    except SimulationError as error:
        return error.in_component(name, time)
    failed = SimulationError(
        "it refused a step.", where=name, got=f"status {loop.status}",
        next_step="Check its parameters and its step; fmu-didim fmu check FILE tries it alone.",
    )  # fmt: skip
    return failed.in_component(name, time)
