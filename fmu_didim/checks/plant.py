"""Checks of a plant before a long computation: the influence of its parameters, and its start."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, PROBLEM, DiagnosedError, Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.cosim import Recording
from fmu_didim.data.signals import Array
from fmu_didim.fit.log_noise import STANDSTILL
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.model.external_torque import EXTERNAL_TORQUE
from fmu_didim.model.free_parameter import BASE, LOG
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.numerical_regressor import RegressorProbe

CHANGE = 1e-2
"""[1] Relative change of a parameter by which its influence is measured: large against the jitter of integrators."""
FIRST_TICKS = 200
"""[ticks] Simulated first; parameters without influence there are simulated to the end."""
COMPARED_TICKS = 50
"""[ticks] At which the signals are compared."""
START_TOLERANCE = 1e-3
"""[1] Distance of the plant from the start of the reference, as a fraction of its range, that is reported."""

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
PLANT_START = CATALOGUE(
    "plant-start", DOUBT, rank=32,
    meaning="The plant does not start where the reference starts, so the simulation starts with a jump.",
    next_step="Name the start values of the plant: plant: {parameter_names: {q_start1: name in the plant}}, or start "
    "the reference where the plant stands.",
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
    try:
        for count in sorted({min(FIRST_TICKS, total), total}):
            idle = _idle(model, theta, count, idle) if idle else []
    except SimulationError:
        return  # the estimator reports a loop that does not run
    if idle:
        text = f"Some parameters have no effect in the plant: {_listed(model, idle)}."
        raise DiagnosedError([Diagnostic(PARAMETER_IDLE, text, "plant")])
    if model.parameters.is_probed:
        silent = _silent(model, theta, FIRST_TICKS)
        if silent and (silent := _silent(model, theta, total)):
            text = f"Some parameters have no effect while the plant runs: {_listed(model, silent)}."
            raise DiagnosedError([Diagnostic(PARAMETER_FIXED, text, "identify")])


def _listed(model: LoopModel, places: list[int]) -> str:
    found = []
    for i in places:
        parameter = model.free_parameters[i]
        own, owner = parameter.key, parameter.owner
        if owner == BASE:
            own, owner = model.parameters.plant_names[model.parameters.names.index(parameter.key)], "plant"
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
        other = values.copy()
        other[i] += CHANGE * (abs(values[i]) or 1.0)
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


def start_diagnostics(model: LoopModel) -> list[Diagnostic]:
    """Joints whose plant starts elsewhere than the reference, where nobody says that they do (``initial_state:``).

    Outputs after the step (``outputs_after_step``) are those at the end of the first step of the plant: its positions
    are compared with the reference there; its velocities, which a step at wrong values changes, are not.
    """
    reference, given = model.experiments[model.first].reference, model.experiments[model.first].initial_state.values
    plant, system = model.loop.plant_name, model.loop.systems[model.first]
    first_row = system.every.get(plant, 1) if plant in system.after_step else 0
    try:
        first = model.simulation(model.start).record(ticks=np.zeros(1, dtype=np.int64))
    except SimulationError:
        return []
    found = []
    compared = [("q", "q_start")] if first_row else [("q", "q_start"), ("dq", "dq_start")]
    for name, what in compared:
        for j, signal in enumerate(model.loop.joint_signals(name), start=1):
            if signal not in first.applied or f"{name}{j}" not in reference.names or f"{name}{j}" in given:
                continue
            column = reference.select([f"{name}{j}"])
            at_start, wanted = float(first.applied[signal][0]), float(column[min(first_row, len(column) - 1), 0])
            bound, away = START_TOLERANCE * max(float(np.ptp(column)), STANDSTILL), abs(at_start - wanted)
            if away > bound:
                text = f"The plant starts at {name}{j} = {at_start:.4g} while the reference starts at {wanted:.4g}."
                step = (
                    f"Name its start value: plant: {{parameter_names: {{{what}{j}: name in the plant}}}}, or start "
                    "the reference where the plant stands."
                )
                found.append(Diagnostic(PLANT_START, text, f"plant: joint {j}", away, bound, next_step=step))
    return found
