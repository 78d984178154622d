"""Simulations side by side: compiled loops release Python's lock, so threads use several cores."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

from fmu_didim.base.errors import InputError
from fmu_didim.components import FmuComponent
from fmu_didim.cosim import System

MOST_WORKERS = 4
"""More threads only wait for memory and for Python's part of a simulation."""
VARIABLE = "FMU_DIDIM_WORKERS"
"""Environment variable with the number of threads."""

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
