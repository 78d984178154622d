"""Settings of an FMU component: all that its instances, its trials and its own process need to know of it."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.components.base import Component, Instance, check_names
from fmu_didim.components.fmu.description import INTEGER_TYPES, REAL_TYPES, FmuDescription, Interface
from fmu_didim.components.fmu.units import Conversion
from fmu_didim.components.fmu.versions.base import FmiVersion
from fmu_didim.data.signals import Array, Variable, altered

DEFAULT_SUBSTEPS = 10
"""[1] Substeps of RK4 in a communication step, in model exchange."""
DEFAULT_TIME_LIMIT = 10.0
"""[s] Limit for one call of an isolated FMU."""
Option = int | float | str | bool
AUTO, RESET, STATE, AGAIN, PROCESS = "auto", "reset", "state", "re-instantiate", "fresh process"
STRATEGIES = (AUTO, RESET, STATE, AGAIN, PROCESS)
"""The ways to run an FMU again."""


@dataclass(frozen=True)
class Rerun:
    """How to run an FMU again, and why; isolated: only in a process of its own."""

    strategy: str
    reason: str
    isolated: bool = False


class RestartableInstance(Instance):
    """A running FMU in this process."""

    @abstractmethod
    def restart_by(self, strategy: str, component: FmuSettings) -> bool:
        """Become a new instance by reset or by the state of a new instance, all parameters at their start values.

        Returns:
            Whether that was possible; if not, nothing has been changed.
        """


@dataclass(frozen=True)
class Ports:
    """What follows from the variables of an FMU, whatever values they have.

    Attributes:
        inputs, outputs: their names; starts: (nu,) of the inputs.
        settable: names of all that :meth:`FmuSettings.with_parameters` sets.
        references: name of a parameter, option or start value -> value reference.
        converts_inputs, converts_outputs: whether the FMU's own unit of one is not the one shown.
        follows_at_once: pairs of an output and an input that it follows at once, by their names; None where that is not
            known.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    starts: Array
    settable: frozenset[str]
    references: Mapping[str, int]
    converts_inputs: bool
    converts_outputs: bool
    follows_at_once: frozenset[tuple[str, str]] | None


