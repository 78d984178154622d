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

RESTS = "{0} on joint {1}, which rests at {2:.3g} ± {3:.2g} {4} then"


def rests(named: Sequence[EffectAtJoint], builder: LoopModelBuilder) -> dict[EffectAtJoint, EffectAtJoint]:
    """Those of some effects that are no more than where another one of them rests -> that one."""
    found = ((EffectAtJoint(builder.effect(a).rest, a.joint), a) for a in named)
    return {constant: effect_at for constant, effect_at in found if constant in named}


def part_of(fit: Fit, effect_at: EffectAtJoint, named: Sequence[EffectAtJoint], builder: LoopModelBuilder) -> str:
    """Of which other one of the effects that were named an effect may be a part, and where that rests then, in words;
    empty if of none."""
    whole = rests(named, builder).get(effect_at)
    if whole is None:
        return ""
    rest, deviation = _rest(fit, whole, effect_at)
    unit = "rad" if builder.loop.joint_type(whole.joint) == "revolute" else "m"
    return RESTS.format(builder.effect(whole).title.lower(), whole.joint, rest, deviation, unit)


def _rest(fit: Fit, effect_at: EffectAtJoint, constant: EffectAtJoint) -> tuple[float, float]:
    """q_0 and its standard deviation, from the one amplitude of either."""
    owners = [fit.model.added_effects.index(a) for a in (constant, effect_at)]
    places = [i for owner in owners for i, p in enumerate(fit.model.free_parameters) if p.effect == owner]
    c, k = fit.values[places]
    slope = np.array([-1 / k, c / k**2])
    return float(-c / k), float(np.sqrt(slope @ fit.covariance[np.ix_(places, places)] @ slope))
