"""The other process for FMUs, seen from here: a crash, an exit or an endless loop there ends in an error here.

The process is started fresh (it inherits no memory), talks over its standard input and output, and ends when it is
told to, when its input closes, or when a call takes longer than the time limit.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import time as clock
import weakref
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any

from fmu_didim.errors import FmuDidimError, FmuError, SimulationError

START_LIMIT = 120.0
"""Seconds until the process must have started: it imports this package first."""
_KILLED = 9
"""SIGKILL: how a system without memory left ends a process."""
_START = Path(__file__).resolve().with_name("worker_start.py")
_PACKAGE = _START.parents[2] / "__init__.py"


def send(stream: IO[bytes], message: Any) -> None:
    """Write one message."""
    stream.write(pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL))
    stream.flush()


def receive(stream: IO[bytes]) -> Any:
    """Read one message; raises EOFError when the other end is gone."""
    return pickle.load(stream)  # from our own child, or its parent


def worker_command() -> list[str]:
    """The command of the process: see ``worker_start`` for why it is not ``python -m``.

    Of the folders that this process searches for modules it gets all but the current one.
    """
    here = {""}
    with contextlib.suppress(OSError):  # the current folder was deleted
        here.add(os.path.realpath(os.curdir))
    folders = [os.path.abspath(folder) for folder in sys.path if folder and os.path.realpath(folder) not in here]  # noqa: PTH100
    quiet = ["-B"] if sys.dont_write_bytecode else []  # what the environment says of it is not read in isolated mode
    return [sys.executable, "-I", *quiet, str(_START), str(_PACKAGE), *folders]


class ProcessEndedError(FmuError):
    """The process of an FMU died or was stopped: no matter of the values that it was run with, so no SimulationError.

    Attributes:
        by_fmu: the FMU itself ended it, by a crash or an exit, and would do so again. Not so if it took too long,
            which a busy machine may be the reason for, was killed, or never began.
        expired: it took too long; killed: from outside, as by a system without memory left.
    """

    by_fmu = False
    expired = False
    killed = False


class Worker:
    """A child process that runs what it is sent, one request after the other.

    Args:
        where: the FMU, for messages; time_limit: seconds for one request.
        subject: what runs there, for messages; environment: variables that the process has beside those of this one.
    """

    def __init__(
        self,
        where: str,
        time_limit: float,
        *,
        subject: str = "The FMU",
        environment: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self._where, self._limit, self._subject = where, time_limit, subject
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - without a name, gone with the handle
        self._has_begun = False
        try:
            self._process = subprocess.Popen(
                worker_command(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors,
                env={**os.environ, **environment},
            )  # fmt: skip
        except OSError as error:
            self._errors.close()
            what = f"The process of {subject[0].lower()}{subject[1:]} could not be started."
            raise ProcessEndedError(what, where=where, got=error) from error
        self._deadline: list[float] = [0.0]
        self._expired, self._done = threading.Event(), threading.Event()
        watch = (self._process, self._deadline, self._expired, self._done, min(0.2, time_limit / 5))
        threading.Thread(target=_watch, args=watch, daemon=True).start()
        self._end = weakref.finalize(self, _stop, self._process, self._done, self._errors)

    def request(self, what: str, function: Callable[..., Any], *arguments: Any, limit: float | None = None) -> Any:
        """Call a function of this package there, and return its result; all must be picklable.

        Args:
            what: the call, for messages.
            function: its first argument is a namespace that lives as long as the process.

        Raises:
            SimulationError, FmuError: the call raised it there, the process died, or the time limit passed.
        """
        if not self._end.alive:
            raise SimulationError("The process of the FMU has ended.", where=self._where)
        allowed = limit or self._limit
        self._deadline[0] = clock.monotonic() + allowed
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            send(self._process.stdin, (function, *arguments))
            kind, answer = receive(self._process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            self._process.kill() if self._expired.is_set() else None
            raise self._died(what, allowed) from error
        except BaseException:  # such as Ctrl-C: the answer would be taken for that to the next request
            self._process.kill()
            self.close()
            raise
        finally:
            self._deadline[0] = 0.0
        self._has_begun = True
        if kind == "error":
            raise _rebuilt(answer)
        return answer

    def _died(self, call: str, allowed: float) -> ProcessEndedError:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=5)
        code = self._process.poll()
        if self._expired.is_set():
            what = f"{self._subject} gave no answer within {allowed:g} s and was stopped."
            advice = "It loops or waits for something; raise time_limit_s if it is only slow."
        elif code is not None and code < 0:
            what = f"{self._subject} crashed its process ({_signal_name(-code)})."
            advice = "Its binary is faulty or was used in a way it does not stand; ask its maker."
        else:
            what = f"{self._subject} ended its process (exit status {code})."
            advice = "Its binary calls exit(), or cannot run in this process; ask its maker."
        by_fmu = self._has_begun and not self._expired.is_set() and code is not None and code != -_KILLED
        got = f"during {call}"
        with contextlib.suppress(OSError, ValueError):
            self._errors.seek(0)
            lines = self._errors.read().decode("utf-8", "replace").strip().splitlines()
            got += f"; its last words: {lines[-1][:300]}" if lines else ""
        self.close()
        ended = ProcessEndedError(what, where=self._where, got=got, next_step=advice)
        ended.by_fmu, ended.expired = by_fmu, self._expired.is_set()
        ended.killed = code == -_KILLED and not ended.expired
        return ended

    def kill(self) -> None:
        """End the process at once, from another thread too; the request that it is on fails."""
        self._process.kill()

    def close(self) -> None:
        """End the process; may be called twice."""
        self._end()


def _watch(
    process: subprocess.Popen[bytes],
    deadline: list[float],
    expired: threading.Event,
    done: threading.Event,
    pause: float,
) -> None:
    while not done.wait(pause):
        if deadline[0] and clock.monotonic() > deadline[0]:
            expired.set()
            process.kill()
            return


def _stop(process: subprocess.Popen[bytes], done: threading.Event, errors: IO[bytes]) -> None:
    done.set()
    if process.stdin is not None:
        with contextlib.suppress(OSError):
            process.stdin.close()  # the child ends when it sees this
    try:
        process.wait(timeout=2)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdout is not None:
        process.stdout.close()
    errors.close()


def _signal_name(number: int) -> str:
    try:
        return f"{signal.Signals(number).name}, {signal.strsignal(number)}"
    except ValueError:
        return f"signal {number}"


def _hold(there: Any, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    there.job = function, arguments


def _run_held(there: Any) -> Any:
    function, arguments = there.job
    return function(*arguments)


def as_message(error: Exception) -> tuple[str, dict[str, Any]]:
    """An exception as it goes over the pipe."""
    if isinstance(error, FmuDidimError):
        keys = ("what", "where", "got", "valid", "next_step")
        got = {key: getattr(error, key) for key in keys}
        got["got"] = None if got["got"] is None else str(got["got"])
        return type(error).__name__, got
    return "SimulationError", {"what": f"{type(error).__name__}: {error}"}


def _rebuilt(answer: tuple[str, dict[str, Any]]) -> FmuDidimError:
    name, parts = answer
    return (FmuError if name == "FmuError" else SimulationError)(**parts)


def run_in_fresh_process(function: Callable[..., Any], *arguments: Any, where: str, time_limit: float) -> Any:
    """The result of a function of this package, called in a new process; all must be picklable.

    Raises:
        SimulationError, FmuError: it raised it there, the process died, or the time limit passed.
    """
    worker = Worker(where, time_limit)
    try:
        worker.request("start", _hold, function, arguments, limit=max(time_limit, START_LIMIT))
        return worker.request("the run", _run_held)
    finally:
        worker.close()
