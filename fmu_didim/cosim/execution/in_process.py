"""Running a system in this process: the loop over the ticks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import DivergedError, FmuDidimError, InputError
from fmu_didim.components.native import Native
from fmu_didim.cosim.execution.algebraic_loops import LoopSolver, algebraic_loops, really_closed
from fmu_didim.cosim.execution.compiled import fits, loop_library, pass_values, run_compiled
from fmu_didim.cosim.execution.instance_pool import InstancePool
from fmu_didim.cosim.execution.interpreted import run_interpreted
from fmu_didim.cosim.execution.running import Beat, LoopRun, Order, assemble
from fmu_didim.cosim.recording import Columns, Recording
from fmu_didim.cosim.system import OF_INPUTS, System


def run_in_process(order: Order, pool: InstancePool | None = None, beat: Beat | None = None) -> Recording:
    """Run the closed loop in this process; errors as of :func:`fmu_didim.cosim.simulate`.

    Args:
        beat: called all the time while the run goes on.
    """
    check_reference(order)
    observe, python = order.observe, order.compiled is False or order.observe is not None
    if not python and loop_library() is not None:
        system = compiled_components(order.system)
        order = order if system is order.system else replace(order, system=system)
    try:
        with _running(order, pool, beat, python=python) as run:
            solver = _loop_solver(run)
            natives = None if python or solver is not None else _natives(run)
            if order.compiled and natives is None:
                raise _not_compiled(run)
            run.allocate(None if natives is None else order.signals)
            if natives is not None:
                run_compiled(run, natives)
            else:
                run_interpreted(run, observe, solver)
            return _recording(run, compiled=natives is not None)
    except DivergedError as error:
        if error.is_finite:
            raise
        first = error
    # Signals are looked at every 32 ticks: by then NaN has gone around the loop, and the first one in the
    # order of the signals is not the first one in time.
    with _running(order, pool, beat, python=True) as run:
        run.allocate()
        run_interpreted(run, solver=_loop_solver(run), careful=True)
    raise first  # it was one only once


@contextmanager
def _running(
    order: Order, pool: InstancePool | None, beat: Beat | None, *, python: bool = False
) -> Iterator[LoopRun]:  # fmt: skip
    """A run that is initialised, by compiled code where that is known from its last run, unless it must be Python; its
    instances go back to the pool, unless a component failed in it."""
    run, reusable = assemble(order.system, order.reference, pool, beat), False
    try:
        with np.errstate(all="ignore"):
            run.prepare(_all_ticks(order.reference.time.size) if order.ticks is None else order.ticks, order.bounds)
            run.initialise(None if python else pass_values)
            yield run
        reusable = True
    except FmuDidimError as error:
        reusable = isinstance(error, DivergedError)
        raise
    finally:
        run.close(pool, reusable=reusable)


def compiled_components(system: System) -> System:
    """The system with the compiled form of each component that has one."""
    forms = {name: component.compiled() for name, component in system.components.items()}
    for name, form in forms.items():
        if form is not system.components[name]:
            system = system.replace(name, form)
    return system


def _natives(run: LoopRun) -> list[Native] | None:
    """How compiled code runs the parts; None if only Python can run one of them."""
    if loop_library() is None:
        return None
    natives = []
    for part in run.parts:
        native = part.instance.native()
        if native is None or not fits(native, part):
            return None
        natives.append(native)
    return natives


def _not_compiled(run: LoopRun) -> InputError:
    if loop_library() is None:
        return InputError("There is no C compiler for the loop.", next_step="pip install ziglang")
    python = [part.name for part in run.parts if part.instance.native() is None]
    return InputError(
        "The loop cannot run in compiled code.",
        got=f"components that only Python can run: {', '.join(python) or 'none, but outputs must be iterated'}",
        next_step="Use compiled=None, which takes Python where it must.",
    )


def _loop_solver(run: LoopRun) -> LoopSolver | None:
    treatment = run.system.algebraic_loops
    if treatment == "previous":
        return None
    loops = algebraic_loops(run.system)
    closed = really_closed(run, loops) if loops else []
    if not closed:
        return None
    if treatment == "iterate":
        return LoopSolver()
    raise InputError(
        "The components form an algebraic loop: each output depends at once on the others.",
        got=" -> ".join(closed[0]),
        valid="a delay on one of them, algebraic_loops: iterate, or algebraic_loops: previous",
        next_step="Choose one of these in loop:, or break the loop by another signal.",
    )


@lru_cache(maxsize=2)
def _all_ticks(count: int) -> NDArray[np.int64]:
    ticks = np.arange(count, dtype=np.int64)
    ticks.flags.writeable = False
    return ticks


def check_reference(order: Order) -> None:
    """Raise InputError where the reference does not fit the step, or the ticks lie outside of it."""
    reference, ticks, h = order.reference, order.ticks, order.system.step_size
    time = reference.time
    worst = 0.0 if order.system.at_instants else reference.deviation(h)
    if worst > 0.01 * h:
        raise InputError(
            "The reference is not sampled at the control rate.",
            where=reference.source or "reference",
            got=f"instants up to {worst:.3g} s away from t0 + k * {h:g} s",
            next_step="Resample it to the control rate, or correct the rate of the loop.",
        )
    if ticks is not None and (
        ticks.size == 0
        or ticks.item(0) < 0
        or ticks.item(-1) >= time.size
        or np.count_nonzero(ticks[1:] > ticks[:-1]) < ticks.size - 1
    ):
        raise InputError(
            "The ticks to record lie outside the reference.",
            where=reference.source or "reference",
            got="no ticks" if ticks.size == 0 else f"ticks {ticks[0]} to {ticks[-1]}",
            valid=f"0 to {time.size - 1}",
            next_step="Shorten the measurement, or give a reference that covers it.",
        )


def _recording(run: LoopRun, *, compiled: bool) -> Recording:
    bad = run.unsound
    if run.columns is None and not (run.finite or np.isfinite(run.applied).all()):
        bad = int(np.flatnonzero(~np.isfinite(run.applied).all(axis=1))[0])
    if bad is not None:
        time = run.time_of(int(run.ticks[bad]))
        raise DivergedError(
            f"The {'closed loop' if run.system.closes else 'simulation'} gave values that are not finite.", time=time,
            is_finite=False, next_step="Check the gains, signs and units of the loop, and the start values."
            if run.system.closes else OF_INPUTS,
        )  # fmt: skip
    signals, inputs = run.layout.signal_places, run.layout.input_places
    if run.columns is not None:
        kept = {run.recorded[i]: k for k, i in enumerate(run.columns)}
        signals, inputs = ({name: k for name, k in kept.items() if name in of} for of in (signals, inputs))
    applied = Columns(signals, run.record)
    return Recording(
        ticks=run.ticks,
        start=run.start,
        step_size=run.system.step_size,
        applied=applied,
        inputs=Columns(inputs, run.record),
        sampled=Columns(signals, run.sampled) if run.delayed else applied,
        compiled=compiled,
        instants=None if run.instants is None else run.instants[run.ticks],
    )
