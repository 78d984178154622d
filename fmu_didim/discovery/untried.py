"""Effects that cannot be tried on a black box, because it does not give the motion that they depend on."""

from __future__ import annotations

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.judge import remaining_gaps
from fmu_didim.dynamics.effects.inserted import VELOCITY_UNITS
from fmu_didim.fit.fit import Fit

EFFECTS_UNTRIED = CATALOGUE(
    "effects-untried", DOUBT, rank=45,
    meaning="The model leaves more than noise, and effects in the torque balance of the plant, such as friction, were "
    "not tried, because the plant does not give the velocity of its joints.",
    next_step="Map its velocity (plant: {outputs: {dq1: name in the plant}}) to have them tried; where it is no "
    "output, make it one and export the plant anew.",
)  # fmt: skip
NO_MOTION = (
    "The plant has no output {0}: effects in its torque balance, such as friction, were left out, except those whose "
    "parameters it has."
)
NO_POSITION = (
    " A torque limit that falls with the speed was left out, too, because there is no position q{0} to take it from."
)
IS_A_VELOCITY = "Its q{0} is in {1}, a velocity: map that output as dq{0}, not as q{0}."
INTEGRATED = (
    "The plant has no output {0}: the position is the integral of the velocity, from the start of the reference or "
    "from zero. What depends on the position is therefore known up to its zero."
)


def motion_notes(builder: LoopModelBuilder) -> tuple[str, ...]:
    """Notes on a black box that does not give its whole motion."""
    if dumb := _without_velocity(builder):
        return (_no_motion(builder, dumb),)
    integrated = [] if builder.description is not None else _not_given(builder, "q")
    return (INTEGRATED.format(", ".join(f"q{j}" for j in integrated)),) if integrated else ()


def untried_effects(builder: LoopModelBuilder, final: Fit) -> list[Diagnostic]:
    """Whether what a final model leaves may be an effect that needs a velocity which the plant does not give."""
    dumb = _without_velocity(builder)
    if not dumb or not remaining_gaps(final):
        return []
    unit = {v.name: v.unit for v in builder.base.loop.plant.outputs}
    swapped = [j for j in dumb if unit.get(f"q{j}") in VELOCITY_UNITS]
    advice = " ".join(IS_A_VELOCITY.format(j, unit[f"q{j}"]) for j in swapped)
    return [Diagnostic(EFFECTS_UNTRIED, _no_motion(builder, dumb), "plant", next_step=advice)]


def _no_motion(builder: LoopModelBuilder, joints: list[int]) -> str:
    unit = {v.name: v.unit for v in builder.base.loop.plant.outputs}
    still = [j for j in joints if unit.get(f"q{j}", "rad/s") in VELOCITY_UNITS]
    text = NO_MOTION.format(", ".join(f"dq{j}" for j in joints))
    return text + (NO_POSITION.format(", q".join(map(str, still))) if still else "")


def _without_velocity(builder: LoopModelBuilder) -> list[int]:
    """The joints, from 1, whose velocity a black box does not give."""
    return [] if builder.description is not None else _not_given(builder, "dq")


def _not_given(builder: LoopModelBuilder, signal: str) -> list[int]:
    given = {v.name for v in builder.base.loop.plant.outputs}
    return [j for j in range(1, builder.base.joint_count + 1) if f"{signal}{j}" not in given]
