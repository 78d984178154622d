"""Whether a plant of another tool follows the steps of the loop."""

from __future__ import annotations

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.components.fmu.component import foreign_co_simulation
from fmu_didim.data.signals import Array
from fmu_didim.model.loop_model import Simulation

TICKS_LOOKED_AT = 2000
"""[ticks] Of the loop, from its start: two seconds at 1 kHz, a fraction of an experiment."""
FEWEST_CHANGES = 10
"""[changes] Of the outputs of a plant, from which its holding time is judged."""

PLANT_HOLDS = CATALOGUE(
    "plant-holds", DOUBT, rank=14,
    meaning="The plant takes longer steps than the loop and holds its outputs in between: the controller acts on an "
    "outdated motion.",
    next_step="Let the loop run at the rate of the plant (loop: {rate_hz: ...}), or run the plant in model exchange "
    "(plant: {interface: model-exchange}).",
)  # fmt: skip


def plant_diagnostics(run: Simulation) -> list[Diagnostic]:
    """A plant FMU of another tool, in co-simulation, whose outputs change at few ticks of the loop only."""
    name, system = run.model.loop.plant_name, run.model.loop.systems[run.label]
    if foreign_co_simulation(system.components[name]) is None:
        return []
    motion = {f"{kind}{j}" for kind in ("q", "dq") for j in range(1, run.model.joint_count + 1)}
    names = [f"{name}.{v.name}" for v in system.components[name].outputs if v.name in motion]
    count = min(run.experiment.reference.time.size, TICKS_LOOKED_AT)
    try:
        recording = run.record(ticks=np.arange(count))
    except FmuDidimError:  # the fit deals with such a start
        return []
    steps = held_steps(recording.table(names, sampled=True)) if names else 1
    if steps <= system.every.get(name, 1):
        return []
    period = steps * system.step_size
    text = f"Positions and velocities of the plant change only once in {steps} ticks of the loop, every {period:g} s."
    return [Diagnostic(PLANT_HOLDS, text, run.label, float(steps), 1.0, "ticks")]


def held_steps(outputs: Array) -> int:
    """Median number of equal rows in succession in a table (N, m); 1 where all rows differ or none does."""
    changes = np.flatnonzero((np.diff(outputs, axis=0) != 0).any(axis=1))
    return int(np.median(np.diff(changes))) if changes.size > FEWEST_CHANGES else 1
