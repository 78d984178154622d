"""Windows of time in which an output is off a model, beside values that what acted there does not pull.

A pulse on an output is no part of the model, but a fit makes up for a part of it: the values are off, and so is all
that the model leaves before and after the pulse. Its begin and end are read from what values v + d leave,

    min over d of |W (r - J d)|^2,      W: 0 at the samples within a window, 1 elsewhere

with the residual r and the sensitivity J of the fit; windows and d are found in turn. The final model keeps its values.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.localise import output_windows
from fmu_didim.discovery.signals.search import quick_noise
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.linear_problem import LinearProblem
from fmu_didim.fit.region import Region
from fmu_didim.results.findings import WindowResult

TURNS = 3
"""[turns] In which windows and values are found; after the second of them windows of pulses move by less than a
sample."""
LEFT_OUT = 0.5
"""[1] Part of all samples within windows from which the values stay: what is off for that long is no event, and what is
left tells no values."""


def windows_of(final: Fit) -> list[WindowResult]:
    """Intervals in which an output is off a model, by experiment, held out or not; the best first in each output."""
    values, found = final.values, list(_beside(final, final.values))
    for _ in range(TURNS if final.values.size else 0):
        inside = _within(final, found)
        if not inside.any() or inside.sum() > LEFT_OUT * final.model.output_counts.sum():
            break
        moved = final.values + _pulled(final, inside)
        if np.array_equal(moved, values):
            break
        try:
            final.model.output_residual(moved)
        except SimulationError:
            break
        values, found = moved, list(_beside(final, moved))
    return found


def _beside(final: Fit, values: Array) -> Iterator[WindowResult]:
    """The windows in what a model leaves with these values (p,); none of an experiment that it cannot simulate."""
    names, noise, experiments = final.model.loop.output_names, quick_noise(final).deviation, final.model.experiments
    for label, experiment in experiments.items():
        try:
            residual = final.model.residual(values, label)
            simulated = final.model.simulation(values, label).channels()
        except SimulationError:
            continue
        outputs = [(name, experiment.time, residual[:, k]) for k, name in enumerate(names)]
        outputs += [(c.name, c.time, c.values - simulated[c.name]) for c in experiment.channels if c.name in simulated]
        deviation = dict(zip((*names, *experiments.channels), noise.tolist(), strict=True))
        for name, time, own in outputs:
            if name in deviation and np.isfinite(own).all():
                yield from output_windows(own, time, deviation[name], name, label)


def _within(final: Fit, windows: Sequence[WindowResult]) -> Array:
    """(M, m) whether a sample of an output lies within a window of that, of the experiments that are fitted."""
    inside = np.zeros(final.outputs.shape, dtype=bool)
    names = (*final.model.loop.output_names, *final.model.experiments.channels)
    for block in final.model.experiments.output_blocks:
        for log in block.logs:
            rows = np.arange(len(inside))[log.rows]
            for k in range(block.columns.start, block.columns.stop):
                for w in windows:
                    if (w.experiment, w.signal) == (log.label, names[k]):
                        inside[rows[(log.time >= w.begin_s) & (log.time <= w.end_s)], k] = True
    return inside


def _pulled(final: Fit, inside: Array) -> Array:
    """(p,) by how much the values move, within their limits, where the samples inside windows (M, m) do not count."""
    kept = np.where(inside, 0.0, 1.0)
    outputs = final.model.measured_outputs - final.residual * kept
    bare = replace(final, jacobian=final.jacobian * kept[:, :, None], outputs=outputs)
    equations: LinearProblem = bare.equations
    return equations.step(final.values, Region.of(final.model), 0.0)[0]
