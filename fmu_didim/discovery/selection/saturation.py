"""The pre-check for a limit of the torque, to which linear screening is blind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fmu_didim.discovery.augmentation.builder import LoopModelBuilder, Proposal
from fmu_didim.discovery.selection.contenders import Contender, contender, refit, torque_change_without
from fmu_didim.discovery.selection.decide import (
    FAILS_HELD_OUT,
    Options,
    Step,
    held_out_ratio,
    objection,
    step_of,
)
from fmu_didim.effects.spliced import SplicedEffect
from fmu_didim.errors import SimulationError
from fmu_didim.prediction.least_squares import Fit
from fmu_didim.prediction.loop_model import EffectAtJoint
from fmu_didim.prediction.noise import Noise

NAME = "torque_saturation"
QUANTILES = (0.9, 0.95, 0.97, 0.98, 0.99, 0.995, 0.998)
"""Of the measured torque of a joint, tried as its limit."""
WORSE = 1.02
"""Held-out RMS ratio beyond which data that do not reach the limit still speak against it; a little comes from the base
parameters, which are fitted along."""


def saturation(
    builder: LoopModelBuilder, fit: Fit, noise: Noise, options: Options, say: Callable[[str], None]
) -> tuple[Step, Fit] | None:
    """The limit of a torque if there is one.

    Limits at the upper quantiles of the measured torque of each joint are tried in full simulations.
    """
    effect = builder.effects.get(NAME)
    if not isinstance(effect, SplicedEffect) or NAME in options.forbid:
        return None
    say("pre-check: saturation")
    measured = fit.model.measured
    cost = float(np.sum((fit.residual * noise.weight) ** 2))
    tried: list[tuple[float, EffectAtJoint, float]] = []
    for joint in range(1, fit.model.joint_count + 1):
        effect_at = EffectAtJoint(NAME, joint)
        for part in QUANTILES:
            limit = float(np.quantile(np.abs(measured[:, joint - 1]), part))
            model = builder.build(fit.model, [Proposal(effect_at, {"limit": limit})])
            try:
                reached = float(np.sum((model.residual(model.start) * noise.weight) ** 2))
            except SimulationError:
                continue
            tried.append((reached, effect_at, limit))
    best = min(tried, default=None, key=lambda t: t[0])
    if best is None or best[0] > 0.9 * cost:
        return None
    found: list[Contender] = []
    for effect_at in dict.fromkeys(a for _, a, _ in sorted(tried, key=lambda t: t[0])[:4]):
        limit = min((t for t in tried if t[1] == effect_at), key=lambda t: t[0])[2]
        fitted = refit(Proposal(effect_at, {"limit": limit}, {"limit": limit}), builder, fit, noise)
        if fitted is not None:
            found.append(contender(effect_at, fitted, builder, fit, noise))
    found.sort(key=lambda c: -c.delta_bic)
    reason = objection(found[0], fit, noise, options, base=fit) if found else "no limit of it can be simulated"
    remark = ""
    if reason.startswith(FAILS_HELD_OUT) and not _held_out_tells(found[0], builder, fit, noise, options):
        reason = ""
        remark = (
            f"{NAME} on joint {found[0].effect_at.joint}: the held-out experiment hardly reaches the limit and "
            "neither confirms nor contradicts it; the estimation data alone decided."
        )
    if reason:
        return None
    say(f"added: {NAME} on joint {found[0].effect_at.joint}")
    step = step_of(found[0], found, builder, fit, noise, options)
    return replace(step, remark=remark), found[0].fit


def _held_out_tells(candidate: Contender, builder: LoopModelBuilder, fit: Fit, noise: Noise, options: Options) -> bool:
    """Whether the held-out experiment comes to the limit, so that it would be seen there, or speaks against it."""
    if (
        torque_change_without(candidate.effect_at, candidate.fit, builder, noise, held_out=True)
        >= options.smallest_size
    ):
        return True
    ratio = held_out_ratio(fit, candidate.fit, noise, options)
    return ratio is None or ratio.low > WORSE
