"""Free parameters of a case beside the base parameters: gains of controller or drives, the delay, the log's clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.case.document import CaseDocument
from fmu_didim.case.sources import IdentifiedParameter
from fmu_didim.cosim import System
from fmu_didim.dynamics.effects.drive_gain import DriveGain
from fmu_didim.model.free_parameter import (
    DELAY,
    LOG,
    PLANT,
    FreeParameter,
    FreeParameters,
    base_free_parameters,
    delay_parameter,
    log_shift_parameter,
    of_experiment,
)
from fmu_didim.model.parameters import Parameters

DRIVE = "drive"
"""Owner, in a case, of the gain of a drive."""


def beside_the_plant(document: CaseDocument) -> Mapping[str, IdentifiedParameter]:
    """The entries of ``identify`` that do not belong to the plant."""
    return {name: e for name, e in (document.identify or {}).items() if e.of not in (PLANT, document.plant_name)}


def free_parameters(document: CaseDocument, parameters: Parameters, system: System) -> FreeParameters:
    """The free parameters: base parameters, own ones of experiments, and those that ``identify`` lists beside them.

    Raises:
        InputError, UnknownNameError: an entry names no part of the loop, or an experiment something that is not free.
    """
    further = {name: _entry(name, entry, system, document) for name, entry in beside_the_plant(document).items()}
    _check_each_once(further, parameters)
    own = {label: run.own for label, run in document.runs.items() if run.own}
    for label, names in own.items():
        for name in names:
            if name not in further and name not in parameters.names:
                valid = (*parameters.names, *further)
                raise UnknownNameError("free parameter", name, valid, where=f"experiments.{label}.own")
    base = {label: [name for name in names if name in parameters.names] for label, names in own.items()}
    others = [of_experiment(further[name], label) for label, names in own.items() for name in names if name in further]
    return FreeParameters((*base_free_parameters(parameters, base), *further.values(), *others))


def _check_each_once(further: Mapping[str, FreeParameter], parameters: Parameters) -> None:
    """Raises InputError: two parameters with one name, or one parameter under two names."""
    if taken := [name for name in further if name in parameters.names]:
        raise InputError(
            "A base parameter has this name already.", where="identify", got=", ".join(taken),
            next_step="List it under another name; parameter: says what it is called in its component.",
        )  # fmt: skip
    meant: dict[tuple[str, str], str] = {}
    for name, parameter in further.items():
        before = meant.setdefault((parameter.owner, parameter.key), name)
        if before != name:
            raise InputError(
                "One parameter is listed twice.", where="identify", got=f"{before} and {name}",
                next_step="Take one of them out.",
            )  # fmt: skip


def _entry(name: str, entry: IdentifiedParameter, system: System, document: CaseDocument) -> FreeParameter:
    if entry.of == DELAY:
        found = replace(delay_parameter(float(system.delays.get(document.plant_name, 0.0))), name=name)
    elif entry.of == LOG:
        found = replace(log_shift_parameter(), name=name)
    else:
        owner, key = entry.of, entry.parameter or name
        if owner == DRIVE:
            owner, key = f"{DriveGain.name}{entry.joint}", DriveGain.name
        if owner not in system.components:
            valid = (*system.components, DRIVE, DELAY, LOG)
            raise UnknownNameError("part of the loop", entry.of, valid, where=f"identify.{name}.of")
        offered = {v.name: v for v in system.components[owner].parameters}
        if key not in offered:
            raise UnknownNameError(f"parameter of the {entry.of}", key, offered, where=f"identify.{name}")
        start = offered[key].start
        found = FreeParameter(name, offered[key].unit, owner, key, start, abs(start) or 1.0)
    value, low, high = entry.start_and_limits(name, found.value, (found.lowest, found.highest))
    return replace(found, value=value, lowest=low, highest=high)
