"""The process of an FMU, as its parent controls it: a crash, an exit or an endless loop becomes an error.

The process is started fresh (it inherits no memory), talks over its standard input and output, and ends when it is
asked to, when its input closes, or when a call takes longer than the time limit.
"""

from __future__ import annotations

import contextlib
import io
import os
import pickle
import subprocess
import sys
import tempfile
import threading
import time as clock
import weakref
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any

from fmu_didim.base.errors import FmuError, SimulationError
from fmu_didim.components.fmu.isolation.exit_status import crash_name, is_from_outside

START_LIMIT = 120.0
"""[s] Limit for the start of the process: it imports this package first."""
_START = Path(__file__).resolve().with_name("worker_start.py")
_PACKAGE = _START.parents[3] / "__init__.py"


WELL = 77
"""Exit status of a process that came to its end: an FMU that calls exit() ends it with another one."""
ANSWER, ERROR, BEAT = "answer", "error", "beat"
"""Kinds of messages of the process."""
MOST_CONSTANTS = 64
"""[1] Objects that the process keeps at most; then it forgets all of them."""


def pack(message: Any, numbers: Mapping[int, int] | None = None) -> bytes:
    """A message as bytes; objects whose ``id`` is among ``numbers`` go as their numbers."""
    buffer = io.BytesIO()
    _Referring(buffer, numbers or {}).dump(message)
    return buffer.getvalue()


def unpack(data: bytes, constants: Sequence[Any] = ()) -> Any:
    """The message that :func:`pack` has packed."""
    return _Resolving(io.BytesIO(data), constants).load()  # from our own child, or its parent


def send(stream: IO[bytes], data: bytes) -> None:
    """Write one packed message."""
    stream.write(len(data).to_bytes(8, "big"))
    stream.write(data)
    stream.flush()


def receive(stream: IO[bytes]) -> bytes:
    """Read one packed message; raises EOFError when the other end is gone."""
    head = stream.read(8)
    size = int.from_bytes(head, "big")
    data = stream.read(size) if len(head) == 8 else b""
    if len(head) < 8 or len(data) < size:
        raise EOFError
    return data


class _Referring(pickle.Pickler):
    def __init__(self, stream: IO[bytes], numbers: Mapping[int, int]) -> None:
        super().__init__(stream, protocol=pickle.HIGHEST_PROTOCOL)
        self._numbers = numbers

    def persistent_id(self, obj: Any) -> int | None:
        return self._numbers.get(id(obj))


class _Resolving(pickle.Unpickler):
    def __init__(self, stream: IO[bytes], constants: Sequence[Any]) -> None:
        super().__init__(stream)
        self._constants = constants

    def persistent_load(self, pid: int) -> Any:
        return self._constants[pid]


def not_carried(error: Exception, where: str = "") -> NotCarriedError:
    """The error of something that cannot be packed or unpacked."""
    got = f"{type(error).__name__}: {error}"
    return NotCarriedError(
        "This cannot be sent to another process.", where=where, got=got,
        next_step="Define it in a module that can be imported, not in a notebook or in the program itself.",
    )  # fmt: skip


def worker_command() -> list[str]:
    """The command of the process: see ``worker_start`` for why it is not ``python -m``.

    Of the folders that this process searches for modules it gets all but the current one.
    """
    current = {""}
    with contextlib.suppress(OSError):  # the current folder was deleted
        current.add(os.path.realpath(os.curdir))
    folders = [os.path.abspath(folder) for folder in sys.path if folder and os.path.realpath(folder) not in current]  # noqa: PTH100
    quiet = ["-B"] if sys.dont_write_bytecode else []  # what the environment says of it is not read in isolated mode
    return [sys.executable, "-I", *quiet, str(_START), str(_PACKAGE), *folders]


class NotCarriedError(SimulationError):
    """A part of a request cannot be sent to another process, such as a function defined in this one."""


