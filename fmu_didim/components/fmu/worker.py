"""What runs in the process of an isolated FMU: begun by ``worker_start``, started by ``process`` only."""

from __future__ import annotations

import os
import pickle
import sys
import threading
import time as clock
from types import SimpleNamespace
from typing import IO

from fmu_didim.components.fmu.process import as_message, receive, send


def _end_with_parent(parent: int) -> None:
    """A process in an endless loop of an FMU sees no end of input; so look for the parent too."""
    while os.getppid() == parent:
        clock.sleep(1.0)
    os._exit(1)


def _serve(requests: IO[bytes], answers: IO[bytes]) -> None:
    """Call what is asked for, one function after the other, each with what those before it have kept."""
    kept = SimpleNamespace(instance=None)
    while True:
        try:
            function, *arguments = receive(requests)
        except (EOFError, pickle.UnpicklingError):
            break
        try:
            reply = ("answer", function(kept, *arguments))
        except Exception as error:  # noqa: BLE001 - whatever it is, the other process has to know
            reply = ("error", as_message(error))
        try:
            send(answers, reply)
        except OSError:
            break
    if kept.instance is not None:
        kept.instance.close()


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
