"""A running instance for the compiled loop: C functions and the memory they work on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.data.signals import Array

FMI2, FMI3, LINEAR = 2, 3, 10
EXCHANGE = {FMI2: 12, FMI3: 13}
"""Kinds of native parts; ``cosim/execution/loop.c`` knows the same numbers."""


@dataclass(frozen=True)
class NativeSolver:
    """A solver of a library: name in ``exchange.h`` -> address, and what must live as long as it runs."""

    addresses: Mapping[str, int]
    kept: Any


@dataclass(frozen=True)
class ExchangeEquations:
    """How the compiled loop integrates an FMU in model exchange; functions by their addresses.

    Attributes:
        functions: name in ``exchange.h`` -> address, 0 where the FMU has no such function.
        states, indicators: numbers of them; completes: whether the FMU wants to know of each complete substep.
        substeps: of RK4 in a communication step.
        solver: makes CVode from the addresses of its right-hand side, its root function and their data; None: RK4.
        explain: the error for (negative status of ``exchange.h``, instant in s).
    """

    functions: Mapping[str, int]
    states: int
    indicators: int
    completes: bool
    substeps: int
    solver: Callable[[int, int, int], NativeSolver] | None
    explain: Callable[[int, float], FmuDidimError] = field(repr=False)


@dataclass(frozen=True)
class NativeFmu:
    """An FMU by its function pointers.

    Attributes:
        kind: FMI2 or FMI3, in whose way its functions are called, or that of :data:`EXCHANGE`.
        self_address: the instance.
        calls: names of the functions that set, get and step, for messages.
        set_address, get_address, step_address: those functions; 0 where there is nothing to pass.
        input_references, output_references: C arrays of value references, one a variable: an array of FMI 3.0 has one
            reference and many values.
        own_inputs, own_outputs: values in the FMU's own units; the instance's buffers where those are the units shown.
        input_scaling, output_scaling: (factor, offset), shown = factor * own + offset; None where they are alike.
        check: raises SimulationError for (name of the call, status worse than a warning).
        exchange: of model exchange; its ``step_address`` is 0.
    """

    kind: int
    self_address: int
    calls: tuple[str, str, str]
    set_address: int
    get_address: int
    step_address: int
    input_references: Any
    output_references: Any
    own_inputs: Array
    own_outputs: Array
    input_scaling: tuple[Array, Array] | None
    output_scaling: tuple[Array, Array] | None
    check: Callable[[str, int], None] = field(repr=False)
    exchange: ExchangeEquations | None = None


@dataclass(frozen=True)
class NativeLinear:
    """A linear system: dx/dt = A x + B u, or x[k+1] = A x + B u if sampled; y = C x + D u.

    Attributes:
        matrices: A, B, C, D, contiguous.
        state, held: (nx,) and (nu,) memory of the instance, used and changed by the loop.
        period: sample time in s, 0 for a continuous system; start: first sample instant in s.
        substeps: RK4 substeps in a communication step of a continuous system; 0: chosen by ``choose`` from its size.
    """

    matrices: tuple[Array, Array, Array, Array]
    state: Array
    held: Array
    period: float
    start: float
    substeps: int
    choose: Callable[[float], int] = field(repr=False)


Native = NativeFmu | NativeLinear
