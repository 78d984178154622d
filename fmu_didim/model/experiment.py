"""One run of the real system: what it was asked to do, and what was logged of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import date
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.cosim import Indices, SampleOperator, grid_places
from fmu_didim.data.filters import band_limited
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.model.external_torque import ExternalTorque
from fmu_didim.model.signals.channel import Channel
from fmu_didim.model.signals.error_model import ErrorModel

Role = Literal["estimation", "validation"]
StartKind = Literal["detected", "free", "reference", "given", "found"]


@dataclass(frozen=True)
class InitialState:
    """Where the motion of an experiment starts, and the states of its controllers.

    Attributes:
        kind: ``reference``: on the first row of the reference, controllers as they are built; ``given``: there, but for
            the values that are given; ``free``: unknown, identified from the torque; ``detected``: unknown where the
            log shows that the loop does not start there, else as ``reference``; ``found``: by the first part of a
            held-out log, which gives the values.
        values: name -> value, where it is given or found: ``q<j>``, ``dq<j>``, in rad or m, rad/s or m/s, and states of
            controllers, see :attr:`fmu_didim.model.loop.Loop.starts`.
        acts_s: how long after the beginning of the reference a start that was found shows in the torque, s.
    """

    kind: StartKind = "detected"
    values: Mapping[str, float] = field(default_factory=dict)
    acts_s: float = 0.0


@dataclass(frozen=True)
class Experiment:
    """One run of the real system.

    Attributes:
        reference: what the controller was given, one row a control period; columns ``q<j>`` and, where
            known, ``dq<j>``, ``ddq<j>``.
        time: (N,) instants of the torque log, s; torque: (N, n) joint torque, N.m or N.
        operator: how the log follows from the held command.
        positions: measured positions ``q<j>``, for the estimators that need them.
        label: name shown to the user.
        role: whether the parameters are fitted to it, or only judged by it.
        external_torques: torques from outside the model that are known to have acted.
        stamps: instants of the log as its file has them, before another rate was chosen; None: those in ``time``.
        told: diagnostics of reading its files.
        initial_state: where its motion starts.
        measured_starts: parameter of the plant -> start of a state of it that was measured in this run, such as
            ``temperature_start1``.
        channels: what else was measured and is fitted beside the torque.
        errors: (n,) error models of the columns of the log, or none; scale: (N, n) that its samples are divided by in a
            fit; recorded: (N, n) what was measured where a fit takes other values for it; as of :class:`Channel`.
        leaves_out_outliers: whether samples that are outliers are left out before a fit.
        is_unsigned: whether the log shows sizes alone; ``torque`` then has signs that a model gave it.
        shares_noise: whether torques of joints were made of those of motors that drive several, so that they share
            their noise.
        unit: of the machine, empty where it is not known; day: on which it was recorded, None where it is not known.
    """

    reference: Trajectory
    time: Array
    torque: Array
    operator: SampleOperator
    positions: Trajectory | None = None
    label: str = "estimation"
    role: Role = "estimation"
    external_torques: tuple[ExternalTorque, ...] = ()
    stamps: Array | None = None
    told: tuple[Diagnostic, ...] = ()
    initial_state: InitialState = field(default_factory=InitialState)
    measured_starts: Mapping[str, float] = field(default_factory=dict)
    channels: tuple[Channel, ...] = ()
    errors: tuple[ErrorModel, ...] = ()
    scale: Array | None = None
    recorded: Array | None = None
    leaves_out_outliers: bool = False
    is_unsigned: bool = False
    shares_noise: bool = False
    unit: str = ""
    day: date | None = None

    def scaled(self, values: Array) -> Array:
        """Values (N, n, ...) at the samples of the log as a fit compares them."""
        return values if self.scale is None else values / _like(self.scale, values)

    def unscaled(self, values: Array) -> Array:
        """The reverse of :meth:`scaled`."""
        return values if self.scale is None else values * _like(self.scale, values)

    @cached_property
    def first_row(self) -> dict[str, float]:
        """The first row of the reference by its columns, with what is known of the start instead."""
        reference = self.reference
        return {**dict(zip(reference.names, reference.values[0].tolist(), strict=True)), **self.initial_state.values}

    def plant_start(self, joint_count: int) -> dict[str, float]:
        """Parameters of a plant of so many joints that say where it starts, by its first row: ``t_start`` (s),
        ``q_start<j>``, ``dq_start<j>``, and those of measured states; not to be changed."""
        if joint_count not in self._plant_starts:  # each simulation asks for them
            first, found = self.first_row, {"t_start": float(self.reference.time[0]), **self.measured_starts}
            for j in range(1, joint_count + 1):
                if f"q{j}" in first:
                    found[f"q_start{j}"] = float(first[f"q{j}"])
                    found[f"dq_start{j}"] = float(first.get(f"dq{j}", 0.0))
            self._plant_starts[joint_count] = found
        return self._plant_starts[joint_count]

    @cached_property
    def _plant_starts(self) -> dict[int, dict[str, float]]:
        return {}

    @property
    def rate_hz(self) -> float:
        """Mean rate of the torque log, counting the samples that are missing."""
        return float(self.places[-1] / (self.time[-1] - self.time[0]))

    @property
    def places(self) -> Indices:
        """(N,) place of each sample when those count, too, that the logger has dropped."""
        return grid_places(self.time)

    @property
    def has_settled(self) -> NDArray[np.bool_]:
        """(N,) which samples come after those in which an unknown start acts."""
        return np.asarray(self.time >= self.reference.time[0] + self.initial_state.acts_s)

    def with_gaps(self, values: Array) -> Array:
        """(M, ...) values (N, ...) of the samples with rows of NaN for those that are missing."""
        places = self.places
        result = np.full((places[-1] + 1, *values.shape[1:]), np.nan)
        result[places] = values
        return result

    @cached_property
    def instants(self) -> Array:
        """(M,) instants at which anything was measured, s: the rows of tables over all outputs."""
        return np.unique(np.concatenate([self.time, *(channel.time for channel in self.channels)]))

    def row_of(self, times: Array) -> Indices:
        """(N,) rows of these instants (N,) in tables over all outputs."""
        return np.searchsorted(self.instants, times)

    def after(self, seconds: float) -> Experiment:
        """The same without the samples of the first ``seconds`` of the reference."""
        begin = self.reference.time[0] + seconds - 1e-9
        first = int(np.searchsorted(self.time, begin))
        return replace(
            self, time=self.time[first:], torque=self.torque[first:], operator=self.operator.after(first),
            channels=tuple(channel.after(begin) for channel in self.channels), **self._tables(slice(first, None)),
        )  # fmt: skip

    def with_samples_of(self, other: Experiment) -> Experiment:
        """The same, what acts in it and where it starts, with the samples of another part of its log."""
        return replace(
            self, time=other.time, torque=other.torque, operator=other.operator, channels=other.channels,
            scale=other.scale, recorded=other.recorded,
        )  # fmt: skip

    def at(self, rows: Indices) -> Experiment:
        """The same with these samples of the torque alone."""
        tables = self._tables(rows)
        return replace(self, time=self.time[rows], torque=self.torque[rows], operator=self.operator.at(rows), **tables)

    def band_limited(self, cutoff_hz: float) -> Experiment:
        """The same with fewer samples of the torque, without what is above a cut-off, and nothing else measured."""
        weights, middle = band_limited(self.rate_hz, self.time.size, cutoff_hz)
        return replace(
            self, time=self.time[middle], torque=np.asarray(weights @ self.torque),
            operator=self.operator.summed(weights), channels=(), **self._tables(middle),
        )  # fmt: skip

    def _tables(self, rows: slice | Indices) -> dict[str, Any]:
        """Some rows of the tables beside the log."""
        return {
            "scale": None if self.scale is None else self.scale[rows],
            "recorded": None if self.recorded is None else self.recorded[rows],
        }

    def before(self, count: int) -> Experiment:
        """The first samples of the torque alone."""
        return replace(
            self,
            time=self.time[:count],
            torque=self.torque[:count],
            operator=self.operator.before(count),
            channels=(),
            **self._tables(slice(count)),
        )


def _like(scale: Array, values: Array) -> Array:
    """A scale (N, n) as a table of as many axes as values (N, n, ...)."""
    return scale.reshape(*scale.shape, *(1,) * (values.ndim - 2))
