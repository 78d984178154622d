"""What a ``modelDescription.xml`` says, as far as it matters here."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from fmu_didim.components.fmu.archive import DESCRIPTION, check_description, open_archive
from fmu_didim.components.fmu.units import BASE_UNITS, UnitDefinition
from fmu_didim.errors import FmuError

CO_SIMULATION, MODEL_EXCHANGE, SCHEDULED_EXECUTION = "co-simulation", "model-exchange", "scheduled-execution"
REAL_TYPES = ("Real", "Float64")
INTEGER_TYPES = ("Integer", "Enumeration", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")
OPTION_TYPES = (*INTEGER_TYPES, "Boolean", "String")


@dataclass(frozen=True)
class FmuVariable:
    """A variable of an FMU.

    Attributes:
        type: as in the file: ``Real``, ``Float64``, ``Integer``, ...; reference: its value reference.
        variability, initial: as in FMI, defaults filled in.
        unit: the FMU's own unit, from the variable or its declared type.
        start: text of the start value, elements of an array separated by blanks; None if there is none.
        shape: sizes of the dimensions of an array, () for a scalar.
    """

    name: str
    reference: int
    type: str
    causality: str
    variability: str
    initial: str
    unit: str = ""
    start: str | None = None
    shape: tuple[int, ...] = ()
    description: str = ""

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)

    @property
    def is_settable(self) -> bool:
        """Whether it is a parameter that may be set before the initialisation."""
        return self.causality == "parameter" and self.variability in ("fixed", "tunable")

    def element_names(self) -> tuple[str, ...]:
        """Names of the elements in the order of FMI (last index fastest): ``x[1]``, ``A[2,1]``; a scalar's own."""
        if not self.shape:
            return (self.name,)
        places = product(*(range(1, n + 1) for n in self.shape))
        return tuple(f"{self.name}[{','.join(map(str, place))}]" for place in places)

    def starts(self, path: Path | str) -> tuple[float, ...]:
        """Start values of the elements, 0 where there is none; raises FmuError for what is no number."""
        try:
            numbers = [float(text) for text in (self.start or "").split()] or [0.0]
        except ValueError as error:
            where = f"{path}, variable '{self.name}'"
            raise FmuError("A start value in the FMU is no number.", where=where, got=self.start) from error
        return tuple(numbers) if len(numbers) == self.size else (numbers[0],) * self.size


@dataclass(frozen=True)
class Interface:
    """One of the ways in which an FMU can be run, with its capabilities as declared."""

    kind: str
    identifier: str
    needs_execution_tool: bool = False
    once_per_process: bool = False
    has_state: bool = False
    can_serialise_state: bool = False
    has_derivatives: bool = False
    has_variable_step: bool = False
    needs_completed_step: bool = True


@dataclass(frozen=True)
class Experiment:
    """Default experiment: times in s and tolerance, None where not given."""

    start: float | None = None
    stop: float | None = None
    tolerance: float | None = None
    step: float | None = None


@dataclass(frozen=True)
class FmuDescription:
    """An FMU as its file describes it; made by :func:`read_description`.

    Attributes:
        path: the ``.fmu`` file; folder: where it is extracted; digest: SHA-256 of the file.
        version: FMI version; token: GUID or instantiation token; tool: what generated it.
        platforms: folders of ``binaries/`` with at least one library.
        state_count, indicator_count: continuous states and event indicators.
        units: unit -> its definition, where the FMU has one.
    """

    path: Path
    folder: Path
    digest: str
    version: str
    name: str
    token: str
    tool: str
    interfaces: tuple[Interface, ...]
    platforms: tuple[str, ...]
    variables: tuple[FmuVariable, ...]
    state_count: int = 0
    indicator_count: int = 0
    experiment: Experiment = Experiment()
    units: Mapping[str, UnitDefinition] = field(default_factory=dict)

    @property
    def major(self) -> int:
        """2 or 3."""
        return int(self.version.partition(".")[0])

    def interface(self, kind: str) -> Interface | None:
        """The interface of this kind, if there is one."""
        return next((i for i in self.interfaces if i.kind == kind), None)

    def of_causality(self, causality: str, types: tuple[str, ...] = REAL_TYPES) -> tuple[FmuVariable, ...]:
        """The variables of a causality and of some types, in the order of the file."""
        return tuple(v for v in self.variables if v.causality == causality and v.type in types)


def read_description(path: Path | str) -> FmuDescription:
    """Read what an FMU says about itself, without loading its library. Its validation problems are not looked for.

    Raises:
        FmuError: the file is not a readable FMU, or of another FMI version than 2.0 and 3.0.
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
        return FmuDescription(
            path=path,
            folder=folder,
            digest=digest,
            version=own.fmiVersion,
            name=own.modelName or path.stem,
            token=own.guid or "",
            tool=own.generationTool or "",
            interfaces=tuple(_interfaces(own, root)),
            platforms=_platforms(folder),
            variables=tuple(_variable(v) for v in own.modelVariables),
            state_count=own.numberOfContinuousStates,
            indicator_count=own.numberOfEventIndicators,
            experiment=_experiment(own.defaultExperiment),
            units={u.name: _unit(u.baseUnit) for u in own.unitDefinitions if u.name and u.baseUnit is not None},
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
        kind = "co-simulation" if root.find("Implementation") is not None else "model exchange only"
        version = f"1.0, {kind}"
    elif root.tag == "fmiModelDescription" and (version == "2.0" or version.startswith("3.")):
        return root
    raise FmuError(
        "This FMI version is not supported.",
        where=str(path),
        got=version or f"no fmiVersion in <{root.tag}>",
        valid="2.0, 3.0",
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
            # FMPy knows the attribute by its name in FMI 2.0 only.
            plural = root.find(tag + "[@providesDirectionalDerivatives='true']") is not None
            completed = kind == MODEL_EXCHANGE and found.needsCompletedIntegratorStep
            yield Interface(
                kind=kind,
                identifier=found.modelIdentifier or "",
                needs_execution_tool=found.needsExecutionTool,
                once_per_process=found.canBeInstantiatedOnlyOncePerProcess,
                has_state=found.canGetAndSetFMUstate,
                can_serialise_state=found.canSerializeFMUstate,
                has_derivatives=plural or found.providesDirectionalDerivative,
                has_variable_step=bool(getattr(found, "canHandleVariableCommunicationStepSize", False)),
                needs_completed_step=completed,
            )


def _platforms(folder: Path) -> tuple[str, ...]:
    suffixes = (".so", ".dll", ".dylib")
    binaries = folder / "binaries"
    if not binaries.is_dir():
        return ()
    folders = [d for d in binaries.iterdir() if d.is_dir() and any(f.suffix in suffixes for f in d.iterdir())]
    return tuple(sorted(d.name for d in folders))


def _variable(own: Any) -> FmuVariable:
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
    )


def _experiment(own: Any) -> Experiment:
    def number(text: str | None) -> float | None:
        return float(text) if text else None

    if own is None:
        return Experiment()
    return Experiment(*(number(t) for t in (own.startTime, own.stopTime, own.tolerance, own.stepSize)))


def _unit(own: Any) -> UnitDefinition:
    return UnitDefinition(tuple(int(getattr(own, name)) for name in BASE_UNITS), float(own.factor), float(own.offset))
