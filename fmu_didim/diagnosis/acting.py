"""What can be said of a plant before long work: whether the identified parameters act, and from where it starts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmu_didim.errors import InputError, SimulationError
from fmu_didim.master import Recording, simulate
from fmu_didim.prediction.guard import mass_matrix_problem
from fmu_didim.prediction.probing import RegressorProbe
from fmu_didim.prediction.problem import Problem, joint_signals
from fmu_didim.signals import Array

SHORT, STEPS = 200, 50
"""Ticks that are simulated first, and instants compared; what shows no effect there is simulated to the end."""
CHANGE = 1e-2
"""Relative change of a parameter."""
START_TOLERANCE = 1e-3
"""Distance of the plant from the start of the reference, relative to the range of the reference, that is told."""


def check_acting(problem: Problem) -> None:
    """Simulate with each parameter changed: one that changes nothing at all cannot be identified.

    Needs one short simulation a parameter, and for the regressor measured on the plant one short simulation.

    Raises:
        InputError: parameters do not act in the plant, such as those that an FMU reads when it is instantiated only.
    """
    theta = problem.parameters.nominal()
    if mass_matrix_problem(problem, theta):
        return  # nothing can be simulated with these values; the estimator starts elsewhere
    total = problem.experiment.reference.time.size
    idle = list(range(theta.size))
    try:
        for count in sorted({min(SHORT, total), total}):
            idle = _idle(problem, theta, _ticks(count), idle) if idle else []
    except SimulationError:
        return  # the estimator says more about a loop that does not run
    if idle:
        raise InputError(
            "Some parameters have no effect in the plant.", where="plant",
            got=f"{_listed(problem, idle)}: the simulation stays the same, to the last digit, when they change",
            next_step="Leave them out, name the parameter that acts, or export the plant with tunable parameters.",
        )  # fmt: skip
    if problem.parameters.is_probed:
        silent = _silent(problem, theta, _ticks(min(SHORT, total)))
        if silent and (silent := _silent(problem, theta, _ticks(total))):
            raise InputError(
                "Some parameters have no effect while the plant runs, so no regressor can be measured.",
                where="identify", got=_listed(problem, silent),
                next_step="Use the estimator clie, which sets them before each run.",
            )  # fmt: skip


def _listed(problem: Problem, places: list[int]) -> str:
    pairs = [(problem.parameters.names[i], problem.parameters.plant_names[i]) for i in places]
    return ", ".join(name if name == own else f"{name} ({own} in the plant)" for name, own in pairs)


def _ticks(count: int) -> NDArray[np.int64]:
    return np.unique(np.linspace(0, count - 1, STEPS).astype(np.int64))


def _run(problem: Problem, theta: Array, ticks: NDArray[np.int64], probe: RegressorProbe | None = None) -> Recording:
    return simulate(
        problem.system_with(theta), problem.experiment.reference, ticks=ticks, bounds=problem.position_bounds(),
        observe=probe, pool=problem.pool,
    )  # fmt: skip


def _idle(problem: Problem, theta: Array, ticks: NDArray[np.int64], asked: list[int]) -> list[int]:
    """Which of these parameters leave every signal of the loop as it is."""
    base = _run(problem, theta, ticks)
    found = []
    for i in asked:
        other = theta.copy()
        other[i] += CHANGE * (abs(theta[i]) or 1.0)
        if mass_matrix_problem(problem, other):
            continue
        try:
            run = _run(problem, other, ticks)
        except SimulationError:
            continue  # it acts, if only to the worse
        if all(np.array_equal(values, run.applied[name]) for name, values in base.applied.items()):
            found.append(i)
    return found


def _silent(problem: Problem, theta: Array, ticks: NDArray[np.int64]) -> list[int]:
    """Parameters whose measured column is zero everywhere."""
    probe = RegressorProbe(problem.plant, problem.parameters, theta, ticks.size)
    try:
        _run(problem, theta, ticks, probe)
    except SimulationError:
        return []  # the estimator says why
    return [int(i) for i in np.flatnonzero(~np.abs(probe.columns).any(axis=(0, 1)))]


def start_warnings(problem: Problem) -> list[str]:
    """Joints that the plant starts elsewhere than the reference, a line each."""
    theta = problem.parameters.nominal()
    reference = problem.experiment.reference
    try:
        first = _run(problem, theta, np.zeros(1, dtype=np.int64))
    except SimulationError:
        return []
    found = []
    for name, what in (("q", "q_start"), ("dq", "dq_start")):
        for j, signal in enumerate(joint_signals(problem, name), start=1):
            if signal not in first.applied or f"{name}{j}" not in reference.names:
                continue
            column = reference.select([f"{name}{j}"])
            here, there = float(first.applied[signal][0]), float(column[0, 0])
            if abs(here - there) > START_TOLERANCE * max(float(np.ptp(column)), 1e-9):
                found.append(
                    f"The plant starts at {name}{j} = {here:.4g} while the reference starts at {there:.4g}. "
                    f"Name its start value: plant: {{parameter_names: {{{what}{j}: name in the plant}}}}, or begin "
                    f"the reference where the plant stands."
                )
    return found
