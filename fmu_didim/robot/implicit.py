"""The linearly implicit stage of a robot: M + g D in place of M, D from the slopes of friction, gears and bristles.

With rows r(x, a, u) = 0 of the torque balance, v the velocities, w positions and states of effects, dw/dt = f_w, and
s(v, w) the stiff torques in the rows, T holds -M^-1 ds/dv, -M^-1 ds/dw, the diagonal of df_w/dw and df_w/dv. Then, with
P = (1 - g df_w/dw)^-1 and F = df_w/dv,

    r(x, k_v - c_v, u) + g (ds/dv + g ds/dw P F) k_v + g ds/dw P (f_w + c_w) = 0
    k_w = P (f_w + c_w + g F k_v)

which is linear in k_v. Slopes below zero (Stribeck friction) are left to the explicit part, so that the matrix stays
positive definite.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from fmu_didim.linearly_implicit import LinearlyImplicit


@dataclass(frozen=True)
class StiffBalance:
    """What of a robot's torque balance a linearly implicit stage is made of, in symbols.

    Attributes:
        rows: (na,) imbalance; unknown: (na,) accelerations; v, w: (na,), (nw,) symbols; rate: f_w (nw,).
        friction: (na,) torques of the effects in the rows; gears: (na,) those of springs and dampers.
    """

    rows: ca.SX
    unknown: ca.SX
    v: ca.SX
    w: ca.SX
    rate: ca.SX
    friction: ca.SX
    gears: ca.SX


class _Slopes:
    """Entries of T that change during the run become symbols d; constants and parameters stay in the stage."""

    def __init__(self, state: ca.SX) -> None:
        self._state = state
        self.values: list[ca.SX] = []
        self.symbols: list[ca.SX] = []

    def held(self, matrix: ca.SX) -> ca.SX:
        result = ca.SX(matrix.sparsity())
        for i, entry in enumerate(matrix.nonzeros()):
            if ca.depends_on(entry, self._state):
                self.values.append(entry)
                self.symbols.append(ca.SX.sym(f"d{len(self.symbols)}"))
                entry = self.symbols[-1]
            result.nz[i] = entry
        return result


def implicit_stage(
    balance: StiffBalance,
    x: ca.SX,
    order: Sequence[int],
    u: ca.SX,
    p: ca.SX,
    *,
    rates: Sequence[ca.SX],
    within: Sequence[Sequence[ca.SX]],
) -> LinearlyImplicit:
    """The stage of a plant with these states.

    Args:
        x: symbols of the states; order: for each state its place in (v, w), -1 for the clock.
        u, p: inputs and parameters of the block; rates: from which the steps follow, 1/s, by p: those
            that are accurate, and those that are stable.
        within: symbols of the equations and what stands for them: parameters as expressions of p.
    """
    v, w, count = balance.v, balance.w, balance.v.numel()
    slopes = _Slopes(x)
    mass = ca.jacobian(balance.rows, balance.unknown)
    speed = ca.if_else(v == 0, STANDSTILL, v)
    tangents = ca.substitute(ca.jacobian(balance.friction, v), v, speed)
    friction, chords = slopes.held(tangents), slopes.held(_chords(balance.friction, v, speed))
    bristles = slopes.held(ca.jacobian(balance.friction, w))
    dampers, springs = slopes.held(ca.jacobian(balance.gears, v)), slopes.held(ca.jacobian(balance.gears, w))
    own = slopes.held(ca.diag(ca.jacobian(balance.rate, w)))
    following = slopes.held(ca.jacobian(balance.rate, v))
    g, c, k = ca.SX.sym("g"), ca.SX.sym("c", x.numel()), ca.SX.sym("k", count)
    friction = _at_reversals(friction, chords, g, mass)
    c_all = ca.SX.zeros(count + w.numel())
    for place, target in enumerate(order):
        if target >= 0:
            c_all[target] = c[place]
    share = 1 / (1 - g * own)
    matrix = _stabilising(friction + g * bristles @ ca.diag(share) @ following)
    matrix = matrix + _symmetric(dampers + g * springs @ ca.diag(share) @ following)
    known = share * (balance.rate + c_all[count:])
    moved = ca.substitute(balance.rows, balance.unknown, k - c_all[:count])
    rows = moved + g * (matrix @ k) + g * ((bristles + springs) @ known)
    all_k = ca.vertcat(k, known + g * share * (following @ k))
    stage = ca.vertcat(*(all_k[target] if target >= 0 else 1 + c[place] for place, target in enumerate(order)))
    bias = ca.substitute(balance.rows, balance.unknown, ca.SX.zeros(count))
    rest = bias - mass @ c_all[:count] + g * ((bristles + springs) @ known)
    solution = ca.ldl_solve(-rest, *ca.ldl(mass + g * matrix))
    d = ca.vertcat(ca.SX(0, 1), *slopes.symbols)
    values = ca.vertcat(ca.SX(0, 1), *slopes.values)
    values, rows, solution, stage = ca.substitute([values, rows, solution, stage], *map(list, within))
    arguments, solved = [x, c, d, k, u, p, g], [x, c, d, u, p, g]
    return LinearlyImplicit(
        slopes=ca.Function("slopes", [x, p], [ca.densify(values)]),
        residual=ca.Function("residual", arguments, [ca.densify(rows)]),
        solution=ca.Function("solution", solved, [ca.densify(solution)]),
        stage=ca.Function("stage", arguments, [ca.densify(stage)]),
        rate=ca.Function("rate", [x, p], [ca.densify(rates[0])]),
        resolution=ca.Function("resolution", [x, p], [ca.densify(rates[1])]),
    )


def _symmetric(matrix: ca.SX) -> ca.SX:
    return (matrix + matrix.T) / 2 if not matrix.sparsity().is_diag() else matrix


def _stabilising(matrix: ca.SX) -> ca.SX:
    """The symmetric part, without diagonal entries below zero."""
    result = ca.SX(_symmetric(matrix))
    for i in range(matrix.shape[0]):
        if result.sparsity().has_nz(i, i):
            result[i, i] = ca.fmax(result[i, i], 0)
    return result


def _chords(friction: ca.SX, v: ca.SX, speed: ca.SX) -> ca.SX:
    """(na,) slopes of friction by the own velocity, from standstill to the present speed."""
    result = ca.SX(v.numel(), 1)
    for i in range(v.numel()):
        if ca.depends_on(friction[i], v[i]):
            moving, still = (ca.substitute(friction[i], v[i], at) for at in (speed[i], 0.0))
            result[i] = (moving - still) / speed[i]
    return result


def _at_reversals(tangents: ca.SX, chords: ca.SX, g: ca.SX, mass: ca.SX) -> ca.SX:
    """Tangents, but chords where friction would carry the joint through standstill within the step.

    There the tangent is zero and the joint would be thrown to the other side, again and again. With the chord C it
    comes to rest; r = g C / M says how far a step would carry it, and r^2/(1 + r^2) fades the chord in.
    """
    result = ca.SX(tangents)
    for i in range(tangents.shape[0]):
        if chords.sparsity().has_nz(i, 0):
            carried = (g * chords[i]) ** 2
            result[i, i] = tangents[i, i] + (chords[i] - tangents[i, i]) * carried / (mass[i, i] ** 2 + carried)
    return result


STANDSTILL = 1e-9
"""Speed in rad/s (m/s) that stands for none, where a chord would be 0/0; tangents are taken there, too, so that both
share what is costly."""
