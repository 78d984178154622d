"""Derivatives of CasADi expressions, one thread at a time.

CasADi lets other threads run while it works, and forming two derivatives at once can end the process with a
segmentation fault (CasADi 3.8.2: ``jacobian`` in three threads, in seconds). Functions may be made and called at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from threading import RLock
from typing import TypeAlias

import casadi as ca

_Seeds: TypeAlias = Sequence[Sequence[ca.SX]]
_ONE_AT_A_TIME = RLock()


def jacobian(expression: ca.SX, variables: ca.SX) -> ca.SX:
    """d expression / d variables, (rows of the expression, variables)."""
    with _ONE_AT_A_TIME:
        return ca.jacobian(expression, variables)


def forward(
    expressions: Sequence[ca.SX], variables: Sequence[ca.SX], seeds: Sequence[Sequence[ca.SX]]
) -> list[list[ca.SX]]:
    """Directional derivatives of the expressions, for each list of seeds, one seed a variable."""
    with _ONE_AT_A_TIME:
        return list(ca.forward(expressions, variables, seeds))


def reverse(
    expressions: Sequence[ca.SX], variables: Sequence[ca.SX], seeds: Sequence[Sequence[ca.SX]]
) -> list[list[ca.SX]]:
    """Adjoint derivatives with respect to the variables, for each list of seeds, one seed an expression."""
    with _ONE_AT_A_TIME:
        return list(ca.reverse(expressions, variables, seeds))


def serialised(function: ca.Function) -> bytes:
    """A function as CasADi saves it: the same for the same operations on the same arguments, in every process."""
    with _ONE_AT_A_TIME:
        return str(function.serialize()).encode()
