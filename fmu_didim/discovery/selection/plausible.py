"""Whether the fitted values of an effect are significant, physically possible and usual.

An effect is not significant if, by the covariance C of its amplitudes a, they may all be neutral, a_0:

    (a - a_0)' C^-1 (a - a_0)  below the quantile of a chi-square      (Wald's test)

Source: A. Wald, Transactions of the American Mathematical Society 54 (1943).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.base.distributions import chi2_sf
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.dynamics.effects import Effect
from fmu_didim.dynamics.effects.base import SURE
from fmu_didim.fit.fit import Fit
from fmu_didim.model.free_parameter import plain_name
from fmu_didim.model.motion import joint_reference

UNUSUAL = CATALOGUE(
    "effect-unusual", DOUBT, rank=54,
    meaning="A named effect has a value that hardly any machine has, such as a drag that falls with the speed or a "
    "gear that loses a third of its torque: its form explains the log, its name may be that of something else.",
    next_step="Ask what else has this form: friction at other speeds, a gain of the drive, a load; look at the rivals "
    "of the finding in the report.",
)  # fmt: skip
ZERO = 0.05
"""[1] Largest p value, by its covariance, of an effect that is named: that of a 95 % interval."""

UNTOLD = 3.0
"""[1] Standard deviation over value of all amplitudes of an effect from which not its form explains the data, but
a limit of it: a gravity compensator of 35 ± 530 000 N.m has imitated an offset."""

NOT_TOLD = "its form is not told"
"""Beginning of the objection that none of several amplitudes is known."""

MAY_BE_ABSENT = "may be absent"
"""Beginning of the objection that the amplitudes of an effect may all be neutral."""

LONGEST = 0.5
"""[1] Fraction of the data that torques from outside may last: what lasts longer may as well be an offset, a load,
or what a drift has that its form lacks."""

FEWEST_REPEATS = 2.0
"""[1] Over the range in which a joint moved, of what is known by nothing but that it repeats: what is seen less than
twice is any bump or notch. On blind cases a notch or detent was called a ripple that repeats 1.3 to 2.3 times, 40
hidden ripples repeat 2.2 times or more."""

MOSTLY_TOUCHED = 0.5
"""[1] Of the samples, those at which a joint may lie where something acts that is met at the end of its way, as a stop:
what is met for longer has the form of a spring or a constant. An offset beside an error of the encoder was told as a
stop that begins beyond the motion."""

STILL = 0.01
"""[1] Of the largest speed of a joint along the fitted motions, below which it stands still."""
MOSTLY_STILL = 0.9
"""[1] Of the time in which a torque from outside or a change of payload acts, that its joints stand still: friction may
hold it then."""


def implausible(fit: Fit, index: int, effect: Effect, link: Mapping[str, float]) -> str:
    """Why the values of an effect are not significant or not possible, or an empty string.

    Args:
        index: of the effect among those of the model; link: known inertial parameters of its link.
    """
    amplitudes = _amplitudes(fit, index)
    if not amplitudes:
        return ""
    if (part := _lasting(fit, index, effect)) > LONGEST:
        return (
            f"lasts {100 * part:.0f} % of the data: more than {100 * LONGEST:g} % may be an offset, a load or a drift"
        )
    if (often := repeats(fit, index, effect)) < FEWEST_REPEATS:
        return (
            f"repeats {often:.2g} times over the range in which the joint moved: fewer than {FEWEST_REPEATS:g} times "
            "may be any bump or notch"
        )
    names, places = list(amplitudes), list(amplitudes.values())
    values = fit.values[places]
    covariance = fit.covariance[np.ix_(places, places)]
    deviations = np.sqrt(np.diag(covariance))
    found = dict(zip(names, values.tolist(), strict=True))
    if why := _held_by_friction(fit, index, effect, values - SURE * deviations * np.sign(values)):
        return why
    why = effect.impossible(found, dict(zip(names, deviations.tolist(), strict=True)), link)
    if why:
        return f"physically impossible: {why}"
    text = ", ".join(f"{n} = {v:.3g} ± {s:.2g}" for n, v, s in zip(names, values, deviations, strict=True))
    off = values - np.array([effect.neutral.get(name, 0.0) for name in names])
    if len(names) > 1 and np.isfinite(off).all() and (deviations > UNTOLD * np.abs(off)).all():
        return f"{NOT_TOLD}: {text}"
    chance = chance_of_none(values, covariance, np.array([effect.neutral.get(name, 0.0) for name in names]))
    if chance > ZERO:
        return f"{MAY_BE_ABSENT}: {text} (p = {chance:.2g})"
    return ""


def unusual_values(fit: Fit, builder: LoopModelBuilder) -> list[Diagnostic]:
    """The doubts about named effects with values that hardly any machine has."""
    named = enumerate(fit.model.added_effects)
    told = [(effect_at, unusual(fit, index, builder.effect(effect_at), builder.effects)) for index, effect_at in named]
    return [Diagnostic(UNUSUAL, f"{text}.", effect_at.text) for effect_at, text in told if text]


def unusual(fit: Fit, index: int, effect: Effect, effects: Mapping[str, Effect]) -> str:
    """What hardly any machine has of an effect, the one of this index, in words, or an empty string.

    Args:
        effects: the catalogue.
    """
    if effect.bends and not _is_beside(fit, index, effects[effect.bends]):
        return f"acts without a {effects[effect.bends].title.lower()}, whose law it bends"
    places, deviations = _amplitudes(fit, index), np.sqrt(np.diag(fit.covariance))
    values, own = ({name: float(of[i]) for name, i in places.items()} for of in (fit.values, deviations))
    touched = _touched(fit, index, effect)
    if touched > MOSTLY_TOUCHED:
        return f"acts at {100 * touched:.0f} % of the positions of the motion: usual is at its end"
    return effect.unusual(values, own)


def _is_beside(fit: Fit, index: int, other: Effect) -> bool:
    """Whether a fit has another effect on the joint of the one of this index, added or in the model from the start."""
    joint, own = fit.model.added_effects[index].joint, {p.name for p in other.own_parameters}
    return any(plain_name(p.name, joint) in own for p in fit.model.free_parameters)


def _held_by_friction(fit: Fit, index: int, effect: Effect, least: Array) -> str:
    """Why what acts for a while may be friction of joints that stand still, or an empty string.

    There the torque of Coulomb friction Fc is any one from -Fc to Fc, and stays where the motion has left it; the
    smoothed one of the model is zero.

    Args:
        least: (m,) amplitudes, nearer to zero by what they are not sure by.
    """
    span = _span(fit, index, effect)
    torques = {} if span is None else _torques(fit, index, effect, least, span)
    free = {p.name: float(value) for p, value in zip(fit.model.free_parameters, fit.values, strict=True)}
    if span is None or any(torque > free.get(f"Fc{joint}", 0.0) for joint, torque in torques.items()):
        return ""
    references = [fit.model.experiments[label].reference for label in fit.model.estimation_labels]
    time = np.concatenate([reference.time for reference in references])
    acts, still = (time >= span[0]) & (time < span[1]), dict[int, float]()
    for joint in torques:
        speed = np.concatenate([np.abs(joint_reference(reference, joint)[1]) for reference in references])
        still[joint] = float(np.mean(speed[acts] < STILL * speed.max())) if acts.any() else 0.0
    if not still or min(still.values()) < MOSTLY_STILL:
        return ""
    least_still = 100 * min(still.values())
    if len(still) == 1:
        (joint,) = still
        return (
            f"joint {joint} stands still for {least_still:.0f} % of the time in which it acts, where its Coulomb "
            f"friction of {free[f'Fc{joint}']:.3g} may hold as much"
        )
    return (
        f"joints {', '.join(map(str, still))} stand still for {least_still:.0f} % of the time in which it acts, where "
        "their Coulomb friction may hold as much"
    )


def _torques(fit: Fit, index: int, effect: Effect, least: Array, span: tuple[float, float]) -> dict[int, float]:
    """Joint -> largest torque of what acts for a while, where it is more than the noise there."""
    if effect.is_external:
        return {fit.model.added_effects[index].joint: float(np.abs(least).max())}
    own = fit.torque_alone
    change = np.abs(own.jacobian[:, :, list(_amplitudes(fit, index).values())] @ least)[_acting(fit, span)]
    largest = change.max(axis=0, initial=0.0)
    return {j + 1: float(t) for j, t in enumerate(largest) if t > own.deviation[j]}


def _span(fit: Fit, index: int, effect: Effect) -> tuple[float, float] | None:
    """Begin and end, s, of an effect that acts for a while; None of one that always may."""
    shapes = {name: float(fit.values[i]) for name, i in _places(fit, index, shapes=True).items()}
    return effect.acts(shapes) if shapes else None


def repeats(fit: Fit, index: int, effect: Effect) -> float:
    """How often an effect repeats over the range in which its joint moved; infinite of one that need not repeat, and
    where no reference says how it moved."""
    if not effect.frequency:
        return np.inf
    experiments, joint = fit.model.experiments, fit.model.added_effects[index].joint
    positions = [joint_reference(experiments[label].reference, joint)[0] for label in fit.model.estimation_labels]
    moved = max(float(np.ptp(position)) for position in positions)
    frequency = float(fit.values[_places(fit, index, shapes=True)[effect.frequency]])
    return frequency * moved / (2 * np.pi) if moved > 0 else np.inf


def _touched(fit: Fit, index: int, effect: Effect) -> float:
    """Fraction of the fitted motions at which the joint lies where an effect acts that does so at some positions alone;
    0 of what acts at all of them, and where no reference says how it moved."""
    between = effect.acts_between({n: float(fit.values[i]) for n, i in _places(fit, index, shapes=True).items()})
    if between is None:
        return 0.0
    position = _positions(fit, fit.model.added_effects[index].joint)
    if np.ptp(position) == 0:
        return 0.0
    return float(np.mean((position > between[0]) & (position < between[1])))


def _positions(fit: Fit, joint: int) -> Array:
    """(N,) of a joint along the references of the fitted experiments."""
    labels = fit.model.estimation_labels
    return np.concatenate([joint_reference(fit.model.experiments[label].reference, joint)[0] for label in labels])


def _lasting(fit: Fit, index: int, effect: Effect) -> float:
    """Fraction of the samples at which a torque from outside acts that does so for a while; 0 of what always may."""
    span = _span(fit, index, effect)
    if span is None or not effect.is_external:
        return 0.0
    return float(np.mean(_acting(fit, span)))


def _acting(fit: Fit, span: tuple[float, float]) -> NDArray[np.bool_]:
    """(N,) the fitted samples at which an effect acts that does so for a while."""
    time = np.concatenate([fit.model.experiments[label].time for label in fit.model.estimation_labels])
    return (time >= span[0]) & (time < span[1])


def _amplitudes(fit: Fit, index: int) -> dict[str, int]:
    """Name, without the joint, -> place of the parameters of an effect that are no shapes."""
    return _places(fit, index, shapes=False)


def _places(fit: Fit, index: int, *, shapes: bool) -> dict[str, int]:
    joint = fit.model.added_effects[index].joint
    free = enumerate(fit.model.free_parameters)
    return {plain_name(p.name, joint): i for i, p in free if p.effect == index and p.is_shape == shapes}


def chance_of_none(values: Array, covariance: Array, neutral: Array) -> float:
    """Probability of values (k,) as far from neutral ones by chance; where the neutral one is infinite, as of a
    stiffness, the inverse is compared with zero."""
    inverse = ~np.isfinite(neutral)
    scale = np.where(inverse, 1 / np.where(inverse, values, 1.0) ** 2, 1.0)
    covariance = covariance * np.outer(scale, scale)
    off = np.where(inverse, values * scale, values - np.where(inverse, 0.0, neutral))
    free = np.diag(covariance) > 0
    if not free.any():
        return 0.0
    part = covariance[np.ix_(free, free)]
    return float(chi2_sf(off[free] @ np.linalg.pinv(part, hermitian=True) @ off[free], int(free.sum())))
