"""A simulated motion near the measured one, and linear fits of the base parameters along it.

A few steps of DIDIM bring the simulated motion near: each is one simulation and one linear fit, y = S (W theta + known)
with the sampling S of the log. Along that motion the same fit shows whether another sampling (another S) or another
robot (another W) explains the log better. Along a rich motion base parameters can absorb neither, so start values need
not be good.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import FmuDidimError, SimulationError
from fmu_didim.base.tall import in_blocks
from fmu_didim.checks.data.expected import fitted_by, solved_by, solved_from
from fmu_didim.cosim import SampleOperator
from fmu_didim.data.signals import Array
from fmu_didim.estimators.starts.reference_start import from_reference
from fmu_didim.fit.noise.noise import TINY, effective_fraction
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.fit.solver.bounded import least_between
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.loop_model import LoopModel, Simulation
from fmu_didim.model.parameters import Parameters
from fmu_didim.model.prediction import predict

COARSE_S = 1e-3
"""[s] Steps of a plant by which a motion is approached: five to ten times as fast as a tick of four steps, and the
torque of a robot errs by some hundredths of its noise."""
DIDIM_STEPS = 20
"""[simulations] Towards the measured motion at most: DIDIM takes two or three, along fast motions of six joints
that are logged at 20 Hz up to sixteen."""
NEAR = 0.7
"""[1] Error, of the deviation of the log, from which a motion is near enough to judge by it."""
HELPS = 0.98
"""[1] Of the error that a step must leave at most for another one to follow."""
ROUNDING = 1e-6
"""[1] Of a step, by which it may be longer than it is meant."""
EXACT = 1e-4
"""[1] Of the deviation of a torque, below which a residual is the error of the simulation, not noise of the log."""
RIVALS = 2
"""[explanations] Reported at most where the data cannot decide between them."""
CLEARLY = 20.0
"""[1] BIC difference from which an explanation is reported: twice that of very strong evidence."""
WORTH_IT = 0.97
"""[1] Of the mean square residual that an explanation must leave at most."""
WHOLE = 4
"""[1] Ticks of a run over those of a log up to which the regressor is computed at all of them at once, for every shift
of the log that is tried; beyond, at those that a shift asks for."""
REMEMBERED = 3
"""[tables] Of the regressor, at ticks that were asked for last: of no shift, and of those near the least misfit."""
PARTS = (8, 2)
"""[samples] Of which one is taken at first, and then, to see that a misfit is larger than one that decides."""
NEARLY = 0.999
"""[1] Of a bound by a part of the samples, which counts: squares are summed with rounding."""
FINE = 0.1
"""[1] Of the step to its sides, to which the least misfit is searched."""


@dataclass(frozen=True)
class Explanation:
    """A better explanation of a log: its misfit (:meth:`FittedMotion.misfit`), BIC difference and diagnostic."""

    misfit: float
    gain: float
    diagnostic: Diagnostic


Ticks = NDArray[np.int64]
Rows = Callable[[Ticks], tuple[Array, Array]]
"""From ticks (K,) to columns (K, n, b) and known (K, n), so that the logged torque there is columns theta + known."""


@dataclass(frozen=True)
class RegressorRows:
    """The regressor along a motion, computed where it is asked for.

    Attributes:
        parameters: whose regressor; theta: (b,) values of the motion.
        motion: q, dq, ddq, (K, n) each; observed: (K, no) further signals; torque: (K, n) as logged, at all ticks.
    """

    parameters: Parameters
    theta: Array
    motion: tuple[Array, Array, Array]
    observed: Array | None
    torque: Array

    def __call__(self, ticks: Ticks) -> tuple[Array, Array]:
        if len(self.torque) > WHOLE * ticks.size:
            key = ticks.tobytes()  # shifts within a tick ask for the same ones
            found = self._last.pop(key, None)
            self._last[key] = rows = self._at(ticks) if found is None else found
            if len(self._last) > REMEMBERED:
                del self._last[next(iter(self._last))]
            return rows
        columns, known = self._whole
        return (columns, known) if ticks.size == len(self.torque) else (columns[ticks], known[ticks])

    @cached_property
    def _last(self) -> dict[bytes, tuple[Array, Array]]:
        return {}

    @cached_property
    def _whole(self) -> tuple[Array, Array]:
        return self._at(slice(None))

    def _at(self, ticks: Ticks | slice) -> tuple[Array, Array]:
        columns = self.columns(self.parameters, ticks)
        return columns, self.torque[ticks] - columns @ self.theta

    def columns(self, parameters: Parameters, ticks: Ticks | slice) -> Array:
        """(K, n, b) of any parameters along the motion."""
        observed = None if self.observed is None else self.observed[ticks]
        return parameters.regressor(*(signal[ticks] for signal in self.motion), observed=observed)[0]


@dataclass(frozen=True)
class FittedMotion:
    """A simulated motion at all ticks of an experiment, and its regressor.

    Attributes:
        run: the simulation, of a loop with that experiment alone.
        along: the regressor along the motion.
        changed: the rows of another robot along it; None: those of the own one.
    """

    run: Simulation
    along: RegressorRows
    changed: Rows | None = None

    @property
    def rows(self) -> Rows:
        """The rows of the fit."""
        return self.along if self.changed is None else self.changed

    @property
    def experiment(self) -> Experiment:
        """The experiment."""
        return self.run.experiment

    @cached_property
    def size(self) -> Array:
        """(n,) of the residual as the case has it, by which the joints of all compared residuals are divided."""
        equal = np.maximum(self.experiment.torque.std(axis=0), TINY)
        rest = self._rest(self.experiment.operator, equal)
        return np.asarray(np.maximum(rest.std(axis=0), EXACT * equal))

    @cached_property
    def samples(self) -> float:
        """Number of samples that count as independent, by the autocorrelation of the residual."""
        rest = self.residual()
        return float((effective_fraction(rest) * rest.shape[0]).sum())

    def residual(self, operator: SampleOperator | None = None) -> Array:
        """(N, n) residual of a fit of the log, with another sampling where one is given."""
        return self._residual if operator is None else self._rest(operator, self.size)

    @cached_property
    def _residual(self) -> Array:
        return self._rest(self.experiment.operator, self.size)

    def misfit(self, operator: SampleOperator | None = None) -> float:
        """Mean square of that residual, each joint divided by its size; 1 as the case has it."""
        return float(np.mean((self.residual(operator) / self.size) ** 2))

    def is_above(self, bound: float, operator: SampleOperator, rows: Rows | None = None) -> bool:
        """Whether the misfit with another sampling, or of another robot, is above a bound for sure: by some of the
        samples, as a fit to them alone leaves no more of them than the fit to all. Nothing is sure of a log that is
        filtered.

        Args:
            rows: of the other robot.
        """
        experiments = self.run.model.experiments
        measured = experiments.measured_in(self.run.label)
        if experiments.low_pass is not None or not np.isfinite(bound):
            return False
        for stride in PARTS:
            some, own = operator.every(stride), measured[::stride]
            columns, known = (some.apply(table) for table in (rows or self.rows)(some.ticks))
            rest = (own - fitted_by(columns, own, known, self.size)) / self.size
            if NEARLY * float(np.sum(rest**2)) > bound * measured.size:
                return True
        return False

    def misfit_by_scales(self) -> Callable[[Array], float]:
        """The misfit where the rows of each joint are a scale (n,) times as large, as a function of that: products of
        the columns are made once for all of them."""
        columns, known = self._filtered(self.experiment.operator)
        measured, size = self.run.model.experiments.measured_in(self.run.label), self.size
        n, count = columns.shape[1:]
        products, along = np.zeros((n, count, count)), np.zeros((n, count, 2))
        for block, *rights in zip(*(in_blocks(table) for table in (columns, measured, known)), strict=True):
            for j in range(n):
                products[j] += block[:, j].T @ block[:, j]
                along[j] += block[:, j].T @ np.column_stack([right[:, j] for right in rights])

        def misfit(scale: Array) -> float:
            weight = scale / size
            right = (weight / size) @ along[:, :, 0] - weight**2 @ along[:, :, 1]
            values = solved_from(np.tensordot(weight**2, products, 1), right)[0]
            rest = measured - (columns @ values + known) * scale
            return float(np.mean((rest / size) ** 2))

        return misfit

    def least(self, misfit: Callable[[float], float], step: float, bound: float) -> tuple[float, float, float] | None:
        """Where a misfit is least within a bound, its standard deviation by the curvature there, and the misfit.

        None where neither steps to both sides nor the parabola through them gain anything.

        Args:
            misfit: as a function of one quantity, 1 where it is 0.
        """
        below, above = misfit(-step), misfit(step)
        curvature = below + above - 2 * (present := self.misfit())
        best = min(below, above, present - 0.5 * (0.5 * (below - above)) ** 2 / curvature if curvature > 0 else present)
        if self.gain(best) <= 0:
            return None
        x, least = least_between(misfit, -bound, bound, accuracy=FINE * step)
        return x, self.deviation(misfit, x, least, step), least

    def deviation(self, misfit: Callable[[float], float], x: float, least: float, step: float) -> float:
        """Standard deviation of a quantity at its least misfit, by the curvature there; infinite without a minimum."""
        curvature = (misfit(x - step) + misfit(x + step) - 2 * least) / step**2
        return float(np.sqrt(2 * least / (self.samples * curvature))) if curvature > 0 else np.inf

    def best(self, offered: Iterable[Explanation]) -> list[Diagnostic]:
        """The explanations that are clearly better than the case, the best first, and one that is nearly as good."""
        better = [e for e in offered if e.gain > CLEARLY and e.misfit < WORTH_IT]
        least = min((e.misfit for e in better), default=0.0)
        rivals = [e for e in better if self.samples * np.log(e.misfit / least) < CLEARLY]
        rivals = sorted(rivals, key=lambda e: -e.gain)[:RIVALS]
        return [replace(e.diagnostic, weight=e.gain) for e in rivals]

    def misfit_of(self, other: FittedMotion) -> float:
        """The misfit along another motion, joints divided by their size along this one."""
        rest = other._rest(other.experiment.operator, self.size)
        return float(np.mean((rest / self.size) ** 2))

    def gain(self, misfit: float, parameters: float = 1.0) -> float:
        """BIC difference by which a model with this misfit is better than the one of the case."""
        ratio = np.log(self.misfit() / max(misfit, TINY))
        return float(self.samples * ratio - parameters * np.log(max(self.samples, 1.0)))

    def moved_by(self, operator: SampleOperator) -> Array:
        """(b,) standard deviations by which another sampling moves the values of the fit."""
        return self.apart(replace(self, run=self.run.on(replace(self.experiment, operator=operator))))

    def values(self) -> tuple[Array, Array]:
        """The values (b,) of the fit, and their standard deviations with the memory of the residual."""
        values, deviation = self._solved(self.size)
        return values, deviation * np.sqrt(self.experiment.torque.size / self.samples)

    def apart(self, other: FittedMotion) -> Array:
        """(b,) standard deviations between the values of the fits along this motion and along another one."""
        (own, deviation), (others, _) = self.values(), other._solved(self.size)
        return np.asarray(np.abs(others - own) / np.maximum(deviation, TINY))

    @property
    def sampled(self) -> tuple[Array, Array]:
        """Columns (N, n, b) and known (N, n) as the log samples them, not filtered."""
        operator = self.experiment.operator
        columns, known = self.rows(operator.ticks)
        return operator.apply(columns), operator.apply(known)

    @property
    def sampled_speed(self) -> Array:
        """(N, n) speeds of the joints as the log samples them."""
        operator = self.experiment.operator
        return operator.apply(np.abs(self.along.motion[1][operator.ticks]))

    def _filtered(self, operator: SampleOperator) -> tuple[Array, Array]:
        columns, known = self.rows(operator.ticks)
        filtered = self.run.model.experiments.filtered
        return filtered(operator.apply(columns), self.run.label), filtered(operator.apply(known), self.run.label)

    def _solved(self, size: Array) -> tuple[Array, Array]:
        """The values (b,) of the fit, and their deviations as of noise of this size (n,)."""
        operator, measured = self.experiment.operator, self.run.model.experiments.measured_in(self.run.label)
        columns, known = self._filtered(operator)
        return solved_by(columns, measured - known, size)

    def _rest(self, operator: SampleOperator, size: Array) -> Array:
        measured = self.run.model.experiments.measured_in(self.run.label)
        columns, known = self._filtered(operator)
        return np.asarray(measured - fitted_by(columns, measured, known, size))


def fitted_motion(model: LoopModel, start: Array | None = None) -> FittedMotion | None:
    """The motion of a model of one experiment after a few steps of DIDIM; None if it does not come near enough.

    Args:
        start: (p,) values from which alone the steps begin.
    """
    if not model.parameters.has_regressor or model.linear_count < len(model.free_parameters):
        return None
    for values in _starts(model) if start is None else [start]:
        if (found := _approached(model, values)) is not None:
            return found
        reached = _steps(model, values)
        if reached is not None and reached[0] <= NEAR:
            return motion_with_regressor(model.simulation(reached[1]))
    return None


def _approached(model: LoopModel, values: Array) -> FittedMotion | None:
    """The same by steps with a plant that is integrated as coarsely as is enough for that; None where it cannot be
    integrated more coarsely than it is, does not come near enough, or where its error is not that of the motion."""
    count = math.ceil(model.loop.systems[model.first].step_size / COARSE_S - ROUNDING)
    if model.loop.substeps is None or count >= model.loop.substeps:
        return None
    reached = _steps(model.with_loop(substeps=max(count, 1)), values)
    if reached is None or reached[0] > NEAR:
        return None
    try:
        found = motion_with_regressor(model.simulation(reached[1]))
        error = _error(model.measured, found.run.torque_at(found.along.torque))
    except SimulationError:
        return None
    return found if HELPS * error <= reached[0] else None


def _error(measured: Array, torque: Array) -> float:
    """Of a torque (N, n), relative to the deviation of the log, root mean square over samples and joints."""
    size = np.maximum(measured.std(axis=0), TINY)
    return float(np.sqrt(np.mean(((measured - torque) / size) ** 2)))


def motion_with_regressor(run: Simulation) -> FittedMotion:
    """A motion with its regressor; raises SimulationError."""
    model = run.model
    given = ("q", "dq", "ddq") if model.loop.gives_acceleration else ("q", "dq")
    names = [f"{model.loop.plant_name}.{name}" for name in model.parameters.observed]
    asked = [*model.loop.logged, *(signal for name in given for signal in model.loop.joint_signals(name)), *names]
    recording = run.record(all_ticks=True, signals=asked)
    q, dq, *accelerations = (recording.table(model.loop.joint_signals(name)) for name in given)
    ddq = accelerations[0] if accelerations else np.gradient(dq, recording.spacing, axis=0)
    observed = recording.table(names) if names else None
    rows = RegressorRows(model.parameters, run.theta, (q, dq, ddq), observed, run.logged_torque(recording))
    return FittedMotion(run, rows)


def _starts(model: LoopModel) -> Iterator[Array]:
    with suppress(FmuDidimError):
        yield from_reference(model)
    yield model.start


def _steps(model: LoopModel, values: Array) -> tuple[float, Array] | None:
    """Error relative to the deviation of the log, and the values, after steps of DIDIM while they help."""
    measured, size = model.measured, np.maximum(model.measured.std(axis=0), TINY)
    best: tuple[float, Array] | None = None
    for _ in range(DIDIM_STEPS):
        if mass_matrix_problem(model, values):
            break
        try:
            found = predict(model, values)
        except FmuDidimError:
            break
        error = _error(measured, found.torque)
        if best is not None and error > best[0] * HELPS:
            return min(best, (error, values), key=lambda pair: pair[0])
        best = (error, values)
        assert found.regressor is not None and found.known is not None
        values = values.copy()
        values[: model.linear_count] = solved_by(found.regressor, measured - found.known, size)[0]
    return best
