"""Components with one input and one output inserted into the wiring of a system.

The plant stays as it is, so that a vendor's black box gains a lag or a dead zone too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.components import Component
from fmu_didim.components.inserted import InsertedComponent, inserted_component
from fmu_didim.cosim.system import REFERENCE, Connection, System
from fmu_didim.dynamics.effects import JointType
from fmu_didim.dynamics.effects.inserted import InsertedEffect


def insert_before_input(
    system: System, name: str, component: Component, *, at: str, also: Mapping[str, str] = MappingProxyType({})
) -> System:
    """Insert a component into the connections that end at an input.

    All that went to ``at`` now goes, with its gains, to the component's input; the component's output goes to
    ``at`` with gain 1. It is evaluated right before the component that ``at`` belongs to, whose delay stays behind
    it. Of several components inserted at one input the newest lies nearest to it. ``System.replace`` exchanges the
    component.

    Args:
        system: the system; it stays as it is.
        name: of the component in the system; component: with exactly one output, and one input beside those of
            ``also``.
        at: ``component.input``.
        also: further inputs of the component -> ``component.output`` that feeds them, at the same instant.

    Raises:
        InputError: the component has other inputs or outputs, its name is taken, nothing ends at ``at``, or the
            system runs in parallel (Jacobi), where a component more is a sample of delay more.
        UnknownNameError: there is no such component, input or output.
    """
    inside, outside = _ports(system, name, component, also)
    target, _, variable = at.partition(".")
    _check_place(system, target, variable, kind="input")
    if not any(c.target == at for c in system.connections):
        raise InputError(
            "Nothing is connected to this input.", where=f"insertion of '{name}'", got=at,
            next_step="Insert it at an input that a connection ends in.",
        )  # fmt: skip
    moved = tuple(replace(c, target=inside) if c.target == at else c for c in system.connections)
    fed = (Connection(source, f"{name}.{own}") for own, source in also.items())
    return _with_component(system, name, component, (*moved, Connection(outside, at), *fed), before=target)


def insert_after_output(system: System, name: str, component: Component, *, of: str) -> System:
    """Insert a component behind an output: all that took ``of`` takes the component's output, with the same gains.

    It is evaluated right before the first component that takes its output. Of several components inserted behind
    one output the newest lies nearest to it.

    Raises:
        InputError, UnknownNameError: as :func:`insert_before_input`.
    """
    inside, outside = _ports(system, name, component)
    source, _, variable = of.partition(".")
    _check_place(system, source, variable, kind="output")
    takers = [c.target.partition(".")[0] for c in system.connections if c.source == of]
    if not takers:
        raise InputError(
            "Nothing is connected to this output.", where=f"insertion of '{name}'", got=of,
            next_step="Insert it behind an output that a connection begins at.",
        )  # fmt: skip
    moved = tuple(replace(c, source=outside) if c.source == of else c for c in system.connections)
    first = next(each for each in system.order if each in takers)
    return _with_component(system, name, component, (*moved, Connection(of, inside)), before=first)


def _ports(
    system: System, name: str, component: Component, also: Mapping[str, str] = MappingProxyType({})
) -> tuple[str, str]:
    """The input that is inserted, without those that are fed by others, and the output."""
    where = f"insertion of '{name}'"
    inputs = [v.name for v in component.inputs if v.name not in also]
    if len(inputs) != 1 or len(component.inputs) != 1 + len(also) or len(component.outputs) != 1:
        raise InputError(
            "Only a component with one input and one output can be inserted into a connection.", where=where,
            got=f"{len(component.inputs)} inputs, {len(component.outputs)} outputs",
            next_step="Insert a component for each connection, or connect this one in components: and connections:.",
        )  # fmt: skip
    if name in system.components or name == REFERENCE:
        raise InputError(
            "The system has a component of this name.", where=where, got=name, next_step="Give it another name."
        )
    if system.jacobi:
        raise InputError(
            "A component cannot be inserted into a loop that runs in parallel: it would add a sample of delay.",
            where=where,
            got="algorithm: jacobi",
            next_step="Use algorithm: gauss_seidel with the delay of the parallel loop (delay_samples: 1).",
        )
    return f"{name}.{inputs[0]}", f"{name}.{component.outputs[0].name}"


def _check_place(system: System, name: str, variable: str, *, kind: str) -> None:
    if name not in system.components:
        raise UnknownNameError("component", name, system.components, where="insertion")
    component = system.components[name]
    known = [v.name for v in (component.inputs if kind == "input" else component.outputs)]
    if variable not in known:
        raise UnknownNameError(kind, variable, known, where=f"insertion at component '{name}'")


def _with_component(
    system: System, name: str, component: Component, connections: tuple[Connection, ...], *, before: str
) -> System:
    place = system.order.index(before)
    return replace(
        system,
        components={**system.components, name: component},
        connections=connections,
        order=(*system.order[:place], name, *system.order[place:]),
    )


def insert_effect(
    system: System,
    effect: InsertedEffect,
    joint: int,
    joint_type: JointType,
    *,
    values: Mapping[str, float] | None = None,
    plant: str = "plant",
) -> System:
    """The system with an effect of a drive or a sensor at one joint, as the component ``<effect><joint>``.

    Effects of one drive lie in the order of their ranks, independent of the order in which they are added, so that
    :func:`logged_torque` knows where the torque log is taken.

    Args:
        joint: counted from 1; joint_type: its type.
        values: parameters by their plain names; the others are neutral.
        plant: name of the plant, with input ``tau<j>`` and output ``q<j>``; what else an effect takes, as ``dq<j>``,
            comes from its outputs, too.

    Raises:
        InputError: the joint has this effect, or the system has no place for it; the plant does not give what it
            depends on; it is computed for a constant control period, and that of the system changes.
    """
    name = f"{effect.name}{joint}"
    given = outputs_of(system, plant)
    fed = effect.fed_by(given, joint)
    if fed is None:
        raise InputError(
            "This effect depends on the velocity of its joint, and the plant gives neither that nor its position.",
            where=name, got=", ".join(given), valid=f"an output dq{joint} or q{joint}",
            next_step=f"Map the velocity (plant: {{outputs: {{dq{joint}: name in the plant}}}}), or leave the effect "
            "out.",
        )  # fmt: skip
    effect = fed
    if system.at_instants:
        check_period(effect, joint_type, name)
    component = inserted_component(effect, joint_type, system.step_size, values)
    if effect.place == "sensor":
        return insert_after_output(system, name, component, of=f"{plant}.q{joint}")
    at = f"{plant}.tau{joint}"
    for other, inside in _drive(system, at):
        if other.rank > effect.rank:
            at = inside
    also = {v.name: f"{plant}.{v.name}{joint}" for v in effect.inputs(joint_type)[1:]}
    return insert_before_input(system, name, component, at=at, also=also)


def outputs_of(system: System, name: str) -> dict[str, str]:
    """Name -> unit of the outputs of a component; nothing where the system lacks it."""
    return {v.name: v.unit for v in system.components[name].outputs} if name in system.components else {}


def check_period(effect: InsertedEffect, joint_type: JointType, name: str) -> None:
    """Raise InputError where an effect is computed for a constant control period, so that none may change."""
    if effect.depends_on_period(joint_type):
        raise InputError(
            "This effect is computed for a constant control period, and that of the loop changes.", where=name,
            got="instants of the controller", next_step="Leave the effect out, or use a part of the run at one rate, "
            "without instants: from_s, to_s.",
        )  # fmt: skip


def logged_torque(system: System, joint: int, *, plant: str = "plant") -> str:
    """The ``component.input`` whose value is the logged torque of a joint, counted from 1.

    That of the plant, or of the first effect in the drive that the log does not show.
    """
    at = f"{plant}.tau{joint}"
    for effect, inside in _drive(system, at):
        if effect.logged == "before":
            at = inside
    return at


def measured_output(system: System, signal: str) -> str:
    """The ``component.output`` that a sensor of a signal ``component.output`` shows: that of the signal itself, or of
    the effects of an encoder behind it, as the controller gets it."""
    while True:
        takers = [c.target.partition(".")[0] for c in system.connections if c.source == signal]
        sensors = [
            name for name in takers
            if isinstance(part := system.components[name], InsertedComponent)
            and part.effect is not None and part.effect.place == "sensor"
        ]  # fmt: skip
        if not sensors:
            return signal
        signal = f"{sensors[0]}.{system.components[sensors[0]].outputs[0].name}"


def _drive(system: System, at: str) -> Iterator[tuple[InsertedEffect, str]]:
    """The effects of the drive that ends at an input, from there backwards, each with the input of its component."""
    while True:
        sources = [c.source.partition(".")[0] for c in system.connections if c.target == at]
        component = system.components.get(sources[0]) if len(sources) == 1 else None
        if not isinstance(component, InsertedComponent) or component.effect is None:
            return
        at = f"{sources[0]}.{component.inputs[0].name}"
        yield component.effect, at
