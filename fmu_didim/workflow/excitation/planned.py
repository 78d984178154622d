"""A motion that is planned for the loop of a case: what a log of it would show, before anyone runs it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.case import Case
from fmu_didim.checks.data.expected_accuracy import ExpectedAccuracy, predicted
from fmu_didim.cosim.sampling import decimated_times, sample_operator
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.discovery.excitation.limits import Bounds
from fmu_didim.discovery.excitation.optimum import Criterion
from fmu_didim.fit.confounding import confounded
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.noise.weighting import whitened
from fmu_didim.model.experiment import Experiment, InitialState
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.simulated_table import simulated_table

FOLLOWED = 0.3
"""[1] Deviation of the simulated from the reference velocity, relative to that, up to which a loop follows: about that
of a first-order lag at its bandwidth, of which 0.7 of the amplitude are left."""
BEYOND = 1e-3
"""[1] By which the simulated loop may exceed a limit, of its size."""


@dataclass(frozen=True)
class Plan:
    """How motions of a case will be logged.

    Attributes:
        case: the case; label: of the experiment; rate_hz: of its torque log; deviation: (n,) of its noise.
        values: (p,) of what is free; none as long as they are not known.
        beside: labels of further experiments with the same motion, such as one with a load.
    """

    case: Case
    label: str
    rate_hz: float
    deviation: Array
    values: Array
    beside: tuple[str, ...] = ()

    @property
    def labels(self) -> tuple[str, ...]:
        """Of all experiments of the motion."""
        return (self.label, *self.beside)

    def at(self, values: Array, model: LoopModel) -> Plan:
        """The same for values (p,) of a model of the case, which a virtual controller of it knows, too."""
        case, tracking = self.case, self.case.tracking
        if tracking is not None:
            thetas = {label: model.theta(values, label) for label in self.labels}
            carried = {label: theta for label, theta in thetas.items() if label in model.loads}
            planned = tracking.planned(model.theta(values), carried, drive_gains(model, values))
            case = replace(case, tracking=planned, controller=planned.controller)
        return replace(self, case=case, values=values)

    def times(self, reference: Trajectory) -> Array:
        """(N,) instants of the log of a motion, s."""
        torque = self.case.document.runs[self.label].torque
        phase = 0.0 if torque is None else torque.phase_s
        found: Array = decimated_times(reference.time, self.rate_hz, phase)
        # The last instant may begin a period that the loop does not have any more.
        return np.asarray(found[found < reference.time[-1] - 1e-9])

    def model_on(self, reference: Trajectory) -> LoopModel:
        """The loop of the case along a motion, with the torque that it simulates as the log of each experiment."""
        model = self.case.model_on({label: self._experiment(label, reference) for label in self.labels})
        model = replace(model, torque_deviation=self.deviation)
        if len(model.names) != self.values.size:
            return model
        for label in self.labels:
            logged = replace(model.experiments[label], torque=model.torque(self.values, label))
            model = model.with_experiment(label, logged)
        return model

    def _experiment(self, label: str, reference: Trajectory) -> Experiment:
        """One of the experiments, whose log is empty."""
        source, step = self.case.document.runs[label], self.case.step_size
        times = self.times(reference)
        sampled = {} if source.torque is None else source.torque.sampled
        late = 0.0 if source.torque is None else source.torque.log_shift_s
        count = reference.time.size
        operator = sample_operator(times, start=float(reference.time[0]), step=step, tick_count=count, **sampled)
        operator = operator.stamped_later(late / step, count)
        nothing = np.zeros((times.size, self.case.parameters.joint_count))
        begin = InitialState("reference")
        if self.case.tracking is not None:
            reference = self.case.tracking.followed(reference, label)
        warm = self.case.measured_starts(label, reference)
        return Experiment(reference, times, nothing, operator, label=label, initial_state=begin, measured_starts=warm)


def drive_gains(model: LoopModel, values: Array) -> Array:
    """(n,) gains of the drives among values (p,); one where they are not free."""
    free = model.free_parameters.gains_of_drives(model.joint_count)
    return np.array([values[free[j]] if j in free else 1.0 for j in range(model.joint_count)])


@dataclass(frozen=True)
class Peaks:
    """The largest of a motion, (n,) each: lowest and highest position, speed, acceleration, torque; NaN if unknown."""

    low: Array
    high: Array
    speed: Array
    acceleration: Array
    torque: Array

    @classmethod
    def of(cls, table: Trajectory, n: int) -> Peaks:
        """Of a table with the columns ``q<j>`` and so on, as far as it has them."""
        found = {}
        for name in ("q", "dq", "ddq", "tau"):
            wanted = [f"{name}{j}" for j in range(1, n + 1)]
            has = set(wanted) <= set(table.names)
            found[name] = table.select(wanted) if has else np.full((table.time.size, n), np.nan)
        sizes = {name: np.abs(values).max(axis=0) for name, values in found.items()}
        q = found["q"]
        return cls(q.min(axis=0), q.max(axis=0), sizes["dq"], sizes["ddq"], sizes["tau"])

    def excess(self, bounds: Bounds) -> float:
        """By how much of its size the worst limit of position, speed and torque is exceeded; an unknown one is not."""
        limits = bounds.limits
        half = (limits.high - limits.low) / 2
        ratios = [
            (self.high - limits.high) / half, (limits.low - self.low) / half, self.speed / limits.speed - 1,
            self.torque / bounds.torque - 1,
        ]  # fmt: skip
        return float(np.nanmax(np.concatenate([[-1.0], *ratios])))


@dataclass(frozen=True)
class Prediction:
    """What a log of a motion would tell.

    Attributes:
        reference: a row a control period; loop: the simulated torque (of the joint, not of its log) and motion, of
            several experiments one after the other.
        prospect: predicted standard deviations; None where the log cannot determine all parameters.
        unexcited: parameters that do nothing to the log; alike: those that it cannot tell apart.
        condition: condition number of the whitened sensitivity with columns of length one.
        criterion: log det of the information on the parameters asked for, in the simulated loop, or minus the logarithm
            of the mean of their relative standard deviations; kind: which of the two.
    """

    reference: Trajectory
    loop: Trajectory
    prospect: ExpectedAccuracy | None
    unexcited: tuple[str, ...]
    alike: tuple[str, ...]
    condition: float
    criterion: float
    kind: Criterion = "determinant"

    @property
    def length_s(self) -> float:
        """Duration of the motion, s."""
        return float(np.ptp(self.reference.time))

    @property
    def part_s(self) -> float:
        """From the start of one experiment in ``loop`` to that of the next, s."""
        return self.length_s + self.reference.step

    def criterion_in(self, length_s: float, asked: int) -> float:
        """The criterion if the motion were repeated for that long: information grows with the duration."""
        grown = float(np.log(length_s / self.length_s))
        return self.criterion + (asked * grown if self.kind == "determinant" else grown / 2)

    def lag(self, n: int) -> Array:
        """(n,) deviation of the simulated from the reference velocity, relative to that; NaN where it is not known."""
        names = [f"dq{j}" for j in range(1, n + 1)]
        if not set(names) <= set(self.loop.names) & set(self.reference.names):
            return np.full(n, np.nan)
        wanted, found = self.reference.select(names), self.loop.select(names)
        runs = max(1, round(found.shape[0] / wanted.shape[0]))
        error = (found - np.tile(wanted[: found.shape[0] // runs], (runs, 1))).std(axis=0)
        return np.asarray(error / np.maximum(wanted.std(axis=0), 1e-12))


def mean_percent(prospect: ExpectedAccuracy | None, asked: Sequence[str]) -> float:
    """Mean relative standard deviation of those of some parameters that are not zero, percent; NaN without any."""
    if prospect is None:
        return float("nan")
    rows = zip(prospect.names, prospect.values, prospect.deviation, strict=True)
    known = [100 * deviation / abs(value) for name, value, deviation in rows if name in asked and value]
    return float(np.mean(known)) if known else float("nan")


def predict(plan: Plan, reference: Trajectory, asked: Sequence[str], kind: Criterion = "determinant") -> Prediction:
    """What the log of a motion would tell, by the sensitivities of the simulated loop.

    Raises:
        SimulationError: the loop diverges on it.
    """
    model = plan.model_on(reference)
    torque = model.measured
    if torque.size <= len(model.names):
        raise InputError(
            "The log would not have more samples than parameters.", where="torque.rate_hz",
            got=f"{torque.size} samples, {len(model.names)} parameters", next_step="Move for longer, or log faster.",
        )  # fmt: skip
    columns = whitened(sensitivity(model, plan.values, torque), plan.deviation)
    unexcited = tuple(name for i, name in enumerate(model.names) if not columns[:, i].any())
    columns = model.beside_prior(columns)
    length = np.linalg.norm(columns, axis=0)
    size = float(np.linalg.norm(torque / plan.deviation))
    loop = _simulated(plan, model)
    if unexcited:
        return Prediction(reference, loop, None, unexcited, (), np.inf, -np.inf, kind)
    singular = np.linalg.svd(np.linalg.qr(columns / length)[1], compute_uv=False)
    condition = float(singular[0] / singular[-1]) if singular[-1] > 0 else np.inf
    alike = confounded(columns, plan.values, model.names, torque=size)
    places = [model.names.index(name) for name in asked]
    prospect = predicted(model, plan.values, columns)
    mean = mean_percent(prospect, asked) / 100
    reached = information(columns, places) if kind == "determinant" else -float(np.log(mean))
    return Prediction(
        reference, loop, prospect, (), alike, condition, reached if np.isfinite(reached) else -np.inf, kind
    )


def _simulated(plan: Plan, model: LoopModel) -> Trajectory:
    """Torque of the joints and motion of all experiments, one after the other."""
    n, gains = model.joint_count, drive_gains(model, plan.values)
    tables = [simulated_table(model.simulation(plan.values, e), motion=("q", "dq", "ddq")) for e in plan.labels]
    length = float(np.ptp(model.experiments[plan.label].reference.time)) + plan.case.step_size
    values = np.concatenate([table.values for table in tables])
    values[:, :n] *= gains
    time = np.concatenate([table.time + i * length for i, table in enumerate(tables)])
    return replace(tables[0], time=time, values=values)


def information(columns: Array, places: Sequence[int]) -> float:
    """log det of the information (r, p) on some of the parameters while the others are unknown, too."""
    others = [i for i in range(columns.shape[1]) if i not in places]
    table = columns[:, [*others, *places]]
    diagonal = np.abs(np.diag(np.linalg.qr(table)[1]))[len(others) :]
    return float(2 * np.log(diagonal).sum()) if (diagonal > 0).all() else -np.inf
