"""CasADi functions evaluated on fixed numpy buffers."""

from __future__ import annotations

import casadi as ca

from fmu_didim.data.signals import Array


class Evaluator:
    """Calls a CasADi function on fixed buffers, without allocation.

    Args:
        function: its arguments and its results are dense vectors.
        arguments: one contiguous buffer an argument, read at each call.
        results: contiguous buffers that each call fills.
    """

    def __init__(self, function: ca.Function, arguments: list[Array], *results: Array) -> None:
        self._buffer, self._run = function.buffer()
        self._keep = (*arguments, *results)  # the buffer holds bare addresses
        for i, argument in enumerate(arguments):
            self._buffer.set_arg(i, argument.data)
        for i, result in enumerate(results):
            self._buffer.set_res(i, result.data)

    def __call__(self) -> None:
        self._run()
