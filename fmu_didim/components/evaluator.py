"""CasADi functions evaluated on fixed numpy buffers."""

from __future__ import annotations

import casadi as ca

from fmu_didim.signals import Array


class Evaluator:
    """Calls a CasADi function with one result on fixed buffers, without allocation.

    Args:
        function: its arguments and its result are dense vectors.
        arguments: one contiguous buffer an argument, read at each call.
        result: contiguous buffer that each call fills.
    """

    def __init__(self, function: ca.Function, arguments: list[Array], result: Array) -> None:
        self._buffer, self._run = function.buffer()
        self._keep = (*arguments, result)  # the buffer holds bare addresses
        for i, argument in enumerate(arguments):
            self._buffer.set_arg(i, argument.data)
        self._buffer.set_res(0, result.data)

    def __call__(self) -> None:
        self._run()
