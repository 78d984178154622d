"""The whole loop in a process of its own, for FMUs that may crash it: one request for each run.

What crashes, exits, hangs or changes the current folder does so there. The process keeps the instances from run to run,
as a pool does here. Where it dies, the loop is run once more with each such FMU in a process of its own, one message
for each call: so the error names the FMU, the call and the time.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from fmu_didim.components import Component, FmuComponent
from fmu_didim.components.fmu.isolation.process import START_LIMIT, NotCarriedError, ProcessEndedError, Worker
from fmu_didim.components.fmu.isolation.trust import log_isolation, record_trust
from fmu_didim.components.fmu.settings import PROCESS
from fmu_didim.cosim.execution.compiled import loop_library
from fmu_didim.cosim.execution.in_process import compiled_components, run_in_process
from fmu_didim.cosim.execution.instance_pool import InstancePool
from fmu_didim.cosim.execution.running import Order
from fmu_didim.cosim.recording import Recording
from fmu_didim.cosim.system import System

_log = logging.getLogger(__name__)
BEATS_A_LIMIT = 5
"""[1] Signs of life of a process within the time limit of a call, while it runs a loop."""


class LoopProcess:
    """A process in which loops run.

    Args:
        fmus: those because of which it is there, one as often as there are instances of it.
    """

    def __init__(self, fmus: tuple[FmuComponent, ...]) -> None:
        self._fmus = fmus
        self._limit = max(fmu.time_limit_s for fmu in fmus)
        self._worker = Worker(", ".join(str(fmu.path) for fmu in fmus), self._limit)
        self._worker.request("start", _prepare, self._limit / BEATS_A_LIMIT, limit=START_LIMIT)
        self.runs = 0

    def run(self, order: Order) -> Recording:
        """Run a loop there; raises the errors of the run, ProcessEndedError and NotCarriedError."""
        fmus = [c for c in order.system.components.values() if isinstance(c, FmuComponent)]
        large = (*(c.fmu for c in fmus), *(c.block for c in fmus if c.block is not None), order.reference)
        found, observed = self._worker.request("the loop", _run, order, constants=large)
        self.runs += 1
        if order.observe is not None:
            vars(order.observe).update(observed)
        recording: Recording = found
        return recording

    def close(self) -> None:
        """End the process; if it ends well, its FMUs are trusted from then on. May be called twice."""
        self._worker.close()
        if self.runs and self._worker.ended_well:
            counts = Counter(fmu.digest for fmu in self._fmus)
            for fmu in self._fmus:
                record_trust(fmu, counts[fmu.digest])


def _prepare(there: Any, beat_every: float) -> None:
    there.beat_every, there.pool, there.ways = beat_every, InstancePool(), {}
    there.closing.append(there.pool)


def _run(there: Any, order: Order) -> tuple[Recording, dict[str, Any] | None]:
    ways = {c.digest: c.rerun for c in order.system.components.values() if isinstance(c, FmuComponent)}
    if any(there.ways.get(digest, way) != way for digest, way in ways.items()):
        there.pool.close()  # an FMU that allows one instance is not made a second time beside the first
    there.ways |= ways
    found = run_in_process(order, there.pool, there.beat)
    return found, None if order.observe is None else vars(order.observe)


def run_in_separate_process(order: Order, fmus: Mapping[str, FmuComponent], pool: InstancePool | None) -> Recording:
    """Run a loop in a process of its own because of some FMUs; with a pool, in the one that it ran in before."""
    key = frozenset((name, c.digest, c.interface.kind, c.time_limit_s) for name, c in fmus.items())
    if pool is not None and key in pool.noted:
        return _run_isolated(order, fmus, pool)
    process = pool.borrow(key) if pool is not None else None
    system, once = _as_sent(order.system, run_before=process is not None)
    process = process if process is not None else LoopProcess(tuple(fmus.values()))
    names, keep = ", ".join(sorted({fmu.path.name for fmu in fmus.values()})), False
    try:
        found = process.run(replace(order, system=system))
        keep = pool is not None and not once
        return found
    except ProcessEndedError as error:
        if not error.by_fmu and not error.expired:
            raise  # it was killed from outside
        found = _run_isolated(order, fmus, None)  # raises an error that says more
        _log.warning(
            "A loop with %s ends its process (%s), while each of them in one of its own does not. It runs so now, "
            "tens of times slower: perhaps they cannot share a process.", names, error.what,
        )  # fmt: skip
        if pool is not None:
            pool.noted.add(key)
        return found
    except NotCarriedError as error:
        _log.warning(
            "The loop cannot be sent to another process (%s). So each of these FMUs runs in one of its own, tens of "
            "times slower, until it is trusted; isolated: false, if you trust it: %s.", error.got, names,
        )  # fmt: skip
        if pool is not None:
            pool.noted.add(key)
        return _run_isolated(order, fmus, pool)
    finally:
        if keep and pool is not None:
            pool.put_back(key, process)
        else:
            process.close()


def needing_own_process(system: System) -> dict[str, FmuComponent]:
    """The FMUs of a system that may crash their process, by name."""
    fmus = [c for c in system.components.values() if isinstance(c, FmuComponent)]
    if all(fmu.is_own and not fmu.needs_own_process() for fmu in fmus):
        return {}
    counts = Counter(fmu.digest for fmu in fmus)
    return {
        name: fmu
        for name, fmu in system.components.items()
        if isinstance(fmu, FmuComponent) and fmu.needs_own_process(counts[fmu.digest])
    }


def _as_sent(system: System, *, run_before: bool) -> tuple[System, bool]:
    """The system to send to the process, and whether an FMU of it needs a new process for each run."""
    if loop_library() is not None:
        system = compiled_components(system)
    components: dict[str, Component] = {}
    once = False
    for name, component in system.components.items():
        components[name] = component
        if isinstance(component, FmuComponent):
            components[name], rerun = component.for_separate_process(run_before=run_before and not component.is_own)
            if component.isolated is not None or component.rerun == PROCESS:
                pass  # as asked for
            elif rerun is not None and rerun.isolated:
                log_isolation(component, rerun)
            elif component.needs_own_process():
                log_isolation(component, None)
            once |= rerun is not None and rerun.strategy == PROCESS
    return replace(system, components=components), once


def _run_isolated(order: Order, fmus: Mapping[str, FmuComponent], pool: InstancePool | None) -> Recording:
    """The loop in this process, with each of these FMUs in a process of its own."""
    isolated = {name: replace(fmu, isolated=True) for name, fmu in fmus.items()}
    system = replace(order.system, components={**order.system.components, **isolated})
    return run_in_process(replace(order, system=system), pool)
