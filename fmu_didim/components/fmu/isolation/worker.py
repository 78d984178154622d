"""The main function of the process of an isolated FMU; run by ``worker_start``, which only ``process`` starts."""

from __future__ import annotations

import os
import sys
import threading
import time as clock
from types import SimpleNamespace
from typing import IO

from fmu_didim.base.errors import FmuDidimError, SimulationError
from fmu_didim.components.fmu.isolation.process import (
    ANSWER,
    BEAT,
    ERROR,
    WELL,
    not_carried,
    pack,
    receive,
    send,
    unpack,
)


def _end_with_parent(parent: int) -> None:
    """End this process with its parent: in an endless loop of an FMU it does not notice the end of its input."""
    while os.getppid() == parent:
        clock.sleep(1.0)
    os._exit(1)


class WorkerState(SimpleNamespace):
    """State that the called functions share, and their sign of life to the other process.

    Attributes:
        closing: what is closed at the end, in reverse order.
        beat_every: s between two beats at least.
    """

    def __init__(self, answers: IO[bytes]) -> None:
        super().__init__(closing=[], beat_every=0.2, constants=[])
        self._answers, self._last = answers, clock.monotonic()

    def beat(self) -> None:
        """Report to the other process that the call goes on."""
        if clock.monotonic() - self._last > self.beat_every:
            send(self._answers, pack((BEAT, None)))
            self._last = clock.monotonic()


def _serve(requests: IO[bytes], answers: IO[bytes]) -> None:
    """Call the requested functions one after the other; they share a state."""
    state = WorkerState(answers)
    while True:
        try:
            data = receive(requests)
        except EOFError:
            break
        try:
            send(answers, _reply(state, data))
        except OSError:
            break
    while state.closing:
        state.closing.pop().close()


def _reply(state: WorkerState, data: bytes) -> bytes:
    try:
        function, *arguments = unpack(data, state.constants)
    except Exception as error:  # noqa: BLE001 - such as a module that is not found here
        return pack((ERROR, not_carried(error)))
    try:
        return pack((ANSWER, function(state, *arguments)))
    except FmuDidimError as error:
        return pack((ERROR, error))
    except Exception as error:  # noqa: BLE001 - the other process reports it
        return pack((ERROR, SimulationError(
            f"{type(error).__name__}: {error}",
            next_step="Report it with the model; isolate: false shows where.",
        )))  # fmt: skip


def main() -> None:
    """Serve until the input closes. What the FMU prints goes to the standard error, not between the answers."""
    requests = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(2, 1)
    if hasattr(os, "getppid") and sys.platform != "win32":
        threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    _serve(requests, answers)
    sys.exit(WELL)
