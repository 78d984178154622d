"""What a fit leaves of the outputs of a model, and how these move when something else does."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fmu_didim.checks.motion.colour import Logs
from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.noise.weighting import noise_floor
from fmu_didim.fit.uncertainty import stretches
from fmu_didim.model.experiments import OutputLog
from fmu_didim.model.loop_model import LoopModel


@dataclass(frozen=True)
class OutputResiduals:
    """The outputs (M, m) of all fitted experiments at the values (p,) of a fit, zero where one was not measured.

    Attributes:
        model: with all that was measured; outputs: (M, m) simulated; jacobian: (M, m, p) of them.
        accuracy: (m,) of the simulation, or one for all outputs.
    """

    model: LoopModel
    values: Array
    outputs: Array
    jacobian: Array
    accuracy: Array = field(default_factory=lambda: np.zeros(1))

    @classmethod
    def of(cls, estimate: Estimate) -> OutputResiduals:
        """Those of an estimate; raises SimulationError."""
        fit = estimate.fit
        if fit is not None and not estimate.model.experiments.channels:
            return cls(fit.model, fit.values, fit.outputs, fit.jacobian, estimate.accuracy)
        model = estimate.model if fit is None else fit.model
        model = model.with_values(estimate.value)
        if fit is not None:  # with the integration steps of the fit, and all that was measured
            model = LoopModel(
                fit.model.loop, estimate.model.experiments, model.free_parameters, pool=estimate.model.pool,
                recordings=estimate.model.recordings,
            )  # fmt: skip
        outputs = model.outputs(estimate.value)
        return cls(model, estimate.value, outputs, sensitivity(model, estimate.value, outputs), estimate.accuracy)

    @property
    def names(self) -> tuple[str, ...]:
        """(m,) names of the outputs, those of the log first."""
        return (*self.model.loop.labels, *self.model.experiments.channels)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """(m,) their units."""
        further = {c.name: c.unit for e in self.model.experiments.values() for c in e.channels}
        channels = (further[name] for name in self.model.experiments.channels)
        return (*self.model.parameters.torque_units, *channels)

    @cached_property
    def residual(self) -> Array:
        """(M, m) measured minus simulated."""
        return self.model.measured_outputs - self.outputs

    def logs(self, k: int) -> tuple[OutputLog, ...]:
        """Where the samples of output ``k``, from 0, stand."""
        return next(b.logs for b in self.model.experiments.output_blocks if b.columns.start <= k < b.columns.stop)

    def rows(self, k: int) -> Indices:
        """(N,) rows of the samples of output ``k``."""
        return np.concatenate([self.indices(log.rows) for log in self.logs(k)])

    def tables(self, k: int) -> Logs:
        """The logs of output ``k`` in tables of its samples, whose noise has a colour."""
        return Logs(tuple(stretches([log.time for log in self.logs(k)])))

    def times(self, k: int) -> Array:
        """(N,) instants of the samples of output ``k``, s."""
        return np.concatenate([log.time for log in self.logs(k)])

    @cached_property
    def deviation(self) -> Array:
        """(m,) root mean square of each residual, never zero."""
        squares = [np.mean(self.residual[self.rows(k), k] ** 2) for k in range(len(self.names))]
        return np.asarray(np.maximum(np.sqrt(squares), TINY))

    @cached_property
    def judged(self) -> tuple[int, ...]:
        """Places of the outputs that leave more than the simulation itself errs by, so that it may be asked whether
        that is noise."""
        floor = noise_floor(self.model.measured_outputs, self.model.output_counts)
        known = np.maximum(np.broadcast_to(self.accuracy, floor.shape), floor)
        return tuple(int(k) for k in np.flatnonzero(self.deviation > known))

    @cached_property
    def measured_at(self) -> NDArray[np.bool_]:
        """(M, m) whether an output has a sample in a row."""
        found = np.zeros(self.outputs.shape, dtype=bool)
        for k in range(len(self.names)):
            found[self.rows(k), k] = True
        return found

    def whitened(self, table: Array) -> Array:
        """A table (M, m, ...) in one column, in standard deviations of the residuals."""
        size = self.deviation.reshape(1, -1, *(1 for _ in table.shape[2:]))
        return np.asarray((table / size)[self.measured_at])

    @staticmethod
    def indices(rows: slice | Indices) -> Indices:
        """Rows as numbers."""
        return np.arange(rows.start, rows.stop) if isinstance(rows, slice) else np.asarray(rows)
