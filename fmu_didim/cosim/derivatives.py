"""A loop with the derivatives of all its signals by parameters of its components."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from fmu_didim.base.errors import BuildError
from fmu_didim.components.derivatives import VariationalComponent, derivative_name
from fmu_didim.cosim.system import REFERENCE, Connection, System
from fmu_didim.data.signals import altered
from fmu_didim.dynamics.block import Block
from fmu_didim.export.variational import lane_count


def with_derivatives(
    system: System, parameters: Sequence[tuple[str, str]], observed: Sequence[str] = ()
) -> System | None:
    """The loop whose signals are followed by their derivatives (``plant.q1``, then ``plant.q1@0``, ...).

    Args:
        system: the loop, one that compiled code runs.
        parameters: what is differentiated by, (component, name of its parameter) each.
        observed: outputs (``component.output``) whose derivatives are wanted though nothing in the loop takes them.

    Returns:
        The loop, with the same names; None where a component has no equations that can be differentiated, such as
        the FMU of another tool.
    """
    count, found = len(parameters), {}
    sources = {c.source for c in system.connections} | set(observed)
    for name in system.order:
        known = system.components[name].equations()
        if known is None or not _can_differentiate(system, name, known[0]):
            return None
        block, substeps = known
        followed = tuple(i for i, v in enumerate(block.outputs) if f"{name}.{v.name}" in sources)
        places = [v.name for v in block.parameters]
        own = {lane: parameter for lane, (owner, parameter) in enumerate(parameters) if owner == name}
        if any(parameter not in places for parameter in own.values()):
            return None
        lanes = tuple((lane, places.index(parameter)) for lane, parameter in own.items())
        found[name] = VariationalComponent(block, substeps, lanes, count, followed)
    if sum(len(component.differentiated) for component in found.values()) < count:
        return None
    key = (tuple(parameters), tuple(observed))
    if known_system := _of_other_values(system.varied.get(key), found):
        return known_system
    try:
        for component in found.values():
            component.library()
    except BuildError:
        return None
    wires = [
        Connection(derivative_name(c.source, i), derivative_name(c.target, i), c.gain)
        for c in system.connections
        if not c.source.startswith(f"{REFERENCE}.")
        for i in range(lane_count(count))
    ]
    # Without derivatives the loop ran, so it holds no algebraic loop.
    system.varied[key] = replace(
        system, components=found, connections=(*system.connections, *wires), algebraic_loops="previous"
    )  # fmt: skip
    return system.varied[key]


def _of_other_values(varied: System | None, wanted: Mapping[str, VariationalComponent]) -> System | None:
    """A system with derivatives with the values of other components, wired as it is; None where these are not of the
    same equations and variables."""
    if varied is None:
        return None
    for name, component in wanted.items():
        present = varied.components[name]
        if not (isinstance(present, VariationalComponent) and present.has_equations_of(component)):
            return None
        varied = varied.replace(name, altered(present, block=component.block, substeps=component.substeps))
    return varied


def _can_differentiate(system: System, name: str, block: Block) -> bool:
    """Whether the equations are of scalar expressions, and a sampled block samples once in each of its steps."""
    functions = (block.update, block.output, block.start, block.rate_bound)
    if not all(f is None or f.is_a("SXFunction") for f in functions):
        return False
    if block.sample_time is None:
        return True
    period = system.step_size * system.every.get(name, 1)
    fraction = system.delays.get(name, 0.0) % 1.0
    return abs(block.sample_time - period) <= 1e-6 * period and system.substeps.get(name, 1) == 1 and not fraction
