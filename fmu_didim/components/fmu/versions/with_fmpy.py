"""FMPy's descriptions, function signatures and platforms of FMI 1.0, 2.0 and 3.0."""

from __future__ import annotations

import ctypes
import inspect
import math
import tempfile
import types
import typing
from collections.abc import Callable, Iterator
from copy import deepcopy
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from fmu_didim.components.fmu.archive import DESCRIPTION
from fmu_didim.components.fmu.description import (
    CO_SIMULATION,
    MODEL_EXCHANGE,
    SCHEDULED_EXECUTION,
    Experiment,
    FmuDescription,
    FmuVariable,
    Interface,
    element_names,
)
from fmu_didim.components.fmu.versions.base import TRUE, DescriptionFile, Signatures
from fmu_didim.components.fmu.versions.display_units import DisplayUnits
from fmu_didim.data.units import BASE_UNITS, UnitDefinition

_OWNERS = {CO_SIMULATION: "Slave", MODEL_EXCHANGE: "Model"}


def _parsed(file: DescriptionFile, version: str) -> Any:
    import fmpy

    if file.version == version:
        # The file, not the folder: FMPy would also parse other XML files, unchecked.
        return fmpy.read_model_description(str(file.folder / DESCRIPTION), validate=False)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / DESCRIPTION
        root = deepcopy(file.root)
        root.set("fmiVersion", version)
        ET.ElementTree(root).write(copy, encoding="utf-8", xml_declaration=True)
        return fmpy.read_model_description(str(copy), validate=False)


def description(file: DescriptionFile, version: str, *, negated: frozenset[str] = frozenset()) -> FmuDescription:
    """The description, read by FMPy as of a version that it knows; interfaces and dependencies of FMI 2.0 and 3.0.

    Args:
        negated: names of the variables that are minus what their references mean.
    """
    own = _parsed(file, version)
    default = own.defaultExperiment
    stated = (default.startTime, default.stopTime, default.tolerance, default.stepSize) if default else ()
    displays = DisplayUnits.of(own, file.root)
    return FmuDescription(
        path=file.path,
        folder=file.folder,
        digest=file.digest,
        version=file.version,
        name=own.modelName or file.path.stem,
        token=own.guid or "",
        tool=own.generationTool or "",
        interfaces=tuple(_interfaces(own, file.root)),
        platforms=file.platforms,
        variables=tuple(_variable(v, v.name in negated, displays) for v in own.modelVariables if not _is_left_out(v)),
        state_count=own.numberOfContinuousStates,
        indicator_count=own.numberOfEventIndicators,
        experiment=Experiment(*(float(text) if text else None for text in stated)),
        units={u.name: _unit(u.baseUnit) for u in own.unitDefinitions if u.name and u.baseUnit is not None},
        dependencies=_dependencies(own) or None,
        states=_states(own),
    )


def _interfaces(own: Any, root: ET.Element) -> Iterator[Interface]:
    given = (
        (CO_SIMULATION, own.coSimulation, "CoSimulation"),
        (MODEL_EXCHANGE, own.modelExchange, "ModelExchange"),
        (SCHEDULED_EXECUTION, own.scheduledExecution, "ScheduledExecution"),
    )
    for kind, found, tag in given:
        if found is not None:
            element = root.find(tag)
            stated = element.attrib if element is not None else {}
            completed = kind == MODEL_EXCHANGE and found.needsCompletedIntegratorStep
            yield Interface(
                kind=kind,
                identifier=found.modelIdentifier or "",
                needs_execution_tool=found.needsExecutionTool,
                once_per_process=found.canBeInstantiatedOnlyOncePerProcess,
                has_state=found.canGetAndSetFMUstate,
                # FMPy knows the attribute by its name in FMI 2.0 only.
                has_derivatives=found.providesDirectionalDerivative
                or stated.get("providesDirectionalDerivatives") in TRUE,
                has_variable_step=bool(getattr(found, "canHandleVariableCommunicationStepSize", False)),
                needs_completed_step=completed,
                has_event_mode=stated.get("hasEventMode") in TRUE,
                may_return_early=stated.get("mightReturnEarlyFromDoStep") in TRUE,
                own_step=_positive(stated.get("fixedInternalStepSize")),
            )


def _is_left_out(variable: Any) -> bool:
    """Clocks, which are read elsewhere, and further names of an input (FMI 3.0): as inputs of their own, they would
    overwrite its value with their start value at each step."""
    return variable.type == "Clock" or (variable.alias is not None and variable.causality == "input")


