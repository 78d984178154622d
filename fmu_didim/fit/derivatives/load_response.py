"""The response of the logged command to a load, which the controller compensates as fast as its loop allows.

    du_i(t_k) = sum_j sum_l g_ij[l] e_j(t_(k-l)),      e_j: load of joint j, its mean over [t_k, t_(k+1))

g is the best linear approximation along the simulated motion: the least-squares response to a small random two-level
torque on one joint after the other. Slow loads show in the command in full; jumps of friction at a reversal do not. Nor
is the loop the same there as elsewhere along the motion: loads that act at reversals are simulated as they are.

Source: Pintelon, Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., 2012, chapter 3.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import fft, sparse

from fmu_didim.base.errors import SimulationError
from fmu_didim.base.tall import in_blocks, with_rows
from fmu_didim.components import SameObject
from fmu_didim.cosim import SampleOperator
from fmu_didim.data.signals import Array
from fmu_didim.model.external_torque import ExternalTorque
from fmu_didim.model.loop_model import Simulation
from fmu_didim.model.workers import side_by_side

SPACING_S = 0.005
"""[s] Largest spacing of the instants at which loads are taken, unless the control period is longer."""
MEMORY_S = 0.5
"""[s] Time after which a lasting load is compensated."""
MOST_TAPS = 200
"""[taps] Of the answer to a load."""
MOST_OF_LOG = 4
"""[1] The answer is at most one part in so many of the log."""
MOST_WEIGHTS = 2_000_000
"""[weights] Of a table from loads to answers, 24 MB, up to which such tables are made: they take a fortieth of the time
of transforms where a log shows one tick in twenty, two thirds where it shows all. Longer logs are transformed."""
MOVED = 0.5
"""[1] Of the columns of a row, by which the rows of a dense part of such a table move on: half as many zeros again."""
TOGETHER = 1 << 14
"""[ticks] Whose answers are computed at a time: their transforms stay in the caches, and the memory is that of the
answers, however long a log is."""
SIZE = 0.02
"""[1] Of the random two-level test torque, as a fraction of the torque of the joint."""
DWELL_S = (0.01, 0.2)
"""[s] Range of the times between its changes."""

NO_COURSE = SameObject(None)


@dataclass(frozen=True)
class LoadInTime(ExternalTorque):
    """A torque that changes with time.

    Attributes:
        course: (K,) its mean over each control period; the very same one, as a key: to compare a hundred thousand
            values each time would take as long as a simulation with them.
    """

    course: SameObject = NO_COURSE

    @classmethod
    def of(cls, joint: int, time: Array, course: Array) -> LoadInTime:
        """On a joint, from 1, its mean (K,) over the control periods that begin at these instants (K,)."""
        kept = course.copy()
        kept.flags.writeable = False
        return cls(joint, float(time[0]), float(time[-1]), 1.0, course=SameObject(kept))

    def along(self, time: Array) -> Array:
        """(K,) it, over all control periods."""
        return np.asarray(self.course.value)


@dataclass(frozen=True)
class DenseParts:
    """A sparse table (N, K) that has in each row the columns near one place, farther on from row to row, as dense
    tables of some rows each: with many columns they are multiplied in a third of the time.

    Attributes:
        rows: N; parts: rows and columns of each table, and itself.
    """

    rows: int
    parts: tuple[tuple[slice, slice, Array], ...]

    @staticmethod
    def of(table: sparse.csr_array) -> DenseParts:
        """Of so many rows each that they move on by half of what a row has."""
        (count, width), begins = table.shape, table.indptr
        of_rows = np.diff(begins)
        together = max(int(MOVED * of_rows.max(initial=0) * count / max(width, 1)), 1)
        row, parts = np.repeat(np.arange(count), of_rows), []
        for first in range(0, count, together):
            last = min(first + together, count)
            own = slice(begins[first], begins[last])
            columns = table.indices[own]
            if columns.size:
                least = int(columns.min())
                part = np.zeros((last - first, int(columns.max()) + 1 - least))
                part[row[own] - first, columns - least] = table.data[own]
                parts.append((slice(first, last), slice(least, least + part.shape[1]), part))
        return DenseParts(count, tuple(parts))

    def times(self, other: Array) -> Array:
        """(N, w) the product with another table (K, w)."""
        found = np.zeros((self.rows, other.shape[1]))
        for rows, columns, part in self.parts:
            np.matmul(part, other[columns], out=found[rows])
        return found


@dataclass(frozen=True)
class LoadResponse:
    """The response of the logged torque, and of what else is measured, to loads.

    Attributes:
        ticks: (K,) of the control at which loads are taken, equally spaced.
        taps: (L, m, n) g: response of output i, second axis, the torques first, to joint j, third.
        sampling: (N, K) from the response at the ticks to the samples of the log; further: the same of each channel.
        run: the experiment.
    """

    ticks: NDArray[np.int64]
    taps: Array
    sampling: sparse.csr_array
    further: tuple[sparse.csr_array, ...]
    run: Simulation

    def at_samples(self, columns: Array) -> Array:
        """(K, n, w) loads at the ticks -> (M, m, w) change of all outputs."""
        joints = [int(j) for j in np.flatnonzero(columns.any(axis=(0, 2)))]
        n, outputs = self.taps.shape[2], self.taps.shape[1]
        if self._weights * n * outputs <= MOST_WEIGHTS:
            shown = [self._by_table(i, joints, columns) for i in range(outputs)]
            torque, channels = np.stack(shown[:n], axis=1), shown[n:]
        else:
            whole = self._answers(columns, joints, slice(None))
            torque = self._sampled(self.sampling, whole[:, :n])
            channels = [self._sampled(sampling, whole[:, n + k]) for k, sampling in enumerate(self.further)]
        return self.run.model.experiments.outputs_of(self.run.label, torque, channels)

    def of_joint(self, loads: Array, joint: int) -> Array:
        """(K, w) loads on a joint, from 0, at the ticks -> (M, w) change of its own torque, among all outputs: a part
        of what :meth:`at_samples` gives."""
        if self._weights <= MOST_WEIGHTS:
            torque = self._parts(joint).times(loads)[:, None]
        else:
            own = slice(joint, joint + 1)
            torque = self._sampled(self.sampling, self._answers(loads[:, None], [0], own, spectra=own))
        channels = [np.zeros((sampling.shape[0], loads.shape[1])) for sampling in self.further]
        return self.run.model.experiments.outputs_of(self.run.label, torque, channels)[:, 0]

    @property
    def _weights(self) -> int:
        """Of the table from the loads of a joint to an output at the ticks, or at more samples."""
        rows = (self.ticks.size, *(sampling.shape[0] for sampling in (self.sampling, *self.further)))
        return int(self.taps.shape[0] * max(rows))

    def _table(self, output: int, joint: int) -> sparse.csr_array:
        """(N, K) from the loads of a joint at the ticks to the samples of an output, both from 0."""
        known = self._tables.get((output, joint))
        if known is None:
            taps, count, n = self.taps[:, output, joint], self.ticks.size, self.taps.shape[2]
            lags = [-lag for lag in range(taps.size)]
            answers = sparse.diags_array(list(taps), offsets=lags, shape=(count, count), format="csr")
            half = np.full(count, 0.5)
            means = sparse.diags_array([np.append(half[1:], 1.0), half[1:]], offsets=[0, 1], format="csr")
            sampling = self.sampling if output < n else self.further[output - n]
            known = self._tables[output, joint] = sparse.csr_array(sampling @ answers @ means)
        return known

    def _parts(self, joint: int) -> DenseParts:
        """The table from the loads of a joint, from 0, to its own torque, which many are multiplied with."""
        if joint not in self._dense:
            self._dense[joint] = DenseParts.of(self._table(joint, joint))
        return self._dense[joint]

    @cached_property
    def _dense(self) -> dict[int, DenseParts]:
        return {}

    def _by_table(self, output: int, joints: Sequence[int], columns: Array) -> Array:
        """(N, w) samples of an output, from loads (K, n, w), of which those of these joints are not zero."""
        rows = self.sampling if output < self.taps.shape[2] else self.further[output - self.taps.shape[2]]
        found = np.zeros((rows.shape[0], columns.shape[2]))
        for j in joints:
            found += self._table(output, j) @ columns[:, j]
        return found

    @cached_property
    def _tables(self) -> dict[tuple[int, int], sparse.csr_array]:
        """Those that were asked for."""
        return {}

    def _answers(self, loads: Array, joints: Sequence[int], outputs: slice, *, spectra: slice = slice(None)) -> Array:
        """(K, o, w) of outputs at the ticks to the means of loads (K, n, w) over the periods that begin there, some
        ticks at a time (overlap-save: what a block needs of those before is transformed again).

        Args:
            joints: of the loads that are not zero, among them; spectra: the taps of the joints of the loads.
        """
        spectrum, before = self._spectrum[spectra, outputs], self.taps.shape[0] - 1
        count, width = loads.shape[0], loads.shape[2]
        answers = np.zeros((count, spectrum.shape[1], width))
        for first in range(0, count if joints else 0, self._size - before):
            begin, last = max(first - before, 0), min(first + self._size - before, count)
            answer = 0.0
            for j in joints:
                held = np.array(loads[begin : last + 1, j].T, order="C")
                held[:, :-1] = 0.5 * (held[:, :-1] + held[:, 1:])
                answer = answer + spectrum[j][:, None] * fft.rfft(held[:, : last - begin], self._size)
            whole = fft.irfft(answer, self._size)[:, :, first - begin : last - begin]
            answers[first:last] = whole.transpose(2, 0, 1)
        return answers

    @staticmethod
    def _sampled(sampling: sparse.csr_array, answers: Array) -> Array:
        """(N, ...) samples of answers (K, ...) at the ticks."""
        flat = np.ascontiguousarray(answers).reshape(len(answers), -1)
        return np.asarray(sampling @ flat).reshape(-1, *answers.shape[1:])

    def simulated(self, load: Array) -> Array:
        """(K, n) load at the ticks -> (M, m) change of all outputs, by a simulation with a small one of its course;
        raises SimulationError."""
        experiment = self.run.experiment
        time, measured = experiment.reference.time, self.run.model.experiments.measured_in(self.run.label)
        loaded = load.any(axis=0)
        size = SIZE * float(
            np.sqrt(np.min(np.mean(measured[:, loaded] ** 2, axis=0) / np.mean(load[:, loaded] ** 2, axis=0)))
        )
        courses = [np.interp(time, time[self.ticks], column) for column in -size * load.T]
        for course in courses:
            course[:-1] = 0.5 * (course[:-1] + course[1:])
        external = [LoadInTime.of(j, time, course) for j, course in enumerate(courses, start=1) if course.any()]
        run = self.run.on(replace(experiment, external_torques=(*experiment.external_torques, *external)))
        return np.asarray((run.outputs() - self.run.outputs()) / size)

    @cached_property
    def _size(self) -> int:
        """Ticks that are transformed at a time."""
        return int(fft.next_fast_len(min(self.ticks.size, TOGETHER) + self.taps.shape[0], real=True))

    @cached_property
    def _spectrum(self) -> Array:
        """(n, m, frequencies) of the taps: by the joint with the load, then the output that answers."""
        return np.asarray(fft.rfft(np.ascontiguousarray(self.taps.transpose(2, 1, 0)), self._size))


def load_response(run: Simulation, *, seed: int = 0) -> LoadResponse:
    """The response of the closed loop along an experiment; the identity where it cannot be simulated.

    Args:
        seed: of the random two-level torque.
    """
    model, reference = run.model, run.experiment.reference
    time, step = reference.time, reference.step
    every = max(round(SPACING_S / step), 1)
    ticks = np.arange(0, time.size, every)
    length = min(max(round(MEMORY_S / (every * step)), 1), MOST_TAPS, ticks.size // MOST_OF_LOG)
    switched = _telegraph(ticks.size, every * step, np.random.default_rng(seed))
    lagged = partial(_lagged, switched, length)
    inverse = np.linalg.pinv(sum(rows.T @ rows for rows in lagged()), hermitian=True)
    try:
        still = _signals(run, ())
        joints = range(1, model.joint_count + 1)
        tasks = [_answer(run, still, switched, every, j) for j in joints]
        answers = side_by_side(tasks, model.allowed_workers(run.values))
        along = (sum(rows.T @ own for own, rows in with_rows(answer[ticks], lagged())) for answer in answers)
        taps = -np.stack([inverse @ one for one in along], axis=2)
    except SimulationError:
        taps = np.eye(model.joint_count + len(run.experiment.channels), model.joint_count)[None]
    further = tuple(_sampling(channel.operator, every, ticks.size) for channel in run.experiment.channels)
    return LoadResponse(ticks, taps, _sampling(run.operator, every, ticks.size), further, run)


def _lagged(signal: Array, lags: int) -> Iterator[Array]:
    """(b, lags) a signal (K,) at some instants and at those before, zero before it begins."""
    whole = sliding_window_view(np.concatenate([np.zeros(lags - 1), signal]), lags)[:, ::-1]
    return map(np.ascontiguousarray, in_blocks(whole))


def _telegraph(count: int, step: float, rng: np.random.Generator) -> Array:
    """(K,) of 1 and -1, constant for times spread evenly over the decades of ``DWELL_S``."""
    signal, at, level = np.zeros(count), 0, 1.0
    while at < count:
        stay = max(round(float(np.exp(rng.uniform(*np.log(DWELL_S)))) / step), 1)
        signal[at : at + stay] = level
        at, level = at + stay, -level
    return signal


def _answer(run: Simulation, still: Array, switched: Array, every: int, joint: int) -> Callable[[], Array]:
    """A function that simulates the change (ticks, m) of the outputs by the two-level torque on a joint of size one,
    which may switch after so many control periods."""

    def simulated() -> Array:
        size = SIZE * float(np.sqrt(np.mean(run.model.experiments.measured_in(run.label)[:, joint - 1] ** 2)))
        course = size * np.repeat(switched, every)[: run.experiment.reference.time.size]
        loaded = LoadInTime.of(joint, run.experiment.reference.time, course)
        return (_signals(run, [loaded]) - still) / size

    return simulated


def _signals(run: Simulation, further: Sequence[ExternalTorque]) -> Array:
    """(ticks, m) command at all ticks, without the external torques, and the channels of the experiment."""
    run = run.on(replace(run.experiment, external_torques=(*run.experiment.external_torques, *further)))
    names = [run.signal_of(channel) for channel in run.experiment.channels]
    recording = run.record(all_ticks=True, signals=[*run.model.loop.logged, *names])
    torque = run.logged_torque(recording)
    if not run.experiment.channels:
        return torque
    return np.concatenate([torque, recording.table(names, sampled=True)], axis=1)


def _sampling(operator: SampleOperator, every: int, count: int) -> sparse.csr_array:
    """(N, K): straight lines between the ticks of the response, then the samples of an operator."""
    place = np.minimum(operator.ticks / every, count - 1.0)
    left = np.minimum(place.astype(int), max(count - 2, 0))
    part = place - left
    rows = np.arange(place.size)
    between = sparse.csr_array(
        (np.concatenate([1 - part, part]), (np.concatenate([rows, rows]), np.concatenate([left, left + 1]))),
        shape=(place.size, count),
    )
    return sparse.csr_array(operator.matrix @ between)
