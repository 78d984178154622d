"""The linearly implicit step of a robot: M + h D in place of M, D from the slopes of friction, gears and bristles.

With rows r(x, a, u) = 0 of the torque balance, v the velocities, w positions and states of effects, dw/dt = f_w, and
the remembered slopes b of v and c of w (of positions c = v + h/4 b), all is evaluated at the midpoint

    v + h/2 b,    w + h/2 c

where D are the slopes of the steep torques by v and S by w, and df_w has the diagonal O by w and F by v. A step solves

    r(x, a, u) + h D (Theta a - b/2) + S (h Theta_w k_w - h/2 c) = 0
    k_w = P (f_w - h/2 O c + h/2 F (a - b)),    P = (1 - h Theta_w O)^-1

which is linear in a. Slopes below zero (Stribeck friction) are left to the explicit part, so that the matrix stays
positive definite; the order holds for any slopes (:mod:`fmu_didim.dynamics.linearly_implicit`). Friction that depends
on the load has the slopes that it would have with the load of the accelerations b of the step before; its torque in r
is that of a itself, for which the loads are solved by Newton's method (:func:`with_loads`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca

from fmu_didim.base.symbolic import jacobian
from fmu_didim.dynamics.linearly_implicit import LinearlyImplicit


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
        factors: of M by LDL^T; extra: (na,) E by the symbols of the loads; unknown: a in what these stand for.
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


@dataclass(frozen=True)
class StiffBalance:
    """The parts of a robot's torque balance that a linearly implicit step needs, in symbols.

    Attributes:
        rows: (na,) imbalance; unknown: (na,) accelerations; v, w: (na,), (nw,) symbols; rate: f_w (nw,).
        states: places in w of the states of effects; the others are positions.
        friction: (na,) torques of the effects in the rows; gears: (na,) those of springs and dampers.
        clock: symbol for the time.
        loads: that rows and friction depend on by their symbols; None where they depend on none.
    """

    rows: ca.SX
    unknown: ca.SX
    v: ca.SX
    w: ca.SX
    rate: ca.SX
    states: range
    friction: ca.SX
    gears: ca.SX
    clock: ca.SX
    loads: Loads | None = None


@dataclass(frozen=True)
class _Motion:
    """Symbols of a step: v, w, clock where it begins, slopes b (na,) and those of the states remembered, size h."""

    v: ca.SX
    w: ca.SX
    clock: ca.SX
    b: ca.SX
    own: ca.SX
    h: ca.SX

    @classmethod
    def of(cls, balance: StiffBalance) -> _Motion:
        sizes = {"v": balance.v.numel(), "w": balance.w.numel(), "clock": 1}
        sizes |= {"b": balance.v.numel(), "own": len(balance.states), "h": 1}
        return cls(**{name: ca.SX.sym(name, size) for name, size in sizes.items()})

    @property
    def memory(self) -> ca.SX:
        return ca.vertcat(self.b, self.own)

    def remembered(self, balance: StiffBalance) -> ca.SX:
        """c (nw,), slopes of w by which the midpoint is found."""
        moving = jacobian(balance.rate, balance.v)
        slopes = moving @ (self.v + self.h / 4 * self.b)
        for i, place in enumerate(balance.states):
            slopes[place] = self.own[i]
        return slopes

    def midpoint(self, balance: StiffBalance) -> tuple[ca.SX, ca.SX]:
        """Symbols of the balance, and what they are at the midpoint."""
        half = self.h / 2
        there = ca.vertcat(self.v + half * self.b, self.w + half * self.remembered(balance), self.clock + half)
        return ca.vertcat(balance.v, balance.w, balance.clock), there


def implicit_step(
    balance: StiffBalance,
    x: ca.SX,
    order: Sequence[int],
    u: ca.SX,
    p: ca.SX,
    *,
    rates: Sequence[ca.SX],
    within: Sequence[Sequence[ca.SX]],
) -> LinearlyImplicit | None:
    """The step of a plant with these states; None where nothing is steep: what damps and springs by constants, a method
    of higher order integrates better.

    Args:
        x: symbols of the states; order: for each state its place in (v, w), -1 for the clock.
        u, p: inputs and parameters of the block; rates: from which the steps follow, 1/s, by p: those
            that are accurate, and those that are stable.
        within: symbols of the equations and what stands for them: parameters as expressions of p.
    """
    moving = ca.vertcat(balance.v, balance.w)
    steep = jacobian(ca.vertcat(balance.friction, balance.gears, balance.rate), moving)
    if not ca.depends_on(steep, ca.vertcat(moving, balance.clock)):
        return None
    motion = _Motion.of(balance)
    rows, slopes, loads = _rows(balance, motion)
    count, h = balance.v.numel(), motion.h
    following = [ca.vertcat(motion.v, motion.w) + h * slopes, motion.clock + h]
    memory = ca.vertcat(balance.unknown, *(slopes[count + place] for place in balance.states))
    solution = _solution(rows, balance.unknown, loads)
    if loads is not None:
        rows = ca.substitute(rows, loads.symbols, loads.meant)
    after = ca.vertcat(*(following[0][target] if target >= 0 else following[1] for target in order))
    places = {target: place for place, target in enumerate(order)}
    begin = ca.vertcat(*(x[places[target]] for target in range(count + balance.w.numel())))
    clock = x[places[-1]] if -1 in places else ca.SX(0)  # nothing depends on it
    symbols, begun = [*within[0], motion.v, motion.w, motion.clock], [*within[1], begin[:count], begin[count:], clock]
    rows, solution, after, memory = ca.substitute([rows, solution, after, memory], symbols, begun)
    m, a = motion.memory, balance.unknown
    arguments, solved = [x, m, a, u, p, h], [x, m, u, p, h]
    return LinearlyImplicit(
        residual=ca.Function("residual", arguments, [ca.densify(rows)]),
        solution=ca.Function("solution", solved, [ca.densify(solution)]),
        following=ca.Function("following", arguments, [ca.densify(after), ca.densify(memory)]),
        rate=ca.Function("rate", [x, p], [ca.densify(rates[0])]),
        resolution=ca.Function("resolution", [x, p], [ca.densify(rates[1])]),
        symmetric=loads is None,
    )


def _solution(rows: ca.SX, unknown: ca.SX, loads: Loads | None) -> ca.SX:
    """The unknowns (na,) for which the rows are zero; with the loads by their symbols in these."""
    count = unknown.numel()
    factors, rest = ca.ldl(jacobian(rows, unknown)), ca.substitute(rows, unknown, ca.SX.zeros(count))
    if loads is None:
        return ca.ldl_solve(-rest, *factors)
    by_load = [ca.depends_on(rest[i], loads.symbols) for i in range(count)]
    extra = ca.vertcat(*(rest[i] if by_load[i] else ca.SX(0) for i in range(count)))
    plain = ca.vertcat(*(ca.SX(0) if by_load[i] else rest[i] for i in range(count)))
    return with_loads(ca.ldl_solve(-plain, *factors), factors, extra, loads, unknown)


def _rows(balance: StiffBalance, motion: _Motion) -> tuple[ca.SX, ca.SX, Loads | None]:
    """The rows (na,) that a step solves, the slopes (na + nw,) of v and w in it, and what the loads in the rows are."""
    v, w, a, b, h = balance.v, balance.w, balance.unknown, motion.b, motion.h
    symbols, there = motion.midpoint(balance)
    steep, held = balance.friction, ca.SX(0, 1)
    if balance.loads is not None:
        held = ca.SX.sym("held", balance.loads.symbols.numel())
        steep = ca.substitute(steep, balance.loads.symbols, held)
    bristles, springs = jacobian(steep, w), jacobian(balance.gears, w)
    own, moved = ca.diag(jacobian(balance.rate, w)), jacobian(balance.rate, v)
    c = motion.remembered(balance)
    weights = _weights(-h * own)
    share = 1 / (1 - h * weights * own)
    known = share * (balance.rate - h / 2 * own * c)
    by_states = h / 2 * ca.diag(weights * share) @ moved
    bent = _stabilising(bristles @ by_states) + _symmetric(springs @ by_states)
    rows = balance.rows + _damped(balance, steep, motion) + h * bent @ (a - b)
    rows = rows + (bristles + springs) @ (h * weights * known - h / 2 * c)
    slopes = ca.vertcat(a, known + h / 2 * share * (moved @ (a - b)))
    meant = ca.SX(0, 1) if balance.loads is None else balance.loads.meant
    rows, slopes, meant = ca.substitute([rows, slopes, meant], [symbols], [there])
    if balance.loads is None:
        return rows, slopes, None
    rows = ca.substitute(rows, held, ca.substitute(meant, a, b))
    return rows, slopes, replace(balance.loads, meant=meant)


def _damped(balance: StiffBalance, steep: ca.SX, motion: _Motion) -> ca.SX:
    """h D (Theta a - b/2), with Theta for each row; where the step does not resolve a reversal, friction is that of the
    beginning of the step with its chord, F(v) + h C a.

    There the tangent is zero and the joint would be thrown to the other side, again and again; with the chord it comes
    to rest.

    Args:
        steep: the friction with loads of the step before, from which the slopes are.
    """
    a, b, h, mass = balance.unknown, motion.b, motion.h, ca.diag(jacobian(balance.rows, balance.unknown))
    tangents = jacobian(steep, balance.v)
    begun, before = ca.substitute([balance.friction, steep], [balance.v], [motion.v])
    carried = h * ca.fmax(_chords(before, motion.v), 0)
    relaxed = h * ca.fmax(ca.substitute(ca.diag(tangents), balance.v, ca.SX.zeros(mass.numel())), 0)
    unresolved = _unresolved(motion.v, motion.v - h * b, carried, relaxed, mass)
    tangents, dampers = _stabilising(tangents), _symmetric(jacobian(balance.gears, balance.v))
    if tangents.sparsity().is_diag():
        late = (1 - unresolved) * (tangents @ (a - b) / 2)
    else:
        kept = ca.sqrt(1 - unresolved)  # on both sides, so that the matrix stays symmetric and positive
        late = kept * (tangents @ (kept * (a - b) / 2))
    root = ca.sqrt(_weights(h * ca.diag(dampers) / mass))
    late = late + root * (dampers @ (root * a)) - dampers @ b / 2
    return unresolved * (begun - balance.friction + carried * a) + h * late


def _unresolved(now: ca.SX, before: ca.SX, carried: ca.SX, relaxed: ca.SX, mass: ca.SX) -> ca.SX:
    """Share (na,) of friction that the step does not resolve.

    Args:
        now, before: velocities where this step and the one before begin; carried, relaxed: slopes of friction times h,
            from standstill to now and at standstill, which over the mass say how many times the velocity it would take
            in the step, and how many times what is at rest would relax in it.
    """
    turned = 2 * ca.fmax(-now * before, 0) / (now**2 + before**2 + STANDSTILL**2)
    far = carried**2 / (mass**2 + carried**2)
    resolved = (1 - turned * _beyond(relaxed, RESOLVED * mass)) * (1 - far * _beyond(relaxed, STEEPEST * mass))
    return ca.densify(1 - resolved)


def _beyond(value: ca.SX, limit: ca.SX) -> ca.SX:
    """From 0 to 1 where the value passes the limit."""
    steep, flat = (square * square * square for square in (value**2, limit**2))
    return steep / (flat + steep)


def _weights(relaxed: ca.SX) -> ca.SX:
    """Theta by the relaxation in the step."""
    return ca.densify(1 - 1 / (2 * (1 + (ca.fmax(relaxed, 0) / RELAXED) ** 2)))


def _symmetric(matrix: ca.SX) -> ca.SX:
    return (matrix + matrix.T) / 2 if not matrix.sparsity().is_diag() else matrix


def _stabilising(matrix: ca.SX) -> ca.SX:
    """The symmetric part, without diagonal entries below zero."""
    result = ca.SX(_symmetric(matrix))
    for i in range(matrix.shape[0]):
        if result.sparsity().has_nz(i, i):
            result[i, i] = ca.fmax(result[i, i], 0)
    return result


def _chords(friction: ca.SX, v: ca.SX) -> ca.SX:
    """(na,) slopes of friction by the own velocity, from standstill to the present speed; 0 at standstill."""
    result, speed = ca.SX(v.numel(), 1), ca.if_else(v == 0, STANDSTILL, v)
    for i in range(v.numel()):
        if ca.depends_on(friction[i], v[i]):
            result[i] = (friction[i] - ca.substitute(friction[i], v[i], 0.0)) / speed[i]
    return result


NEWTON_STEPS = 3
"""Enough for |load| and the like: once no load changes its sign, one step is exact."""
STANDSTILL = 1e-9
"""Speed in rad/s (m/s) that replaces zero, where a chord would be 0/0."""
RELAXED = 30.0
"""Times of relaxation in a step from which Theta leaves 1/2: beyond, the rule would ring by (1 - z/2)/(1 + z/2) a step,
below it is more accurate with 1/2."""
RESOLVED = 10.0
"""Times of relaxation in a step up to which reversals are resolved; beyond, a velocity that has just turned would turn
again and again. With 15, joints under very steep friction (``test_linearly_implicit.py``) do not come to rest at 30 to
200 times. The TX40 has 5 at 5 kHz and 25 at 1 kHz; its torque is the same to 1e-6 with 10 and without."""
STEEPEST = 200.0
"""Times of relaxation in a step beyond which friction that is fast is taken for such a reversal, too. Without it
joints do not come to rest at 3 000 times and more; with 400, some do not at 500 to 3 000."""