@dataclass(frozen=True)
class FmuSettings(Component):
    """An FMU with its settings and the places of its values; its subclass runs it.

    Attributes:
        fmi: the version that it is read as; fmu: its description, with the variables that matter in the loop.
        interface: how it is run.
        inputs, outputs, parameters: in SI where the FMU's unit is a multiple of an SI unit; inputs and outputs of
            integer and Boolean type are numbers too; elements of arrays are variables of their own: ``A[2,1]``.
        references: name of a parameter or option -> value reference; input_references, output_references: one a
            variable of the FMU, in its order. Inputs and outputs may have been given other names.
        start_values: of variables that are no parameters but have a start value that can be set, in the units shown.
        start_references: their value references.
        conversions: of inputs, outputs and parameters from the FMU's units.
        arrays: name of an element of an array parameter -> names of all its elements.
        option_types: Integer, Boolean, String and Enumeration parameters, and the accuracy that FMUs exported here have
            -> type; options: their values that were set.
        changed: names of the parameters and start values that were set.
        fixed: names of the parameters that cannot be changed in a run.
        state_starts: name of a parameter that is where a continuous state starts -> place of the state; it is set when
            the initialisation is over.
        solver, substeps, isolated, time_limit_s, rerun, event_mode: as for ``load_fmu``; isolated is None where the
            user does not say.
        tolerance: given to the FMU when a run is set up; None: no tolerance is given.
        reads_between: whether outputs that follow the inputs at once are read between inputs and step; if not, all are
            those after the last step.
    """

    fmi: FmiVersion = field(compare=False, repr=False)  # it follows from the description
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
    state_starts: Mapping[str, int] = field(default_factory=dict)
    sample_time: float | None = None
    has_derivatives: bool = False
    solver: str = "rk4"
    substeps: int | None = None
    isolated: bool | None = None
    time_limit_s: float = DEFAULT_TIME_LIMIT
    rerun: str = AUTO
    event_mode: bool = False
    tolerance: float | None = None
    reads_between: bool = True

    @property
    def is_own(self) -> bool:
        """Whether this package has exported it."""
        return self.fmu.is_own

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
        """Type of each input, one entry for each element of an array."""
        return self.fmu.input_types

    @cached_property
    def ports(self) -> Ports:
        """What follows from its variables alone: kept for all that are made of it with other values."""
        settable = (*(v.name for v in self.parameters), *self.option_types, *self.start_values)
        return Ports(
            tuple(v.name for v in self.inputs), tuple(v.name for v in self.outputs),
            np.array([v.start for v in self.inputs], dtype=float), frozenset(settable),
            {**self.start_references, **self.references},
            converts_inputs=not all(c.is_identity for c in self.input_conversions),
            converts_outputs=not all(c.is_identity for c in self.output_conversions),
            follows_at_once=self._follows_at_once(),
        )  # fmt: skip

    def _follows_at_once(self) -> frozenset[tuple[str, str]] | None:
        stated = self.fmu.dependencies
        if not self.reads_between:
            return frozenset()
        if stated is None:
            return None
        own_inputs = [v.name for v in self.fmu.of_causality("input") for _ in range(v.size)]
        own_outputs = [v.name for v in self.fmu.of_causality("output") for _ in range(v.size)]
        pairs = []
        for output, own in zip(self.outputs, own_outputs, strict=True):
            known = stated.get(own)  # an output that is not listed may depend on all inputs
            pairs += [
                (output.name, shown.name)
                for shown, name in zip(self.inputs, own_inputs, strict=True)
                if known is None or name in known
            ]
        return frozenset(pairs)

    def feedthrough(self) -> frozenset[tuple[str, str]] | None:
        return self.ports.follows_at_once

    def reference(self, name: str) -> int:
        """Value reference of a parameter or start value."""
        return self.ports.references[name]

    def parameter_conversion(self, name: str) -> Conversion:
        """From the FMU's own unit of a parameter or start value to the one shown."""
        return self.parameter_conversions.get(name, _AS_IT_IS)

    def with_parameters(self, values: Mapping[str, float]) -> Self:
        """Other values; Integer, Boolean and Enumeration parameters and start values may be among them.

        Raises:
            UnknownNameError: no parameter that can be set has this name.
        """
        options = {n: values[n] for n in self.option_types if n in values}
        values = {n: v for n, v in values.items() if n not in options} if options else values
        if not values.keys() <= self.ports.settable:
            starts = tuple(Variable(name) for name in self.start_values)
            check_names("parameter", values, (*self.parameters, *self._option_variables, *starts), where=str(self.path))
        parameters = tuple(
            [
                v if (x := values.get(v.name, v.start)) == v.start else altered(v, start=float(x))
                for v in self.parameters
            ]
        )
        start_values = self.start_values and {n: float(values.get(n, start)) for n, start in self.start_values.items()}
        known = self.changed if values.keys() <= self.changed else self.changed.union(values)
        changed = self.of_other_values(parameters=parameters, start_values=start_values, changed=known)
        return changed.with_options(options) if options else changed

    def of_other_values(self, **values: Any) -> Self:
        """The same FMU, of the same variables, with other values in these attributes: what follows from the variables
        alone is known of it, too, however often values change."""
        self.ports  # noqa: B018 - known from now on, of this one and of all that are made from it
        return altered(self, **values)

    def with_options(self, values: Mapping[str, Option]) -> Self:
        """Other values of Integer, Enumeration, Boolean and String parameters.

        Raises:
            UnknownNameError: there is no such parameter.
            InputError: a value does not fit its type.
        """
        check_names("option", values, self._option_variables, where=str(self.path))
        new = {name: _checked_option(name, self.option_types[name], v, self.path) for name, v in values.items()}
        return self.of_other_values(options={**self.options, **new})

    @cached_property
    def _option_variables(self) -> tuple[Variable, ...]:
        return tuple(Variable(name, causality="parameter") for name in self.option_types)

    @abstractmethod
    def instantiate_in_process(self, *, keep_new_state: bool = False) -> RestartableInstance:
        """A new running instance in this process; ``keep_new_state``: keep its state for the strategy ``state``."""

    @abstractmethod
    def find_rerun(self) -> Rerun:
        """How it is run again; tries it out, in another process, if that is not known yet."""


_AS_IT_IS = Conversion("")


def _checked_option(name: str, kind: str, value: Option, path: Path) -> Option:
    if kind == "String":
        fits = isinstance(value, str)
    elif kind in REAL_TYPES:
        fits = isinstance(value, int | float) and math.isfinite(value)
    elif kind == "Boolean":
        fits = not isinstance(value, str) and value in (0, 1)
    else:
        fits = not isinstance(value, str) and float(value).is_integer()
    if not fits:
        wanted = {"String": "text", "Boolean": "true, false"}.get(kind, "an integer")
        wanted = "a number" if kind in REAL_TYPES else wanted
        raise InputError(
            f"The parameter '{name}' is of type {kind}.", where=str(path), got=repr(value), valid=wanted,
            next_step="Give a value of this type.",
        )  # fmt: skip
    if kind == "Boolean":
        return bool(value)
    return int(value) if kind in INTEGER_TYPES else value
