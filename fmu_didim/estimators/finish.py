"""From the last point of the iterations to an estimate: the efficient finish, refinement of the integration,
statistics.

DIDIM's fixed point solves W'(y - tau_s) = 0 and is consistent; the minimum of |y - tau_s|^2 solves
S'(y - tau_s) = 0 and reaches the Cramer-Rao bound. From DIDIM's answer a few steps suffice.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.fit.confounding import refuse_confounded, refuse_ridge
from fmu_didim.fit.derivatives.sensitivity import parameter_sizes
from fmu_didim.fit.ending import Ending
from fmu_didim.fit.estimate import Estimate, JointFit, Stage, Status
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.fit_uncertainty import fit_uncertainty
from fmu_didim.fit.iteration import Iteration
from fmu_didim.fit.linear_problem import LinearProblem
from fmu_didim.fit.log_noise import known_noise
from fmu_didim.fit.noise.weighting import NoiseOfResidual, whitened
from fmu_didim.fit.prior_fit import prior_fit
from fmu_didim.fit.region import Region
from fmu_didim.fit.solver.accuracy import (
    Accuracy,
    divided_steps,
    integration_change,
    simulation_accuracy,
    with_accuracy,
)
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.numerical_noise import Roughness, roughness, smoother_advice
from fmu_didim.fit.solver.search import BEYOND_EDGE, FAILED, NO_STEP
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.fit.statistics import covariance_white
from fmu_didim.fit.uncertainty import Uncertainty
from fmu_didim.model.loop import MOST_SUBDIVISIONS
from fmu_didim.model.loop_model import LoopModel

INTEGRATION_TOLERANCE = 1e-5
"""[1] Change of the torque by twice the substeps of the rule, relative to its size, that is allowed in any case."""
CLEARLY_BETTER = 0.5
"""[1] Residual with twice the substeps over that before, below which they explain the data better."""
INTEGRATION_SHIFT = 0.02
"""[standard deviations] Twice the substeps may move no value by more: invisible beside the noise."""
MAXIMUM_REFINEMENTS = 4
"""[refinements] Of the integration, by twice the substeps each."""
NEXT_STEP = 0.01
"""[standard deviations] A step of the finish that would be smaller is not made: invisible beside the noise."""
FINISH_TOLERANCE = 1e-6
"""[1] Relative change of the values at which it stops at the latest: data without noise."""
MOVED = 0.1
"""[standard deviations] By which the limits of machines move a value before it is reported."""
FINISH_ITERATIONS = 15
"""[steps] Of the efficient finish."""


ROUNDS = 3
"""[rounds] Of fit and colour: the inflation follows from the residual, and the residual from the weights."""
SAME_INFLATION = 0.1
"""[1] Relative change of an inflation below which the weights stay: it moves no standard deviation by 1 %."""
LEAST_INFLATION = 0.1
"""[1] Smallest inflation of a channel: weights must stay finite where it says nothing of any value."""


@dataclass(frozen=True)
class Minimum:
    """The minimum of the torque error.

    Attributes:
        fit: the closed loop there; iterations: those of the finish.
        integration_error: the change by twice the substeps of the plant.
        known: how well the values are known.
        remarks: changes on the way; roughness: of the sensitivity, where it is one by central differences.
        rivals: parameter and its value at other minima that fit the data almost as well.
        joint: beside the torque alone, where further channels were fitted with it.
    """

    fit: Fit
    integration_error: IntegrationError
    known: Uncertainty
    iterations: tuple[Iteration, ...] = ()
    remarks: tuple[str, ...] = ()
    roughness: Roughness | None = None
    rivals: tuple[tuple[str, float], ...] = ()
    joint: JointFit | None = None

    def after(self, earlier: Minimum, *why: str) -> Minimum:
        """This minimum with the iterations and remarks that led to it from an earlier one, and why that was left."""
        told = (remark for remark in self.remarks if remark not in earlier.remarks)
        remarks = (*earlier.remarks, *told, *why)
        return replace(self, iterations=(*earlier.iterations, *self.iterations), remarks=remarks)


def finish_by_colour(
    start: Fit,
    *,
    tolerance: float | None,
    progress: Callable[[Iteration], None],
    stage: str = "finish",
    maximum_iterations: int = FINISH_ITERATIONS,
) -> Minimum:
    """The efficient finish, again with weights by the colour of the noise where that changes them: of channels beside
    the torque, or of all outputs beside a prior. Without these, the finish itself.

    Args:
        tolerance, stage, maximum_iterations: as of :func:`efficient_finish`.
    """
    iterations: list[Iteration] = []
    remarks: list[str] = []
    fit, inflation = start, None
    for _ in range(ROUNDS):
        found = efficient_finish(
            fit, tolerance=tolerance, progress=progress, stage=stage, inflation=inflation,
            maximum_iterations=maximum_iterations,
        )  # fmt: skip
        if not (fit.model.experiments.channels or fit.model.prior is not None):
            return found
        iterations.extend(found.iterations)
        remarks.extend(remark for remark in found.remarks if remark not in remarks)
        fit, wanted = found.fit, _inflation(found)
        before = np.ones(wanted.size) if inflation is None else inflation
        if (np.abs(wanted / before - 1) <= SAME_INFLATION).all():
            break
        inflation = wanted
    return replace(found, iterations=tuple(iterations), remarks=tuple(remarks))


def _inflation(minimum: Minimum) -> Array:
    """(m,) by how much each output counts less than its white noise would say: beside a prior all of them, else what
    was measured beside the torque, whose own weights stay those of the torque alone."""
    model, joints = minimum.fit.model, minimum.fit.model.joint_count
    found = np.zeros(model.output_counts.size)
    for colour in minimum.known.colours:
        found[colour.joint - 1] = max(found[colour.joint - 1], colour.inflation)
    found[joints:] = np.maximum(found[joints:], LEAST_INFLATION)
    if model.prior is not None:
        return np.concatenate([np.maximum(found[:joints], 1.0), found[joints:]])
    of_torque = float(np.sqrt(np.mean(found[:joints] ** 2)))
    return np.concatenate([np.ones(joints), found[joints:] / (of_torque or 1.0)])  # none of a torque that is given


def efficient_finish(
    start: Fit,
    *,
    tolerance: float | None,
    progress: Callable[[Iteration], None],
    stage: str = "finish",
    maximum_iterations: int = FINISH_ITERATIONS,
    inflation: Array | None = None,
) -> Minimum:
    """Minimise the weighted error from a point, again with finer substeps while they change the torque too much.

    Args:
        tolerance: see :class:`~fmu_didim.fit.solver.least_squares.Stopping`; None: until the next step would be far
            below the standard deviations. stage: names the iterations.
        inflation: (m,) of the outputs, see :class:`~fmu_didim.fit.noise.weighting.NoiseOfResidual`.
    """
    iterations: list[Iteration] = []
    remarks: list[str] = []
    stopping = Stopping(
        maximum_iterations, tolerance=FINISH_TOLERANCE if tolerance is None else tolerance,
        next_step=NEXT_STEP if tolerance is None else 0.0, updates=None, check_all=False, exact=True, whole=True,
    )  # fmt: skip
    fit, model = start, start.model
    _refuse_confounded(fit, at_start=True)
    sizes = None if fit.prediction is None else parameter_sizes(model, fit.values, fit.prediction)
    for left in reversed(range(MAXIMUM_REFINEMENTS)):
        fit = minimise(
            model, NoiseOfResidual(model, inflation), stopping=stopping, jacobian=fit.jacobian, outputs=fit.outputs,
            sizes=sizes, steps=fit.steps, stage=stage, progress=progress,
        )  # fmt: skip
        iterations.extend(fit.iterations)
        error = integration_error(fit)
        if error.excess <= 1 or not left:
            break
        model = _finer(fit.model, fit.values, error.excess)
        if fit.model.loop.substeps is None and not model.divides_steps:  # more than the case or the rule says
            change = f"{100 * error.relative:.2g} %"
            whole, quantity = model.loop.whole, model.loop.quantity
            remarks.append(f"Substeps of the {whole} doubled: halving them changed the {quantity} by {change}.")
        fit = replace(fit, model=model, outputs=model.outputs(fit.values))
    if fit.model.divides_steps and fit.model.loop.subdivision > 1:
        inputs = "linear inputs are held" if fit.model.loop.holds_ramps else "inputs go straight"
        remarks.append(f"Steps are divided into {fit.model.loop.subdivision}: over each of them {inputs}.")
    if fit.model.loop.finest < MOST_SUBDIVISIONS:
        remarks.append(
            f"Steps are not divided into more than {fit.model.loop.finest}, as linear inputs would ask for: shorter "
            "ones change the outputs without end, as of an FMU whose own solver has a fixed step."
        )
    if not model.loop.shows_torque:  # where it began, the outputs may have shown what they do not here
        _refuse_confounded(fit)
    if error.excess > 1:
        moved = f"{float(np.max(error.shift)):.2g} of its standard deviation"
        told = (
            f"Steps half as long, at which linear inputs are set, would still move a value by {moved}: give the "
            "inputs at more instants."
            if model.divides_steps
            else f"Twice the substeps of the {model.loop.whole} would still move a value by {moved}: state more "
            "substeps."
        )
        remarks.append(told)
    known, told_of = with_accuracy(fit_uncertainty(fit), fit, error.accuracy)
    remarks += told_of
    return Minimum(fit, error, known, tuple(iterations), tuple(remarks), roughness(fit, sizes))


def _refuse_confounded(fit: Fit, *, at_start: bool = False) -> None:
    """Raise IdentificationError where the data do not tell the parameters apart at a fit; at a start of any model only
    where no data would: its noise is not known yet, and elsewhere the outputs may show more."""
    model = fit.model
    known = [k.scale if k.is_start else v for k, v in zip(model.free_parameters, fit.values, strict=True)]
    table = model.beside_prior(whitened(fit.jacobian, fit.deviation))
    size = float(np.linalg.norm(model.measured_outputs / fit.deviation))
    if model.loop.shows_torque:
        refuse_confounded(table, np.array(known), model.names, torque=size)
    else:
        refuse_ridge(table, np.array(known), model.names, outputs=math.inf if at_start else size)


def _finer(model: LoopModel, values: Array, excess: float) -> LoopModel:
    """The model with more substeps: as many as errors of second order ask for, at most those of the rule, which are
    doubled; or with so many shorter steps at which linear inputs are set."""
    if model.divides_steps:
        wanted = model.loop.subdivision * 2 ** math.ceil(math.log2(excess) / 2)
        return divided_steps(model, values, wanted)
    if model.loop.substeps is None:
        return model.with_loop(substep_factor=2 * model.loop.substep_factor)
    more = max(model.loop.substeps, model.fewest_substeps(values)) * 2 ** math.ceil(math.log2(excess) / 2)
    return model.with_loop(substeps=more if more < model.automatic_substeps(values) else None)


@dataclass(frozen=True)
class IntegrationError:
    """Change of torque and values by twice the substeps of the plant.

    Attributes:
        relative: of the torque, relative to its size; shift: (p,) of the values, in their standard deviations; NaN
            where the substeps cannot be chosen.
        excess: the largest change over what is allowed; accuracy: of the simulation.
    """

    relative: float
    shift: Array
    excess: float
    accuracy: Accuracy


def integration_error(fit: Fit) -> IntegrationError:
    """The error of the integration at a fit, by a run with steps half as long.

    The values would move by (S'S)^-1 S' d tau, which can be far more, in standard deviations, than the torque changes
    in those of the noise: errors of the integration are systematic.
    """
    model = fit.model
    finer = model.twice_as_fine()
    if finer is None:
        return IntegrationError(np.nan, np.full(fit.values.size, np.nan), 0.0, simulation_accuracy(fit, None))
    outputs = finer.outputs(fit.values)
    change, torque = outputs - fit.outputs, model.torque_of(outputs)
    accuracy = simulation_accuracy(fit, change)
    relative = float(np.linalg.norm(torque - fit.torque) / np.linalg.norm(torque))
    sensitivity = whitened(fit.jacobian, fit.deviation)
    table, right = model.beside_prior(sensitivity), (change / fit.deviation).ravel()
    moved = np.linalg.lstsq(table, np.pad(right, (0, len(table) - right.size)), rcond=None)[0]
    shift = np.abs(moved) / np.sqrt(np.diag(covariance_white(table)))
    if model.loop.substeps is None and relative <= INTEGRATION_TOLERANCE:
        # Only data without noise can ask for more than the rule: where finer steps explain them better.
        left = (model.measured_outputs - outputs) / fit.deviation + (sensitivity @ moved).reshape(outputs.shape)
        if np.linalg.norm(left) > CLEARLY_BETTER * np.linalg.norm(fit.residual / fit.deviation):
            return IntegrationError(relative, shift, 0.0, accuracy)
    excess = integration_change(model, fit.outputs, outputs)
    return IntegrationError(relative, shift, max(excess, float(shift.max()) / INTEGRATION_SHIFT), accuracy)


def degrees_of_freedom(model: LoopModel, count: int, inflation: float = 1.0) -> float:
    """Degrees of freedom of the intervals of ``count`` parameters: those of one output where the noise of each is
    estimated by itself, the safe end of what Welch and Satterthwaite's rule can give; dependent samples
    count as the number of independent ones with the same uncertainty."""
    total = model.output_counts.sum() - count
    if model.torque_deviation is not None and inflation <= 1:
        return float(total)
    return float(total) / model.output_counts.size / inflation**2


def torque_estimate(
    minimum: Minimum,
    *,
    estimator: str,
    settled: bool,
    iterations: Sequence[Iteration],
    stages: Mapping[str, Stage],
) -> Estimate:
    """The estimate at a minimum, or at another point of the closed loop."""
    fit, model, known = minimum.fit, minimum.fit.model, minimum.known
    unlimited, n = unlimited_values(fit), minimum.fit.model.joint_count
    return Estimate(
        estimator=estimator,
        model=model.with_loop(substeps=None, substep_factor=1),
        covariance=known.covariance,
        freedom=degrees_of_freedom(model, fit.values.size, known.inflation),
        time=model.experiments.time,
        measured=np.concatenate([model.experiments.recorded_in(label) for label in model.estimation_labels]),
        simulated=model.experiments.unscaled(fit.torque),
        noise=(fit.noise.deviation * model.experiments.typical_scales)[:n],
        condition_number=fit.condition_number,
        status=Status.CONVERGED if settled else Status.MAXIMUM_ITERATIONS,
        iterations=tuple(iterations),
        stages=stages,
        integration_error=minimum.integration_error.relative,
        integration_shift=minimum.integration_error.shift,
        integration=model.integration(fit.values),
        colours=tuple(colour for colour in known.colours if colour.joint <= n),
        known_noise=known_noise(model),
        noise_is_stated=model.torque_deviation is not None,
        fit=fit.torque_alone,
        minimum=fit,
        roughness=minimum.roughness,
        accuracy=minimum.integration_error.accuracy.size,
        rivals=minimum.rivals,
        joint=minimum.joint,
        prior=prior_fit(fit, known),
        unlimited=unlimited,
        remarks=(
            *minimum.remarks,
            *_of_failures(iterations),
            *remarks_of_limits(model, fit.values, known.deviation, unlimited),
        ),
        advice="" if settled else unsettled_advice(model, iterations),
    )


def unlimited_values(fit: Fit) -> Array | None:
    """As :func:`unlimited_by`, at a fit."""
    return unlimited_by(fit.equations, fit.model, fit.values)


def unlimited_by(equations: LinearProblem, model: LoopModel, values: Array) -> Array | None:
    """(p,) values that the data, and a prior, ask for without limits, by the linear problem at these values (p,); None
    where a machine has them."""
    region = Region.of(model.with_values(values))
    free = equations.step(values, replace(region, low=model.free_parameters.limits[0], machines=()), 0.0)[0]
    held = equations.step(values, region, 0.0)[0]
    return None if (free == held).all() else values + free


def _of_failures(iterations: Sequence[Iteration]) -> list[str]:
    """Steps to values with which a model cannot be simulated."""
    failed = [one.note.partition(FAILED)[2] for one in iterations if FAILED in one.note]
    if not failed:
        return []
    if len(failed) == 1:
        return [f"A step was shortened, because the model cannot be simulated where it led: {failed[0]}."]
    begin = f"{len(failed)} steps were shortened, because the model cannot be simulated where they led"
    return [f"{begin}; first {failed[0]}."]


def remarks_of_limits(model: LoopModel, values: Array, deviation: Array, unlimited: Array | None) -> list[str]:
    """What the limits of machines change of an answer, in words."""
    if unlimited is None:
        return []
    moved = (values - unlimited) / deviation
    alone = "alone" if model.prior is None else "without limits"
    told = [
        f"{name} = {values[i]:.3g} ({alone} {unlimited[i]:.3g} ± {deviation[i]:.2g}) {unit}"
        for i, (name, unit) in enumerate(zip(model.names, model.free_parameters.units, strict=True))
        if abs(moved[i]) > MOVED
    ]
    if not told:
        return []
    if not model.loop.shows_torque:
        return [f"At the limits of the case; without them the data ask for others: {', '.join(told)}."]
    ask = "the data alone ask" if model.prior is None else "data and prior ask"
    return [
        f"These values are the nearest that a machine can have, with friction that is not negative and links of "
        f"positive mass; {ask} for others: {', '.join(told)}."
    ]


def unsettled_advice(model: LoopModel, iterations: Sequence[Iteration]) -> str:
    """Advice for a fit that has not settled; empty where the status gives it."""
    begin = "The iterations did not settle: the values are those of the last one. "
    note = iterations[-1].note if iterations else ""
    if note.startswith(BEYOND_EDGE):
        return (
            f"{begin}Where the data lead, the loop cannot be simulated ({note.removeprefix(BEYOND_EDGE).rstrip('.')}): "
            "they do not hold some values to what a machine may have. Give a longer motion in which the joints move "
            "each for itself, leave out what it does not show (known: in the robot description), or give a prior "
            "(prior:)."
        )
    if note == NO_STEP:
        if not model.loop.shows_torque:
            start = "Start nearer to the truth (identify: {name: {start: ...}})."
        else:
            start = "Start nearer to the truth (start: {name: value})."
        finer = "State more substeps of the plant." if model.can_refine else smoother_advice(model)
        jitter = f"Where its own step control makes the {model.loop.quantity} jitter:"
        words = (begin.strip(), Ending.NO_STEP.value, *((jitter, finer) if finer else ()), start)
        return " ".join(words)
    if model.parameters.has_regressor:
        return ""
    if not model.loop.shows_torque:
        return f"{begin}Increase maximum_iterations, or start nearer to the truth (identify: {{name: {{start: ...}}}})."
    return (
        f"{begin}Increase maximum_iterations, start nearer to the truth (start: {{name: value}}), or check the "
        "controller and the delay of the loop."
    )
