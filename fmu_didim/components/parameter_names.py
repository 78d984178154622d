"""Other names for the parameters of a component, as a vendor's plant needs them.

The names are changed in the description of the component, so that nothing is translated while it runs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from fmu_didim.base.errors import InputError
from fmu_didim.components.base import Component, check_names
from fmu_didim.components.block_control import to_control
from fmu_didim.components.control import ControlComponent
from fmu_didim.components.fmu import FmuComponent
from fmu_didim.components.model import ModelComponent
from fmu_didim.data.signals import Array, Variable
from fmu_didim.dynamics.block import Block

Value = TypeVar("Value")
WHERE = "parameter_names"


def name_parameters(component: Component, names: Mapping[str, str]) -> Component:
    """The same component whose parameters have other names.

    A start value of a state of an FMU (a variable with ``initial="exact"`` that is no parameter) may be named too; it
    is a parameter then, which only acts before the run.

    Args:
        names: new name -> own name. Other parameters keep theirs.

    Raises:
        UnknownNameError: the component has no parameter of that own name.
        InputError: two parameters would have the same name, or the parameters of this kind of component cannot be
            renamed.
    """
    if not names:
        return component
    if isinstance(component, FmuComponent):
        return _fmu(component, names)
    if isinstance(component, ModelComponent):
        renamed = _variables(component.parameters, names)
        twin = None if component.twin is None else name_parameters(component.twin, names)
        return replace(component, block=_block(component.block, renamed, names), twin=twin)
    if isinstance(component, ControlComponent):
        renamed = _variables(component.parameters, names)
        if component.block is not None:
            block = _block(component.block, renamed, names)
            return replace(component, block=block, system=to_control(block), parameters=renamed)
        new = {v.name: other.name for v, other in zip(component.parameters, renamed, strict=True)}
        starts = tuple(new[name] for name in component.state_parameters)
        own = {role: name for role, name in names.items() if name not in component.state_parameters}
        system = _control_system(component.system, own) if own else component.system
        return replace(component, system=system, parameters=renamed, state_parameters=starts)
    raise InputError(
        "The parameters of this component cannot be renamed.", where=WHERE, got=component.describe().get("kind"),
        valid="fmu, model, control", next_step="Take the names that the component has.",
    )  # fmt: skip


def _new_names(own: Iterable[str], names: Mapping[str, str]) -> dict[str, str]:
    """Own name -> new name for all; raises if one does not exist or two become the same."""
    own = list(own)
    check_names("parameter", names.values(), [Variable(name) for name in own], where=WHERE)
    back = {name: role for role, name in names.items()}
    if len(back) < len(names):
        doubled = [name for name, count in Counter(names.values()).items() if count > 1]
        raise InputError(
            "A parameter is named twice.", where=WHERE, got=", ".join(doubled),
            next_step="Give each parameter a name of its own.",
        )  # fmt: skip
    new = {name: back.get(name, name) for name in own}
    clashes = [name for name, count in Counter(new.values()).items() if count > 1]
    if clashes:
        raise InputError(
            "The component has another parameter of this name already.", where=WHERE, got=", ".join(clashes),
            next_step="Give that one another name too.",
        )  # fmt: skip
    return new


def _variables(variables: tuple[Variable, ...], names: Mapping[str, str]) -> tuple[Variable, ...]:
    new = _new_names((v.name for v in variables), names)
    return tuple(replace(v, name=new[v.name]) for v in variables)


def _block(block: Block, renamed: tuple[Variable, ...], names: Mapping[str, str]) -> Block:
    back = {name: role for role, name in names.items()}
    return replace(block, parameters=renamed, fixed=frozenset(back.get(name, name) for name in block.fixed))


def _fmu(component: FmuComponent, names: Mapping[str, str]) -> FmuComponent:
    own = [v.name for v in component.parameters]
    starts = [name for name in component.start_values if name in names.values()]
    options = list(component.option_types)
    new = _new_names(dict.fromkeys((*own, *component.start_values, *options)), names)

    def keys(table: Mapping[str, Value]) -> dict[str, Value]:
        return {new[name]: value for name, value in table.items()}

    def promoted_from(name: str) -> Variable:
        own, rule = (
            next(v for v in component.fmu.variables if name in v.element_names()),
            component.parameter_conversion(name),
        )
        display = own.display if rule.is_identity else None
        return Variable(name, rule.unit or own.unit, "parameter", component.start_values[name], display=display)

    # A start value that was given a name is a parameter from here on, one that cannot change in a run.
    promoted = [promoted_from(name) for name in starts]
    return replace(
        component,
        parameters=tuple(replace(v, name=new[v.name]) for v in (*component.parameters, *promoted)),
        references=keys({**component.references, **{name: component.start_references[name] for name in starts}}),
        parameter_conversions=keys(component.parameter_conversions),
        start_values=keys({n: v for n, v in component.start_values.items() if n not in starts}),
        start_references=keys({n: r for n, r in component.start_references.items() if n not in starts}),
        arrays={new[name]: tuple(new[n] for n in members) for name, members in component.arrays.items()},
        option_types=keys(component.option_types),
        options=keys(component.options),
        changed=frozenset(new[name] for name in component.changed),
        fixed=frozenset(new[name] for name in (*component.fixed, *starts)),
    )


@dataclass(frozen=True)
class _Translated:
    """A function of a python-control system that takes its parameters by their new names."""

    function: Callable[..., Any]
    own: Mapping[str, str]

    def __call__(self, time: float, state: Array, inputs: Array, params: Mapping[str, Any]) -> Any:
        values = {self.own.get(name, name): value for name, value in params.items()}
        return self.function(time, state, inputs, params=values)


def _control_system(system: Any, names: Mapping[str, str]) -> Any:
    import control

    back = {name: role for role, name in names.items()}
    return control.nlsys(
        _Translated(system.dynamics, names) if system.nstates else None,
        _Translated(system.output, names),
        inputs=system.input_labels, outputs=system.output_labels, states=system.state_labels, dt=system.dt,
        name=system.name, params={back.get(name, name): value for name, value in system.params.items()},
    )  # fmt: skip