def _dependencies(own: Any) -> dict[str, tuple[str, ...] | None]:
    """Output -> inputs that it depends on at once, under each of its names."""
    stated = {u.variable.name: _inputs(u.dependencies) for u in own.outputs}
    further = {v.name: stated[v.alias.name] for v in own.modelVariables if v.alias and v.alias.name in stated}
    return stated | further


def _positive(text: str | None) -> float | None:
    """A positive number in an attribute; None where there is none."""
    try:
        found = float(text or 0)
    except ValueError:
        return None
    return found if found > 0 and math.isfinite(found) else None


def _inputs(known: Any) -> tuple[str, ...] | None:
    """The inputs among the variables on which an output depends; states, which may be listed too, do not count."""
    return None if known is None else tuple(v.name for v in known if v.causality == "input")


def _states(own: Any) -> tuple[str, ...]:
    """The continuous states in the order of their derivatives; none where a derivative does not say whose it is, by its
    attribute or, as ``der(x)``, by its name."""
    by_name = {f"der({v.name})": v for v in own.modelVariables}
    derivatives = [unknown.variable for unknown in own.derivatives]
    found = [v.derivative if v.derivative is not None else by_name.get(v.name) for v in derivatives]
    if None in found:
        return ()
    return tuple(name for state in found if state for name in element_names(state.name, tuple(state.shape or ())))


def _variable(own: Any, negated: bool, displays: DisplayUnits) -> FmuVariable:
    unit = own.unit or (own.declaredType.unit if own.declaredType else "") or ""
    return FmuVariable(
        name=own.name,
        reference=int(own.valueReference),
        type=own.type,
        causality=own.causality or "local",
        variability=own.variability or "",
        initial=own.initial or "",
        unit=unit,
        start=own.start,
        shape=tuple(own.shape or ()),
        description=own.description or "",
        clocks=tuple(int(c.valueReference) for c in own.clocks or ()),
        negated=negated,
        display=displays.display(own, unit),
    )


def _unit(own: Any) -> UnitDefinition:
    return UnitDefinition(tuple(int(getattr(own, name)) for name in BASE_UNITS), float(own.factor), float(own.offset))


@cache
def signatures(kind: str, major: int) -> Signatures:
    """Argument and result types of the functions of FMI 2.0 or 3.0, from the annotations of FMPy's methods."""
    owner = getattr(import_module(f"fmpy.fmi{major}"), f"FMU{major}{_OWNERS[kind]}")
    found = {}
    for name, method in inspect.getmembers(owner, inspect.isfunction):
        if not name.startswith(f"fmi{major}"):
            continue
        signature = inspect.signature(method)
        annotations = [p.annotation for p in list(signature.parameters.values())[1:]]
        arguments = [typing.get_args(a)[0] if isinstance(a, types.UnionType) else a for a in annotations]
        stated = signature.return_annotation
        found[name] = (arguments, {bytes: ctypes.c_char_p, int: ctypes.c_int}.get(stated, stated))
    return found


def callbacks(prefix: str, log: Callable[..., None]) -> Any:
    """The structure of callback functions that an instance of FMI 1.0 or 2.0 is given; it must live as long."""
    structure, logger, allocate, free = _callback_parts(prefix)
    made = structure()
    made.logger, made.allocateMemory, made.freeMemory = logger(log), allocate, free
    return made


@cache
def _callback_parts(prefix: str) -> tuple[Any, Any, Any, Any]:
    """The type of the structure, that of a logger, and the functions for memory, which all instances share."""
    from fmpy import calloc, free

    module = import_module(f"fmpy.{prefix}")
    types = (getattr(module, f"{prefix}Callback{what}TYPE") for what in ("Logger", "AllocateMemory", "FreeMemory"))
    logger, allocate, free_type = types
    return getattr(module, f"{prefix}CallbackFunctions"), logger, allocate(calloc), free_type(free)


def bits_or_tuple() -> tuple[str, ...]:
    """Folders of binaries up to FMI 2.0: ``linux64``; for other processors than Intel's the tuple comes first."""
    import fmpy

    bits, pair = str(fmpy.platform), str(fmpy.platform_tuple)
    return (bits, pair) if pair.startswith("x86") else (pair, bits)


def platform_tuple() -> tuple[str, ...]:
    """The folder of binaries of FMI 3.0: ``x86_64-linux``."""
    import fmpy

    return (str(fmpy.platform_tuple),)
