"""The gains of controllers that were found, as they are stated in a case, and how to change the controller."""

from __future__ import annotations

from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.places import InController
from fmu_didim.dynamics.effects import InsertedEffect
from fmu_didim.fit.fit import Fit
from fmu_didim.model.loop_model import EffectAtJoint

CHANGED = (
    "To change the controller of joint {0}: {1}. The augmented case states these as `gains:` of each run; in a loop "
    "that is written as an archive its controller has them."
)
ONE_FACTOR = (
    "To change the controller of joint {0}: its command is {1:.4g} times that of its law, so that all gains of that "
    "joint that stand before a term of their own are multiplied by this. The augmented model has the factor between "
    "controller and log."
)


def found_gains(fit: Fit, label: str) -> dict[str, tuple[float, float]]:
    """``component.parameter`` -> the value that the case states in an experiment, and the one that was found."""
    return {name: pair for effect_at in fit.model.added_effects for name, pair in _gains(fit, effect_at, label).items()}


def _gains(fit: Fit, effect_at: EffectAtJoint, label: str) -> dict[str, tuple[float, float]]:
    index, loop, found = fit.model.added_effects.index(effect_at), fit.model.loop, {}
    for parameter, value in zip(fit.model.free_parameters, fit.values, strict=True):
        if parameter.effect == index and parameter.owner in loop.factors:
            component, key, stated = loop.multiplied(label, parameter.owner, parameter.key)
            found[f"{component}.{key}"] = (stated, stated * float(value))
    return found


def gain_notes(fit: Fit, builder: LoopModelBuilder) -> list[str]:
    """How to change the controllers whose gains were found to be others, a note for each joint."""
    notes, label = [], fit.model.first
    names = {effect.class_name for effect in builder.effects.values() if effect.place == "controller"}
    for index, effect_at in enumerate(fit.model.added_effects):
        effect = builder.effect(effect_at)
        if isinstance(builder.at(effect_at), InController):
            pairs = _gains(fit, effect_at, label).items()
            told = ", ".join(f"{name} = {value:.4g} instead of {stated:.4g}" for name, (stated, value) in pairs)
            notes.append(CHANGED.format(effect_at.joint, told))
        elif isinstance(effect, InsertedEffect) and effect.class_name in names:
            own = [v for p, v in zip(fit.model.free_parameters, fit.values, strict=True) if p.effect == index]
            notes.append(ONE_FACTOR.format(effect_at.joint, float(own[0])))
    return notes
