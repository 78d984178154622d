"""The fewest substeps of the plant, or of the steps over which it holds linear inputs, whose error is hidden by the
noise of the data."""

from __future__ import annotations

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.loop_model import LoopModel

POLISHING = 2
"""[steps] From the minimum with one integration to that with a finer one, a small fraction of the noise away."""
INTEGRATION_SHARE = 0.01
"""[standard deviations] Twice the substeps of the plant may change the torque of a joint by this much of its noise: a
hundredth moves no parameter by more than a hundredth of its standard deviation."""


def with_fitting_substeps(model: LoopModel, values: Array, deviation: Array | None = None) -> LoopModel:
    """The model with the fewest substeps of its plant whose doubling changes the torque by less than a hundredth of
    the noise, at each joint.

    A model whose substeps a case states, or whose equations are not known, stays as it is. Where even half of the
    substeps by the rule change the torque by more, the rule holds.

    Args:
        values: (p,) at which the torque is compared.
        deviation: (m,) noise of each output; by default that of the model, else the residual at the values.
    """
    if model.loop.holds_ramps:
        return _with_fitting_steps(model, values, deviation)
    automatic = model.with_loop(substeps=None)
    if not model.loop.chooses_substeps:
        return automatic
    most, count, outputs = automatic.automatic_substeps(values), model.fewest_substeps(values), None
    while 2 * count <= most:
        finer = _outputs(model.with_loop(substeps=2 * count), values)
        outputs = _outputs(model.with_loop(substeps=count), values) if outputs is None else outputs
        if outputs is not None and finer is not None and integration_change(model, outputs, finer, deviation) <= 1:
            return model.with_loop(substeps=count)
        if outputs is None and finer is None and _outputs(automatic, values) is None:
            return automatic  # nothing can be simulated
        count, outputs = 2 * count, finer
    return automatic


def _with_fitting_steps(model: LoopModel, values: Array, deviation: Array | None) -> LoopModel:
    """The model with the longest steps over which linear inputs are held whose halves change the outputs by no more."""
    chosen = model.with_loop(subdivision=1)
    outputs, finer = _outputs(chosen, values), chosen.twice_as_fine()
    while outputs is not None and finer is not None:
        more = _outputs(finer, values)
        if more is None or integration_change(model, outputs, more, deviation) <= 1:
            return chosen
        chosen, outputs, finer = finer, more, finer.twice_as_fine()
    return chosen


def integrated(fit: Fit) -> Fit:
    """The same minimum, integrated as finely as its model asks for there; raises SimulationError where that fails."""
    model = with_fitting_substeps(fit.model, fit.values, fit.noise.deviation)
    if model.loop.substeps == fit.model.loop.substeps:
        return fit
    return minimise(model, fit.noise, stopping=Stopping(POLISHING, updates=0), jacobian=fit.jacobian)


def integration_change(model: LoopModel, outputs: Array, finer: Array, deviation: Array | None = None) -> float:
    """Change of the outputs (M, m) by finer integration over what is allowed, at the one where it is worst.

    Args:
        deviation: (m,) noise; by default that of the model, else the residual.
    """
    counts = model.output_counts
    if deviation is None:
        stated = model.stated_deviations
        deviation = np.where(np.isnan(stated), _rms(model.measured_outputs - finer, counts), stated)
    allowed = np.maximum(INTEGRATION_SHARE * deviation, np.finfo(float).tiny)
    return float(np.max(_rms(finer - outputs, counts) / allowed))


def _rms(table: Array, counts: Array) -> Array:
    """(m,) of a table (M, m) in which each output has so many samples."""
    return np.asarray(np.sqrt(np.sum(table**2, axis=0) / counts))


def _outputs(model: LoopModel, values: Array) -> Array | None:
    try:
        return model.outputs(values)
    except SimulationError:
        return None
