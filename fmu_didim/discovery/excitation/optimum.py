"""The best motion of a basis within limits: of all information on the parameters asked for, or of their mean deviation.

    determinant:  maximise  log det (sum_i W_i' S^-2 W_i) - log det of the same of the other parameters
    mean:         minimise  mean of sigma_j / |theta_j|,  sigma_j^2 the diagonal of (sum_i W_i' S^-2 W_i)^-1

W_i (n, b) is the regressor at the instants of the log along the reference, S the standard deviations of the noise. The
second term makes it the information on some parameters while the others are unknown, too (D_s-optimality). Positions,
velocities and accelerations are linear in the coefficients; the torque is that of the inverse model. Solved by IPOPT
with derivatives by CasADi.

Source: Swevers, Ganseman, Tuekel, De Schutter, Van Brussel, "Optimal robot excitation and identification", IEEE
Transactions on Robotics and Automation 13(5), 1997; Atkinson, Donev, "Optimum Experimental Designs", 1992.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import casadi as ca
import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.excitation.basis import FINE, Basis
from fmu_didim.discovery.excitation.limits import Bounds
from fmu_didim.discovery.excitation.runs import Runs
from fmu_didim.dynamics.base_parameters import BaseParameters
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.dynamics.space.space import Space
from fmu_didim.fit.statistics import covariance_white

Criterion = Literal["determinant", "mean"]
"""What is made best."""
MOST_INSTANTS = 240
"""[samples] Of a period, in all runs together, that stand for all of a faster log: many more than there are
coefficients."""
DIGITS = 9
"""[decimals] Of an instant within a period, s, so that those of all periods are the same."""
ITERATIONS = 300
"""[iterations] Of IPOPT from one start."""
SETTLED = 1e-4
"""[1] Accuracy of the optimum, in the mean logarithm of the information on a parameter: far below what shows."""
ACCEPTED = 5
"""[iterations] In a row with the accuracy NEARLY, after which no more is gained;"""
NEARLY = 1e-3
"""[1] ten times that of the optimum."""
SHOWN = 0.1
"""[standard deviations] From zero, from which a value has a relative deviation that is worth making small, all others
being known: a hundred logs would show it at last."""
RIDGE = 1e-10
"""[1] Added to the scaled information: what no motion excites then stays finite."""
IDLE = 1e-9
"""[1] Length of a column of the regressor, relative to the torque at its value, that is rounding."""
TORQUE_WITHIN = 0.99
"""[1] Of the limit of the torque, asked for at the instants of the grid: more than it grows between them."""
KEPT = 1e-6
"""[1] By which a solution may break a limit, of its size: the accuracy of IPOPT's constraints."""
AT_OPTIMUM = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
"""What IPOPT says of a start that has come to an optimum."""
TORQUE_ROUNDS = 6
"""[1] Most of giving joints a limit of the torque, or a lower one, until it is kept between the instants, too."""
SHRINK = 0.9
"""[1] Factor by which a motion beyond the torque is made smaller, again and again;"""
SHRINKS = 60
"""[1] so often, to a five-hundredth."""
POSTURES = 500
"""[postures] Drawn at most for one about which a random motion keeps its space;"""
SMALL = 0.05
"""[1] of the range of each joint, which a motion that is drawn is not smaller than, while others are left."""
ROOM = 0.1
"""[m] By which clearances are divided as constraints: of the size of links, as the others are of that of limits."""
NEAR = 0.003
"""[m] Beyond the least clearance, asked for at the instants of the grid: links come nearer between them."""
LITTLE = 0.002
"""[1] By which a solution is made smaller, again and again, where its torque is still beyond the limit between the
instants: friction turns there, and moves on where the limit is lowered."""


@dataclass(frozen=True)
class Solution:
    """The end of IPOPT from one start.

    Attributes:
        coefficients: (d, n); criterion: log det of the information, or minus the logarithm of the mean relative
            standard deviation; that of the start in ``begun``.
        status: of IPOPT; is_settled: whether it is an optimum; iterations: it took.
    """

    coefficients: Array
    criterion: float
    begun: float
    status: str
    is_settled: bool
    iterations: int


