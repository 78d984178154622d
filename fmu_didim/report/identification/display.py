"""Signals of a model in the units in which its tool shows them (FMI: ``displayUnit``)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmu_didim.data.signals import Trajectory
from fmu_didim.results.result import DisplayResult, ResultDocument


def shown_value(unit: DisplayResult, value: float) -> float:
    """A value in that unit."""
    return unit.factor * value + unit.offset


def in_display_units(document: ResultDocument) -> ResultDocument:
    """The same result, the units of outputs and inputs, and the noise of outputs, those of display."""
    displays = document.displays
    if not displays:
        return document

    def size(name: str, value: float | None) -> float | None:
        return value if value is None or name not in displays else abs(displays[name].factor) * value

    def unit(name: str, own: str) -> str:
        return displays[name].name if name in displays else own

    experiments = {
        label: one.model_copy(
            update={
                "channels": {
                    name: c.model_copy(update={"unit": unit(name, c.unit), "std": size(name, c.std)})
                    for name, c in one.channels.items()
                }
            }
        )
        for label, one in document.experiments.items()
    }
    joint = document.joint
    if joint is not None:
        channels = {
            name: c.model_copy(update={"unit": unit(name, c.unit), "noise_std": size(name, c.noise_std)})
            for name, c in joint.channels.items()
        }
        joint = joint.model_copy(update={"channels": channels})
    return document.model_copy(
        update={
            "torque_unit": [unit(*one) for one in zip(document.outputs, document.torque_unit, strict=True)],
            "noise_std": [size(*one) for one in zip(document.outputs, document.noise_std, strict=True)],
            "inputs": {name: unit(name, own) for name, own in document.inputs.items()},
            "experiments": experiments,
            "joint": joint,
        }
    )


def table_in_display_units(document: ResultDocument, file: str, table: Trajectory) -> Trajectory:
    """A saved table of signals in the units of display."""
    displays, names = document.displays, {column: column for column in table.names}
    if not displays:
        return table
    for name, pair in zip(document.outputs, document.table_columns, strict=True):
        names |= dict.fromkeys(pair, name)
    for one in document.experiments.values():
        for name, channel in one.channels.items():
            if channel.file == file:
                names |= dict.fromkeys(("measured", "simulated"), name)
    as_it_is = DisplayResult(name="", factor=1.0, offset=0.0)
    units = [displays.get(names[column], as_it_is) for column in table.names]
    factors, offsets = np.array([(unit.factor, unit.offset) for unit in units]).T
    return replace(table, values=table.values * factors + offsets)
