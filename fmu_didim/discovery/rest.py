"""Where an effect rests that was found with a constant on its joint: both are one cause, if nothing else makes that.

A spring that rests at q_0 is a spring and a constant, k (q - q_0) = k q + c, so that

    q_0 = -c / k,    sigma^2 = [-1 / k, c / k^2] Cov(c, k) [-1 / k, c / k^2]'

to first order. The constant may as well be of another cause, such as an offset of the torque that is measured.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.fit.fit import Fit
from fmu_didim.model.loop_model import EffectAtJoint

RESTS = (
    "{0} and {1} on joint {2} are one cause if nothing else makes the constant: a spring that rests at "
    "{3:.3g} ± {4:.2g} {5}."
)


def rests(named: Sequence[EffectAtJoint], builder: LoopModelBuilder) -> dict[EffectAtJoint, EffectAtJoint]:
    """Those of some effects that are no more than where another one of them rests -> that one."""
    found = ((EffectAtJoint(builder.effect(a).rest, a.joint), a) for a in named)
    return {constant: effect_at for constant, effect_at in found if constant in named}


def rest_notes(fit: Fit, named: Sequence[EffectAtJoint], builder: LoopModelBuilder) -> list[str]:
    """Where effects rest that were named with the constant of their rest, a note for each."""
    notes = []
    for constant, effect_at in rests(named, builder).items():
        rest, deviation = _rest(fit, effect_at, constant)
        titles = builder.effect(effect_at).title, builder.effect(constant).title.lower()
        unit = "rad" if builder.loop.joint_type(effect_at.joint) == "revolute" else "m"
        notes.append(RESTS.format(*titles, effect_at.joint, rest, deviation, unit))
    return notes


def _rest(fit: Fit, effect_at: EffectAtJoint, constant: EffectAtJoint) -> tuple[float, float]:
    """q_0 and its standard deviation, from the one amplitude of either."""
    owners = [fit.model.added_effects.index(a) for a in (constant, effect_at)]
    places = [i for owner in owners for i, p in enumerate(fit.model.free_parameters) if p.effect == owner]
    c, k = fit.values[places]
    slope = np.array([-1 / k, c / k**2])
    return float(-c / k), float(np.sqrt(slope @ fit.covariance[np.ix_(places, places)] @ slope))
