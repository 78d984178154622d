"""When a change began: which of the logs after the reference is the first of the changed state.

With the value of the machine in the reference m (covariance C_m) and of the logs after it v_i (covariances S_i, of the
noise of each and the spread between logs),

    v_i = m + s_i d + e_i,       e_i ~ N(0, S_i)

for a shape s of the change: a *step* from a log on (s_i = 0, then 1), an *episode* from one log to another, which may
be a single log, or a *drift* from one on (s_i = 0, then in proportion to the time). G(s) is the chi-square by which d
explains the logs better, with m free about its estimate. The kind is the one of the largest

    G(s) - 2 log(number of shapes of this kind)

and an onset k is as likely as exp(G_k / 2) among its kind; the interval holds 95 % of that. It is asked once logs have
been called changed one by one: it is no second test.

Source: D. Hinkley, Biometrika 57 (1970).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby, permutations
from typing import Literal

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.discovery.selection.decide import BIC
from fmu_didim.fit.statistics import CONFIDENCE

Kind = Literal["step", "drift", "episode", "last"]
FEWEST_OF_DRIFT = 3
"""[logs] From which a drift differs from a step: of two, any line goes through both."""
MOST_ENDS = 40
"""[logs] Latest ones in which an episode may begin or end: 820 shapes, of 60 values each some seconds."""
ORDERS = 2000
"""[orders] Of the reference logs that are drawn where there are more: a chance of 0.01 is known to 20 %."""
EVERY_ORDER = 6
"""[logs] Up to which all orders are tried."""
SEED = 20240609
"""[1] Of these draws, so that they are the same each time: any will do."""


@dataclass(frozen=True)
class Onset:
    """The shape of a change.

    Attributes:
        kind: ``step``, ``drift``, ``episode``, or ``last``: of the last log alone, so that no later one tells
            whether it lasts.
        first, last: places, from 0, of the first log and the last one of the changed state.
        earliest, latest: the onset lies between these with 95 %.
        gain: chi-square by which it explains the logs better; rivals: other kinds that are as good.
    """

    kind: Kind
    first: int
    last: int
    earliest: int
    latest: int
    gain: float
    rivals: tuple[Kind, ...] = ()


@dataclass(frozen=True)
class After:
    """Logs after a reference.

    Attributes:
        mean, covariance: (p,) and (p, p) of the reference; values: (M, p); spreads: (M, p, p); time: (M,) since the
            last reference log, increasing, in any unit.
    """

    mean: Array
    covariance: Array
    values: Array
    spreads: Array
    time: Array

    def gains(self, shapes: Array) -> Array:
        """(S,) G of shapes (S, M)."""
        inverse = np.linalg.inv(self.spreads)
        of_mean = np.linalg.inv(self.covariance)
        right = np.einsum("mpq,mq->mp", inverse, self.values - self.mean)
        whole = of_mean + inverse.sum(axis=0)
        moved = np.linalg.solve(whole, right.sum(axis=0))
        found = []
        for shape in shapes:
            cross = np.tensordot(shape, inverse, axes=1)
            own = np.tensordot(shape**2, inverse, axes=1)
            schur = own - cross.T @ np.linalg.solve(whole, cross)
            rest = shape @ right - cross.T @ moved
            found.append(float(rest @ np.linalg.lstsq(schur, rest, rcond=None)[0]))
        return np.array(found)


def onset(logs: After) -> Onset:
    """When the change began, and of which kind it is."""
    count = len(logs.values)
    scored: list[tuple[float, Kind, tuple[int, int], Array, Array]] = []
    for kind, each in groupby(_shapes(logs.time), key=lambda one: one[0]):
        kept = [(one[1], one[2]) for one in each]
        ends = np.array([places for places, _ in kept])
        gains = logs.gains(np.array([shape for _, shape in kept]))
        best = int(np.argmax(gains))
        score = float(gains[best]) - 2 * float(np.log(len(ends)))
        scored.append((score, kind, (int(ends[best, 0]), int(ends[best, 1])), ends, gains))
    scored.sort(key=lambda one: -one[0])
    score, kind, (first, last), ends, gains = scored[0]
    earliest, latest = _interval(ends[:, 0], gains, first)
    rivals = tuple(other for value, other, *_ in scored[1:] if score - value < BIC)
    if kind != "drift" and first == last == count - 1:
        return Onset("last", first, last, earliest, latest, float(gains.max()), ())
    return Onset(kind, first, last, earliest, latest, float(gains.max()), rivals)


def _shapes(time: Array) -> Iterator[tuple[Kind, tuple[int, int], Array]]:
    """Kind, first and last log, and s (M,), those of a kind below each other."""
    count = time.size
    places = np.arange(count)
    for k in range(count):
        yield "step", (k, count - 1), (places >= k).astype(float)
    begin = max(0, count - MOST_ENDS)
    for a in range(begin, count - 1):
        for b in range(a, count - 1):
            yield "episode", (a, b), ((places >= a) & (places <= b)).astype(float)
    for k in range(count - FEWEST_OF_DRIFT + 1):
        since = np.maximum(time - (time[k - 1] if k else 0.0), 0.0)
        if since[-1] > 0:
            yield "drift", (k, count - 1), since / since[-1]


def _interval(first: Array, gains: Array, best: int) -> tuple[int, int]:
    """Least and largest onset of the shortest range about the best one that holds CONFIDENCE of the weight."""
    weight = np.exp((gains - gains.max()) / 2)
    total = {int(k): float(weight[first == k].sum()) for k in np.unique(first)}
    whole, low, high = sum(total.values()), best, best
    while sum(v for k, v in total.items() if low <= k <= high) < CONFIDENCE * whole:
        below, above = total.get(low - 1, -1.0), total.get(high + 1, -1.0)
        if below < 0 and above < 0:
            break
        low, high = (low - 1, high) if below >= above else (low, high + 1)
    return low, high


def order_chance(values: Array, covariance: Array, time: Array) -> tuple[float, int]:
    """Probability that logs (N, p) of one state show as clear a step or drift in another order, and the place of the
    first log behind the clearest step. Any order is as likely as theirs where nothing has changed, whatever the spread
    between them is.

    Args:
        covariance: (p, p) of one of them, by which values are weighed.
    """
    count = len(values)
    if count < 3:
        return 1.0, 0
    sizes, vectors = np.linalg.eigh(covariance)
    whitened = (values - values.mean(axis=0)) @ (vectors / np.sqrt(np.maximum(sizes, np.finfo(float).tiny)))
    steps = (np.arange(count)[None, :] >= np.arange(1, count)[:, None]).astype(float)
    shapes = np.vstack([steps, time[None, :]])
    shapes -= shapes.mean(axis=1, keepdims=True)
    size = np.linalg.norm(shapes, axis=1, keepdims=True)
    shapes = shapes[size[:, 0] > 0] / size[size[:, 0] > 0]

    if count <= EVERY_ORDER:
        orders = np.array(list(permutations(range(count))))
    else:
        rng = np.random.default_rng(SEED)
        orders = np.array([range(count), *(rng.permutation(count) for _ in range(ORDERS))])
    clearest = np.sum(np.einsum("sn,onp->osp", shapes, whitened[orders]) ** 2, axis=2).max(axis=1)
    chance = float(np.mean(clearest >= clearest[0] * (1 - ROUNDING)))  # the first order is theirs
    place = int(np.argmax(np.sum((shapes[: count - 1] @ whitened) ** 2, axis=1))) + 1
    return chance, place


ROUNDING = 1e-9
"""[1] Relative, by which equal sums of squares of two orders may differ."""
