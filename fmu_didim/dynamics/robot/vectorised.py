"""CasADi functions over many points at once: one numpy operation an instruction, for all points."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from fmu_didim.data.signals import Array

TOGETHER = 4096
"""Points evaluated at once: more would need much memory and leave the processor's caches."""
_OPERATIONS: dict[int, Callable[..., Any]] = {  # of one argument or two, and the array that they fill
    ca.OP_ASSIGN: np.positive,
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
    ca.OP_TWICE: lambda x, out: np.multiply(2.0, x, out),
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
    ca.OP_LT: np.less,
    ca.OP_LE: np.less_equal,
    ca.OP_EQ: np.equal,
    ca.OP_NE: np.not_equal,
    ca.OP_NOT: lambda x, out: np.equal(x, 0.0, out),
    ca.OP_AND: np.logical_and,
    ca.OP_OR: np.logical_or,
    ca.OP_IF_ELSE_ZERO: lambda x, y, out: np.copyto(out, np.where(np.not_equal(x, 0.0), y, 0.0)),
}


class Vectorised:
    """A function of scalar expressions with one dense output, evaluated at K points.

    An instruction is a numpy operation on K numbers, into the place where CasADi keeps its result: many times faster
    than CasADi's virtual machine, which goes through all instructions for each point. A function that holds other
    instructions is left to CasADi.

    Args:
        function: (a, b, ...) -> y (m,).

    Attributes:
        is_known: whether all its instructions are known here.
    """

    def __init__(self, function: ca.Function) -> None:
        self._function, self._size = function, function.nnz_out(0)
        count = function.n_instructions() if function.is_a("SXFunction") else 0
        self._program = [_Instruction.of(function, k) for k in range(count)]
        self._parts = dict[tuple[int, ...], _Steps]()
        known = {*_OPERATIONS, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}
        self.is_known = count > 0 and all(one.operation in known for one in self._program)

    def __call__(self, count: int, arguments: Sequence[Array | Sequence[Any]]) -> Array:
        """(K, m) of the output.

        Args:
            count: K; arguments: for each argument of the function its elements, each (K,) or one number.
        """
        if not self.is_known:
            return self._by_casadi(count, arguments)
        result = np.empty((count, self._size))
        for part, own in self._blocks(count, arguments, tuple(range(self._size))):
            result[part] = own.T  # while it is in the cache of the processor
        return result

    def blocks(
        self, count: int, arguments: Sequence[Array | Sequence[Any]], elements: Sequence[int]
    ) -> Iterator[tuple[slice, Array]]:
        """Some points at a time, and (e, b) some elements of the output at them, by their places; what the others alone
        need is not computed. Arguments as above."""
        if self.is_known:
            yield from self._blocks(count, arguments, tuple(elements))
            return
        for part in _parts(count):
            inputs = [[value[part] if np.ndim(value) else value for value in rows] for rows in arguments]
            yield part, self._by_casadi(part.stop - part.start, inputs).T[list(elements)]

    def _blocks(
        self, count: int, arguments: Sequence[Array | Sequence[Any]], elements: tuple[int, ...]
    ) -> Iterator[tuple[slice, Array]]:
        if elements not in self._parts:
            self._parts[elements] = _Steps.of(
                _needed_for(self._program, elements), self._function.sz_w(), len(elements)
            )
        for part in _parts(count):
            inputs = [
                [np.ascontiguousarray(value[part]) if np.ndim(value) else value for value in rows] for rows in arguments
            ]
            own = np.zeros((len(elements), part.stop - part.start))
            self._parts[elements].run(inputs, own)
            yield part, own

    def _by_casadi(self, count: int, arguments: Sequence[Array | Sequence[Any]]) -> Array:
        tables = [
            np.array([np.broadcast_to(value, count) for value in rows]).reshape(len(rows), count) for rows in arguments
        ]
        return np.asarray(self._function.map(count)(*tables).full().T)


class _Instruction(NamedTuple):
    """An instruction of a function: from places of the work vector, or of the input, to one of that, or of the
    output."""

    operation: int
    given: tuple[int, ...]
    made: int
    constant: float

    @classmethod
    def of(cls, function: ca.Function, k: int) -> _Instruction:
        operation, made = function.instruction_id(k), function.instruction_output(k)
        constant = function.instruction_constant(k) if operation == ca.OP_CONST else 0.0
        place = made[1] if operation == ca.OP_OUTPUT else made[0]
        return cls(operation, tuple(function.instruction_input(k)), place, constant)


class _Steps(NamedTuple):
    """A program as numpy operations on a list of places: those of the work vector, which are used again and again, of
    the results, of inputs and of constants.

    Attributes:
        work: number of places of the work vector.
        inputs: (argument, element) of those behind the results; constants: values of those behind them.
        steps: (operation, place of its first argument, of its second one or -1, place that it fills).
    """

    work: int
    inputs: list[tuple[int, ...]]
    constants: list[float]
    steps: list[tuple[Callable[..., Any], int, int, int]]

    @classmethod
    def of(cls, program: Sequence[_Instruction], work: int, results: int) -> _Steps:
        inputs = list(dict.fromkeys(one.given for one in program if one.operation == ca.OP_INPUT))
        input_places = {given: work + results + k for k, given in enumerate(inputs)}
        steps, at, constants = list[tuple[Callable[..., Any], int, int, int]](), dict[int, int](), list[float]()
        for one in program:
            if one.operation == ca.OP_INPUT:
                at[one.made] = input_places[one.given]
            elif one.operation == ca.OP_CONST:
                at[one.made] = work + results + len(inputs) + len(constants)
                constants.append(one.constant)
            elif one.operation == ca.OP_OUTPUT:
                steps.append((np.positive, at[one.given[0]], -1, work + one.made))
            else:
                places = [at[place] for place in one.given]
                at[one.made] = one.made
                steps.append((_OPERATIONS[one.operation], places[0], places[1] if len(places) > 1 else -1, one.made))
        return cls(work, inputs, constants, steps)

    def run(self, arguments: Sequence[Sequence[Any]], result: Array) -> None:
        """Fill (e, K) of the output."""
        places: list[Any] = [*np.empty((self.work, result.shape[1])), *result]
        places += [arguments[argument][element] for argument, element in self.inputs]
        places += self.constants
        with np.errstate(all="ignore"):
            for operation, first, second, made in self.steps:
                if second < 0:
                    operation(places[first], places[made])
                else:
                    operation(places[first], places[second], places[made])


def _needed_for(program: Sequence[_Instruction], elements: Sequence[int]) -> list[_Instruction]:
    """The instructions that some elements of the output need, which are its first ones then."""
    places, asked, kept = {element: k for k, element in enumerate(elements)}, set[int](), list[_Instruction]()
    for one in reversed(program):
        if one.operation == ca.OP_OUTPUT:
            if one.made not in places:
                continue
            one = one._replace(made=places[one.made])
        elif one.made not in asked:
            continue
        else:
            asked.remove(one.made)
        if one.operation not in (ca.OP_INPUT, ca.OP_CONST):
            asked.update(one.given)
        kept.append(one)
    return kept[::-1]


def _parts(count: int) -> Iterator[slice]:
    """Points that are evaluated together."""
    return (slice(first, min(first + TOGETHER, count)) for first in range(0, count, TOGETHER))
