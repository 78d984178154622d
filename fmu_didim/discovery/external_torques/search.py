"""The search for external torques to first order: steps of a torque, found by their response in the residual.

With s(t) the change of the log by a lasting unit torque that begins at t = 0, which one more simulation gives, a
residual made of external torques is

    r(t) = sum_k F_k s(t - t_k),    s: response of the command,  or of the command plus the external torque where the
    log shows it

The instants t_k are picked greedily, together with the parameters of the model; steps up and down are joined to
external torques.

Source: orthogonal matching pursuit, Pati, Rezaiifar, Krishnaprasad, Asilomar 1993.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.cosim import SampleOperator
from fmu_didim.data.signals import Array
from fmu_didim.data.spectrum import lagged_products
from fmu_didim.discovery.localise import MAXIMUM_WINDOWS
from fmu_didim.fit.base_projection import DEPENDENT, BaseProjection
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.noise.noise import effective_fraction
from fmu_didim.model.external_torque import ExternalTorque

MOST = 2 * MAXIMUM_WINDOWS
"""[external torques] Looked for on a joint: twice as many as windows."""
STEP_COST = 2.0
"""[parameters] Cost of a step: instant and size."""
INDEPENDENT = 0.05
"""[1] Smallest fraction of the samples that counts as independent in the cost of a step."""
WEAKEST = 0.02
"""[1] Least power of a shifted response, of the largest: steps at the end of the log hardly show."""
SMALLEST_GAIN = 0.003
"""[1] Fraction of the sum of squares that a step must explain to be looked at."""
UNSETTLED = 0.2
"""[1] Fraction of its largest value by which a response may be off its end, to count as settled."""
NEAR = 5.0
"""[samples] Of the log, beyond the time in which the loop settles, within which steps are taken for one."""
UNPAIRED = 0.35
"""[1] Fraction of a step up by which the step down may differ, so that both bound one external torque."""
LEAST = 0.05
"""[1] Fraction of the largest step below which a step only corrects the instant of another."""


def step_response(fit: Fit, label: str, joint: int) -> Array | None:
    """(K,) change of the command by a lasting unit torque on the joint, from its first tick on; None if that fails."""
    run = fit.simulation(label)
    time, already = run.experiment.reference.time, run.experiment.external_torques
    size = float(np.sqrt(np.mean(run.model.experiments.measured_in(label)[:, joint - 1] ** 2)))
    begin = time.size // 2
    try:
        still = run.logged_torque(run.record(all_ticks=True))
        external = ExternalTorque(joint, float(time[begin]), float(time[-1] + 1.0), size)
        moved = run.on(replace(run.experiment, external_torques=(*already, external)))
        after = moved.logged_torque(moved.record(all_ticks=True))
    except SimulationError:
        return None
    return np.asarray((after - still)[begin:, joint - 1] / size)


@dataclass(frozen=True)
class _Shifted:
    """The response at the samples for a step at any tick."""

    places: Array
    response: Array
    ahead: int

    def column(self, tick: int) -> Array:
        at = np.asarray(self.places - tick + self.ahead)
        return np.where(at < 0, 0.0, self.response[np.clip(at, 0, self.response.size - 1)])


def _shifted(operator: SampleOperator, response: Array, ticks: int) -> _Shifted:
    """The response as the log takes it, a mean over several ticks where it averages."""
    matrix = operator.matrix
    places = operator.ticks[matrix.indices[matrix.indptr[:-1]]]
    middle = matrix.shape[0] // 2
    row = slice(matrix.indptr[middle], matrix.indptr[middle + 1])
    offsets = operator.ticks[matrix.indices[row]]
    offsets, ahead = offsets - offsets.min(), int(offsets.max() - offsets.min())
    long = np.concatenate([np.zeros(ahead), response, np.full(ticks + ahead, response[-1])])[: ticks + 2 * ahead]
    taken = np.zeros(ticks + ahead)
    for offset, weight in zip(offsets, matrix.data[row], strict=True):
        part = long[offset : offset + taken.size]
        taken[: part.size] += weight * part
    return _Shifted(np.asarray(places), taken, ahead)


def linear_external_torques(
    fit: Fit, label: str, joint: int, response: Array, is_logged: bool
) -> tuple[float, list[ExternalTorque]] | None:
    """Share of the gap of the joint that external torques explain to first order, and the external torques."""
    experiment, rows = fit.model.experiments[label], fit.model.experiments.rows[label]
    time = experiment.reference.time
    weight = 1 / fit.noise.deviation[joint - 1]
    shifted = _shifted(experiment.operator, response, time.size)
    problem = _Problem.of(fit.jacobian[:, joint - 1] * weight, fit.residual[:, joint - 1] * weight, rows)
    chosen: list[int] = []
    rest = problem.rest([])
    gap = problem.gap([])
    if gap <= 0:
        return None
    first = float(rest @ rest)
    power = _correlation(np.ones(rest.size), shifted.response**2, shifted, time.size)
    floor = STEP_COST * np.log(rest.size) / max(float(effective_fraction(rest[:, None])[0]), INDEPENDENT)
    while len(chosen) < 2 * MOST:
        correlation = _correlation(rest, shifted.response, shifted, time.size)
        gain = correlation**2 / np.maximum(power, WEAKEST * power.max())
        left = problem.rest([shifted.column(k) * weight for k in (*chosen, int(np.argmax(gain)))])
        if float(rest @ rest - left @ left) < max(floor, SMALLEST_GAIN * first):
            break
        chosen.append(int(np.argmax(gain)))
        rest = left
    if not chosen:
        return None
    chosen.sort()
    step = experiment.reference.step
    settled = np.abs(response - response[-1]) > UNSETTLED * np.abs(response).max()
    near = round(NEAR / (experiment.rate_hz * step)) + int(np.flatnonzero(settled).max(initial=0))
    for again in (True, False):
        sizes = problem.sizes([shifted.column(k) * weight for k in chosen])
        if again:
            chosen = _merged(chosen, sizes, near)
    external_torques = _joined(time, chosen, sizes, joint, is_logged)
    if not external_torques or len(external_torques) > MOST:
        return None
    instants = fit.simulation(label).instants

    def tick(at: float) -> int:
        return round((at - time[0]) / step if instants is None else float(instants.position(np.array(at))))

    edges = [(shifted.column(tick(p.begin_s)) - shifted.column(tick(p.end_s))) * weight for p in external_torques]
    return 1 - problem.gap(edges) / gap, external_torques


@dataclass(frozen=True)
class _Problem:
    """Least squares of the residual of a joint on the parameters of the model and on columns of one experiment.

    A QR decomposition reduces the other experiments to as many rows as there are parameters.

    Attributes:
        base, target: rows of the experiment, then those of the others; own: number of the former.
        unexplained: sum of squares of the others that the parameters leave in any case; count: of all samples.
    """

    base: Array
    target: Array
    own: int
    unexplained: float
    count: int

    @staticmethod
    def of(base: Array, target: Array, rows: slice) -> _Problem:
        own, others = base[rows], np.delete(base, rows, axis=0)
        wanted = np.delete(target, rows)
        if not wanted.size:
            return _Problem(own, target[rows], own.shape[0], 0.0, own.shape[0])
        q, r = np.linalg.qr(others)
        projected = q.T @ wanted
        unexplained = float(wanted @ wanted - projected @ projected)
        stacked = np.concatenate([target[rows], projected])
        return _Problem(np.concatenate([own, r]), stacked, own.shape[0], unexplained, target.size)

    def rest(self, columns: Sequence[Array]) -> Array:
        """Residual of the experiment beside these columns."""
        return self._left(columns)[: self.own]

    def gap(self, columns: Sequence[Array]) -> float:
        """By how much the squared residual of all experiments exceeds that of noise."""
        left = self._left(columns)
        return float(left @ left) + self.unexplained - self.count

    def sizes(self, columns: Sequence[Array]) -> Array:
        """Coefficients of the columns."""
        return _solved(self._table(columns), self.target)[self.base.shape[1] :]

    def _left(self, columns: Sequence[Array]) -> Array:
        return BaseProjection.of(self._table(columns)).rest_of(self.target)

    def _table(self, columns: Sequence[Array]) -> Array:
        further = np.zeros((self.base.shape[0], len(columns)))
        for i, column in enumerate(columns):
            further[: self.own, i] = column
        return np.column_stack([self.base, further])


def _merged(ticks: list[int], sizes: Array, near: int) -> list[int]:
    """Instants of the steps; those that only correct the instant or the response of another are joined with it."""
    groups: list[list[int]] = []
    for i, tick in enumerate(ticks):
        group = groups[-1] if groups else []
        main = max((abs(sizes[k]), sizes[k]) for k in group)[1] if group else 0.0
        alike = sizes[i] * main > 0 or min(abs(sizes[i]), abs(main)) < UNPAIRED * max(abs(sizes[i]), abs(main))
        if group and alike and tick - ticks[group[0]] <= near:
            group.append(i)
        else:
            groups.append([i])
    least = LEAST * float(np.abs(sizes).max())
    kept = [group for group in groups if abs(sizes[group].sum()) > least]
    # To first order the impulse of the whole group.
    return [round(float(np.average(np.array(ticks)[group], weights=sizes[group]))) for group in kept]


def _correlation(values: Array, response: Array, shifted: _Shifted, ticks: int) -> Array:
    """sum_n values_n response(place_n - tick) for every tick, by one transform."""
    line = np.bincount(shifted.places, values, minlength=ticks).astype(float)
    # The response has one row for each tick and those ahead of the step, whose own is row ``ahead``.
    return lagged_products(line, response, np.arange(ticks) - shifted.ahead)


def _solved(table: Array, target: Array) -> Array:
    scale = np.linalg.norm(table, axis=0)
    scale[scale == 0] = 1.0
    return np.asarray(np.linalg.lstsq(table / scale, target, rcond=DEPENDENT)[0] / scale)


def _joined(time: Array, ticks: list[int], sizes: Array, joint: int, is_logged: bool) -> list[ExternalTorque]:
    """Steps joined to external torques: neighbours that cancel bound one; of others the torque between them counts."""
    external_torques: list[ExternalTorque] = []
    end = float(time[-1] + (time[1] - time[0]))
    level, i = 0.0, 0
    while i < len(ticks):
        begin = float(time[ticks[i]])
        after = float(time[ticks[i + 1]]) if i + 1 < len(ticks) else end
        pair = sizes[i : i + 2]
        if level == 0 and pair.size == 2 and abs(pair.sum()) < UNPAIRED * np.abs(pair).max():
            external_torques.append(ExternalTorque(joint, begin, after, float(pair[0] - pair[1]) / 2, is_logged))
            i += 2
            continue
        # A staircase, or an external torque that outlasts the data: a small rest at its end is not counted.
        level += float(sizes[i])
        if abs(level) < UNPAIRED * np.abs(sizes).max():
            level = 0.0
        else:
            external_torques.append(ExternalTorque(joint, begin, after, level, is_logged))
        i += 1
    return external_torques
