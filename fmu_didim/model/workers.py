"""Work side by side: compiled loops release Python's lock, so threads use several cores; what is mostly Python needs
processes of its own."""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
import pickle
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial, wraps
from multiprocessing.connection import Connection
from typing import Any, Generic, ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

from fmu_didim.base.errors import InputError
from fmu_didim.base.ticking import is_alone
from fmu_didim.components import FmuComponent
from fmu_didim.cosim import System

MOST_WORKERS = 4
"""More threads only wait for memory and for Python's part of a simulation."""
MOST_SHARES = 1024
"""[shares] Into which tasks are divided, from which processes take the next one: their numbers fit into a pipe, which
holds at least 4096 bytes (POSIX, PIPE_BUF)."""
NUMBER_BYTES = 4
"""[bytes] Of a number in it."""
VARIABLE = "FMU_DIDIM_WORKERS"
"""Environment variable with the number of threads."""

_is_copy = False
"""Whether this process is a copy of another one, made here."""
_Result = TypeVar("_Result")
_Arguments = ParamSpec("_Arguments")


def one_blas_thread(function: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """The function, run with one thread of BLAS.

    The matrices here are narrow: more threads only wait for each other, actively, and take cores from the simulations
    (three times the CPU time for six joints on two cores).
    """

    @wraps(function)
    def limited(*arguments: _Arguments.args, **options: _Arguments.kwargs) -> _Result:
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*arguments, **options)

    return limited


def default_workers() -> int:
    """Threads for simulations: what the variable FMU_DIDIM_WORKERS says, else the cores up to MOST_WORKERS.

    One in a child process, because its parent uses the other cores already.

    Raises:
        InputError: the variable is no positive whole number.
    """
    stated = os.environ.get(VARIABLE)
    if stated is not None:
        if not (stated.isascii() and stated.isdigit() and int(stated) > 0):
            raise InputError(
                "The number of threads is not valid.", where=f"environment variable {VARIABLE}", got=stated,
                valid="1, 2, 3, ...", next_step="Unset the variable, or give it a whole number.",
            )  # fmt: skip
        return int(stated)
    if multiprocessing.parent_process() is not None:
        return 1
    return min(os.cpu_count() or 1, MOST_WORKERS)


def may_run_side_by_side(system: System) -> bool:
    """Whether several runs of a system that compiled code runs may go on at once: not where an FMU of another tool
    takes part, whose instances may share memory."""
    forms = (component.compiled() for component in system.components.values())
    return not any(isinstance(form, FmuComponent) and not form.is_own for form in forms)


def side_by_side(tasks: Sequence[Callable[[], _Result]], workers: int) -> list[_Result]:
    """Results of the tasks in their order; the first error of one is raised when all have ended.

    Args:
        workers: threads at the same time; 1 runs all in this one.
    """
    if workers < 2 or len(tasks) < 2:
        return [task() for task in tasks]
    with ThreadPoolExecutor(min(workers, len(tasks))) as threads:
        return list(threads.map(lambda task: task(), tasks))


def apart(tasks: Sequence[Callable[[], _Result]], workers: int) -> list[_Result]:
    """Results of tasks that are mostly Python, in their order; the first error of one is raised when all have ended.

    Every other process is a copy of this one, so that nothing is handed to it, and what it remembers is lost with it.
    Whichever is free takes the next task. Copies are made on Linux, where no other thread runs that might hold a lock;
    elsewhere threads take the tasks in turns, as :func:`side_by_side`. What a copy could not hand back is done here.

    Args:
        workers: processes at the same time, this one among them; 1 runs all in this one.
    """
    count = 1 if _is_copy else min(workers, len(tasks))  # a copy has one core to itself
    if count < 2 or not can_copy_process():
        return side_by_side(tasks, count)
    shares, found = min(len(tasks), MOST_SHARES), dict[int, list[Any]]()
    with _numbers(shares) as numbers:
        own = (partial(_share, tasks, k, shares) for k in numbers)
        copies = [_Copy(own) for _ in range(1, count)]
        found |= (share() for share in own)
        for copy in copies:
            found |= copy.answers()
    found |= (_share(tasks, k, shares) for k in range(shares) if k not in found)  # what copies could not hand back
    results = list[Any](tasks)
    for k, some in found.items():
        results[k::shares] = some
    for result in results:
        if isinstance(result, Exception):
            raise result
    return results


