"""FMUs as components."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from fmu_didim.components.base import Component, Instance, check_names
from fmu_didim.components.fmu.description import (
    CO_SIMULATION,
    INTEGER_TYPES,
    MODEL_EXCHANGE,
    OPTION_TYPES,
    REAL_TYPES,
    FmuDescription,
    FmuVariable,
    Interface,
    read_description,
)
from fmu_didim.components.fmu.instance import CoSimulationInstance
from fmu_didim.components.fmu.isolate import DEFAULT_TIME_LIMIT, IsolatedInstance
from fmu_didim.components.fmu.library import library_file
from fmu_didim.components.fmu.model_exchange import DEFAULT_SUBSTEPS, ModelExchangeInstance
from fmu_didim.components.fmu.units import Conversion, conversion
from fmu_didim.errors import FmuError, InputError
from fmu_didim.signals import Variable

SUBSTEPS = "substeps"
"""Integer parameter of the FMUs that this framework exports; 0 means chosen automatically."""
RESET_STRATEGY = "a new instance for every run"
SOLVERS = ("rk4", "cvode")
Option = int | float | str | bool


@dataclass(frozen=True)
class FmuComponent(Component):
    """An FMU as a component; made by :func:`load_fmu`.

    Attributes:
        fmu: its description, with the variables that matter in the loop; interface: how it is run.
        inputs, outputs, parameters: in SI where the FMU's unit is a multiple of an SI unit; elements of arrays are
            variables of their own, ``x[1]``, ``A[2,1]``.
        references: name of a parameter or option -> value reference; input_references, output_references: one a
            variable of the FMU, in its order. Inputs and outputs may have been given other names.
        conversions: of inputs, outputs and parameters from the FMU's units.
        arrays: name of an element of an array parameter -> names of all its elements.
        option_types: Integer, Boolean, String and Enumeration parameters -> type; options: their values that were set.
        changed: names of the parameters whose values were set, in addition to the FMU's own start values.
        fixed: names of the parameters that cannot be changed in a run.
        solver, substeps: of model exchange.
        isolated: run in a process of its own; time_limit_s: for each call then.
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

    @property
    def path(self) -> Path:
        """The ``.fmu`` file."""
        return self.fmu.path

    @property
    def digest(self) -> str:
        """SHA-256 of the file."""
        return self.fmu.digest

    def parameter_conversion(self, name: str) -> Conversion:
        """From the FMU's own unit of a parameter to the one shown."""
        return self.parameter_conversions.get(name, _AS_IT_IS)

    def with_parameters(self, values: Mapping[str, float]) -> FmuComponent:
        """Other values; Integer, Boolean and Enumeration parameters may be among them.

        Raises:
            UnknownNameError: no parameter that can be set has this name.
        """
        options = {n: v for n, v in values.items() if n in self.option_types}
        values = {n: v for n, v in values.items() if n not in options}
        check_names("parameter", values, (*self.parameters, *self._option_variables), where=str(self.path))
        parameters = tuple(replace(v, start=float(values.get(v.name, v.start))) for v in self.parameters)
        changed = replace(self, parameters=parameters, changed=self.changed | set(values))
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

    def pool_key(self) -> Hashable:
        names = (*(v.name for v in self.inputs), "", *(v.name for v in self.outputs))
        how = (self.interface.kind, self.solver, self.substeps, self.isolated, self.time_limit_s)
        return (self.digest, how, self.input_references, self.output_references, names)

    def instantiate(self) -> Instance:
        if self.isolated:
            return IsolatedInstance(replace(self, isolated=False), self.time_limit_s)
        if self.interface.kind == CO_SIMULATION:
            return CoSimulationInstance(self)
        return ModelExchangeInstance(self)

    def describe(self) -> dict[str, Any]:
        told: dict[str, Any] = {
            "kind": "fmu",
            "file": self.path.name,
            "sha256": self.digest,
            "guid": self.fmu.token,
            "fmi_version": self.fmu.version,
            "interface": self.interface.kind,
            "reset": RESET_STRATEGY,
            "options": dict(self.options),
        }
        if self.interface.kind == MODEL_EXCHANGE:
            told["solver"] = self.solver
            if self.solver == "rk4":
                told["substeps"] = self.substeps or DEFAULT_SUBSTEPS
        return told | ({"isolated": True} if self.isolated else {})


_AS_IT_IS = Conversion("")


