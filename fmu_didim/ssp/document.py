"""What an SSD file says, as plain frozen data; read by :mod:`fmu_didim.ssp.parse`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fmu_didim.ssp.transform import Affine, Unit

SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
SSM = "http://ssp-standard.org/SSP1/SystemStructureParameterMapping"
STRUCTURE = "SystemStructure.ssd"
FMU_TYPE = "application/x-fmu-sharedlibrary"
INTERFACES = {"any": None, "CoSimulation": "co-simulation", "ModelExchange": "model-exchange"}
"""``implementation`` of a component -> interface of the FMU."""
LOOP_TYPE = "org.fmu-didim.loop"
LOOP = "urn:fmu-didim:loop:1"
"""Type of the annotation with what SSP cannot say, and the namespace of its content."""


@dataclass(frozen=True)
class Connector:
    """A connector: kind ``input``, ``output``, ``parameter`` or ``calculatedParameter``; type ``Real`` if not given."""

    name: str
    kind: str
    type: str
    unit: Unit | None


@dataclass(frozen=True)
class Link:
    """A connection inside one system; an element of None is the system itself."""

    start: tuple[str | None, str]
    end: tuple[str | None, str]
    transformation: Affine
    suppress: bool


@dataclass(frozen=True)
class Value:
    """One parameter of a parameter set."""

    name: str
    type: str
    text: str
    unit: Unit | None


@dataclass(frozen=True)
class MappingEntry:
    """Which value of a set goes where, and how it is transformed after its unit was converted."""

    source: str
    target: str
    transformation: Affine
    suppress: bool


@dataclass(frozen=True)
class Binding:
    """A parameter set bound to an element; without a mapping all values keep their names."""

    where: str
    prefix: str
    values: tuple[Value, ...]
    mapping: tuple[MappingEntry, ...] | None


@dataclass(frozen=True)
class ComponentElement:
    """An FMU of the archive; interface: how it is run, None if that is left open."""

    name: str
    source: str
    connectors: tuple[Connector, ...]
    bindings: tuple[Binding, ...]
    interface: str | None = None


@dataclass(frozen=True)
class SystemElement:
    """A system of components and systems."""

    name: str
    connectors: tuple[Connector, ...]
    bindings: tuple[Binding, ...]
    components: tuple[ComponentElement, ...]
    systems: tuple[SystemElement, ...]
    links: tuple[Link, ...]


@dataclass(frozen=True)
class Loop:
    """What SSP cannot say of a loop.

    Attributes:
        order: names of the components in the order of evaluation.
        delays: name -> delay of the inputs in samples.
        roles: (component, variable of the FMU) -> its name in the loop.
        jacobi: whether all components get the outputs of the last step.
        every, substeps, after_step, algebraic_loops: as in :class:`fmu_didim.master.System`.
        solvers: component in model exchange -> solver and its substeps, None for the default.
    """

    step_size: float
    order: tuple[str, ...]
    delays: Mapping[str, float] = field(default_factory=dict)
    roles: Mapping[tuple[str, str], str] = field(default_factory=dict)
    jacobi: bool = False
    every: Mapping[str, int] = field(default_factory=dict)
    substeps: Mapping[str, int] = field(default_factory=dict)
    after_step: frozenset[str] = frozenset()
    algebraic_loops: str = "refuse"
    solvers: Mapping[str, tuple[str, int | None]] = field(default_factory=dict)


@dataclass(frozen=True)
class Structure:
    """A system structure description: its root system, its units, and the annotation of the loop if it has one."""

    name: str
    system: SystemElement
    units: Mapping[str, Unit]
    loop: Loop | None
