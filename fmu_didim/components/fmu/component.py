"""FMUs as components."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from fmu_didim.block import Block
from fmu_didim.components.base import Component, Instance, check_names
from fmu_didim.components.fmu.description import (
    INTEGER_TYPES,
    MODEL_EXCHANGE,
    FmuDescription,
    Interface,
)
from fmu_didim.components.fmu.events import EventInstance
from fmu_didim.components.fmu.instance import CoSimulationInstance, FmuInstance
from fmu_didim.components.fmu.isolate import DEFAULT_TIME_LIMIT, IsolatedInstance
from fmu_didim.components.fmu.model_exchange import DEFAULT_SUBSTEPS, ModelExchangeInstance
from fmu_didim.components.fmu.rerun import AUTO, STATE, Rerun, find_rerun, known_rerun
from fmu_didim.components.fmu.units import Conversion
from fmu_didim.errors import InputError
from fmu_didim.signals import Variable

SUBSTEPS = "substeps"
"""Integer parameter of the FMUs that this framework exports; 0 means chosen automatically."""
Option = int | float | str | bool


@dataclass(frozen=True)
class FmuComponent(Component):
    """An FMU as a component; made by :func:`fmu_didim.components.fmu.load_fmu`.

    Attributes:
        fmu: its description, with the variables that matter in the loop; interface: how it is run.
        inputs, outputs, parameters: in SI where the FMU's unit is a multiple of an SI unit; inputs and outputs of
            integer and Boolean type are numbers too; elements of arrays are variables of their own: ``A[2,1]``.
        references: name of a parameter or option -> value reference; input_references, output_references: one a
            variable of the FMU, in its order. Inputs and outputs may have been given other names.
        start_values: of variables that are no parameters but have a start value that can be set, in the units shown.
        start_references: their value references.
        conversions: of inputs, outputs and parameters from the FMU's units.
        arrays: name of an element of an array parameter -> names of all its elements.
        option_types: Integer, Boolean, String and Enumeration parameters -> type; options: their values that were set.
        changed: names of the parameters and start values that were set.
        fixed: names of the parameters that cannot be changed in a run.
        solver, substeps: of model exchange.
        isolated: run in a process of its own; time_limit_s: for each call then.
        rerun: how it is run again: ``auto``, ``reset``, ``state``, ``re-instantiate`` or ``fresh process``.
        event_mode: handle events of FMI 3.0 co-simulation, clocks among them.
        block: the equations from which the FMU was built, if it was built here.
    """

    fmu: FmuDescription
    interface: Interface
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    parameters: tuple[Variable, ...]
    references: Mapping[str, int]
    input_references: tuple[int, ...]
    output_references: tuple[int, ...]
    input_conversions: tuple[Conversion, ...]
    output_conversions: tuple[Conversion, ...]
    parameter_conversions: Mapping[str, Conversion] = field(default_factory=dict)
    start_values: Mapping[str, float] = field(default_factory=dict)
    start_references: Mapping[str, int] = field(default_factory=dict)
    arrays: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    option_types: Mapping[str, str] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    changed: frozenset[str] = frozenset()
    fixed: frozenset[str] = frozenset()
    sample_time: float | None = None
    has_derivatives: bool = False
    solver: str = "rk4"
    substeps: int | None = None
    isolated: bool = False
    time_limit_s: float = DEFAULT_TIME_LIMIT
    rerun: str = AUTO
    event_mode: bool = False
    block: Block | None = field(default=None, compare=False, repr=False)

    @property
    def path(self) -> Path:
        """The ``.fmu`` file."""
        return self.fmu.path

    @property
    def digest(self) -> str:
        """SHA-256 of the file."""
        return self.fmu.digest

    @property
    def input_types(self) -> tuple[str, ...]:
        """Type of each input, elements of arrays apart."""
        return tuple(v.type for v in self.fmu.of_causality("input") for _ in range(v.size))

    def reference(self, name: str) -> int:
        """Value reference of a parameter or start value."""
        return self.references[name] if name in self.references else self.start_references[name]

    def parameter_conversion(self, name: str) -> Conversion:
        """From the FMU's own unit of a parameter or start value to the one shown."""
        return self.parameter_conversions.get(name, _AS_IT_IS)

    def with_parameters(self, values: Mapping[str, float]) -> FmuComponent:
        """Other values; Integer, Boolean and Enumeration parameters and start values may be among them.

        Raises:
            UnknownNameError: no parameter that can be set has this name.
        """
        options = {n: v for n, v in values.items() if n in self.option_types}
        values = {n: v for n, v in values.items() if n not in options}
        starts = tuple(Variable(name) for name in self.start_values)
        check_names("parameter", values, (*self.parameters, *self._option_variables, *starts), where=str(self.path))
        parameters = tuple(v.starting_at(float(values.get(v.name, v.start))) for v in self.parameters)
        start_values = {name: float(values.get(name, start)) for name, start in self.start_values.items()}
        changed = replace(self, parameters=parameters, start_values=start_values, changed=self.changed | set(values))
        return changed.with_options(options) if options else changed

    def with_options(self, values: Mapping[str, Option]) -> FmuComponent:
        """Other values of Integer, Enumeration, Boolean and String parameters.

        Raises:
            UnknownNameError: there is no such parameter.
            InputError: a value does not fit its type.
        """
        check_names("option", dict.fromkeys(values, 0.0), self._option_variables, where=str(self.path))
        new = {name: _checked_option(name, self.option_types[name], v, self.path) for name, v in values.items()}
        return replace(self, options={**self.options, **new})

    @cached_property
    def _option_variables(self) -> tuple[Variable, ...]:
        return tuple(Variable(name, causality="parameter") for name in self.option_types)

    def with_names(self, inputs: tuple[Variable, ...], outputs: tuple[Variable, ...]) -> FmuComponent:
        return replace(self, inputs=inputs, outputs=outputs)

    def with_substeps(self, count: int) -> FmuComponent | None:
        if self.interface.kind == MODEL_EXCHANGE:
            return replace(self, substeps=count) if self.solver == "rk4" else None
        if SUBSTEPS not in self.option_types:
            return None
        return replace(self, options={**self.options, SUBSTEPS: count})

    @property
    def stated_substeps(self) -> int | None:
        if self.interface.kind == MODEL_EXCHANGE:
            return self.substeps
        return int(self.options.get(SUBSTEPS, 0)) or None

    def pool_key(self) -> Hashable:
        names = (*(v.name for v in self.inputs), "", *(v.name for v in self.outputs))
        how = (self.interface.kind, self.solver, self.substeps, self.event_mode, self.rerun)
        where = (self.isolated, self.time_limit_s)
        return (self.digest, how, where, self.input_references, self.output_references, names)

    def instantiate(self) -> Instance:
        rerun = known_rerun(self)
        keep = rerun is not None and rerun.strategy == STATE
        if self.isolated or (rerun is not None and rerun.isolated):
            return IsolatedInstance(replace(self, isolated=False, block=None), self.time_limit_s, keep_new_state=keep)
        return self.instantiate_here(keep_new_state=keep)

    def instantiate_here(self, *, keep_new_state: bool = False) -> FmuInstance:
        """A new running instance in this process; ``keep_new_state`` if it shall be run again from that state."""
        if self.interface.kind == MODEL_EXCHANGE:
            return ModelExchangeInstance(self, keep_new_state=keep_new_state)
        if self.event_mode:
            return EventInstance(self, keep_new_state=keep_new_state)
        return CoSimulationInstance(self, keep_new_state=keep_new_state)

    def find_rerun(self) -> Rerun:
        """How it is run again; tries it out, in another process, if that is not known yet."""
        return find_rerun(self)

    def built_from(self, block: Block) -> FmuComponent:
        """The same FMU with what only the block tells: its sample time and its equations."""
        return replace(self, sample_time=block.sample_time, block=block)

    def equations(self) -> tuple[Block, int | None] | None:
        if self.block is None or self.interface.kind == MODEL_EXCHANGE or self.event_mode:
            return None
        if len(self.parameters) != len(self.block.parameters):
            return None  # a start value has become a parameter
        present = replace(self.block, inputs=self.inputs, outputs=self.outputs, parameters=self.parameters)
        return present, self.stated_substeps

    def feedthrough(self) -> frozenset[tuple[str, str]] | None:
        stated = self.fmu.dependencies
        if stated is None:
            return None
        own_inputs = [v.name for v in self.fmu.of_causality("input") for _ in range(v.size)]
        own_outputs = [v.name for v in self.fmu.of_causality("output") for _ in range(v.size)]
        pairs = []
        for output, own in zip(self.outputs, own_outputs, strict=True):
            known = stated.get(own)  # of an output that is not listed nothing is said: it may depend on all
            pairs += [
                (output.name, shown.name)
                for shown, name in zip(self.inputs, own_inputs, strict=True)
                if known is None or name in known
            ]
        return frozenset(pairs)

    def describe(self) -> dict[str, Any]:
        rerun = known_rerun(self) or Rerun(AUTO, "not found out yet: that is done before the first run again")
        told: dict[str, Any] = {
            "kind": "fmu",
            "file": self.path.name,
            "sha256": self.digest,
            "guid": self.fmu.token,
            "fmi_version": self.fmu.version,
            "interface": self.interface.kind,
            "reset": rerun.strategy,
            "reset_reason": rerun.reason,
            "options": dict(self.options),
        }
        if self.event_mode:
            told["event_mode"] = True
        if self.interface.kind == MODEL_EXCHANGE:
            told["solver"] = self.solver
            if self.solver == "rk4":
                told["substeps"] = self.substeps or DEFAULT_SUBSTEPS
        return told | ({"isolated": True} if self.isolated or rerun.isolated else {})


_AS_IT_IS = Conversion("")


def _checked_option(name: str, kind: str, value: Option, path: Path) -> Option:
    if kind == "String":
        fits = isinstance(value, str)
    elif kind == "Boolean":
        fits = not isinstance(value, str) and value in (0, 1)
    else:
        fits = not isinstance(value, str) and float(value).is_integer()
    if not fits:
        wanted = {"String": "text", "Boolean": "true, false"}.get(kind, "an integer")
        raise InputError(f"The parameter '{name}' is of type {kind}.", where=str(path), got=repr(value), valid=wanted)
    if kind == "Boolean":
        return bool(value)
    return int(value) if kind in INTEGER_TYPES else value
