"""The content of an SSD file as plain frozen data; read by :mod:`fmu_didim.ssp.parse`."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from fmu_didim.ssp.transform import Affine, Unit

SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
SSM = "http://ssp-standard.org/SSP1/SystemStructureParameterMapping"
PREFIXES = {"ssd": SSD, "ssc": SSC, "ssv": SSV, "ssm": SSM}
"""Of the standard; some tools use one in an inline part without declaring it."""
VERSIONS = ("1.0", "2.0")
"""Versions of the standard that are read, with their bug fixes: version 2.0 kept the namespaces of 1.0."""
NUMBERS = {"Real": "Real", "Float64": "Real", "Float32": "Real", "Integer": "Integer"} | {
    f"{sign}Int{bits}": "Integer" for sign in ("", "U") for bits in (8, 16, 32, 64)
}
"""Numeric types of connectors and values -> what they are here."""
STRUCTURE = "SystemStructure.ssd"
FMU_TYPE = "application/x-fmu-sharedlibrary"
INTERFACES = {"any": None, "CoSimulation": "co-simulation", "ModelExchange": "model-exchange"}
"""``implementation`` of a component -> interface of the FMU."""
LOOP_TYPE = "org.fmu-didim.loop"
LOOP = "urn:fmu-didim:loop:1"
"""Type of the annotation with what SSP cannot say, and the namespace of its content."""


STEPS = {"FixedStepAlgorithm": "baseStepSize", "FixedStepMaster": "initialStepSize"}
"""Elements in annotations of other tools (Open Simulation Platform, OMSimulator) -> their attribute with the step."""

Place = tuple[str, ...]
"""Names of the elements from the root system down; empty for the root system itself."""
Node = tuple[Place, str]
"""A connector of an element."""


@dataclass(frozen=True)
class Connector:
    """A connector of an element.

    Attributes:
        kind: ``input``, ``output``, ``parameter`` or ``calculatedParameter``; type: ``Real`` if not given.
        unit: that it states; own: that of the FMU's variable behind it, None for the connector of a system.
    """

    kind: str
    type: str
    unit: Unit | None
    own: Unit | None = None


@dataclass(frozen=True)
class Wire:
    """A connection between two connectors."""

    start: Node
    end: Node
    transformation: Affine
    suppress: bool
    where: str


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
class Element:
    """A system, or an FMU of the archive.

    Attributes:
        connectors: by their names; wires: those inside a system, in the order of the file.
        source: URI of the FMU; None for a system.
        interface: how the FMU is run, None if that is left open.
    """

    connectors: Mapping[str, Connector]
    bindings: tuple[Binding, ...]
    wires: tuple[Wire, ...] = ()
    source: str | None = None
    interface: str | None = None


@dataclass(frozen=True)
class Loop:
    """The part of a loop that SSP has no words for.

    Attributes:
        order: names of the components in the order of evaluation.
        delays: name -> delay of the inputs in samples.
        roles: (component, variable of the FMU) -> its name in the loop.
        jacobi: whether all components get the outputs of the last step.
        every, substeps, after_step, algebraic_loops: as in :class:`fmu_didim.cosim.System`.
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
    """A system structure description: its elements by place, its units, and the annotation of the loop if it has one.

    The components of a system come right after it, its inner systems after those.

    Attributes:
        step_size: communication step in s that another tool has noted; None if none has.
    """

    elements: Mapping[Place, Element]
    units: Mapping[str, Unit]
    loop: Loop | None
    step_size: float | None = None


def free_name(stem: str, suffix: str, taken: Iterable[str]) -> str:
    """``<stem><suffix>``, or ``<stem>_2<suffix>`` and so on where that is taken, capitals or not."""
    folded = {name.casefold() for name in taken}
    names = (stem + (f"_{count}" if count > 1 else "") + suffix for count in itertools.count(1))
    return next(name for name in names if name.casefold() not in folded)
