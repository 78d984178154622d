"""The temperatures of the gears of a run, as the plant takes them: T(t) = temperature + warming (t - t_start)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, REMARK, Diagnostic
from fmu_didim.base.errors import InputError
from fmu_didim.case.files import NONE_GIVEN, read_samples
from fmu_didim.case.sources import COLDEST, HOTTEST, ExperimentSource, TemperatureFile
from fmu_didim.components import Component
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.data.tables import Column
from fmu_didim.dynamics.effects import start_name
from fmu_didim.model.experiment import Experiment

ICE = 273.15
"""[K] Of 0 degC."""
ALL_JOINTS = "temperature"
"""The signal that is the temperature of all joints."""
BENT = 2.0
"""[K] Off a line along the run: friction changes by a few per cent per kelvin at most, so that less hardly shows."""
FEWEST_OF_A_LINE = 3
"""[samples] Of which a line is taken,"""
PART_OF_A_LINE = 0.5
"""[1] and the least part of the run that they cover; else the mean is."""
PARTS = 8
"""[parts] Of a run, over each of which what is off the line is averaged: sensors count in whole kelvins."""
TEMPERATURE_BENT = CATALOGUE(
    "temperature-bent", REMARK, rank=94,
    meaning="The temperature of a gear follows no line along the run, and a line is taken for it.",
    next_step="Use parts of the run as experiments of their own: from_s, to_s.",
)  # fmt: skip


@dataclass(frozen=True)
class Temperatures:
    """Of the gears of a run: parameters of a plant in which they start, and what was found in their file."""

    starts: Mapping[str, float]
    told: tuple[Diagnostic, ...] = ()


def read_temperatures(
    source: ExperimentSource, folder: Path, time: Array, joints: int, label: str,
    signals: Mapping[str, Trajectory] = NONE_GIVEN,
) -> Temperatures:  # fmt: skip
    """The temperatures of a run with so many joints: of a file a line for each, by least squares.

    Args:
        time: (K,) instants of the reference, s.

    Raises:
        InputError: there is not one for each joint, or what the file has is no temperature at which a drive runs.
    """
    given, where = source.temperature, f"{label}: temperature"
    if given is None:
        return Temperatures({})
    if not isinstance(given, TemperatureFile):
        values = given if isinstance(given, tuple) else (given,) * joints
        if len(values) != joints:
            raise InputError(
                "There is not one temperature for each joint.", where=where, got=f"{len(values)} values",
                valid=f"one number for all joints, or {joints}",
                next_step="Give one of a gear that has no sensor, too, such as that of its neighbour.",
            )  # fmt: skip
        return Temperatures(_starts([(value, 0.0) for value in values]))
    wanted = {f"temperature{j}": f"temperature{j}" for j in range(1, joints + 1)}
    if ALL_JOINTS in given.columns:
        wanted = dict.fromkeys(wanted, ALL_JOINTS)
    columns = {name: given.columns.get(name, Column(name=name)) for name in dict.fromkeys(wanted.values())}
    found = read_samples(given, folder, columns, signals, units=dict.fromkeys(columns, "degC"))
    told, lines = list[Diagnostic](), dict[str, tuple[float, float]]()
    for name, read in found.items():
        lines[name], off = _line(read.signals, name, given.offset_s, time, where)
        told += read.told
        if off > BENT:
            text = f"The temperature {name} is up to {off:.2g} K off a line along the run, which is taken for it."
            told.append(Diagnostic(TEMPERATURE_BENT, text, where))
    return Temperatures(_starts([lines[name] for name in wanted.values()]), tuple(dict.fromkeys(told)))


def _starts(lines: Sequence[tuple[float, float]]) -> dict[str, float]:
    """Parameters of the plant for the temperature at the start, K, and its rate, K/s, of each joint, from degC."""
    found = dict[str, float]()
    for j, (degrees, rate) in enumerate(lines, start=1):
        found |= {start_name("temperature", j): degrees + ICE, start_name("warming", j): rate}
    return found


def _line(read: Trajectory, name: str, offset_s: float, time: Array, where: str) -> tuple[tuple[float, float], float]:
    """Temperature at the first instant, degC, and its rate, K/s, along a run; the most by which it is off that line."""
    stamps, values = read.time + offset_s, read.column(name)
    during = (stamps >= time[0]) & (stamps <= time[-1])
    if not during.any():
        raise InputError(
            "The file of the temperatures has no sample during the run.", where=where,
            got=f"{stamps[0]:.6g} to {stamps[-1]:.6g} s", valid=f"{time[0]:.6g} to {time[-1]:.6g} s",
            next_step="Bring it on the clock of the reference by offset_s, or state one number.",
        )  # fmt: skip
    since, values = stamps[during] - time[0], values[during]
    if not ((values >= COLDEST) & (values <= HOTTEST)).all():
        raise InputError(
            "This is no temperature of a drive in degC.", where=where, got=f"{values.min():.4g} to {values.max():.4g}",
            valid=f"{COLDEST:g} to {HOTTEST:g} degC",
            next_step=f"Say its unit, columns: {{{name}: {{name: ..., unit: K}}}}, or name the right column.",
        )  # fmt: skip
    if since.size < FEWEST_OF_A_LINE or np.ptp(since) < PART_OF_A_LINE * (time[-1] - time[0]):
        return (float(values.mean()), 0.0), 0.0
    rate, start = np.polyfit(since, values, 1)
    parts = np.array_split(values - start - rate * since, min(PARTS, since.size))
    return (float(start), float(rate)), float(max(abs(part.mean()) for part in parts))


def check_temperatures(experiments: Mapping[str, Experiment], plant: Component) -> None:
    """Raise InputError where one experiment states temperatures and another one does not, or the plant takes them and
    none is stated."""
    without = [label for label, experiment in experiments.items() if not experiment.measured_starts]
    taken = {v.name for v in plant.parameters} & _starts([(0.0, 0.0)] * len(plant.inputs)).keys()
    if not without or not (taken or len(without) < len(experiments)):
        return
    raise InputError(
        "Friction follows the temperature, which these runs do not state." if taken else
        "Some runs state temperatures and some do not, so that they cannot be compared.",
        where=f"experiments.{without[0]}.temperature", got=f"none in {', '.join(without)}",
        valid="degC: one number, a list with one for each joint, or a file",
        next_step="Give temperature: in every run, held-out ones too, or "
        f"{'take the effect out of the robot' if taken else 'in none'}.",
    )  # fmt: skip
