"""Discovery from end to end: prepare, localise, compete, and write down what was found."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fmu_didim.discovery.augment import Workshop
from fmu_didim.discovery.decide import HELD_OUT, Options
from fmu_didim.discovery.document import findings_document
from fmu_didim.discovery.findings import (
    FindingResult,
    FindingsDocument,
    WindowResult,
)
from fmu_didim.discovery.fit import Fit, integrated
from fmu_didim.discovery.gap import joint_gaps
from fmu_didim.discovery.library import simulated_motion
from fmu_didim.discovery.localise import Region, regions
from fmu_didim.discovery.noise import Noise
from fmu_didim.discovery.prepare import prepare
from fmu_didim.discovery.push_result import push_finding, push_windows, refitted
from fmu_didim.discovery.push_rivals import rivalled
from fmu_didim.discovery.pushes import find_pushes
from fmu_didim.discovery.rounds import Discovery, Say, run_rounds
from fmu_didim.effects import EFFECTS, Effect
from fmu_didim.errors import SimulationError
from fmu_didim.identification.problem import Problem
from fmu_didim.robot import RobotDescription
from fmu_didim.signals import Array

NO_HELD_OUT = (
    "There is no validation experiment: the held-out gate was left out, the information criterion alone decided."
)
BEGIN_S = 0.25
"""Left out at the begin of each experiment: the state in which the machine starts is not known (gears in their play,
friction's deflection, the loop before the first sample)."""


@dataclass(frozen=True)
class Found:
    """What :func:`discover` returns.

    Attributes:
        document: the content of ``findings.json``.
        discovery: base and final fit with the steps between; workshop: builds what was found; noise: of the data.
    """

    document: FindingsDocument
    discovery: Discovery
    workshop: Workshop
    noise: Noise


def discover(
    problem: Problem,
    held_out: Problem | None,
    *,
    description: RobotDescription | None,
    name: str,
    effects: Mapping[str, Effect] = EFFECTS,
    options: Options | None = None,
    provenance: Mapping[str, Any] | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Found:
    """Find the effects that a model lacks.

    Args:
        problem: loop, parameters and data; held_out: the same loop with other data, for the gate.
        description: the robot, None for a plant that is a black box.
        effects: the catalogue by name.

    Raises:
        InputError: the data are too few; SimulationError: the base model cannot be simulated.
    """
    begin = clock.perf_counter()
    options = options or Options()
    say("base model")
    problem = problem.on(problem.experiment.after(BEGIN_S))
    held_out = held_out.on(held_out.experiment.after(BEGIN_S)) if held_out is not None else None
    prepared = prepare(problem, {HELD_OUT: held_out} if held_out is not None else {})
    noise, base = prepared.noise, prepared.fit
    say(f"gap of the base model: {_list(joint_gaps(base.residual, noise))} of the noise")
    start = integrated(base, noise, coarse=True)  # for the search, with its hundreds of simulations
    workshop = Workshop(start.model, description, effects)
    pushed = None if "external_force" in options.forbid else find_pushes(start, noise, say=say)
    if pushed is not None and rivalled(pushed, start, noise, workshop, forbid=options.forbid, say=say):
        pushed = None
    if pushed is not None:
        start, noise, workshop = pushed.fit, pushed.noise, Workshop(pushed.fit.model, description, effects)
    disagreement = _regions(workshop, base, noise)
    discovery = run_rounds(workshop, start, noise, options, say)
    outside: list[FindingResult] = []
    windows: list[WindowResult] = []
    if pushed is not None:
        final, free = refitted(pushed, discovery.final, noise)
        discovery = replace(discovery, final=final)
        outside = [push_finding(pushed, base, free, noise)]
        windows = push_windows(free, noise)
    discovery = replace(discovery, base=base, final=_fully_integrated(base, discovery, noise))
    document = findings_document(
        name, discovery, workshop, noise, options, outside=outside, windows=windows, found_regions=disagreement,
        notes=[*prepared.notes, *([] if held_out is not None else [NO_HELD_OUT])], provenance=provenance,
    )  # fmt: skip
    document = document.model_copy(update={"seconds": clock.perf_counter() - begin})
    return Found(document, discovery, workshop, noise)


def _fully_integrated(base: Fit, discovery: Discovery, noise: Noise) -> Fit:
    """The final model as it will be run by others; the base where nothing was added."""
    final = discovery.final
    if not discovery.steps and not final.model.runs["train"].pushes:
        return base
    try:
        return integrated(final, noise, coarse=False)
    except SimulationError:
        return final


def _regions(workshop: Workshop, base: Fit, noise: Noise) -> list[Region]:
    """Where the base model disagrees; nothing if the plant does not tell its motion."""
    motion = simulated_motion(workshop, base)
    if motion is None:
        return []
    problem = base.model.runs["train"].problem
    return regions(base.residual, motion, _nearest_ticks(problem), noise, problem.parameters.torque_units)


def _nearest_ticks(problem: Problem) -> Array:
    reference, step = problem.experiment.reference, problem.system.step_size
    ticks = np.round((problem.experiment.time - reference.time[0]) / step - problem.experiment.operator.lag).astype(int)
    return np.asarray(np.clip(ticks, 0, reference.time.size - 1))


def _list(values: Sequence[float] | Array) -> str:
    return ", ".join(f"{v:.2f}" for v in values)


__all__ = ["Found", "Options", "Say", "discover"]