class ProcessEndedError(FmuError):
    """The process of an FMU died or was stopped, whatever the values of the run: so it is no SimulationError.

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
        self._constants: list[Any] = []
        self._numbers: dict[int, int] = {}
        try:
            self._process = subprocess.Popen(
                worker_command(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors,
                env={**os.environ, **environment},
            )  # fmt: skip
        except OSError as error:
            self._errors.close()
            what = f"The process of {subject[0].lower()}{subject[1:]} could not be started."
            raise ProcessEndedError(
                what, where=where, got=error,
                next_step="Free memory and processes, or run the FMU in this process: isolate: false.",
            ) from error  # fmt: skip
        self._deadline: list[float] = [0.0]
        self._expired, self._done = threading.Event(), threading.Event()
        watch = (self._process, self._deadline, self._expired, self._done, min(0.2, time_limit / 5))
        threading.Thread(target=_watch, args=watch, daemon=True).start()
        self._end = weakref.finalize(self, _stop, self._process, self._done, self._errors)

    def request(
        self,
        what: str,
        function: Callable[..., Any],
        *arguments: Any,
        limit: float | None = None,
        constants: Sequence[Any] = (),
    ) -> Any:
        """Call a function of this package there, and return its result; all must be picklable.

        Args:
            what: the call, for messages.
            function: its first argument is a namespace that lives as long as the process, with a method ``beat`` by
                which the function reports that it goes on: the time limit starts again then.
            constants: objects among the arguments that further requests will have again: they are sent once.

        Raises:
            FmuDidimError: the call raised it there; ProcessEndedError: the process died, or the time limit passed;
            NotCarriedError: the arguments cannot go there, and nothing was called.
        """
        if not self._end.alive:
            raise SimulationError(
                "The process of the FMU has ended.", where=self._where, next_step="Load the FMU again."
            )
        messages = self._messages((function, *arguments), constants)
        allowed = limit or self._limit
        self._deadline[0] = clock.monotonic() + allowed
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            for message in messages:
                send(self._process.stdin, message)
                kind, answer = unpack(receive(self._process.stdout))
                while kind == BEAT:
                    self._deadline[0] = clock.monotonic() + allowed
                    kind, answer = unpack(receive(self._process.stdout))
                if kind == ERROR:
                    break
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
        if isinstance(answer, NotCarriedError):
            self._constants, self._numbers = [], {}
        if kind == ERROR:
            raise answer
        return answer

    def _messages(self, request: Any, constants: Sequence[Any]) -> list[bytes]:
        """The messages of a request: first those of its constants that the process does not have yet."""
        try:
            messages = []
            if new := [one for one in constants if id(one) not in self._numbers]:
                if forget := len(self._constants) + len(new) > MOST_CONSTANTS:
                    self._constants, self._numbers, new = [], {}, list(constants)
                messages.append(pack((keep_constants, forget, new)))
                self._numbers |= {id(one): len(self._constants) + i for i, one in enumerate(new)}
                self._constants += new  # kept alive, so that no other object gets the same id
            return [*messages, pack(request, self._numbers)]
        except Exception as error:  # the objects may raise anything
            self._constants, self._numbers = [], {}
            raise not_carried(error, self._where) from error

    @property
    def ended_well(self) -> bool:
        """Whether the process ended by itself, after it closed all that it kept."""
        return self._process.poll() == WELL

    def _died(self, call: str, allowed: float) -> ProcessEndedError:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=5)
        code = self._process.poll()
        if self._expired.is_set():
            what = f"{self._subject} gave no answer within {allowed:g} s and was stopped."
            advice = "It loops or waits for something; raise time_limit_s if it is only slow."
        elif crash := crash_name(code):
            what = f"{self._subject} crashed its process ({crash})."
            advice = "Its binary is faulty or was used in a way that it does not support; ask its maker."
        else:
            what = f"{self._subject} ended its process (exit status {code})."
            advice = "Its binary calls exit(), or cannot run in this process; ask its maker."
        killed = is_from_outside(code)
        by_fmu = self._has_begun and not self._expired.is_set() and code is not None and not killed
        got = f"during {call}"
        with contextlib.suppress(OSError, ValueError):
            self._errors.seek(0)
            lines = self._errors.read().decode("utf-8", "replace").strip().splitlines()
            got += f"; its last words: {lines[-1][:300]}" if lines else ""
        self.close()
        ended = ProcessEndedError(what, where=self._where, got=got, next_step=advice)
        ended.by_fmu, ended.expired = by_fmu, self._expired.is_set()
        ended.killed = killed and not ended.expired
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


def keep_constants(there: Any, forget: bool, new: list[Any]) -> None:
    """Keep objects there to which later requests refer by number."""
    there.constants[:] = new if forget else [*there.constants, *new]


def hold(there: Any, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    """Keep a call there; that imports all that it needs, which takes time."""
    there.job = function, arguments


def run_held(there: Any) -> Any:
    """The result of the call that was kept."""
    function, arguments = there.job
    return function(*arguments)
