"""Friction that depends on the torque which a joint transmits: the load holds the acceleration, so both are solved for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from fmu_didim.base.symbolic import jacobian

NEWTON_STEPS = 3
"""Enough for |load| and the like: once no load changes its sign, one step is exact."""


@dataclass(frozen=True)
class Loads:
    """What torques depend on beside the motion, mostly the load of a single joint: y = meant, linear in the
    accelerations.

    Attributes:
        symbols: (ny,) y; meant: (ny,) what they stand for.
    """

    symbols: ca.SX
    meant: ca.SX


def with_loads(free: ca.SX, factors: Sequence[ca.SX], extra: ca.SX, loads: Loads, unknown: ca.SX) -> ca.SX:
    """Solve M a + N + E(y) = tau for a (na,), given free = M^-1 (tau - N), by Newton's method in y.

    y = C a + d holds only what E depends on, so that M is factored once:
    y + C M^-1 E(y) = C free + d,  a = free - M^-1 E(y).

    Args:
        factors: of M by LDL^T; extra: (na,) E by the symbols of the loads; unknown: symbols of a in what they stand for.
    """
    count, symbols = free.numel(), loads.symbols
    rows = [i for i in range(count) if not extra[i].is_zero()]
    force = ca.vertcat(*(extra[i] for i in rows))
    slope = jacobian(force, symbols)
    yielding = ca.ldl_solve(ca.SX.eye(count)[:, rows], *factors)
    coupling = jacobian(loads.meant, unknown)
    offset = ca.substitute(loads.meant, unknown, ca.SX.zeros(count))
    target, mobility = coupling @ free + offset, coupling @ yielding
    y = target
    for _ in range(NEWTON_STEPS):
        here, gradient = ca.substitute([force, slope], [symbols], [y])
        y = y - ca.solve(ca.SX.eye(y.numel()) + mobility @ gradient, y + mobility @ here - target)
    return free - yielding @ ca.substitute(force, symbols, y)
