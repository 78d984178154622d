"""The content of a ``modelDescription.xml``, as far as it is used here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from pathlib import Path

from fmu_didim.base.errors import FmuError
from fmu_didim.data.units import DisplayUnit, UnitDefinition

CO_SIMULATION, MODEL_EXCHANGE, SCHEDULED_EXECUTION = "co-simulation", "model-exchange", "scheduled-execution"
REAL_TYPES = ("Real", "Float64")
INTEGER_TYPES = ("Integer", "Enumeration", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")
OPTION_TYPES = (*INTEGER_TYPES, "Boolean", "String")
FLOAT_TYPES = (*REAL_TYPES, "Float32")
PORT_TYPES = (*FLOAT_TYPES, *INTEGER_TYPES, "Boolean")
"""Types of variables whose values pass through the loop as numbers."""
PERIODIC = ("constant", "fixed")
"""Variabilities of the interval of clocks that tick at instants known beforehand."""


def element_names(name: str, shape: Sequence[int]) -> tuple[str, ...]:
    """Names of the elements in the order of FMI (last index fastest): ``x[1]``, ``A[2,1]``; a scalar's own."""
    if not shape:
        return (name,)
    places = product(*(range(1, n + 1) for n in shape))
    return tuple(f"{name}[{','.join(map(str, place))}]" for place in places)


