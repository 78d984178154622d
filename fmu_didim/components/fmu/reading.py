"""Reads ``modelDescription.xml`` of FMI 1.0, 2.0 and 3.0."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from fmu_didim.components.fmu.archive import DESCRIPTION, check_description, open_archive
from fmu_didim.components.fmu.description import (
    CO_SIMULATION,
    MODEL_EXCHANGE,
    SCHEDULED_EXECUTION,
    ClockVariable,
    Experiment,
    FmuDescription,
    FmuVariable,
    Interface,
)
from fmu_didim.errors import FmuError
from fmu_didim.units import BASE_UNITS, UnitDefinition

_TRUE = ("true", "1")


def read_description(path: Path | str) -> FmuDescription:
    """Read what an FMU says about itself, without loading its library. Its validation problems are not looked for.

    Raises:
        FmuError: the file is not a readable FMU, or neither FMI 2.0, 3.0 nor co-simulation of FMI 1.0.
    """
    import fmpy

    path = Path(path)
    folder, digest = open_archive(path)
    file = folder / DESCRIPTION
    content = file.read_bytes()
    check_description(content, path)
    root = _checked_root(content, path)
    try:
        # The file, not the folder: FMPy would also parse other XML files, unchecked.
        own = fmpy.read_model_description(str(file), validate=False)
        first = own.fmiVersion == "1.0"
        negated = _negated(root) if first else frozenset()
        return FmuDescription(
            path=path,
            folder=folder,
            digest=digest,
            version=own.fmiVersion,
            name=own.modelName or path.stem,
            token=own.guid or "",
            tool=own.generationTool or "",
            interfaces=(_interface_1(root),) if first else tuple(_interfaces(own, root)),
            platforms=_platforms(folder),
            variables=tuple(_variable(v, v.name in negated) for v in own.modelVariables if v.type != "Clock"),
            state_count=own.numberOfContinuousStates,
            indicator_count=own.numberOfEventIndicators,
            experiment=_experiment(own.defaultExperiment),
            units={u.name: _unit(u.baseUnit) for u in own.unitDefinitions if u.name and u.baseUnit is not None},
            dependencies=_dependencies_1(root) if first else _dependencies(own),
            clocks=tuple(_clock(e) for e in root.iterfind("ModelVariables/Clock")),
        )
    except Exception as error:
        raise _unreadable(path, f"{type(error).__name__}: {error}") from error


def _unreadable(path: Path, got: str) -> FmuError:
    return FmuError(f"The file is not a readable FMU: its {DESCRIPTION} is wrong.", where=str(path), got=got)


def _checked_root(content: bytes, path: Path) -> ET.Element:
    try:
        root = ET.fromstring(content)
    except (ET.ParseError, ValueError, LookupError) as error:
        raise _unreadable(path, str(error)) from error
    version = root.get("fmiVersion", "")
    if version == "1.0":
        if root.find("Implementation") is not None:
            return root
        version = "1.0, model exchange only"
    elif root.tag == "fmiModelDescription" and (version == "2.0" or version.startswith("3.")):
        return root
    raise FmuError(
        "This FMI version is not supported.",
        where=str(path),
        got=version or f"no fmiVersion in <{root.tag}>",
        valid="2.0, 3.0, and 1.0 for co-simulation",
        next_step="Export the FMU again for FMI 2.0 or 3.0.",
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
                can_serialise_state=found.canSerializeFMUstate,
                # FMPy knows the attribute by its name in FMI 2.0 only.
                has_derivatives=found.providesDirectionalDerivative
                or stated.get("providesDirectionalDerivatives") in _TRUE,
                has_variable_step=bool(getattr(found, "canHandleVariableCommunicationStepSize", False)),
                needs_completed_step=completed,
                has_event_mode=stated.get("hasEventMode") in _TRUE,
                may_return_early=stated.get("mightReturnEarlyFromDoStep") in _TRUE,
            )


def _interface_1(root: ET.Element) -> Interface:
    """Co-simulation of FMI 1.0, section 3.3 of "FMI for Co-Simulation", version 1.0."""
    tool = root.find("Implementation/CoSimulation_Tool")
    able = root.find("Implementation/*/Capabilities")
    stated = able.attrib if able is not None else {}
    return Interface(
        kind=CO_SIMULATION,
        identifier=root.get("modelIdentifier", ""),
        needs_execution_tool=tool is not None,
        once_per_process=stated.get("canBeInstantiatedOnlyOncePerProcess") in _TRUE,
        has_variable_step=stated.get("canHandleVariableCommunicationStepSize") in _TRUE,
    )


def _platforms(folder: Path) -> tuple[str, ...]:
    suffixes = (".so", ".dll", ".dylib")
    binaries = folder / "binaries"
    if not binaries.is_dir():
        return ()
    folders = [d for d in binaries.iterdir() if d.is_dir() and any(f.suffix in suffixes for f in d.iterdir())]
    return tuple(sorted(d.name for d in folders))


def _variable(own: Any, negated: bool) -> FmuVariable:
    return FmuVariable(
        name=own.name,
        reference=int(own.valueReference),
        type=own.type,
        causality=own.causality or "local",
        variability=own.variability or "",
        initial=own.initial or "",
        unit=own.unit or (own.declaredType.unit if own.declaredType else "") or "",
        start=own.start,
        shape=tuple(own.shape or ()),
        description=own.description or "",
        clocks=tuple(int(c.valueReference) for c in own.clocks or ()),
        negated=negated,
    )


def _clock(element: ET.Element) -> ClockVariable:
    """Interval and shift in s, as decimals or as counters of a resolution."""
    resolution = float(element.get("resolution") or 1)

    def seconds(what: str) -> float | None:
        if element.get(f"{what}Decimal") is not None:
            return float(element.attrib[f"{what}Decimal"])
        counter = element.get(f"{what}Counter")
        return None if counter is None else int(counter) / resolution

    return ClockVariable(
        name=element.attrib["name"],
        reference=int(element.attrib["valueReference"]),
        causality=element.get("causality", "local"),
        variability=element.get("intervalVariability", ""),
        interval=seconds("interval"),
        shift=seconds("shift") or 0.0,
    )


def _dependencies(own: Any) -> dict[str, tuple[str, ...] | None] | None:
    """Inputs on which each output depends; states, which may be listed too, do not count."""
    if not own.outputs:
        return None
    found: dict[str, tuple[str, ...] | None] = {}
    for unknown in own.outputs:
        known = unknown.dependencies
        inputs = None if known is None else tuple(v.name for v in known if v.causality == "input")
        found[unknown.variable.name] = inputs
    return found


def _dependencies_1(root: ET.Element) -> dict[str, tuple[str, ...] | None]:
    found: dict[str, tuple[str, ...] | None] = {}
    for variable in root.iterfind("ModelVariables/ScalarVariable[@causality='output']"):
        stated = variable.find("DirectDependency")
        found[variable.attrib["name"]] = (
            None if stated is None else tuple(e.text or "" for e in stated.iterfind("Name"))
        )
    return found


def _negated(root: ET.Element) -> frozenset[str]:
    found = root.iterfind("ModelVariables/ScalarVariable[@alias='negatedAlias']")
    return frozenset(e.attrib["name"] for e in found)


def _experiment(own: Any) -> Experiment:
    def number(text: str | None) -> float | None:
        return float(text) if text else None

    if own is None:
        return Experiment()
    return Experiment(*(number(t) for t in (own.startTime, own.stopTime, own.tolerance, own.stepSize)))


def _unit(own: Any) -> UnitDefinition:
    return UnitDefinition(tuple(int(getattr(own, name)) for name in BASE_UNITS), float(own.factor), float(own.offset))
