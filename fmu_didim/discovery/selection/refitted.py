"""Smoothing of friction that the robot description states and the data contradict: a finding like any other.

The base model frees the smoothing velocity v0 of each joint's Coulomb friction, so that its error is not taken for
another effect. Where the model with the stated one explains the data worse by as much as a missing effect would, that
is what the model lacks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.selection.decide import Options
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import bic_gain, explained_gap
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.fit.solver.termination import Stopping
from fmu_didim.model.free_parameter import PLANT, FreeParameter

LOOKED_AT = 3.0
"""[standard deviations] By which a fitted value must differ from the stated one for a model with that to be fitted."""
COST = 1.0
"""[parameters] That a shape counts as when models are compared."""


@dataclass(frozen=True)
class Refitted:
    """A shape of the robot description that was fitted.

    Attributes:
        parameter: in the fit, with its value; joint: from 1; described: the value that the description states.
        held: the fit with that value; delta_bic, share: gain of the fitted one, as of an effect.
    """

    parameter: FreeParameter
    joint: int
    described: float
    held: Fit
    delta_bic: float
    share: float

    @property
    def text(self) -> str:
        """What was found, in a sentence."""
        return _text(self.parameter, self.described)


def refitted_shapes(fit: Fit, builder: LoopModelBuilder, options: Options) -> tuple[Refitted, ...]:
    """The smoothing velocities of a fit that explain the data better than those of the description, by as much as an
    effect must to be named."""
    found = []
    for parameter, described in _differing(fit, builder):
        held = _held_at(fit, {parameter.name: described})
        if held is None:
            continue
        size, share = explained_gap(held, fit, fit.noise)
        gain = bic_gain(held, fit, COST, fit.noise)
        if gain >= options.threshold and size >= options.smallest_size:
            joint = int(parameter.key.rpartition("_")[2])
            found.append(Refitted(parameter, joint, described, held, gain, share))
    return tuple(found)


def refitted_notes(fit: Fit, builder: LoopModelBuilder) -> list[str]:
    """What is said of the smoothing velocities of a fit that differ from those of the description."""
    return [_text(parameter, described) for parameter, described in _differing(fit, builder)]


def _differing(fit: Fit, builder: LoopModelBuilder) -> Iterator[tuple[FreeParameter, float]]:
    """The fitted shapes of the description, with their values, and what it states, where the data tell these apart."""
    stated = {v.name: v.start for v in builder.base.loop.plant.parameters}
    deviation = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    for parameter, value, std in zip(fit.model.free_parameters, fit.values, deviation, strict=True):
        if not (parameter.is_shape and parameter.effect is None and parameter.owner == PLANT):
            continue
        described = stated.get(parameter.key)
        if described is not None and abs(value - described) > LOOKED_AT * std:
            yield replace(parameter, value=float(value)), described


def _text(parameter: FreeParameter, described: float) -> str:
    return (
        f"{parameter.name} was fitted: {parameter.value:.3g} {parameter.unit} instead of the {described:.3g} "
        f"{parameter.unit} of the robot description."
    )


def with_stated(fit: Fit, refitted: Sequence[Refitted]) -> Fit | None:
    """The fit with all of them as the description states them; None where the loop does not run then."""
    return _held_at(fit, {one.parameter.name: one.described for one in refitted})


def _held_at(fit: Fit, stated: Mapping[str, float]) -> Fit | None:
    """The fit with some parameters held; None where the loop does not run then."""
    free = [
        replace(p, value=stated[p.name], lowest=stated[p.name], highest=stated[p.name])
        if p.name in stated
        else replace(p, value=float(value))
        for p, value in zip(fit.model.free_parameters, fit.values, strict=True)
    ]
    try:
        return minimise(fit.model.with_free(free), fit.noise, stopping=Stopping(updates=1))
    except SimulationError:
        return None
