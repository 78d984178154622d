"""Check of a plant before a long computation: the influence of its parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.diagnostics import CATALOGUE, PROBLEM, DiagnosedError, Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.plant.idle import CHANGE, awakening, idle_parameters, with_change
from fmu_didim.cosim import Recording
from fmu_didim.data.signals import Array
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.model.external_torque import EXTERNAL_TORQUE
from fmu_didim.model.free_parameter import BASE, LOG
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.numerical_regressor import RegressorProbe

FIRST_TICKS = 200
"""[ticks] Simulated first; parameters without influence there are simulated to the end."""
COMPARED_TICKS = 50
"""[ticks] At which the signals are compared."""
PARAMETER_IDLE = CATALOGUE(
    "parameter-idle", PROBLEM, rank=30,
    meaning="A parameter that is to be identified has no effect in the plant: the simulation stays the same, to the "
    "last digit, when it changes.",
    next_step="Leave it out, name the parameter that has an effect, or export the plant with tunable parameters.",
)  # fmt: skip
PARAMETER_FIXED = CATALOGUE(
    "parameter-fixed-in-run", PROBLEM, rank=31,
    meaning="A parameter has no effect while the plant runs, so no regressor can be measured.",
    next_step="Use the estimator clie, which sets the parameters before each run.",
)  # fmt: skip
UNSEEN = (LOG, EXTERNAL_TORQUE)
"""Owners of parameters that change no signal of the loop, or only later ones."""


def check_parameter_influence(model: LoopModel) -> None:
    """Simulate with each parameter changed, a short run each: one that changes nothing cannot be identified.

    Raises:
        DiagnosedError: parameters have no effect in the plant, as those that an FMU reads only when instantiated.
    """
    theta = model.start
    if mass_matrix_problem(model, theta):
        return  # the estimator starts elsewhere
    total = max(model.experiments[label].reference.time.size for label in model.estimation_labels)
    idle = [i for i, parameter in enumerate(model.free_parameters) if parameter.owner not in UNSEEN]
    if not model.loop.shows_torque:
        _check_of_model(model, idle)
        return
    try:
        for count in sorted({min(FIRST_TICKS, total), total}):
            idle = _idle(model, theta, count, idle) if idle else []
    except SimulationError:
        return  # the estimator reports a loop that does not run
    if idle:
        whole = model.loop.whole
        text = f"Some parameters have no effect in the {whole}: {_listed(model, idle)}."
        raise DiagnosedError([Diagnostic(PARAMETER_IDLE, text, whole)])
    if model.parameters.is_probed:
        silent = _silent(model, theta, FIRST_TICKS)
        if silent and (silent := _silent(model, theta, total)):
            text = f"Some parameters have no effect while the plant runs: {_listed(model, silent)}."
            raise DiagnosedError([Diagnostic(PARAMETER_FIXED, text, "identify")])


def _check_of_model(model: LoopModel, asked: list[int]) -> None:
    """The same of a model without loop, by what was measured, with what would wake each idle parameter."""
    try:
        idle = idle_parameters(model, model.start, asked)
    except SimulationError:
        return  # the estimator reports a model that does not run
    found = []
    for i in idle:
        name, value = model.names[i], model.start[i]
        text = f"{name} changes nothing that was measured: with {value:.6g} and {CHANGE:.0%} more all is the same."
        found.append(
            Diagnostic(PARAMETER_IDLE, text, "identify", next_step=f"{_capital(awakening(model, model.start, i))}.")
        )
    if found:
        raise DiagnosedError(found)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _listed(model: LoopModel, places: list[int]) -> str:
    found = []
    for i in places:
        parameter = model.free_parameters[i]
        own, owner = parameter.key, parameter.owner
        if owner == BASE and not parameter.is_load:
            own, owner = model.parameters.plant_names[model.parameters.names.index(parameter.key)], model.loop.whole
        found.append(parameter.name if parameter.name == own else f"{parameter.name} ({own} in the {owner})")
    return ", ".join(found)


def _ticks(count: int) -> NDArray[np.int64]:
    return np.unique(np.linspace(0, count - 1, COMPARED_TICKS).astype(np.int64))


def _idle(model: LoopModel, values: Array, count: int, asked: list[int]) -> list[int]:
    """Those of these parameters that change no signal of the loop in the first ticks of an experiment."""
    found = []
    base: dict[str, Recording] = {}
    for i in asked:
        label = next(label for label in model.estimation_labels if model.free_parameters.acts(i, label))
        ticks = _ticks(min(count, model.experiments[label].reference.time.size))
        if label not in base:
            base[label] = model.simulation(values, label).record(ticks=ticks)
        other = with_change(values, i, CHANGE)
        if mass_matrix_problem(model, other):
            continue
        try:
            run = model.simulation(other, label).record(ticks=ticks)
        except SimulationError:
            continue  # it acts, if only to the worse
        if all(np.array_equal(signal, run.applied[name]) for name, signal in base[label].applied.items()):
            found.append(i)
    return found


def _silent(model: LoopModel, theta: Array, count: int) -> list[int]:
    """Parameters whose measured column is zero everywhere."""
    ticks = _ticks(min(count, model.experiments[model.first].reference.time.size))
    probe = RegressorProbe(model.loop.plant_name, model.parameters, model.theta(theta), ticks.size)
    try:
        model.simulation(theta).record(ticks=ticks, observe=probe)
    except SimulationError:
        return []  # the estimator reports why
    return [int(i) for i in np.flatnonzero(~np.abs(probe.columns).any(axis=(0, 1)))]
