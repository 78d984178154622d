"""When the outputs of FMUs of other tools are read, and what that changes."""

from __future__ import annotations

import re
from dataclasses import dataclass

from fmu_didim.components.fmu.component import foreign_co_simulation
from fmu_didim.components.fmu.reuse.reading import Reading, find_reading
from fmu_didim.cosim.system import System

ROLE = re.compile(r"d{0,2}q\d+")
"""Outputs that are looked at wherever they exist: positions, velocities and accelerations."""


@dataclass(frozen=True)
class ReadOutputs:
    """What reading the outputs of a component between its inputs and its step does.

    Attributes:
        reading: as a trial has shown; output: the one that changes most.
        used: outputs that the loop or a regressor takes; at_once: outputs that follow the inputs at once.
    """

    reading: Reading
    output: str
    used: frozenset[str]
    at_once: frozenset[str]


def readings(system: System) -> dict[str, ReadOutputs]:
    """Component -> what reading its outputs does, of FMUs of other tools in co-simulation whose outputs may follow the
    inputs at once and are not taken after the step; without those that could not be tried."""
    found = {}
    for name, component in system.components.items():
        fmu = foreign_co_simulation(component)
        if fmu is None or fmu.event_mode or name in system.after_step:
            continue
        if fmu.reads_between and fmu.feedthrough() == frozenset():
            continue
        reading = find_reading(fmu, system.step_size * system.every.get(name, 1) / system.substeps.get(name, 1))
        if reading is None:
            continue
        outputs = [v.name for v in fmu.outputs]
        sources = {c.source.removeprefix(f"{name}.") for c in system.connections if c.source.startswith(f"{name}.")}
        used = sources | {output for output in outputs if ROLE.fullmatch(output)}
        at_once = frozenset(outputs[i] for i in reading.at_once)
        found[name] = ReadOutputs(reading, outputs[reading.place], frozenset(used), at_once)
    return found