class Problem:
    """The optimisation of the coefficients of a :class:`Basis`.

    Args:
        model, base: the robot and its base parameters.
        of: (b,) their values; or several runs of the motion, with all that is free in them.
        deviation: (n,) of the noise of the torque; instants: (N,) of the log within the motion, s.
        asked: places of the parameters asked for among those that are free; kind: what is made best.
        space: the clearances that a motion keeps, as ``Bounds.clearance`` says; None: none.

    Attributes:
        idle: places of parameters on which the torque does not depend along any motion of this model without states of
            effects, or of what is free beside base parameters, loads and drives; the design does not look at them.
    """

    def __init__(
        self, model: RobotModel, base: BaseParameters, of: Array | Runs, deviation: Array, basis: Basis,
        instants: Array, asked: Sequence[int], kind: Criterion = "determinant", space: Space | None = None,
    ) -> None:  # fmt: skip
        self.space = space
        self.runs = of if isinstance(of, Runs) else Runs.alone(of)
        self.model, self.base, self.basis, self.theta = model, base, basis, self.runs.values
        self._deviation, self._asked, self._kind = deviation, tuple(asked), kind
        self._instants = representative(instants, basis, MOST_INSTANTS // len(self.runs.maps))
        self._stand_for = instants.size / self._instants.size
        self._observed = [v.start for v in model.observed]
        self._extra = [ca.DM([v.start for v in model.extra])] if model.extra else []

    @cached_property
    def _rows(self) -> ca.Function:
        """(q, dq, ddq) -> vec of the transpose of what the logs of all runs change with, whitened, (p n R,)."""
        n, runs = self.model.joint_count, self.runs
        q, dq, ddq = (ca.SX.sym(name, n) for name in ("q", "dq", "ddq"))
        observed = [ca.DM(self._observed)] if self._observed else []
        w = self.model.regressor(q, dq, ddq, ca.DM(self.model.shape_values), *observed)[:, self.base.index.tolist()]
        gain = np.array([runs.gain(j) for j in range(n)])
        parts = []
        for map_, torque in zip(runs.maps, self._torques(q, dq, ddq), strict=True):
            table = ca.mtimes(w, ca.sparsify(ca.DM(map_)))
            for joint, place in runs.gains.items():
                table[joint, place] = -torque[joint] / gain[joint]
            parts.append(table / ca.repmat(ca.DM(gain * self._deviation), 1, runs.count))
        return ca.Function("rows", [q, dq, ddq], [ca.densify(ca.vec(ca.vertcat(*parts).T))])

    @cached_property
    def _torque(self) -> ca.Function:
        """(q, dq, ddq) -> torque of the inverse model at the values, of one run after the other, (n R,)."""
        q, dq, ddq = (ca.SX.sym(name, self.model.joint_count) for name in ("q", "dq", "ddq"))
        return ca.Function("torque", [q, dq, ddq], [ca.vertcat(*self._torques(q, dq, ddq))])

    def _torques(self, q: ca.SX, dq: ca.SX, ddq: ca.SX) -> list[ca.SX]:
        """(n,) torque of the inverse model in each run."""
        s = ca.DM(self.model.shape_values)
        chis = [ca.DM(self.base.expand(theta)) for theta in self.runs.thetas]
        return [self.model.inverse(q, dq, ddq, chi, s, *self._extra) for chi in chis]

    def _motion(self, time: Array, z: Array) -> tuple[Array, Array, Array]:
        """q, dq, ddq (n, N)."""
        q, dq, ddq = ((table @ z).T for table in self.basis.tables(time))
        return q + self.basis.constant()[:, None], dq, ddq

    def torque(self, z: Array, time: Array) -> Array:
        """(N, n R) of the inverse model along the reference, of one run after the other."""
        return np.asarray(self._torque.map(time.size)(*self._motion(time, z)).full().T)

    def rows(self, z: Array) -> Array:
        """(p, N n R) what the logs change with, whitened and transposed, at their instants."""
        flat = self._rows.map(self._instants.size)(*self._motion(self._instants, z)).full()
        return np.asarray(flat.reshape(self.runs.count, -1, order="F"))

    def _all_rows(self, z: Array) -> Array:
        """The same beside what is known beforehand."""
        rows, prior = self.rows(z), self.runs.prior
        return rows if prior is None else np.hstack([rows, prior.T / np.sqrt(self._stand_for)])

    @cached_property
    def idle(self) -> tuple[int, ...]:
        """See the class."""
        rng = np.random.default_rng(0)
        # Half a turn, and rates of a turn a second: every term of a rigid model that there is shows somewhere there.
        size = np.array([np.pi, 2 * np.pi, (2 * np.pi) ** 2])[:, None, None]
        motion = rng.uniform(-1.0, 1.0, size=(3, self.model.joint_count, MOST_INSTANTS)) * size
        table = self._rows.map(MOST_INSTANTS)(*motion).full().reshape(self.runs.count, -1, order="F")
        length = np.linalg.norm(table, axis=1)
        return tuple(int(i) for i in np.flatnonzero(length <= IDLE * length.max()))

    def shows(self, z: Array) -> Array:
        """(p,) whether each value would be as far from zero as SHOWN, were all others known."""
        deviations = np.abs(self.theta) * np.linalg.norm(self.rows(z), axis=1)
        return np.asarray(np.sqrt(self._stand_for) * deviations > SHOWN)

    @cached_property
    def shown(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Places of all parameters that the design looks at, and of those of them that were not asked for."""
        seen = tuple(i for i in range(self.runs.count) if i not in self.idle)
        return seen, tuple(i for i in seen if i not in self._asked)

    def criterion(self, z: Array) -> float:
        """log det of the information on the parameters asked for, or minus the logarithm of their mean relative
        standard deviation; minus infinity where there is none."""
        table = self._all_rows(z)
        seen, others = self.shown
        if self._kind == "mean":
            part = table[list(seen)].T
            if (np.linalg.norm(part, axis=0) == 0).any():
                return -np.inf
            places, weights = self._weights
            deviation = np.sqrt(np.diag(covariance_white(part)))
            return float(-np.log(weights @ deviation[list(places)]))

        def of(places: Sequence[int]) -> float:
            part = table[list(places)]
            length = np.linalg.norm(part, axis=1)
            if (length == 0).any():
                return -np.inf
            sign, value = np.linalg.slogdet(part @ part.T / np.outer(length, length))
            return float(value + 2 * np.log(length).sum()) if sign > 0 else -np.inf

        return of(seen) - (of(others) if others else 0.0)

    @cached_property
    def _weights(self) -> tuple[tuple[int, ...], Array]:
        """Places among those that are looked at of the parameters asked for that are not zero, and by what their
        deviations are multiplied for the mean of the relative ones."""
        seen, others = self.shown
        kept = [i for i in seen if i not in others and self.theta[i] != 0]
        if not kept:
            raise InputError(
                "The parameters asked for are zero, or so small that such a log would not show them: they have no "
                "relative deviation.", where="criterion: mean",
                next_step="Ask for the determinant, or give values by parameters.",
            )  # fmt: skip
        return tuple(seen.index(i) for i in kept), 1.0 / (len(kept) * np.abs(self.theta[kept]))

    def random(self, rng: np.random.Generator, bounds: Bounds) -> Array:
        """(d, n) coefficients of a random motion as large as the limits allow; raises InputError where none keeps the
        torque."""
        limit, time, z = TORQUE_WITHIN * bounds.torque, self.basis.grid(), self.basis.drawn(rng, bounds.limits)
        if self.space is not None:
            z = self._placed(z, rng, bounds)
        z, peak = self._within(z, replace(bounds, torque=limit), SHRINK, time)
        if (peak <= limit).all():
            return z
        joint = int(np.argmax(peak / bounds.torque))
        raise InputError(
            "Even a motion that hardly moves needs more torque than the limit.",
            where=f"limits.torque, joint {joint + 1}", got=f"{peak[joint]:.4g} against {bounds.torque[joint]:.4g}",
            next_step="Gravity and friction need that torque there: allow more, or other positions.",
        )  # fmt: skip

    def solved(self, start: Array, bounds: Bounds, *, iterations: int = ITERATIONS) -> Solution:
        """The best coefficients near a start (d, n); raises RuntimeError where IPOPT fails.

        The torque is what makes the constraints nonlinear, and often far from its limit: only the joints whose torque
        is beyond it without one are given theirs, and less where friction that turns makes it larger between the
        instants of the grid; the solution goes on from there.
        """
        best, count, own, limited = start, 0, bounds, np.zeros(bounds.torque.size, dtype=bool)
        fine, near = self.basis.grid(FINE), np.zeros(0 if self.space is None else len(self.space.checks), dtype=bool)
        for _ in range(TORQUE_ROUNDS):
            best, status, steps = self._ended(best, own, limited, near, iterations)
            count += steps
            if not np.isfinite(best).all():
                raise RuntimeError(status)
            peak, short = self._peak(best, fine), self._short(best, fine, bounds)
            beyond, close = peak > bounds.torque, short > 0
            if not beyond.any() and not close.any():
                break
            own = replace(own, torque=np.where(beyond & limited, own.torque * bounds.torque / peak, own.torque))
            if own.clearance is not None:
                own = replace(own, clearance=own.clearance + np.where(near, short, 0.0))
            if (close & ~near).any():
                best = start  # which keeps its space: far inside a box no way out is better than another
            limited, near = limited | beyond, near | close
        best, _ = self._within(best, bounds, 1 - LITTLE, fine)
        broken = self._broken(best, bounds)
        if broken > KEPT:
            raise RuntimeError(f"{status}, limits broken by {broken:.2g}{self._where(best, bounds)}")
        return Solution(best, self.criterion(best), self.criterion(start), status, status in AT_OPTIMUM, count)

    def _placed(self, z: Array, rng: np.random.Generator, bounds: Bounds) -> Array:
        """A motion (d, n) made smaller, or drawn about another posture, until it keeps its space."""
        limits, time = bounds.limits, self.basis.grid()
        for i in range(POSTURES):
            factor = 1.0
            while factor > SMALL:
                small = self.basis.smaller(z, factor)
                q = self._motion(time, small)[0].T
                inside = (q >= limits.low).all() and (q <= limits.high).all()
                if inside and (self._short(small, time, bounds) <= -NEAR).all():
                    return small
                if i and (self._short_at(q[:1], bounds) > 0).any():
                    break
                factor *= SHRINK
            if bounds.start is not None:
                z = self.basis.drawn(rng, limits)
            else:
                z = np.vstack([rng.uniform(limits.low, limits.high), z[1:]])
        raise InputError(
            "No random motion keeps its space.", where="limits: boxes, inside, capsules",
            got=f"{POSTURES} postures drawn; at the last one {self._where(z, bounds).lstrip(', ') or 'all is kept'}",
            next_step="Give a start: with more room about it, smaller boxes, or a narrower range of position.",
        )  # fmt: skip

    def _short(self, z: Array, time: Array, bounds: Bounds) -> Array:
        """(C,) by which each clearance of a motion is too small at some instants (K,), m; negative: what is left."""
        return self._short_at(self._motion(time, z)[0].T, bounds)

    def _short_at(self, q: Array, bounds: Bounds) -> Array:
        if self.space is None or bounds.clearance is None or not bounds.clearance.size:
            return np.zeros(0)
        return np.asarray(bounds.clearance - self.space.at(q).min(axis=0))

    def _where(self, z: Array, bounds: Bounds) -> str:
        """The check that is worst, in words; nothing where all is kept."""
        short = self._short(z, self.basis.grid(FINE), bounds)
        if self.space is None or not (short > 0).any():
            return ""
        worst = int(np.argmax(short))
        return f", {self.space.names[worst]} too near by {1000 * short[worst]:.3g} mm"

    def _within(self, z: Array, bounds: Bounds, factor: float, time: Array) -> tuple[Array, Array]:
        """Coefficients (d, n) of the motion, made smaller by a factor until torque and space are kept at some instants
        (K,), and how large its torque is (n,)."""
        for _ in range(SHRINKS):
            peak = self._peak(z, time)
            if (peak <= bounds.torque).all() and (self._short(z, time, bounds) <= 0).all():
                return z, peak
            z = self.basis.smaller(z, factor)
        return z, self._peak(z, time)

    def _peak(self, z: Array, time: Array) -> Array:
        """(n,) largest torque of a motion at some instants (K,), in any of the runs."""
        of_runs = np.abs(self.torque(z, time)).max(axis=0).reshape(-1, self.model.joint_count)
        return np.asarray(of_runs.max(axis=0))

    def _ended(
        self, start: Array, bounds: Bounds, limited: Array, near: Array, iterations: int
    ) -> tuple[Array, str, int]:
        """Coefficients (d, n) at the end of IPOPT, its status and iterations; ``limited``: (n,) joints whose torque
        has its limit; ``near``: (C,) clearances that have theirs."""
        units = self._units(bounds)
        y = ca.MX.sym("y", *start.shape)
        z = ca.horzcat(*(ca.mtimes(ca.DM(unit), column) for unit, column in zip(units, ca.horzsplit(y), strict=True)))
        rows, low, high = self._constraints(z, bounds, np.flatnonzero(limited).tolist(), near)
        options = {
            "print_time": False,
            "ipopt": {
                "print_level": 0, "sb": "yes", "max_iter": iterations, "tol": SETTLED, "acceptable_tol": NEARLY,
                "acceptable_iter": ACCEPTED, "acceptable_obj_change_tol": SETTLED,
                "hessian_approximation": "limited-memory", "mu_strategy": "adaptive",
                "jac_d_constant": "no" if limited.any() or near.any() else "yes",
            },
        }  # fmt: skip
        solver = ca.nlpsol("excitation", "ipopt", {"x": ca.vec(y), "f": self._objective(z, start), "g": rows}, options)
        begin = np.concatenate([np.linalg.solve(unit, one) for unit, one in zip(units, start.T, strict=True)])
        found, stats = solver(x0=begin, lbg=low, ubg=high), solver.stats()
        end = found["x"].full().reshape(start.shape, order="F")
        best = np.column_stack([unit @ one for unit, one in zip(units, end.T, strict=True)])
        return best, str(stats["return_status"]), int(stats.get("iter_count", 0))

    def _units(self, bounds: Bounds) -> list[Array]:
        """(d, d) of each joint: the coefficients that a unit of each of IPOPT's variables is.

        In these variables the mean square of position, velocity and acceleration over their limits is y'y: a step is
        as large in any direction, which it is not in the coefficients, a high harmonic of which is all acceleration.
        """
        limits, tables = bounds.limits, self.basis.tables(self.basis.grid())
        sizes = np.stack([(limits.high - limits.low) / 2, limits.speed, limits.acceleration], axis=1)
        grams = np.stack([table.T @ table / table.shape[0] for table in tables])
        roots = [np.linalg.cholesky(np.tensordot(1 / size**2, grams, axes=1)) for size in sizes]
        return [np.asarray(np.linalg.inv(root).T) for root in roots]

    def _objective(self, z: ca.MX, start: Array) -> ca.MX:
        """Minus the criterion for each parameter, up to a constant."""
        q, dq, ddq = self._symbolic(self._instants, z)
        seen, others = self.shown
        table = ca.reshape(self._rows.map(self._instants.size)(q, dq, ddq), self.runs.count, -1)
        length = np.linalg.norm(self._all_rows(start), axis=1)
        scale = 1.0 / np.where(length > 0, length, 1.0)
        table = ca.DM(scale[list(seen)]) * table[list(seen), :]
        known = self.runs.known / self._stand_for * np.outer(scale, scale)
        information = ca.mtimes(table, table.T) + ca.DM(known[np.ix_(seen, seen)])
        if self._kind == "mean":
            chosen, weights = self._weights
            rows = scale[[seen[i] for i in chosen]]
            deviation = _deviations(len(seen), chosen)(information) * ca.DM(rows * weights)
            return ca.log(ca.sum1(deviation))
        value = _log_det(len(seen))(information)
        if others:
            places = [seen.index(i) for i in others]
            value = value - _log_det(len(others))(information[places, places])
        return -value / (len(seen) - len(others))

    def _symbolic(self, time: Array, z: ca.MX) -> tuple[ca.MX, ca.MX, ca.MX]:
        q, dq, ddq = (ca.mtimes(ca.DM(table), z).T for table in self.basis.tables(time))
        return q + ca.repmat(ca.DM(self.basis.constant()), 1, time.size), dq, ddq

    def _constraints(self, z: ca.MX, bounds: Bounds, limited: Sequence[int], near: Array) -> tuple[ca.MX, Array, Array]:
        """Rows g and their limits, each divided by its size; ``limited``: joints whose torque has one, ``near``: (C,)
        clearances that have one."""
        limits, time = bounds.limits, self.basis.grid()
        middle, half = (limits.high + limits.low) / 2, (limits.high - limits.low) / 2
        q, dq, ddq = self._symbolic(time, z)
        parts = [
            (q - ca.repmat(ca.DM(middle), 1, time.size)) / ca.repmat(ca.DM(half), 1, time.size),
            dq / ca.repmat(ca.DM(limits.speed), 1, time.size),
            ddq / ca.repmat(ca.DM(limits.acceleration), 1, time.size),
        ]
        sizes = [self.basis.room] * 3
        if limited:
            count, n = len(self.runs.maps), self.model.joint_count
            torque = self._torque.map(time.size)(q, dq, ddq)[[j + n * r for r in range(count) for j in limited], :]
            limit = np.tile(bounds.torque[list(limited)], count)
            parts.append(torque / ca.repmat(ca.DM(limit), 1, time.size))
            sizes.append(TORQUE_WITHIN)
        bound = np.concatenate([np.full(part.numel(), size) for part, size in zip(parts, sizes, strict=True)])
        low, high, free = -bound, bound, np.flatnonzero(near)
        if free.size and self.space is not None and bounds.clearance is not None:
            some = self.space.of([self.space.checks[i] for i in free])
            least = ca.DM(bounds.clearance[free] + NEAR)
            parts.append((some.clearances.map(time.size)(q) - ca.repmat(least, 1, time.size)) / ROOM)
            low = np.concatenate([low, np.zeros(parts[-1].numel())])
            high = np.concatenate([high, np.full(parts[-1].numel(), np.inf)])
        return ca.vertcat(*(ca.vec(part) for part in parts)), low, high

    def _broken(self, z: Array, bounds: Bounds) -> float:
        """By how much of its size the worst limit is broken, on a fine grid."""
        time = self.basis.grid(FINE)
        q, dq, ddq = self._motion(time, z)
        limits = bounds.limits
        middle, half = (limits.high + limits.low) / 2, (limits.high - limits.low) / 2
        ratios: list[Array] = [
            np.abs(q.T - middle).max(axis=0) / half,
            np.abs(dq).max(axis=1) / limits.speed,
            np.abs(ddq).max(axis=1) / limits.acceleration,
            self._peak(z, time) / bounds.torque,
            1.0 + self._short(z, time, bounds),
        ]
        return float(np.max(np.concatenate(ratios)) - 1.0)


def representative(instants: Array, basis: Basis, most: int = MOST_INSTANTS) -> Array:
    """Instants of the log, or some of them spread evenly where there are very many."""
    if instants.size <= most:
        return instants
    one = np.unique(np.round(np.mod(instants, 1 / basis.fundamental_hz), DIGITS))
    rows = np.linspace(0, one.size - 1, min(one.size, most)).astype(int)
    return np.asarray(one[rows], dtype=float)


def _deviations(count: int, places: Sequence[int]) -> ca.Function:
    """(count, count) symmetric, positive definite M -> square roots of some of the diagonal of M^-1: the lengths of
    rows of R^-1, M = R'R."""
    matrix = ca.SX.sym("m", count, count)
    inverse = ca.inv(ca.chol(matrix + RIDGE * ca.SX.eye(count)))
    return ca.Function("deviations", [matrix], [ca.sqrt(ca.sum2(inverse[list(places), :] ** 2))])


def _log_det(count: int) -> ca.Function:
    """(count, count) symmetric, positive definite -> log det, by Cholesky's factorisation."""
    matrix = ca.SX.sym("m", count, count)
    factor = ca.chol(matrix + RIDGE * ca.SX.eye(count))
    return ca.Function("log_det", [matrix], [2 * ca.sum1(ca.log(ca.diag(factor)))])