@dataclass(frozen=True)
class FmuVariable:
    """A variable of an FMU.

    Attributes:
        type: as in the file: ``Real``, ``Float64``, ``Integer``, ...; reference: its value reference.
        variability, initial: as in FMI, defaults filled in.
        unit: the FMU's own unit, from the variable or its declared type; display: in which its tool shows it.
        start: text of the start value, elements of an array separated by blanks; None if there is no start value.
        shape: sizes of the dimensions of an array, () for a scalar.
        clocks: value references of the clocks at whose ticks alone it has a value.
        negated: whether it is minus the variable that its reference means (FMI 1.0).
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
    clocks: tuple[int, ...] = ()
    negated: bool = False
    display: DisplayUnit | None = None

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)

    @property
    def is_settable(self) -> bool:
        """Whether it is a parameter that may be set before the initialisation."""
        return self.causality == "parameter" and self.variability in ("fixed", "tunable")

    @property
    def is_start_value(self) -> bool:
        """Whether it is no parameter, but its start value may be set before the initialisation.

        Some tools write the name of a parameter as start value, which then is to be set instead.
        """
        return (
            self.causality in ("local", "output")
            and self.variability != "constant"
            and self.initial == "exact"
            and not self.clocks
            and all(_is_number(text) for text in (self.start or "").split())
        )

    def element_names(self) -> tuple[str, ...]:
        """Names of the elements, as :func:`element_names` makes them."""
        return element_names(self.name, self.shape)

    def starts(self, path: Path | str) -> tuple[float, ...]:
        """Start values of the elements, 0 where there is no start value; raises FmuError for what is not a number."""
        try:
            words = {"true": "1", "false": "0"} if self.type == "Boolean" else {}
            numbers = [float(words.get(text, text)) for text in (self.start or "").split()] or [0.0]
        except ValueError as error:
            where = f"{path}, variable '{self.name}'"
            raise FmuError(
                "A start value in the FMU is not a number.", where=where, got=self.start,
                next_step="Give this variable another start value, or export the FMU again.",
            ) from error  # fmt: skip
        return tuple(numbers) if len(numbers) == self.size else (numbers[0],) * self.size


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _are_plain(variables: Iterable[FmuVariable]) -> bool:
    return all(v.type in REAL_TYPES and not v.clocks for v in variables)


@dataclass(frozen=True)
class ClockVariable:
    """A clock of FMI 3.0.

    Attributes:
        variability: of its interval: ``constant``, ``fixed``, ``tunable``, ``changing``, ``countdown``, ``triggered``.
        interval, shift: in s; None if the file gives no interval.
    """

    name: str
    reference: int
    causality: str
    variability: str
    interval: float | None = None
    shift: float = 0.0

    @property
    def is_periodic(self) -> bool:
        """Whether its ticks are known beforehand."""
        return self.variability in PERIODIC and self.interval is not None and self.interval > 0


@dataclass(frozen=True)
class Interface:
    """One of the ways in which an FMU can be run, with its capabilities as declared; ``own_step``: of a solver inside
    that has a fixed one, s (FMI 3.0)."""

    kind: str
    identifier: str
    needs_execution_tool: bool = False
    once_per_process: bool = False
    has_state: bool = False
    has_derivatives: bool = False
    has_variable_step: bool = False
    needs_completed_step: bool = True
    has_event_mode: bool = False
    may_return_early: bool = False
    own_step: float | None = None


@dataclass(frozen=True)
class Experiment:
    """Default experiment: times in s and tolerance, None where not given."""

    start: float | None = None
    stop: float | None = None
    tolerance: float | None = None
    step: float | None = None


OWN_TOOL = "fmu_didim "
"""Start of ``generationTool`` of the FMUs exported by this package; the tests prove that their reset is exact."""


@dataclass(frozen=True)
class FmuDescription:
    """An FMU as its file describes it; made by :func:`fmu_didim.components.fmu.reading.read_description`.

    Attributes:
        path: the ``.fmu`` file; folder: where it is extracted; digest: SHA-256 of the file.
        version: FMI version; token: GUID or instantiation token; tool: what generated it.
        platforms: folders of ``binaries/`` with at least one library.
        state_count, indicator_count: continuous states and event indicators.
        units: unit -> its definition, where the FMU has one.
        dependencies: output -> inputs that it depends on at once, None for all; None if the FMU states none.
        states: names of the continuous states, elements of arrays one by one, in the order of the state vector; empty
            where the file does not say.
        clocks: of FMI 3.0.
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
    dependencies: Mapping[str, tuple[str, ...] | None] | None = None
    clocks: tuple[ClockVariable, ...] = ()
    states: tuple[str, ...] = ()

    @cached_property
    def is_own(self) -> bool:
        """Whether this package has exported it."""
        return self.tool.startswith(OWN_TOOL)

    @property
    def major(self) -> int:
        """1, 2 or 3."""
        return int(self.version.partition(".")[0])

    def interface(self, kind: str) -> Interface | None:
        """The interface of this kind, if there is one."""
        return next((i for i in self.interfaces if i.kind == kind), None)

    def of_causality(self, causality: str, types: tuple[str, ...] = PORT_TYPES) -> tuple[FmuVariable, ...]:
        """The variables of a causality and of some types, in the order of the file."""
        key = (causality, types)
        if key not in self._found:
            self._found[key] = tuple(v for v in self.variables if v.causality == causality and v.type in types)
        return self._found[key]

    @cached_property
    def _found(self) -> dict[tuple[str, tuple[str, ...]], tuple[FmuVariable, ...]]:
        return {}

    @cached_property
    def has_plain_inputs(self) -> bool:
        """Whether one C call on the loop's own memory passes all inputs."""
        return _are_plain(self.of_causality("input"))

    @cached_property
    def has_plain_outputs(self) -> bool:
        """Whether one C call on the loop's own memory passes all outputs."""
        return _are_plain(self.of_causality("output"))

    @cached_property
    def input_references(self) -> tuple[int, ...]:
        """Value references of those inputs that have a value."""
        return tuple(v.reference for v in self.of_causality("input") if v.size)

    @cached_property
    def output_references(self) -> tuple[int, ...]:
        """Value references of those outputs that have a value."""
        return tuple(v.reference for v in self.of_causality("output") if v.size)

    @cached_property
    def input_types(self) -> tuple[str, ...]:
        """Type of each input, one entry for each element of an array."""
        return tuple(v.type for v in self.of_causality("input") for _ in range(v.size))

    @cached_property
    def output_types(self) -> tuple[str, ...]:
        """Type of each output, one entry for each element of an array."""
        return tuple(v.type for v in self.of_causality("output") for _ in range(v.size))

    @cached_property
    def resources(self) -> Path:
        """The folder ``resources`` as a whole path; not all FMUs have one."""
        return (self.folder / "resources").resolve()

    @cached_property
    def resources_uri(self) -> bytes:
        """The same as URI, as instances of FMI 2.0 are told it."""
        return self.resources.as_uri().encode()
