"""Checks of the data of a loop model before any fit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fmu_didim.base.diagnostics import Code, Diagnostic, by_weight
from fmu_didim.base.distributions import DEVIATION_OF_MEDIAN
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.data.expected import Expected, expected
from fmu_didim.checks.data.linear_fit import Explanation, FittedMotion, fitted_motion, motion_with_regressor
from fmu_didim.checks.data.log import (
    FAR_FROM_NOISE,
    FEW_OUTLIERS,
    LOG_CONSTANT,
    LOG_OUTLIERS,
    OUTLIERS_LEFT_OUT,
    PERIOD_CHANGES,
    log_diagnostics,
    swings_in,
    wrong_by_themselves,
)
from fmu_didim.checks.data.outliers import outlier_diagnostics, outliers, without
from fmu_didim.checks.data.plant import plant_diagnostics
from fmu_didim.checks.data.reference import reference_diagnostics
from fmu_didim.checks.data.robot import (
    LINK_LENGTH,
    TORQUE_SCALE,
    another_robot,
    frames_diagnostics,
    length_unit_diagnostics,
    misread_diagnostics,
)
from fmu_didim.checks.data.runs import run_diagnostics
from fmu_didim.checks.data.timing import (
    CLOCK_EARLY,
    CLOCK_LATE,
    COMMAND_DELAY,
    SAMPLING_KIND,
    filtered_diagnostics,
    kind_is_clear,
    timings,
)
from fmu_didim.checks.data.torque_channel import torque_channel_diagnostics
from fmu_didim.checks.data.units import position_diagnostics, unit_diagnostics
from fmu_didim.checks.data.unsigned import unsigned_diagnostics
from fmu_didim.checks.data.wrapped import wrapped_diagnostics
from fmu_didim.cosim.system import REFERENCE
from fmu_didim.data.signals import Array
from fmu_didim.estimators.starts.gains import free_gains
from fmu_didim.model.loop_model import LoopModel, Simulation
from fmu_didim.model.workers import apart

SUBSTEPS = 4
"""[substeps] Of the plant, or as many as are stable: a torque to 1e-3, fifteen times as fast as one to 1e-6."""
SHORTEST_S = 2.5e-4
"""[s] Steps of a plant are not made shorter for checks, unless for stability: those of a TX40 at 5 kHz give the torque
to 1e-5."""
OF_TIMING, OF_ROBOT = frozenset({COMMAND_DELAY, SAMPLING_KIND}), frozenset({TORQUE_SCALE, LINK_LENGTH})
"""Codes that are asked again along the motion of a fit, by what explains them."""
LogCheck = Callable[[Simulation, Expected], Iterable[Diagnostic]]
"""From an experiment with the start values and its measured and expected torque to what is found."""
LOG_CHECKS: tuple[LogCheck, ...] = (
    lambda run, _: run.experiment.told,
    reference_diagnostics,
    lambda run, given: log_diagnostics(run.experiment, run.label, given, 1 / run.step_size),
    lambda run, _: filtered_diagnostics(run.experiment, run.label),
)
"""The checks of each experiment, whatever else is found. Those of units, channels and causes, of which one makes the
next needless, are called in turn below."""


def data_diagnostics(model: LoopModel, *, without_torque: Sequence[str] = (), causes: bool = True) -> list[Diagnostic]:
    """Problems and doubts about the data of a model, the most important first.

    Each experiment needs one simulation and one regressor along the reference. Start values may be wrong by a factor
    of three.

    Args:
        without_torque: labels of validation experiments without a log, which are not in the model.
        causes: whether to test other timings, scales and lengths of links, with some steps of DIDIM; discovery names
            such causes itself.
    """
    model = _quick(model)
    found = [*length_unit_diagnostics(model), *frames_diagnostics(model), *run_diagnostics(model, without_torque)]
    found += plant_diagnostics(model.simulation(model.start, model.first))
    gains, explained = drive_gains(model), list[Diagnostic]()
    tasks = [partial(_of_log, model, label, gains, causes=causes) for label in model.experiments]
    workers = model.workers_from_start if len(tasks) > 1 else 1
    for label, of_log in zip(model.experiments, apart(tasks, workers), strict=True):
        if explained and model.experiments[label].role == "validation":
            found += of_log.told  # what explains the fitted logs better explains these, too
        else:
            found += of_log.told if of_log.near is None else of_log.near
            explained += of_log.explained
    return by_weight([*found, *explained])


@dataclass(frozen=True)
class _OfLog:
    """What is found of the log of an experiment.

    Attributes:
        told: by the start values and along the reference.
        near: the same once a simulated motion comes near to the measured one; None where none does, or none is tried.
        explained: what explains the log better along that.
    """

    told: list[Diagnostic]
    near: list[Diagnostic] | None = None
    explained: Sequence[Diagnostic] = ()


def _of_log(model: LoopModel, label: str, gains: Array, *, causes: bool) -> _OfLog:
    """What is found of the log of an experiment; arguments as above."""
    experiment, run = model.experiments[label], model.simulation(model.start, label)
    if model.loop.torque_is_given:  # the log is no answer to the motion of the reference
        return _OfLog([*experiment.told, *reference_diagnostics(run)])
    given, scale_is_free = expected(run), bool(free_gains(model)) and bool(model.loads)
    of_file = [diagnostic for check in LOG_CHECKS for diagnostic in check(run, given)]
    wrapped = wrapped_diagnostics(given, label)
    # Its jumps are no outliers, its ends no limit.
    found = [d for d in of_file if d.place not in {w.place for w in wrapped}]
    # What is wrong by itself would make a log look like that of another motion.
    faulty = wrong_by_themselves(experiment, given)
    clean = given.without(faulty)
    of_units = (unit_diagnostics(run, clean) or misread_diagnostics(run, clean)) if clean.has_all_joints else []
    of_log = wrapped or unsigned_diagnostics(given, label) or of_units
    of_log = of_log or ([] if faulty.all() else torque_channel_diagnostics(
        clean, gains, label, scale_is_free=scale_is_free))  # fmt: skip
    found += [*of_log, *([] if of_units else position_diagnostics(run))]
    if any(d.code in (PERIOD_CHANGES, LOG_CONSTANT) for d in of_file):  # like another clock, scale or motion
        return _OfLog(found)
    if not causes or of_log or (fitted := fitted_motion(model.on(label))) is None:
        return _OfLog(found)
    near = _without_swings(found, fitted, given)
    if wrong := outliers(fitted):
        told = outlier_diagnostics(fitted, wrong)
        near = [d for d in near if (d.code, d.place) not in [(t.code, t.place) for t in told]] + told
        fitted = without(fitted, wrong.values())  # they would look like another clock or another scale
    return _OfLog(found, near, _explained(fitted, held_out=experiment.role == "validation"))


def _without_swings(found: Iterable[Diagnostic], fitted: FittedMotion, given: Expected) -> list[Diagnostic]:
    """The diagnostics without outliers where the loop swings in as it does along a simulated motion near the measured
    one: at start values that are wrong it swings in otherwise."""
    places = {f"{fitted.run.label}: joint {j + 1}": j for j in range(fitted.run.model.joint_count)}
    told = {d.place for d in found if d.code in (LOG_OUTLIERS, FEW_OUTLIERS) and d.place in places}
    near = replace(given, nominal=fitted.run.torque()) if told else given
    swings = {place for place in told if swings_in(places[place], near)}
    return [d for d in found if d.code not in (LOG_OUTLIERS, FEW_OUTLIERS) or d.place not in swings]


def without_outliers(model: LoopModel, found: Iterable[Diagnostic] = ()) -> tuple[LoopModel, list[Diagnostic]]:
    """A model without the outliers of those logs that are to be fitted without, and what is said of them then.

    Args:
        found: of the data as they are; what this makes needless is left out.
    """
    told = list[Diagnostic]()
    for label, experiment in model.experiments.items():
        if not experiment.leaves_out_outliers or not model.loop.shows_torque or model.loop.torque_is_given:
            continue
        fitted = fitted_motion(_quick(model).on(label))
        if fitted is None:
            text = "Outliers were not looked for, and none is left out: no simulated motion comes near to the log."
            told.append(Diagnostic(OUTLIERS_LEFT_OUT, text, label))
        elif wrong := outliers(fitted):
            found_here = outlier_diagnostics(fitted, wrong)
            told += [replace(d, code=OUTLIERS_LEFT_OUT, text=f"{d.text} They are left out.") for d in found_here]
            model = model.with_experiment(label, without(fitted, wrong.values()).experiment)
    places = {d.place for d in told}
    return model, [*(d for d in found if not (d.code in (LOG_OUTLIERS, FEW_OUTLIERS) and d.place in places)), *told]


def _quick(model: LoopModel) -> LoopModel:
    """A model with as many substeps as checks need."""
    if model.loop.chooses_substeps and model.loop.substeps is None:
        step = model.loop.systems[model.first].step_size
        return model.with_loop(substeps=min(max(round(step / SHORTEST_S), 1), SUBSTEPS))
    return model


def confirmed(model: LoopModel, found: Iterable[Diagnostic]) -> list[Diagnostic]:
    """The diagnostics without those scales, lengths and delays that explain nothing along the motion of a fit, without
    kinds of sampling that explain the log clearly worse there, and without outliers that were the transient of a start
    off the reference.

    Before a fit the simulated motion is only near the measured one, and a scale, a length, a delay or an average may
    explain a part of the difference.

    Args:
        model: with the values of the fit; found: before it.
    """
    found = _without_transients(model, list(found))
    doubted = [d for d in found if d.code in OF_TIMING | OF_ROBOT]
    if not doubted or not model.parameters.has_regressor or model.linear_count < len(model.free_parameters):
        return found
    try:
        motions = [motion_with_regressor(model.on(label).simulation(model.start)) for label in model.estimation_labels]
    except SimulationError:  # nothing is cleared up
        return found
    asked = {d.code for d in doubted}
    codes = {d.code for one in motions for d in _still_explained(one, asked)}
    if codes & {CLOCK_LATE, CLOCK_EARLY, SAMPLING_KIND}:
        codes |= {COMMAND_DELAY}  # hardly told apart
    if SAMPLING_KIND in asked - codes and not all(kind_is_clear(one) for one in motions):
        codes |= {SAMPLING_KIND}  # a fit may have absorbed what the kind explained before
    return [d for d in found if d not in doubted or d.code in codes]


def _without_transients(model: LoopModel, found: list[Diagnostic]) -> list[Diagnostic]:
    """The diagnostics without outliers of joints whose residual has none, where a fit found the start."""
    for label in {k.experiment for k in model.free_parameters if k.is_start and k.experiment is not None}:
        size = np.abs(model.experiments.measured_in(label) - model.torque(model.start, label))
        stand_out = np.any(size > FAR_FROM_NOISE * DEVIATION_OF_MEDIAN * np.median(size, axis=0), axis=0)
        clean = {f"{label}: joint {j + 1}" for j in np.flatnonzero(~stand_out)}
        found = [d for d in found if d.code not in (LOG_OUTLIERS, FEW_OUTLIERS) or d.place not in clean]
    return found


def _explained(fitted: FittedMotion, *, held_out: bool = False) -> list[Diagnostic]:
    """Other timings, scales, lengths and gravities that explain a log better, the best first."""
    ways = timings(fitted, clock_alone=held_out)
    if not held_out:
        ways.append(partial(another_robot, fitted))
    _ = fitted.samples  # each of them asks for it
    offered = apart([partial(_listed, way) for way in ways], fitted.run.model.threads)
    return fitted.best(explanation for found in offered for explanation in found)


def _listed(way: Callable[[], Iterator[Explanation]]) -> list[Explanation]:
    return list(way())


def _still_explained(fitted: FittedMotion, asked: Set[Code]) -> list[Diagnostic]:
    """What explains a log better along the motion of a fit; the other kinds of explanations are computed only where one
    of a kind that is asked for explains something."""
    offered = list[Explanation]()
    if asked & OF_TIMING:
        offered += [explanation for way in timings(fitted) for explanation in way()]
    if asked & OF_ROBOT:
        offered += another_robot(fitted)
    return _explained(fitted) if fitted.best(offered) else []


def drive_gains(model: LoopModel) -> Array:
    """(n,) gain from the command to the logged torque of each joint; 1 without one."""
    connections = model.loop.systems[model.first].connections
    own = {c.target: c.gain for c in connections if not c.source.startswith(f"{REFERENCE}.")}
    return np.array([own.get(target, 1.0) for target in model.loop.logged])
