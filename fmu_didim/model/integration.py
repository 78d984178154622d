"""How finely a plant is integrated: its substeps in a control period, shorter ticks for stiff effects in the wiring.

What a case states holds, raised to what is stable. Otherwise a model has as many substeps as its data can resolve
(:func:`with_fitting_substeps`), or those of the rule for its fastest rate.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass, replace

from fmu_didim.components import Component
from fmu_didim.cosim import System
from fmu_didim.dynamics.block import Block, Steps, choose_substeps
from fmu_didim.dynamics.linearly_implicit import NAME

STABLE = 8
"""Substeps of RK4 by the rule for the fastest rate, divided by this, are still stable: h rate <= 1.6, where RK4 bears
2.78. What a case states is raised to that: an unstable simulation would be a minimum of its own, far from the truth."""


@dataclass(frozen=True)
class Integration:
    """How a plant is integrated: the name of the method, and its substeps in a communication step."""

    method: str
    substeps: int


def integration(plant: Component, step: float) -> Integration | None:
    """How a plant is integrated with this communication step (s); None where its equations are not known."""
    known = plant.equations()
    if known is None or known[0].step_rate is None:
        return None
    block, stated = known
    steps = block.automatic_steps(step) if stated is None else Steps(stated, block.implicit is None)
    return Integration("RK4" if steps.explicit else NAME, steps.count)


def stable_substeps(block: Block, step: float) -> int:
    """The fewest substeps in a communication step (s) that are stable, and resolve oscillations."""
    if block.implicit is not None:
        if block.implicit.resolves_all:
            return 1
        return choose_substeps(block.at_start(block.implicit.resolution), step, minimum=1)
    assert block.rate_bound is not None
    return choose_substeps(block.at_start(block.rate_bound), step, minimum=2 * STABLE) // STABLE


def refined(plant: Component, chosen: int | None, factor: int, step: float) -> Component:
    """The plant with the substeps that it states, raised to what is stable, times a factor.

    Args:
        chosen: substeps by the rule for its fastest rate; None where they are unknown or left to the plant.
        step: communication step, s.
    """
    if chosen is None:
        return plant
    stated = plant.stated_substeps
    if stated is None:
        count = chosen
    else:
        known = plant.equations()
        is_known = known is not None and known[0].rate_bound is not None
        count = max(stated, stable_substeps(known[0], step) if known is not None and is_known else chosen // STABLE)
    return plant if factor * count == stated else plant.with_substeps(factor * count) or plant


def searched(plant: Component, wanted: int, factor: int, step: float, joints: int) -> Component:
    """The plant with a wanted number of substeps, raised to what is stable, times a factor; as it is if it states one.

    Where RK4 integrates own states (bristles, gears), it still resolves them.

    Args:
        step: communication step, s; joints: n, of a plant with 2 n states.
    """
    known = None if plant.stated_substeps is not None else plant.equations()
    if known is None or known[0].rate_bound is None:
        return plant
    block = known[0]
    own = block.implicit is None and len(block.states) > 2 * joints
    fewest = block.automatic_substeps(step) if own else stable_substeps(block, step)
    return plant.with_substeps(factor * max(wanted, fewest)) or plant


def divided(system: System, plant: str, added: Set[str], subdivision: int) -> System:
    """The system with shorter ticks: the plant and what belongs to it step with them, all else as before.

    Args:
        plant: its name; added: names of the components of added effects; subdivision: ticks in a control period.
    """
    close = {plant, *(n for n in added if len(system.components[n].inputs) > 1)}
    every = {n: system.every.get(n, 1) * (1 if n in close else subdivision) for n in system.components}
    delays = {name: samples * subdivision for name, samples in system.delays.items()}
    return replace(system, step_size=system.step_size / subdivision, every=every, delays=delays)
