"""Running a system."""

from __future__ import annotations

import contextlib
import logging
import os
import time as clock
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.components.fmu.component import FmuComponent
from fmu_didim.components.fmu.description import MODEL_EXCHANGE
from fmu_didim.components.fmu.library import CURRENT_FOLDER
from fmu_didim.cosim.execution.in_process import check_reference, run_in_process
from fmu_didim.cosim.execution.instance_pool import InstancePool
from fmu_didim.cosim.execution.running import Observer, Order
from fmu_didim.cosim.execution.separate_process import needing_own_process, run_in_separate_process
from fmu_didim.cosim.recording import Recording
from fmu_didim.cosim.system import System
from fmu_didim.data.signals import Trajectory

SLOW = 3.0
"""[s] Duration of a run from which on it is reported: the tens that an identification takes then last minutes."""
_log = logging.getLogger(__name__)


def simulate(
    system: System,
    reference: Trajectory,
    *,
    ticks: NDArray[np.int64] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    observe: Observer | None = None,
    pool: InstancePool | None = None,
    compiled: bool | None = None,
    signals: Sequence[str] | None = None,
) -> Recording:
    """Run the closed loop along a reference.

    Where an FMU takes part that is not trusted yet (see ``load_fmu``), the whole loop runs in a process of its own.

    Args:
        system: the loop.
        reference: columns that the connections name, one row a tick: its time must be t0 + k h, unless the system is
            ``at_instants`` and takes the instants of the ticks from it.
        ticks: increasing tick numbers to record; all by default. The run ends with the last one.
        bounds: signal -> (lowest, highest) sensible value, looked at every 32 ticks and at the end; a signal
            found outside stops the run.
        observe: called with the number of each recorded row and the running instances by name when the row's
            command has just begun to act; it must leave their state and inputs as they were.
        pool: where instances come from and go back to, so that a re-run loads nothing again.
        compiled: run by compiled code: where all components are C code by default; False: never.
        signals: outputs and inputs (``component.variable``) that are recorded at least, all by default: of a loop with
            derivatives few of many, which take the memory of a long log many times.

    Raises:
        InputError: the reference does not fit the step or lacks a column; the components form an algebraic loop;
            ``compiled`` is True and a component is no C code.
        DivergedError: a signal left its bounds or is not finite; if that began with one component, ``component`` of
            the error names it.
        SimulationError, FmuError: a component refused a call, or ended its process.
    """
    order, began = (
        Order(system, reference, ticks, bounds, observe, compiled, None if signals is None else tuple(signals)),
        clock.monotonic(),
    )
    try:
        if fmus := needing_own_process(system):
            check_reference(order)
            return run_in_separate_process(order, fmus, pool)
        if all(isinstance(c, FmuComponent) and c.is_own for c in system.components.values()):
            return run_in_process(order, pool)  # what is exported here stays in its folder
        with _same_folder():
            return run_in_process(order, pool)
    except FmuDidimError as error:
        if pool is not None and error.component and system.components[error.component].equations() is None:
            pool.failure = pool.failure or error  # known equations fail by the values they are given
        raise
    finally:
        if pool is not None and (seconds := clock.monotonic() - began) > SLOW:
            pool.slow_runs += 1
            if pool.slow_runs == 2:  # the first one may have started processes and tried what the FMUs can
                _log.info("%s", _slow(system, seconds))


def _slow(system: System, seconds: float) -> str:
    """What is said of a run that takes long: an identification takes tens of them, and would seem to stand still."""
    stepwise = [
        f"{name} ({component.path.name})"
        for name, component in system.components.items()
        if isinstance(component, FmuComponent) and component.interface.kind == MODEL_EXCHANGE
    ]
    why = f"; {' and '.join(stepwise)} in model exchange, integrated step by step" if stepwise else ""
    faster = "substeps: beside its source, as few as 'fmu-didim fmu check' finds enough, or a lower rate_hz of the loop"
    return f"One simulation takes {seconds:.1f} s{why}: an identification takes tens of them." + (
        f" Faster: {faster}." if stepwise else ""
    )


@contextlib.contextmanager
def _same_folder() -> Iterator[None]:
    """Go back to the current folder where an FMU has gone to another one: results would be written there."""
    try:
        with CURRENT_FOLDER:
            folder = os.getcwd()  # noqa: PTH109 - at every run
    except OSError:
        folder = None
    try:
        yield
    finally:
        with contextlib.suppress(OSError), CURRENT_FOLDER:
            if folder is not None and os.getcwd() != folder:  # noqa: PTH109
                _log.warning("An FMU has changed the current folder; it is %s again.", folder)
                os.chdir(folder)
