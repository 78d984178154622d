"""IDIM-LS: inverse dynamic identification model and least squares (section 2 of the DIDIM paper).

    q -> zero-phase Butterworth low-pass -> dq, ddq by central differences
    Y = W(q, dq, ddq) chi + rho, rows of Y and columns of W decimated in parallel (zero-phase Chebyshev)

Needs positions measured at the rate of the torque. A command is held: what a sample shows of it acts, on average, in
the middle of its control period, or of the window of an average, and later where the loop has a delay. There W is
taken, on cubic splines through the motion at the samples. On the measured EMPS at 1 kHz that leaves 3.77 % of the force
for 4.33 % with the friction of the description, and 3.94 % for 4.04 % with a sharp one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.documents import Count, NotNegative, Positive
from fmu_didim.base.errors import IdentificationError, InputError, SimulationError
from fmu_didim.data.filters import LowPass, thinned
from fmu_didim.data.signals import Array, periods
from fmu_didim.estimators.base import Estimator, Progress, no_progress
from fmu_didim.estimators.finish import remarks_of_limits
from fmu_didim.estimators.starts.reference_start import observed_on
from fmu_didim.fit.estimate import Estimate, RefusedError, Stage, Status
from fmu_didim.fit.iteration import Iteration
from fmu_didim.fit.noise.weighting import noise_floor, weighted_solution, whitened
from fmu_didim.fit.region import Region
from fmu_didim.fit.solver.admissible import physical_problem
from fmu_didim.fit.statistics import covariance_white, influence_efficient, noise_deviation, relative_error_percent
from fmu_didim.fit.uncertainty import Uncertainty, stretches, uncertainty
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.prediction import of_all

ALIKE = 1e-6
"""[s] Up to which instants of torque and positions are the same: digits of a file. A position at 10 rad/s moves by
1e-5 rad in it."""
EVEN = 0.01
"""[1] Of a period, up to which instants may lie off an even grid and still be one, as those of a reference may."""
HIGHEST_HZ, OF_RATE = 100.0, 0.2
"""[Hz], and [1] of the rate of the positions: the cut-off that is chosen is the lower one. 100 Hz is that of the
publications, of positions at 1 kHz and more; of slower ones five samples go to its period."""
GAP = 0.5
"""[periods of the cut-off] Longest gap between rows that a spline fills with what the filter lets through."""
BESIDE = 1.0
"""[periods of the cut-off] On both sides of a longer gap, what is left out: so far the filter mixes what is in it."""

WORSE = 1.5
"""[1] Largest residual of a joint by the nearest machine, over that by values of none: noise and missing friction of
its wrist cost joints of a measured Panda 1.15 times, a wrong sign or clock many times."""


@dataclass(frozen=True)
class Rows:
    """Decimated rows of all fitted logs: instants (M,) of each, regressor W (M, n, b) of the measured motion, target Y
    (M, n) and the torque (M, n) that is no matter of base parameters."""

    times: Sequence[Array]
    columns: Array
    target: Array
    known: Array


@dataclass(frozen=True)
class Solved:
    """Values (b,), the residual (M, n) that they leave, how well they are known, and the error of the torque in
    per cent."""

    value: Array
    residual: Array
    known: Uncertainty
    error: float


@dataclass(frozen=True)
class IdimLs(Estimator):
    """The estimator ``idim_ls``.

    Attributes:
        cutoff_hz: cut-off of the Butterworth filter of the positions, applied forward and backward. None: 100 Hz, or a
            fifth of the rate of the positions where that is less.
        order: its order.
        decimation: one of this many filtered samples is used; 1 uses all and filters nothing.
        sharp_coulomb: take sign(dq) for the smoothed step tanh(dq/v0) of the description, as publications do.
        held: take W where the torque that a sample shows acts; otherwise at the instant of the sample, as publications
            do, half a control period before.
        skip: samples dropped at both ends, where filter and differences see the border.
    """

    name = "idim_ls"
    needs_positions = True

    cutoff_hz: Positive | None = None
    order: Count = 4
    decimation: Count = 10
    skip: NotNegative = 50
    sharp_coulomb: bool = False
    held: bool = True

    def estimate(self, model: LoopModel, *, progress: Progress = no_progress) -> Estimate:
        rows = self.rows(model)
        solution, deviation = weighted_solution(model, rows.columns, rows.target)
        influence = influence_efficient(whitened(rows.columns, deviation))
        found = self.solved(model, rows, solution.solution, influence, deviation)
        iteration = Iteration(self.name, 1, found.value, found.error, condition_number=solution.condition_number)
        progress(iteration)
        paper = self._paper(rows.columns, found.residual, deviation)
        stages = {self.name: Stage(found.value, found.known.deviation, {"paper": paper})}
        return self.concluded(model, rows, found, (iteration,), stages)

    def rows(self, model: LoopModel) -> Rows:
        """Of the logs for the estimation; raises InputError where positions are missing or something else is free."""
        self.base_alone(model)
        parts = [self._rows(model, label) for label in model.estimation_labels]
        columns, target, known = (np.concatenate([part[i] for part in parts]) for i in (1, 2, 3))
        return Rows([part[0] for part in parts], columns, target, known)

    @staticmethod
    def solved(model: LoopModel, rows: Rows, value: Array, influence: Array, deviation: Array) -> Solved:
        """What a value (b,) leaves and how well it is known, with weights 1 / deviation (n,) and the influence
        (M n, b) of whitened rows on it."""
        residual = rows.target - rows.columns @ value
        influence = influence.reshape(rows.columns.shape) / deviation[:, None]
        freedom = residual.size - value.size
        spread = deviation * np.sqrt(np.sum(whitened(residual, deviation) ** 2) / freedom)
        if model.joint_weights == "equal":
            leverage = np.einsum("mjp,mjp->mj", rows.columns, influence)
            spread = noise_deviation(residual, leverage, floor=noise_floor(residual))
        known = uncertainty(residual, rows.columns, influence, spread, stretches(rows.times))
        measured = rows.target + rows.known
        return Solved(value, residual, known, relative_error_percent(measured, measured - residual)[0])

    def concluded(
        self,
        model: LoopModel,
        rows: Rows,
        found: Solved,
        iterations: Sequence[Iteration],
        stages: Mapping[str, Stage],
        status: Status = Status.CONVERGED,
        advice: str = "",
    ) -> Estimate:
        """The estimate, of the nearest machine where the values are of none; raises RefusedError where it is none,
        either."""
        reason, unlimited = physical_problem(model, found.value, found.known.deviation), None
        if reason and (held := of_machine(model, rows, found)) is not None:
            unlimited, found = found.value, held
            reason = physical_problem(model, found.value, found.known.deviation)
        if reason:
            raise RefusedError(
                "The identified model is not physical.", iterations=list(iterations), got=reason,
                next_step="Check sign, unit and clock of torque and positions, and the cut-off frequency.",
                values=found.value, deviation=found.known.deviation,
            )  # fmt: skip
        measured = rows.target + rows.known
        return Estimate(
            estimator=self.name,
            model=model.with_values(found.value),
            covariance=found.known.covariance,
            freedom=float(rows.target.size - found.value.size) / found.known.inflation**2,
            time=np.concatenate(rows.times),
            measured=measured,
            simulated=measured - found.residual,
            noise=np.sqrt((found.residual**2).mean(axis=0)),
            condition_number=iterations[-1].condition_number,
            status=status,
            iterations=tuple(iterations),
            stages=stages,
            colours=found.known.colours,
            unlimited=unlimited,
            remarks=(
                "The fit is that of the inverse model on measured motion, not of a simulation.",
                *self._chosen(model),
                *remarks_of_limits(model, found.value, found.known.deviation, unlimited),
            ),
            advice=advice,
        )

    def _chosen(self, model: LoopModel) -> list[str]:
        """What the filter of the positions is, where the case does not say it: inertias hang on it."""
        slowest = min(self.cutoff_of(model.experiments[label].time) for label in model.estimation_labels)
        if self.cutoff_hz is not None or slowest == HIGHEST_HZ:
            return []
        return [
            f"Positions are low-passed at {slowest:.3g} Hz, a fifth of their rate (estimator: cutoff_hz states another "
            "frequency, above the motion and below the noise)."
        ]

    @staticmethod
    def _paper(columns: Array, residual: Array, deviation: Array) -> Array:
        """(b,) standard deviations by the paper's formula, for white noise."""
        spread = np.sum(whitened(residual, deviation) ** 2) / (residual.size - columns.shape[2])
        return np.asarray(np.sqrt(spread * np.diag(covariance_white(whitened(columns, deviation)))))

    def _rows(self, model: LoopModel, label: str) -> tuple[Array, Array, Array, Array]:
        """Time (M,), regressor (M, n, b), target (M, n) and known torque (M, n) of the rows of an experiment."""
        experiment = model.experiments[label]
        even, q = self._positions(model, label)
        rate = (even.size - 1) / (even[-1] - even[0])
        q = LowPass(self.cutoff_of(even), self.order).apply(q, rate)
        dq = np.gradient(q, 1 / rate, axis=0)
        time, motion = experiment.time, (q, dq, np.gradient(dq, 1 / rate, axis=0))
        if self.held or not np.array_equal(even, time):
            time = acting_instants(model, label) if self.held else time
            motion = moved_to(time, even, motion)

        def rows(observed: Array) -> tuple[Array, Array]:
            columns, known = model.parameters.regressor(*motion, sharp=self.sharp_coulomb, observed=observed)
            return of_all(model, label, columns, known)

        columns, known = rows(
            observed_on(model.parameters, time, motion, experiment.torque, rows, starts=experiment.measured_starts)
        )
        kept = self.inner(experiment.time)
        target = self.decimated((experiment.torque - known)[kept])
        return (
            experiment.time[kept][:: self.decimation],
            self.decimated(columns[kept]),
            target,
            self.decimated(known[kept]),
        )

    def _positions(self, model: LoopModel, label: str) -> tuple[Array, Array]:
        """Even instants (K,), those of the torque where they are even, and the positions (K, n) there."""
        positions, time = self.positions(model, label), model.experiments[label].time
        first = int(np.searchsorted(positions.time, time[0] - ALIKE))
        rows = slice(first, first + time.size)  # of the part of the torque that is fitted
        at = positions.time[rows]
        if at.shape != time.shape or np.abs(at - time).max() > ALIKE:
            raise InputError(
                f"{self.name} needs torque and positions at the same instants.", where=label,
                got=f"torque {_instants(time)}, positions {_instants(positions.time)}",
                next_step="Give both at the full rate of the positions.",
            )  # fmt: skip
        rate, cutoff = (time.size - 1) / (time[-1] - time[0]), self.cutoff_of(time)
        if not 0 < cutoff < rate / 2:
            raise InputError(
                "The cut-off frequency must lie below half the rate of the positions.", where="estimator: cutoff_hz",
                got=f"{cutoff:g} Hz at {rate:.4g} Hz", valid=f"above 0, below {rate / 2:.4g} Hz",
                next_step="State one above the motion and below the noise, such as ten times the highest frequency of "
                "the motion.",
            )  # fmt: skip
        return on_even_grid(time, positions.select([f"q{j}" for j in range(1, model.joint_count + 1)])[rows])

    def cutoff_of(self, time: Array) -> float:
        """[Hz] The cut-off for positions at instants (K,), s."""
        if self.cutoff_hz is not None:
            return self.cutoff_hz
        return min(HIGHEST_HZ, OF_RATE * (time.size - 1) / float(time[-1] - time[0]))

    def inner(self, time: Array) -> NDArray[np.intp]:
        """The samples of a log (N,) that are not dropped: those at its ends are, and those beside a gap in which the
        filter would see more than a spline knows."""
        kept = np.ones(time.size, dtype=bool)
        kept[: self.skip] = kept[time.size - self.skip :] = False
        cutoff = self.cutoff_of(time)
        for i in np.flatnonzero(np.diff(time) > GAP / cutoff):
            kept &= (time < time[i] - BESIDE / cutoff) | (time > time[i + 1] + BESIDE / cutoff)
        return np.flatnonzero(kept)

    def decimated(self, values: Array) -> Array:
        """One of so many rows (N, ...), all of one log, filtered before."""
        return values if self.decimation == 1 else thinned(values, self.decimation)


