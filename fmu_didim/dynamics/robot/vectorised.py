"""CasADi functions over many points at once: one numpy operation an instruction, for all points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from fmu_didim.data.signals import Array

TOGETHER = 4096
"""Points evaluated at once: more would need much memory and leave the processor's caches."""
_OPERATIONS: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: lambda x: x,
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_EXP: np.exp,
    ca.OP_LOG: np.log,
    ca.OP_LOG1P: np.log1p,
    ca.OP_EXPM1: np.expm1,
    ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power,
    ca.OP_SQRT: np.sqrt,
    ca.OP_SQ: np.square,
    ca.OP_TWICE: lambda x: 2.0 * x,
    ca.OP_INV: np.reciprocal,
    ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos,
    ca.OP_TAN: np.tan,
    ca.OP_ASIN: np.arcsin,
    ca.OP_ACOS: np.arccos,
    ca.OP_ATAN: np.arctan,
    ca.OP_ATAN2: np.arctan2,
    ca.OP_SINH: np.sinh,
    ca.OP_COSH: np.cosh,
    ca.OP_TANH: np.tanh,
    ca.OP_FLOOR: np.floor,
    ca.OP_CEIL: np.ceil,
    ca.OP_FMOD: np.fmod,
    ca.OP_FABS: np.abs,
    ca.OP_SIGN: np.sign,
    ca.OP_COPYSIGN: np.copysign,
    ca.OP_FMIN: np.fmin,
    ca.OP_FMAX: np.fmax,
    ca.OP_HYPOT: np.hypot,
    ca.OP_LT: lambda x, y: np.less(x, y).astype(float),
    ca.OP_LE: lambda x, y: np.less_equal(x, y).astype(float),
    ca.OP_EQ: lambda x, y: np.equal(x, y).astype(float),
    ca.OP_NE: lambda x, y: np.not_equal(x, y).astype(float),
    ca.OP_NOT: lambda x: np.equal(x, 0.0).astype(float),
    ca.OP_AND: lambda x, y: np.logical_and(x, y).astype(float),
    ca.OP_OR: lambda x, y: np.logical_or(x, y).astype(float),
    ca.OP_IF_ELSE_ZERO: lambda x, y: np.where(np.not_equal(x, 0.0), y, 0.0),
}


class Vectorised:
    """A function of scalar expressions with one dense output, evaluated at K points.

    An instruction is a numpy operation on K numbers, or on one number where all points have the same: many times
    faster than CasADi's virtual machine, which goes through all instructions for each point. A function that holds
    other instructions is left to CasADi.

    Args:
        function: (a, b, ...) -> y (m,).

    Attributes:
        is_known: whether all its instructions are known here.
    """

    def __init__(self, function: ca.Function) -> None:
        self._function, self._size = function, function.nnz_out(0)
        known = {*_OPERATIONS, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}
        count = function.n_instructions() if function.is_a("SXFunction") else 0
        self._program = [
            (
                function.instruction_id(k),
                tuple(function.instruction_input(k)),
                tuple(function.instruction_output(k)),
                function.instruction_constant(k) if function.instruction_id(k) == ca.OP_CONST else 0.0,
            )
            for k in range(count)
        ]
        self.is_known = count > 0 and all(row[0] in known for row in self._program)

    def __call__(self, count: int, arguments: Sequence[Array | Sequence[Any]]) -> Array:
        """(K, m) of the output.

        Args:
            count: K; arguments: for each argument of the function its elements, each (K,) or one number.
        """
        if not self.is_known:
            return self._by_casadi(count, arguments)
        result = np.empty((count, self._size))
        for first in range(0, count, TOGETHER):
            part = slice(first, min(first + TOGETHER, count))
            inputs = [
                [np.ascontiguousarray(value[part]) if np.ndim(value) else value for value in rows] for rows in arguments
            ]
            own = np.zeros((self._size, part.stop - first))
            self._run(inputs, own)
            result[part] = own.T  # while it is in the cache of the processor
        return result

    def _run(self, arguments: Sequence[Sequence[Any]], result: Array) -> None:
        """Fill (m, K) of the output."""
        work: list[Any] = [0.0] * max(self._function.sz_w(), 1)
        with np.errstate(all="ignore"):
            for operation, given, made, constant in self._program:
                if operation == ca.OP_INPUT:
                    work[made[0]] = arguments[given[0]][given[1]]
                elif operation == ca.OP_CONST:
                    work[made[0]] = constant
                elif operation == ca.OP_OUTPUT:
                    result[made[1]] = work[given[0]]
                else:
                    work[made[0]] = _OPERATIONS[operation](*(work[i] for i in given))

    def _by_casadi(self, count: int, arguments: Sequence[Array | Sequence[Any]]) -> Array:
        tables = [
            np.array([np.broadcast_to(value, count) for value in rows]).reshape(len(rows), count) for rows in arguments
        ]
        return np.asarray(self._function.map(count)(*tables).full().T)
