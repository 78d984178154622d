"""How finely a loop is integrated: fewer substeps for a search, shorter ticks for stiff effects in the wiring."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import replace

import numpy as np

from fmu_didim.block import choose_substeps
from fmu_didim.components import Component
from fmu_didim.master import System

STABLE = 8
"""Substeps by the rule for the fastest rate, divided by this, are still stable: h rate <= 1.6, where RK4 bears 2.78.
What a case states is raised to that: an unstable simulation would be a minimum of its own, far from the truth."""


def refined(plant: Component, chosen: int | None, factor: int) -> Component:
    """The plant with the substeps that it states, raised to what is stable, times a factor.

    Args:
        chosen: substeps by the rule for its fastest rate; None where they are unknown or left to the plant.
    """
    stated = plant.stated_substeps
    if chosen is None:
        return plant
    count = factor * (chosen if stated is None else max(stated, chosen // STABLE))
    return plant if count == stated else plant.with_substeps(count) or plant


def coarsely(plant: Component, step: float, joints: int) -> Component:
    """The plant with as few substeps as keep it stable, h rate <= 1.6, unless their number was stated.

    In what hundreds of simulations search, an error of 1e-4 of the noise is nothing: the bound of the rate is that of
    friction at rest, which the motion hardly ever meets. States of its own (bristles, gears) a plant resolves as ever.

    Args:
        step: communication step, s; joints: n, of a plant with 2 n states.
    """
    known = plant.equations()
    if known is None:
        return plant
    block, stated = known
    if stated is not None or block.rate_bound is None or len(block.states) > 2 * joints:
        return plant
    p = block.parameter_values
    rate = float(block.rate_bound(block.start(np.zeros(len(block.inputs)), p), p))
    count = choose_substeps(rate, step, minimum=2 * STABLE) // STABLE
    return plant.with_substeps(count) or plant if np.isfinite(rate) else plant


def divided(system: System, plant: str, added: Set[str], subdivision: int) -> System:
    """The system with shorter ticks: the plant and what belongs to it step with them, all else as before.

    Args:
        plant: its name; added: names of the components of added effects; subdivision: ticks in a control period.
    """
    close = {plant, *(n for n in added if len(system.components[n].inputs) > 1)}
    every = {n: system.every.get(n, 1) * (1 if n in close else subdivision) for n in system.components}
    delays = {name: samples * subdivision for name, samples in system.delays.items()}
    return replace(system, step_size=system.step_size / subdivision, every=every, delays=delays)