def _instants(time: Array) -> str:
    """How many instants (N,) there are and where, in words."""
    return f"{time.size} samples from {time[0]:.6g} to {time[-1]:.6g} s"


def of_machine(model: LoopModel, rows: Rows, found: Solved) -> Solved | None:
    """What the nearest values that a machine can have leave, by the torque of the rows, with the deviations of those
    that were found; None where no machine has what the description knows, none explains the torque nearly as well, or
    the loop cannot be simulated with it: then something else is wrong."""
    deviation = np.sqrt((found.residual**2).mean(axis=0)) + np.finfo(float).tiny
    table = np.linalg.qr(whitened(rows.columns, deviation))[1]
    try:
        value = Region.of(model).of_base(found.value.size).least_squares(table, table @ found.value).values
        model.outputs(np.concatenate([value, model.start[value.size :]]))
    except (IdentificationError, SimulationError):
        return None
    residual, measured = rows.target - rows.columns @ value, rows.target + rows.known
    if (np.sqrt((residual**2).mean(axis=0)) > WORSE * deviation).any():
        return None
    error = relative_error_percent(measured, measured - residual)[0]
    return replace(found, value=value, residual=residual, error=error)


def on_even_grid(time: Array, q: Array) -> tuple[Array, Array]:
    """Instants and positions (N, n) as they are where the rows are even, else on the even grid of their usual step, by
    cubic splines: filter and differences need that."""
    step = float((time[-1] - time[0]) / (time.size - 1))
    if np.abs(time - time[0] - step * np.arange(time.size)).max() <= EVEN * step:
        return time, q
    from scipy.interpolate import CubicSpline  # few cases need it

    usual = float(np.median(np.diff(time)))
    even = time[0] + usual * np.arange(int((time[-1] - time[0]) / usual + 1e-6) + 1)
    return even, np.asarray(CubicSpline(time, q)(even))


def acting_instants(model: LoopModel, label: str) -> Array:
    """(N,) s, when what each sample of a log shows acts on the plant, on average: a command that is given at a tick t
    acts from t + d to t + d + h, with the delay d of the loop and the control period h."""
    experiment, system = model.experiments[label], model.loop.systems[label]
    instants, operator = experiment.reference.time, experiment.operator
    middle = (instants + periods(instants) / 2)[operator.ticks]
    return operator.apply(middle) + system.delays.get(model.loop.plant_name, 0.0) * system.step_size


def moved_to(wanted: Array, time: Array, motion: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration (N, n) each at other instants (N,), by cubic splines through those at the
    samples; before the first and behind the last one by its ends."""
    from scipy.interpolate import CubicSpline  # few cases need it

    q, dq, ddq = (np.asarray(CubicSpline(time, signal)(wanted)) for signal in motion)
    return q, dq, ddq
