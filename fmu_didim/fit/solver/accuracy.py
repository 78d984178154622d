"""The fewest substeps of the plant, or steps at which linear inputs are set, whose error is hidden by the noise of the
data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.components.fmu.component import FmuComponent, solver_tolerance
from fmu_didim.components.fmu.description import MODEL_EXCHANGE
from fmu_didim.components.fmu.settings import DEFAULT_SUBSTEPS
from fmu_didim.data.signals import Array
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.fit_uncertainty import influences
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.fit.uncertainty import Uncertainty
from fmu_didim.model.loop import MOST_SUBDIVISIONS
from fmu_didim.model.loop_model import LoopModel

ERRORS_ADD_UP = 10.0
"""[1] Error of a simulation over the tolerance of its solver, which holds in each of its steps: the errors of a record
add up to some ten times that."""
DECIDES = 1.1
"""[1] Standard deviations over those of noise alone, from which it is said that the accuracy of the simulation decides
them."""
FALLS = 2.5
"""[1] By which halves of the steps must change less than those twice as long: the error of inputs that are held falls
to a quarter, that of steps within those of an FMU to a half or not at all."""
POLISHING = 2
"""[steps] From the minimum with one integration to that with a finer one, a small fraction of the noise away."""
INTEGRATION_SHARE = 0.01
"""[standard deviations] Twice the substeps of the plant may change the torque of a joint by this much of its noise: a
hundredth moves no parameter by more than a hundredth of its standard deviation."""


def with_fitting_substeps(
    model: LoopModel, values: Array, deviation: Array | None = None, *, times_fewest: int | None = None
) -> LoopModel:
    """The model with the fewest substeps of its plant whose doubling changes the torque by less than a hundredth of
    the noise, at each joint.

    A model whose substeps a case states, or whose equations are not known, stays as it is. Where even half of the
    substeps by the rule change the torque by more, the rule holds.

    Args:
        values: (p,) at which the torque is compared.
        deviation: (m,) noise of each output; by default that of the model, else the residual at the values.
        times_fewest: at most so many times the fewest substeps that are stable and resolve oscillations, however much
            more would change; None: as many as the rule.
    """
    if model.divides_steps:
        return _with_fitting_steps(model, values, deviation)
    automatic = model.with_loop(substeps=None)
    if not model.loop.chooses_substeps:
        return automatic
    most, count, outputs = automatic.automatic_substeps(values), model.fewest_substeps(values), None
    if times_fewest is not None:
        automatic, most = at_most_resolving(automatic, values, times_fewest), min(times_fewest * count, most)
    while 2 * count <= most:
        finer = _outputs(model.with_loop(substeps=2 * count), values)
        outputs = _outputs(model.with_loop(substeps=count), values) if outputs is None else outputs
        if outputs is not None and finer is not None and integration_change(model, outputs, finer, deviation) <= 1:
            return model.with_loop(substeps=count)
        if outputs is None and finer is None and _outputs(automatic, values) is None:
            return automatic  # nothing can be simulated
        count, outputs = 2 * count, finer
    return automatic


def at_most_resolving(model: LoopModel, values: Array, times_fewest: int) -> LoopModel:
    """The model with at most so many times the fewest substeps that are stable and resolve oscillations.

    A model whose substeps a case states, or whose equations are not known, stays as it is.
    """
    if model.divides_steps or not model.loop.chooses_substeps:
        return model
    most = times_fewest * model.fewest_substeps(values)
    present = model.loop.substeps or model.automatic_substeps(values)
    return model.with_loop(substeps=most) if present > most else model


def _with_fitting_steps(model: LoopModel, values: Array, deviation: Array | None) -> LoopModel:
    """The model with the longest steps, at which linear inputs are set, whose halves change the outputs by no more."""

    def is_hidden(outputs: Array, finer: Array) -> bool:
        return integration_change(model, outputs, finer, deviation) <= 1

    return divided_steps(model.with_loop(subdivision=1), values, MOST_SUBDIVISIONS, is_hidden)


def divided_steps(
    model: LoopModel, values: Array, wanted: int, is_hidden: Callable[[Array, Array], bool] = lambda *_: False
) -> LoopModel:
    """The model with so many subdivisions of its steps, or fewer where finer ones change nothing that shows.

    What shorter steps change falls with the square of the step where an FMU takes any. One that has a solver of a fixed
    step inside and is stepped within it only acts on its inputs at other instants, and what that changes does not fall
    so: then its steps are those that its file states, or those of the samples. Elsewhere nothing is inside, and where
    inputs are bent between their rows the change falls as the bends happen to lie.

    Args:
        is_hidden: whether the change from the outputs (M, m) to those of finer steps does not show.
    """
    own, form = model.loop.own_subdivision, model.loop.plant.compiled()
    is_foreign = model.loop.holds_ramps and isinstance(form, FmuComponent) and not form.is_own
    chosen, outputs, before, has_fallen = model, _outputs(model, values), np.inf, False
    while outputs is not None and (finer := chosen.twice_as_fine()) is not None:
        more, ratio = _outputs(finer, values), finer.loop.subdivision / chosen.loop.subdivision
        if more is None or is_hidden(outputs, more):
            return chosen
        change = float(np.linalg.norm(more - outputs))
        if is_foreign and finer.loop.subdivision > own and change > before / FALLS ** np.log2(ratio):
            last = chosen.loop.subdivision if has_fallen else min(chosen.loop.subdivision, own)
            return model.with_loop(subdivision=last, finest=last)
        if chosen.loop.subdivision >= wanted:
            return chosen
        has_fallen = np.isfinite(before)
        chosen, outputs, before = finer, more, change
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


@dataclass(frozen=True)
class Accuracy:
    """By how much the simulated outputs of a model err.

    Attributes:
        change: (M, m) by steps half as long, zero where they cannot be chosen.
        solver: (m,) deviation that the tolerance of a solver leaves that chooses its steps itself.
        size: (m,) root mean square of the error of each output.
    """

    change: Array
    solver: Array
    size: Array


def simulation_accuracy(fit: Fit, change: Array | None) -> Accuracy:
    """By how much the outputs of a model err at a fit: what steps half as long change, or steps twice as long where
    there are none shorter, and what the tolerance of its own solver leaves; nothing of robots, whose noise is far
    larger.

    Args:
        change: (M, m) of the outputs by steps half as long; None where they cannot be chosen.
    """
    model, counts = fit.model, fit.model.output_counts
    if model.loop.shows_torque:
        return Accuracy(np.zeros_like(fit.outputs), np.zeros(counts.size), np.zeros(counts.size))
    if change is None and model.divides_steps and model.loop.subdivision > 1:
        coarser = max(count for count in model.loop.subdivisions if count < model.loop.subdivision)
        longer = _outputs(model.with_loop(subdivision=coarser), fit.values)
        change = None if longer is None else fit.outputs - longer
    if change is None and (finer := _with_half_the_steps(model)) is not None:
        outputs = _outputs(finer, fit.values)
        change = None if outputs is None else outputs - fit.outputs
    change = np.zeros_like(fit.outputs) if change is None else change
    moved = np.sqrt(np.maximum(_rms(fit.outputs, counts) ** 2 - (fit.outputs.sum(axis=0) / counts) ** 2, 0.0))
    solver = ERRORS_ADD_UP * solver_tolerance(model.loop.plant) * moved
    return Accuracy(change, solver, np.maximum(_rms(change, counts), solver))


def _with_half_the_steps(model: LoopModel) -> LoopModel | None:
    """A model in model exchange by RK4 with twice the substeps; None where it is integrated otherwise."""
    plant = model.loop.plant.compiled()
    if not isinstance(plant, FmuComponent) or plant.interface.kind != MODEL_EXCHANGE:
        return None
    finer = plant.with_substeps(2 * (plant.stated_substeps or DEFAULT_SUBSTEPS))
    return None if finer is None else model.with_loop(plant=finer)


def with_accuracy(known: Uncertainty, fit: Fit, accuracy: Accuracy) -> tuple[Uncertainty, list[str]]:
    """How well the values of a fit are known where the simulation itself errs, and what is said where that decides.

        C' = C + m m' + Phi' D Phi,      m = Phi' change

    By the change m of the values steps half as long would move them; noise of an output counts with what a solver
    leaves at least, D = max(solver^2 - s^2, 0).
    """
    more = np.maximum(accuracy.solver**2 - fit.noise.deviation**2, 0.0)
    if not (more.any() or accuracy.change.any()):
        return known, []
    influence, _ = influences(fit)
    flat = (influence * np.sqrt(more)[:, None]).reshape(-1, fit.values.size)
    moved = np.tensordot(influence, accuracy.change, axes=([0, 1], [0, 1]))
    covariance = known.covariance + np.outer(moved, moved) + flat.T @ flat
    grown = np.sqrt(np.max(np.diag(covariance) / np.maximum(np.diag(known.covariance), np.finfo(float).tiny)))
    told = []
    if grown > DECIDES:
        names = (*fit.model.loop.labels, *fit.model.experiments.channels)
        sizes = ", ".join(
            f"{name} {noise:.2g} beside {own:.2g}"
            for name, noise, own in zip(names, fit.noise.deviation, accuracy.size, strict=True)
        )
        told.append(
            "The data hold hardly more noise than the simulation errs by, and standard deviations are those of such "
            f"errors, not of noise: {sizes}."
        )
    return replace(known, covariance=covariance), told


def _rms(table: Array, counts: Array) -> Array:
    """(m,) of a table (M, m) in which each output has so many samples."""
    return np.asarray(np.sqrt(np.sum(table**2, axis=0) / counts))


def _outputs(model: LoopModel, values: Array) -> Array | None:
    try:
        return model.outputs(values)
    except SimulationError:
        return None