def _share(tasks: Sequence[Callable[[], Any]], number: int, shares: int) -> tuple[int, list[Any]]:
    """The number of a share of tasks, and their results."""
    return number, [_tried(task) for task in tasks[number::shares]]


@contextlib.contextmanager
def _numbers(count: int) -> Iterator[Iterator[int]]:
    """The numbers from 0 on, each of which one process takes alone: this one, or one that is copied from it."""
    source, sink = os.pipe()
    try:
        os.write(sink, b"".join(k.to_bytes(NUMBER_BYTES, "little") for k in range(count)))
        os.close(sink)
        yield (int.from_bytes(packed, "little") for packed in iter(partial(os.read, source, NUMBER_BYTES), b""))
    finally:
        os.close(source)


class Beside(Generic[_Result]):
    """A task that a copy of this process works on while this one goes on.

    Args:
        workers: processes at the same time, this one among them; 1: none beside it.
        at_once: where there can be no copy, whether it is done at once, or when its result is asked for.
    """

    def __init__(self, task: Callable[[], _Result], workers: int, *, at_once: bool = True) -> None:
        self._task = task
        self._copy = _Copy([task]) if workers > 1 and can_copy_process() else None
        self._found: list[_Result | Exception] = []
        if self._copy is None and at_once:
            self._found = [_tried(task)]

    @property
    def is_done(self) -> bool:
        """Whether the result can be had without waiting."""
        return bool(self._found) or (self._copy is not None and self._copy.has_answered)

    def result(self) -> _Result:
        """The result; raises the error of the task."""
        if not self._found:
            answers = [] if self._copy is None else self._copy.answers()
            self._found = answers or [_tried(self._task)]
        (found,) = self._found
        if isinstance(found, Exception):
            raise found
        return found

    def __enter__(self) -> Beside[_Result]:
        return self

    def __exit__(self, *_: object) -> None:
        self.leave()

    def leave(self) -> None:
        """End the copy, whose result nobody will ask for any more."""
        if not self._found and self._copy is not None:
            self._copy.end()


def can_copy_process() -> bool:
    """Whether a copy of this process can go on with its work: on Linux, where it has no other thread, in no copy."""
    return sys.platform == "linux" and is_alone() and multiprocessing.parent_process() is None


def _tried(task: Callable[[], _Result]) -> _Result | Exception:
    try:
        return task()
    except Exception as error:  # noqa: BLE001 - raised when all have ended
        return error


class _Copy:
    """A copy of this process that works on some tasks and hands the results back one by one."""

    def __init__(self, tasks: Iterable[Callable[[], Any]]) -> None:
        self._ours, theirs = multiprocessing.Pipe(duplex=False)
        context = multiprocessing.get_context("fork")
        self._process = context.Process(target=_answer, args=(tasks, theirs), daemon=True)
        with warnings.catch_warnings():
            # Of threads of BLAS, which wait, and which BLAS itself ends before and begins after.
            warnings.simplefilter("ignore", DeprecationWarning)
            gc.freeze()  # a search for cycles in the copy would write into, and so copy, all that it shares
            self._process.start()
            gc.unfreeze()
        theirs.close()

    @property
    def has_answered(self) -> bool:
        """Whether an answer is there, or none will come."""
        return self._ours.poll()

    def answers(self) -> list[Any]:
        """The results in the order of the tasks, up to the first that could not be handed back."""
        found = []
        with contextlib.suppress(EOFError, OSError, TypeError, AttributeError, pickle.UnpicklingError):
            while (packed := self._ours.recv_bytes()) != b"":
                found.append(pickle.loads(packed))
        self._ours.close()
        self._process.join()
        return found

    def end(self) -> None:
        """End it, whatever it is at."""
        self._process.terminate()
        self._ours.close()
        self._process.join()


def _answer(tasks: Iterable[Callable[[], Any]], to: Connection) -> None:
    """Send the results, and nothing from the first on that cannot be packed; end without a word where the user does."""
    global _is_copy
    _is_copy = True
    with contextlib.suppress(OSError, TypeError, AttributeError, pickle.PicklingError, KeyboardInterrupt):
        for task in tasks:
            to.send_bytes(pickle.dumps(_tried(task)))
    with contextlib.suppress(OSError, KeyboardInterrupt):
        to.send_bytes(b"")
