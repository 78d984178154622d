"""CVode of SUNDIALS, as FMPy ships it, on callbacks in C.

FMPy's solver makes its callbacks of the methods ``f`` and ``g``; here these are addresses of C functions, so that no
Python stands between the solver and the FMU.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from fmu_didim.components.native import NativeSolver

CVODE_TOLERANCE = 1e-10
"""[1] Relative tolerance of CVode; the absolute one is this times the nominal value of each state."""
MOST_STEPS = 100_000
"""[steps] Of CVode between two communication points; more is a model that it cannot integrate."""

Fill = Callable[[Any, int], None]
"""Fills, or takes, an array in C of so many values."""


def cvode(
    states: int, indicators: int, get_states: Fill, get_nominals: Fill, rhs: int, roots: int, data: int
) -> NativeSolver:
    """CVode on C functions.

    Args:
        rhs, roots: addresses of the callbacks; data: of what they are handed.
    """
    from fmpy.sundials import CVodeSolver
    from fmpy.sundials.cvode import CVode, CVodeReInit
    from fmpy.sundials.libraries import sundials_cvode

    class Solver(CVodeSolver):  # type: ignore[misc]
        f, g = rhs, roots  # addresses in the place of methods: they are not called from Python

    def unused(*arguments: Any) -> None:
        """What FMPy would call from its own callbacks."""

    solver = Solver(
        nx=states, nz=indicators, get_x=get_states, set_x=unused, get_dx=unused, get_z=unused,
        get_nominals=get_nominals, set_time=unused, input=SimpleNamespace(apply=unused), startTime=0.0,
        relativeTolerance=CVODE_TOLERANCE, maxNumSteps=MOST_STEPS,
    )  # fmt: skip
    silence(solver)
    set_data, stop = sundials_cvode.CVodeSetUserData, sundials_cvode.CVodeSetStopTime
    set_data.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
    set_data(solver.cvode_mem, data)
    memory = ctypes.cast(solver.cvode_mem, ctypes.c_void_p).value or 0
    vector = ctypes.cast(solver.x, ctypes.c_void_p).value or 0
    functions = {"advance": CVode, "restart": CVodeReInit, "stop": stop, "array_of": sundials_cvode.N_VGetArrayPointer}
    addresses = {name: ctypes.cast(f, ctypes.c_void_p).value or 0 for name, f in functions.items()}
    return NativeSolver({"memory": memory, "vector": vector, **addresses}, solver)


def silence(solver: Any) -> None:
    """Let a solver of FMPy keep its messages for the error that is raised; by itself it prints them, too."""
    from fmpy.sundials.libraries import sundials_cvode

    sundials_cvode.CVodeSetMaxHnilWarns.argtypes = [ctypes.c_void_p, ctypes.c_int]
    sundials_cvode.CVodeSetMaxHnilWarns(solver.cvode_mem, -1)  # steps lost in rounding show in the end time
    if not hasattr(solver, "sunctx"):
        return  # of a SUNDIALS that prints nothing once it has a handler
    from fmpy.sundials.libraries import sundials_core
    from fmpy.sundials.sundials_context import SUNContext_PushErrHandler

    sundials_core.SUNContext_ClearErrHandlers.argtypes = SUNContext_PushErrHandler.argtypes[:1]
    sundials_core.SUNContext_ClearErrHandlers(solver.sunctx)
    SUNContext_PushErrHandler(solver.sunctx, solver.ehfun_, None)
