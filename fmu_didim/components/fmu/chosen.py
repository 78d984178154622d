"""Variables of an FMU that are chosen beside those of its interface: outputs, and where its states start."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from functools import cache

from fmu_didim.components.fmu.component import FmuComponent
from fmu_didim.components.fmu.description import MODEL_EXCHANGE, PORT_TYPES, REAL_TYPES, FmuDescription, FmuVariable
from fmu_didim.components.fmu.load import scalars_of
from fmu_didim.components.fmu.reading import read_description
from fmu_didim.data.signals import Variable

SEEN = ("local", "output")
"""Causalities of variables that follow from the equations."""


@cache
def whole_description(path: str, digest: str) -> FmuDescription:
    """The description of an FMU with all its variables; ``digest``: of its content, which may change."""
    return read_description(path)


def all_variables(component: FmuComponent) -> tuple[FmuVariable, ...]:
    """All variables of the FMU, not only those that matter in a loop."""
    return whole_description(str(component.path), component.digest).variables


def visible(component: FmuComponent) -> dict[str, FmuVariable]:
    """Name -> variable of all that can be read as an output, element by element."""
    found = (v for v in all_variables(component) if v.causality in SEEN and v.type in PORT_TYPES and not v.clocks)
    return {name: v for v in found for name in v.element_names()}


def with_outputs_too(component: FmuComponent, names: Collection[str], *, si_units: bool) -> FmuComponent:
    """The FMU with these variables, all of :func:`visible`, behind its outputs; of an array all elements.

    Args:
        si_units: as of :func:`~fmu_didim.components.fmu.load.load_fmu`.
    """
    outputs, known = {v.name for v in component.outputs}, visible(component)
    missing = list(dict.fromkeys(known[name].name for name in names if name not in outputs))
    if not missing:
        return component
    by_name = {v.name: v for v in known.values()}
    more = tuple(replace(by_name[name], causality="output") for name in missing)
    kept = tuple(v for v in component.fmu.variables if v.name not in missing)
    pairs = [pair for v in more for pair in scalars_of(component.fmu, v, si_units=si_units)]
    states = set(component.fmu.states)
    # A state does not follow an input at once; what else does is not known.
    of_states: dict[str, tuple[str, ...] | None] = {v.name: () for v in more if set(v.element_names()) <= states}
    stated = component.fmu.dependencies
    return replace(
        component,
        fmu=replace(
            component.fmu,
            variables=(*kept, *more),
            dependencies={**(stated or {}), **of_states} if stated is not None or of_states else None,
        ),
        outputs=(*component.outputs, *(variable for variable, _ in pairs)),
        output_references=(*component.output_references, *(v.reference for v in more)),
        output_conversions=(*component.output_conversions, *(rule for _, rule in pairs)),
    )


def states_of(component: FmuComponent) -> dict[str, int]:
    """Name of each continuous state, and of each other name of it -> its place; empty where the FMU does not say."""
    places = {name: place for place, name in enumerate(component.fmu.states)}
    scalars = {v.name: v for v in all_variables(component) if not v.shape and v.type in REAL_TYPES}
    by_reference = {scalars[name].reference: place for name, place in places.items() if name in scalars}
    others = {n: by_reference[v.reference] for n, v in scalars.items() if v.reference in by_reference and not v.negated}
    return {**others, **places}


def with_start_value(component: FmuComponent, name: str, *, si_units: bool) -> FmuComponent | None:
    """The FMU with the start value of a variable among those that can be set, whatever its ``initial`` says; None where
    it has none."""
    if name in component.start_values:
        return component
    own = visible(component).get(name)
    if own is None or own.type not in REAL_TYPES or own.start is None or own.variability == "constant":
        return None
    pairs = scalars_of(component.fmu, own, si_units=si_units)
    names = own.element_names()
    rules = {v.name: rule for v, rule in pairs if not rule.is_identity}
    is_there = any(v.name == own.name for v in component.fmu.variables)
    return replace(
        component,
        fmu=component.fmu if is_there else replace(component.fmu, variables=(*component.fmu.variables, own)),
        start_values={**component.start_values, **{v.name: v.start for v, _ in pairs}},
        start_references={**component.start_references, **dict.fromkeys(names, own.reference)},
        parameter_conversions={**component.parameter_conversions, **rules},
        arrays={**component.arrays, **(dict.fromkeys(names, names) if own.shape else {})},
    )


def with_state_start(component: FmuComponent, key: str, name: str, value: float, *, si_units: bool) -> FmuComponent:
    """The FMU in model exchange with a parameter ``key`` that is where the state ``name`` starts."""
    assert component.interface.kind == MODEL_EXCHANGE
    own = next(v for v in all_variables(component) if name in v.element_names())
    shown, rule = next(pair for pair in scalars_of(component.fmu, own, si_units=si_units) if pair[0].name == name)
    rules = {} if rule.is_identity else {key: rule}
    return replace(
        component,
        parameters=(*component.parameters, Variable(key, shown.unit, "parameter", value, display=shown.display)),
        parameter_conversions={**component.parameter_conversions, **rules},
        fixed=component.fixed | {key},
        state_starts={**component.state_starts, key: states_of(component)[name]},
    )