def load_fmu(
    path: Path | str,
    *,
    interface: str | None = None,
    solver: str = "rk4",
    substeps: int | None = None,
    si_units: bool = True,
    isolated: bool = False,
    time_limit_s: float = DEFAULT_TIME_LIMIT,
) -> FmuComponent:
    """Read an FMU of FMI 2.0 or 3.0; all its real inputs, outputs and parameters keep their names.

    Args:
        interface: ``co-simulation`` or ``model-exchange``; by default co-simulation if there is one.
        solver: of model exchange: ``rk4`` with equal substeps, or ``cvode`` (SUNDIALS, variable step).
        substeps: of ``rk4`` in a communication step, 10 by default.
        si_units: show values in SI where the FMU has multiples of SI units, such as deg, mm or rpm.
        isolated: run it in a process of its own, which a crash or an endless loop of the FMU ends, and not this one.
        time_limit_s: for each call of an isolated FMU.

    Raises:
        FmuError: the file is not such an FMU, or holds no binary for this platform.
        InputError: an option is not valid.
    """
    if interface not in (None, CO_SIMULATION, MODEL_EXCHANGE):
        raise InputError("This interface is not known.", got=interface, valid=(CO_SIMULATION, MODEL_EXCHANGE))
    if solver not in SOLVERS:
        raise InputError("This solver is not known.", got=solver, valid=SOLVERS)
    if substeps is not None and substeps < 1:
        raise InputError("The number of substeps must be positive.", got=substeps)
    if time_limit_s <= 0:
        raise InputError("The time limit must be positive.", got=time_limit_s)
    fmu = read_description(path)
    chosen = _interface(fmu, interface)
    library_file(fmu, chosen)
    component = _component(fmu, chosen, si_units=si_units)
    component = replace(component, solver=solver, isolated=isolated, time_limit_s=float(time_limit_s))
    return component if substeps is None else component.with_substeps(substeps) or component


def _interface(fmu: FmuDescription, wanted: str | None) -> Interface:
    for kind in (wanted,) if wanted else (CO_SIMULATION, MODEL_EXCHANGE):
        found = fmu.interface(kind)
        if found is not None:
            return found
    kinds = [i.kind for i in fmu.interfaces]
    what = f"The FMU has no {wanted} interface." if wanted else "The FMU has no interface that can run in a loop."
    raise FmuError(
        what,
        where=str(fmu.path),
        got=f"{', '.join(kinds)} only" if kinds else "no interface at all",
        valid=(CO_SIMULATION, MODEL_EXCHANGE),
        next_step="Export it for co-simulation or model exchange.",
    )


def _component(fmu: FmuDescription, interface: Interface, *, si_units: bool) -> FmuComponent:
    def scalars(own: FmuVariable) -> list[tuple[Variable, Conversion]]:
        rule = conversion(own.unit, fmu.units) if si_units else Conversion(own.unit)
        values = zip(own.element_names(), own.starts(fmu.path), strict=True)
        return [
            (Variable(name, rule.unit, own.causality, rule.to_shown(start), own.description), rule)
            for name, start in values
        ]

    groups = {c: fmu.of_causality(c) for c in ("input", "output")}
    real = [v for v in fmu.variables if v.type in REAL_TYPES and v.is_settable]
    options = [v for v in fmu.variables if v.type in OPTION_TYPES and v.is_settable and not v.shape]
    pairs = {c: [p for v in group for p in scalars(v)] for c, group in {**groups, "parameter": tuple(real)}.items()}
    references = {v.name: v.reference for v in options}
    references |= {name: v.reference for v in real for name in v.element_names()}
    kept = (*groups["input"], *groups["output"], *real, *options)
    return FmuComponent(
        fmu=replace(fmu, variables=kept),
        interface=interface,
        inputs=tuple(v for v, _ in pairs["input"]),
        outputs=tuple(v for v, _ in pairs["output"]),
        parameters=tuple(v for v, _ in pairs["parameter"]),
        references=references,
        input_references=tuple(v.reference for v in groups["input"]),
        output_references=tuple(v.reference for v in groups["output"]),
        input_conversions=tuple(c for _, c in pairs["input"]),
        output_conversions=tuple(c for _, c in pairs["output"]),
        parameter_conversions={v.name: c for v, c in pairs["parameter"] if not c.is_identity},
        arrays={name: v.element_names() for v in real if v.shape for name in v.element_names()},
        option_types={v.name: v.type for v in options},
        fixed=frozenset(name for v in real if v.variability == "fixed" for name in v.element_names()),
        has_derivatives=interface.has_derivatives and not any(v.shape for v in kept),
    )


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
