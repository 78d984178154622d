"""Ripples and the motors that a robot description states: which harmonic one is, and what was not looked for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.dynamics.effects import Harmonic
from fmu_didim.dynamics.effects.base import SURE
from fmu_didim.fit.fit import Fit
from fmu_didim.model.loop_model import EffectAtJoint

OF_ONE_PERIOD = 0.25
"""[periods] By which two errors that repeat along a joint may drift apart over the range of its motion and still be one
to the data: a quarter of a period takes less than a fifth off a sum over the range."""
NOT_OF_MOTOR = CATALOGUE(
    "ripple-not-of-motor", DOUBT, rank=55,
    meaning="A ripple was found at a frequency that the motor of the joint does not have by the description: the gear "
    "ratio, the poles or the slots that it states are those of another drive, or the ripple comes from elsewhere.",
    next_step="Compare motor: of this joint with the data sheet, the gear ratio first: all frequencies are in "
    "proportion to it. Teeth of a gear, planets, belts and rollers have frequencies of their own; if it is one of "
    "these, acknowledge the doubt.",
)  # fmt: skip


@dataclass(frozen=True)
class Near:
    """A harmonic of a motor beside what was found.

    Attributes:
        value, deviation: the spatial frequency that was found, and its standard deviation.
        drift: periods by which the two drift apart over the range of the motion.
    """

    harmonic: Harmonic
    value: float
    deviation: float
    drift: float

    @property
    def off(self) -> float:
        """Standard deviations by which they differ."""
        difference = abs(self.value - self.harmonic.frequency)
        return difference / self.deviation if self.deviation > 0 else (np.inf if difference else 0.0)

    @property
    def is_same(self) -> bool:
        """Whether it is this harmonic: the data hardly tell them apart, by its deviation or by what a model that is not
        quite right may move it."""
        return self.off < SURE or self.drift < OF_ONE_PERIOD

    @property
    def text(self) -> str:
        """What it is of; with its distance, where that is not chance."""
        found = f"{self.harmonic.name} ({self.harmonic.frequency:.4g}"
        return found + (")" if self.off < SURE else f", off by {self.off:.2g} standard deviations)")


def by_distance(builder: LoopModelBuilder, fit: Fit, effect_at: EffectAtJoint) -> list[Near]:
    """The harmonics that an effect of a fit may be, the nearest first; none where no motor is stated, or it has none of
    this effect."""
    placed, found = builder.at(effect_at), list[Near]()
    if not placed.harmonics:
        return []
    values, deviations = builder.shapes_in(fit, effect_at)
    within = builder.loop.ranges[effect_at.joint - 1]
    for shape, harmonics in placed.harmonics.items():
        found += [
            Near(h, values[shape], deviations[shape], within.drift(values[shape], h.frequency))
            for h in harmonics if shape in values
        ]  # fmt: skip
    return sorted(found, key=lambda one: one.drift)


def origin(builder: LoopModelBuilder, fit: Fit, effect_at: EffectAtJoint) -> str:
    """Which harmonic of its motor an effect is, in words, or which of several that these data do not tell apart; empty
    where it is none or no motor is stated."""
    return origin_of(by_distance(builder, fit, effect_at))


def origin_of(found: Sequence[Near]) -> str:
    """The same of harmonics, the nearest first."""
    return "; or ".join(one.text for one in found if one.is_same)


def not_of_motors(builder: LoopModelBuilder, fit: Fit) -> list[Diagnostic]:
    """The doubts about ripples at frequencies that the motors of their joints do not have."""
    doubts = []
    for effect_at in fit.model.added_effects:
        near = by_distance(builder, fit, effect_at)
        if not near or origin_of(near):
            continue
        found = near[0]
        text = (
            f"Its frequency of {found.value:.4g} ± {found.deviation:.2g} is no harmonic of the motor that the "
            f"description states: the nearest is {found.harmonic.frequency:.4g} ({found.harmonic.name}), off by "
            f"{found.off:.2g} standard deviations."
        )
        doubts.append(Diagnostic(NOT_OF_MOTOR, text, effect_at.text))
    return doubts


def motor_notes(builder: LoopModelBuilder) -> list[str]:
    """Notes on what the stated motors have and was not looked for."""
    robot = builder.description
    return [] if robot is None else [
        note for j, joint in enumerate(robot.joints, start=1) if joint.motor is not None
        for note in ([_coupled(j)] if j - 1 in robot.coupled_joints() else _unseen(builder, j))
    ]  # fmt: skip


def _coupled(joint: int) -> str:
    return (
        f"Joint {joint} shares its motors with a neighbour by the effects of the description: what repeats in a turn "
        "of a motor does not in the position of a joint, and motor: of this joint was not used."
    )


def _unseen(builder: LoopModelBuilder, joint: int) -> Iterator[str]:
    ripples = (name for name, effect in builder.effects.items() if effect.place == "torque balance")
    placed = [builder.at(EffectAtJoint(name, joint)) for name in ripples]
    of_all = [(h, one.shows(shape, h)) for one in placed for shape, own in one.harmonics.items() for h in own]
    seen, unseen = {h.frequency for h, shows in of_all if shows}, dict[float, str]()
    for h, _ in of_all:
        if h.frequency not in seen:
            unseen.setdefault(h.frequency, f"{h.frequency:.4g} ({h.name})")
    shows = builder.loop.ranges[joint - 1].shows
    if fast := [text for frequency, text in sorted(unseen.items()) if not shows(frequency)]:
        yield (
            f"Joint {joint}: of the ripples that its motor may have these were not looked for, since they pass in less "
            f"than two control periods at the RMS of the speed: {', '.join(fast)}. A slow motion shows them."
        )
    if slow := [text for frequency, text in sorted(unseen.items()) if shows(frequency)]:
        yield (
            f"Joint {joint}: of the ripples that its motor may have these were not looked for, since so few in a turn "
            f"look like gravity: {', '.join(slow)}."
        )
