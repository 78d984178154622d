"""The process of an isolated FMU: ``python -m fmu_didim.components.fmu.worker``, started by ``process`` only."""

from __future__ import annotations

import os
import sys
import threading
import time as clock
from typing import IO, Any

import numpy as np

from fmu_didim.components.fmu.process import as_message, receive, send
from fmu_didim.components.fmu.strategies import STATE


class _Server:
    """Answers requests, one at a time; holds the instance and its saved states."""

    def __init__(self) -> None:
        self._instance: Any = None
        self._states: list[Any] = []
        self._job: tuple[Any, Any] | None = None

    def answer(self, name: str, arguments: tuple[Any, ...]) -> Any:
        if name == "start":
            return None
        if name == "instantiate":
            self._instance = arguments[0].instantiate_here(keep_new_state=arguments[1])
            return None
        if name == "restart":
            self._restart(*arguments)
            return None
        if name == "function":
            self._job = (arguments[0], arguments[1])
            return None
        if name == "result":
            assert self._job is not None
            function, given = self._job
            return function(*given)
        inputs, given = arguments
        instance = self._instance
        if inputs is not None:
            instance.inputs[:] = np.frombuffer(inputs)
            instance.set()
        result = getattr(instance, name)(*self._prepared(name, given))
        if name == "get":
            return instance.outputs.tobytes()
        if name == "save_state":
            self._states.append(result)
            return len(self._states) - 1
        return result

    def _restart(self, strategy: str, component: Any) -> None:
        """Run again in this process, by a new instance where it must be."""
        self._states.clear()
        if not self._instance.restart_by(strategy, component):
            self._instance.close()
            self._instance = component.instantiate_here(keep_new_state=strategy == STATE)

    def _prepared(self, name: str, given: tuple[Any, ...]) -> tuple[Any, ...]:
        return (self._states[given[0]],) if name == "restore_state" else given

    def close(self) -> None:
        if self._instance is not None:
            self._instance.close()


def _end_with_parent(parent: int) -> None:
    """A process in an endless loop of an FMU sees no end of input; so look for the parent too."""
    while os.getppid() == parent:
        clock.sleep(1.0)
    os._exit(1)


def _serve(requests: IO[bytes], answers: IO[bytes]) -> None:
    server = _Server()
    while True:
        try:
            name, *arguments = receive(requests)
        except EOFError:
            break
        try:
            reply = ("answer", server.answer(name, tuple(arguments)))
        except Exception as error:  # noqa: BLE001 - whatever it is, the other process has to know
            reply = ("error", as_message(error))
        try:
            send(answers, reply)
        except OSError:
            break
    server.close()


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


if __name__ == "__main__":
    main()
