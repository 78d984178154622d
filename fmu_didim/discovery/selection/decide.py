"""The decision: the candidate that is added, if any, and those that the data cannot distinguish from it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.places import Proposal
from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition, proposal_of
from fmu_didim.discovery.selection.held_out import (
    FAILS_HELD_OUT,
    Lenience,
    held_out_objection,
    held_out_remark,
    is_confirmed_by_size_alone,
    tells_nothing,
    unconfirmed,
)
from fmu_didim.discovery.selection.plausible import MAY_BE_ABSENT
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import Ratio, channel_gaps, gaps, held_out_ratio, part_of_gap
from fmu_didim.model.free_parameter import LOG
from fmu_didim.model.loop_model import EffectAtJoint

ROUNDS = 5
"""[effects] Largest number that is named."""
BIC = 10.0
"""[BIC] Difference from which a larger model is accepted, or one member of a set: 'very strong' evidence by Kass and
Raftery, Journal of the American Statistical Association 90 (1995)."""
SMALLEST_SIZE = 0.6
"""[standard deviations] Least change of the torque of a joint, in units of its noise, when an effect is switched off
and nothing else changes: as much as the clutter on clean plants of the blind benchmark. What repeats as the motor
of its joint does is no clutter: there SMALLEST_GAIN is enough."""
SMALLEST_GAIN = 0.2
"""[standard deviations] Least part of the residual that only the effect can explain, in the same units."""
SMALLEST_SHARE = 0.05
"""[1] The same as a fraction of the gap."""
SMALLEST_PART = 0.03
"""[1] The same as a fraction of the gap of the base model on the joint where it explains most: a refinement is no
further effect. On EMPS four further forms of friction and ripple explain less than 3 % each."""
NEAR = 0.02
"""[1] Fraction of the gain in BIC by which candidates may differ and still be ambiguous: no form is exact. Measured
with the blind benchmark."""


NEAR_STATED = 0.2
"""[1] The same of an effect that changes what the case states, such as the gains of a controller, or that has values
which hardly any machine has, and what it is confounded with: on EMPS with pulses two gains are ahead of a lag by 5 %.
In blind cases gains that are off lead lags and gears by two fifths or more; a drag that falls with the speed was ahead
of hidden Stribeck friction by 8 %."""
TOLD_BY_FITS = frozenset({"measurement", "controller"})
"""Places of effects that fits alone put into a set, not their class."""
BESIDE_HARMONIC = "a ripple beside this harmonic of the motor, too small for a name, explains more"
TOO_SMALL = "changes "
"""Beginning of the objection that an effect changes the torque, or all signals, by too little."""


@dataclass(frozen=True)
class Options:
    """How to discover.

    Attributes:
        forbid: effects that are not proposed; prefer: effects taken first out of an ambiguous set.
        rounds: largest number of effects; threshold: BIC difference from which a larger model is accepted.
        smallest_size, smallest_gain, smallest_share, smallest_part: see the constants of these names.
        seed: of the bootstrap.
        at_start: whether the data begin where a start in a known state shows, so that a few samples may tell it.
    """

    forbid: frozenset[str] = frozenset()
    prefer: tuple[str, ...] = ()
    rounds: int = ROUNDS
    threshold: float = BIC
    smallest_size: float = SMALLEST_SIZE
    smallest_gain: float = SMALLEST_GAIN
    smallest_share: float = SMALLEST_SHARE
    smallest_part: float = SMALLEST_PART
    seed: int = 0
    at_start: bool = False

    def record(self) -> dict[str, Any]:
        """The options as they are written down, those that the user has."""
        found = {**asdict(self), "forbid": sorted(self.forbid), "prefer": list(self.prefer)}
        return {name: value for name, value in found.items() if name != "at_start"}

    def lenience(self, *, hits: bool) -> Lenience:
        """What may confirm an effect on held-out data, one of many minima or not."""
        return Lenience(hits=hits, at_start=self.at_start)


@dataclass(frozen=True)
class Step:
    """One effect that was added.

    Attributes:
        effect_at, delta_bic, size, share: as of :class:`~fmu_didim.discovery.selection.competition.FittedCandidate`.
        ambiguous: candidates that the data cannot tell from it, with the BIC difference to the best, and the other
            members of its class; a shift of the log and a lag of the loop only where their fits are that close.
        before, after: label -> (n,) gap of each joint; ratio: of the held-out RMS, None without held-out data.
        channels_before, channels_after: label -> name of each channel -> its gap.
        members: the effect and those ambiguous ones that were fitted, with their values.
        remark: on the decision, for the user.
        untested: whether the held-out data tell nothing of it.
        without: the last fit of the other effects without it.
        rivals: effects of another class, or on another joint, that explain the data as well in its place, with their
            lead in BIC, or without a figure (NaN) where they were not fitted there.
    """

    effect_at: EffectAtJoint
    delta_bic: float
    size: float
    share: float
    ambiguous: tuple[tuple[EffectAtJoint, float], ...]
    before: dict[str, Array]
    after: dict[str, Array]
    ratio: Ratio | None
    members: tuple[Proposal, ...] = ()
    remark: str = ""
    untested: bool = False
    without: Fit | None = None
    channels_before: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    channels_after: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    rivals: tuple[tuple[EffectAtJoint, float], ...] = ()


def decide(
    ranking: Sequence[FittedCandidate],
    fit: Fit,
    options: Options,
    *,
    base: Fit,
    held: Callable[[FittedCandidate], Iterable[FittedCandidate]] = lambda candidate: (),
    at_harmonic: Callable[[FittedCandidate], FittedCandidate | None] = lambda candidate: None,
    may_be: Callable[[FittedCandidate, FittedCandidate], bool] = lambda candidate, other: False,
    finished: Callable[[FittedCandidate], FittedCandidate] = lambda candidate: candidate,
    class_of: Callable[[EffectAtJoint], str] = lambda effect_at: effect_at.effect,
    rivals_of: Callable[[FittedCandidate], frozenset[str]] = lambda candidate: frozenset(),
) -> FittedCandidate | tuple[tuple[EffectAtJoint, str], ...]:
    """The candidate to add, or the reasons why no candidate is accepted.

    Args:
        ranking: the best first; fit: of the model without them; base: of the model without any effect.
        held: a candidate that fails on held-out data only, or whose amplitudes may be absent beside shapes that are
            free, with its shapes held at screened values.
        at_harmonic: a candidate that is too small at the frequency where it is best, at a harmonic of its motor.
        may_be: whether a ripple may be what another candidate is: of one class, and of nearly one frequency. A harmonic
            of a motor that is small is not named where another frequency beside it explains more.
        finished: a candidate whose fit was given up, at its minimum.
        class_of: the class of an effect. Where held-out data confirm the best by its size alone, one of its class with
            fewer parameters is as good unless they confirm what the best has more.
        rivals_of: names of the effects that are taken in place of one on its joint where they explain nearly as much.
    """

    def is_simpler(other: FittedCandidate, best: FittedCandidate) -> bool:
        alike = class_of(other.effect_at) == class_of(best.effect_at)
        return alike and other.effect_at.joint == best.effect_at.joint and other.cost < best.cost

    def is_rival(other: FittedCandidate, best: FittedCandidate) -> bool:
        named = other.effect_at.effect in rivals_of(best) and other.effect_at.joint == best.effect_at.joint
        is_as_odd = bool(best.unusual and other.unusual)
        return named and not is_as_odd and other.delta_bic > (1 - NEAR_STATED) * best.delta_bic

    def objected_to(candidate: FittedCandidate) -> str:
        reason = objection(candidate, fit, options, base=base)
        if reason or not candidate.is_known or candidate.change >= options.smallest_size:
            return reason
        ahead = (c for c in ranking if not c.is_known and c.delta_bic > candidate.delta_bic)
        return BESIDE_HARMONIC if any(may_be(candidate, c) for c in ahead) else ""

    def judged(candidate: FittedCandidate) -> tuple[FittedCandidate, str]:
        reason = objected_to(candidate)
        if reason or not candidate.fit.given_up:
            return candidate, reason
        candidate = finished(candidate)
        return candidate, objected_to(candidate)

    reasons: list[tuple[EffectAtJoint, str]] = []
    for first in ranking:
        candidate, reason = judged(first)
        if not reason:
            least = candidate.delta_bic - nearness(candidate.delta_bic, options)
            others = [judged(c) for c in ranking if c is not first and c.delta_bic > least]
            near = [candidate, *(c for c, objected in others if not objected and c.delta_bic > least)]
            if is_confirmed_by_size_alone(fit, candidate.fit, seed=options.seed):
                others = [judged(c) for c in ranking if c.delta_bic <= least and is_simpler(c, candidate)]
                allowed = [c for c, objected in others if not objected]
                near += [c for c in allowed if unconfirmed(c.fit, candidate.fit, seed=options.seed)]
            rivals = [c for c in ranking if is_rival(c, candidate) and candidate.effect_at.effect not in options.prefer]
            allowed = [c for c, objected in map(judged, rivals) if not objected]
            return _simplest(allowed or near, options)
        if reason.startswith(TOO_SMALL) and (known := at_harmonic(candidate)) is not None:
            known, objected = judged(known)
            if not objected:
                return known
        if reason.startswith((FAILS_HELD_OUT, MAY_BE_ABSENT)):
            for other in held(candidate):
                if not objection(other, fit, options, base=base):
                    return other
        reasons.append((candidate.effect_at, reason))
    return tuple(reasons)


def objection(candidate: FittedCandidate, fit: Fit, options: Options, *, base: Fit) -> str:
    """Why a candidate is not accepted, or an empty string."""
    if candidate.delta_bic < options.threshold:
        return f"BIC difference {candidate.delta_bic:.1f} below {options.threshold:g}"
    least = options.smallest_gain if candidate.is_known else options.smallest_size
    if candidate.change < least:
        what = "no signal by more than" if fit.model.experiments.channels else "the torque by"
        small = f"{TOO_SMALL}{what} {candidate.change:.2f} of the noise, less than {least:g}"
        return small + _of_clock(candidate)
    if candidate.size < options.smallest_gain:
        return f"explains {candidate.size:.2f} of the noise, less than {options.smallest_gain:g}"
    if candidate.share < options.smallest_share:
        return f"explains {100 * candidate.share:.0f} % of the gap, less than {100 * options.smallest_share:g} %"
    part = part_of_gap(base, fit, candidate.fit, fit.noise)
    if part < options.smallest_part and not candidate.bends_gear:
        smallest = 100 * options.smallest_part
        return f"explains {100 * part:.1f} % of the gap of the base model on its joint, less than {smallest:g} %"
    if candidate.implausible:
        return candidate.implausible
    why = _held_out(candidate, fit, options)
    return "" if why and _may_be_untold(candidate, fit, options) else why


def too_small(
    ranking: Sequence[FittedCandidate], refused: Sequence[tuple[EffectAtJoint, str]], fit: Fit, options: Options, *,
    base: Fit,
) -> tuple[FittedCandidate, ...]:  # fmt: skip
    """The candidates that were refused because they change too little, and for nothing else."""
    small = {effect_at for effect_at, reason in refused if reason.startswith(TOO_SMALL)}
    of_any_size = replace(options, smallest_size=options.smallest_gain, smallest_share=0.0, smallest_part=0.0)
    return tuple(c for c in ranking if c.effect_at in small and not objection(c, fit, of_any_size, base=base))


def _held_out(candidate: FittedCandidate, fit: Fit, options: Options) -> str:
    """Why held-out data speak against a candidate, or an empty string."""
    lenience = options.lenience(hits=candidate.has_minima)
    return held_out_objection(fit, candidate.fit, seed=options.seed, lenience=lenience)


def _may_be_untold(candidate: FittedCandidate, fit: Fit, options: Options) -> bool:
    return candidate.is_measured and tells_nothing(fit, candidate.fit, seed=options.seed)


def is_untold(candidate: FittedCandidate, fit: Fit, options: Options) -> bool:
    """Whether the held-out data tell nothing of an effect that follows what was measured."""
    return _may_be_untold(candidate, fit, options) and bool(_held_out(candidate, fit, options))


def _of_clock(candidate: FittedCandidate) -> str:
    """The size of what is too small to be named, and as what it counts, where it is the clock of a log that a virtual
    controller follows."""
    fit = candidate.fit
    clock = [i for i, p in enumerate(fit.model.free_parameters) if p.owner == LOG]
    if not clock or not fit.model.loop.is_virtual:
        return ""
    size, deviation = 1e3 * fit.values[clock[0]], 1e3 * np.sqrt(fit.covariance[clock[0], clock[0]])
    return f"; one set with a lag, a delay and how long a torque is held: {size:.2f} ± {deviation:.2f} ms"


def _simplest(near: Sequence[FittedCandidate], options: Options) -> FittedCandidate:
    """The member of an ambiguous set that the user prefers, else the one with the fewest parameters, those last with
    values that hardly any machine has. Of several with as few the best one, or the one that held-out data surely
    predict better: a dead zone of which the fitted motion reaches one side only is a constant there."""
    preferred = [c for name in options.prefer for c in near if c.effect_at.effect == name]
    if preferred:
        return preferred[0]

    def rank(candidate: FittedCandidate) -> tuple[bool, float]:
        return bool(candidate.unusual), candidate.cost

    best, *others = sorted(near, key=lambda c: (*rank(c), -c.delta_bic))
    for other in others:
        if rank(other) == rank(best):
            ratio = held_out_ratio(best.fit, other.fit, seed=options.seed)
            best = other if ratio is not None and ratio.high < 1 else best
    return best


def nearness(gain: float, options: Options) -> float:
    """BIC difference within which explanations are ambiguous, of the gain in BIC of one: no form is exact, so a small
    part of a large gain decides nothing."""
    return max(options.threshold, NEAR * gain)


def step_of(
    accepted: FittedCandidate, ranking: Sequence[FittedCandidate], competition: Competition, options: Options
) -> Step:
    """The step that adds a candidate of this ranking, with the candidates that are as good."""
    builder, fit = competition.builder, competition.fit
    best = ranking[0].delta_bic
    near = [
        (c.effect_at, best - c.delta_bic)
        for c in ranking
        if c.effect_at != accepted.effect_at and c.delta_bic > accepted.delta_bic - nearness(best, options)
    ]
    named = {a for a, _ in near} | {accepted.effect_at}
    fitted = [accepted, *(c for c in ranking if c.effect_at in named and c.effect_at != accepted.effect_at)]
    effect = builder.effect(accepted.effect_at)
    for name, other in builder.effects.items():
        member = EffectAtJoint(name, accepted.effect_at.joint)
        # Whether a shift of the log may stand for a lag of the loop, or one factor of a command for those of the gains,
        # or vice versa, only their fits tell; beside a virtual controller nothing does.
        is_told = not fit.model.loop.is_virtual and bool(TOLD_BY_FITS & {other.place, effect.place})
        # Limits of a torque are fitted side by side, the constant one and the one that falls with the speed.
        is_told |= other.pre_check is not None and any(c.effect_at == member for c in ranking)
        alike = other.class_name == effect.class_name and not is_told
        if alike and member not in named:
            near.append((member, float("nan")))
    return Step(
        effect_at=accepted.effect_at,
        delta_bic=accepted.delta_bic,
        size=accepted.size,
        share=accepted.share,
        ambiguous=tuple(near),
        before=gaps(fit),
        after=gaps(accepted.fit),
        ratio=held_out_ratio(fit, accepted.fit, seed=options.seed),
        members=tuple(proposal_of(c) for c in fitted),
        remark=_remark(accepted, ranking, competition, options),
        without=fit,
        untested=is_untold(accepted, fit, options),
        channels_before=channel_gaps(fit),
        channels_after=channel_gaps(accepted.fit),
    )


def with_in_set(step: Step, rivals: Sequence[tuple[FittedCandidate, float]]) -> Step:
    """The step with rivals in its set that were not there, each with its lead in BIC."""
    known = {a for a, _ in step.ambiguous}
    new = [(c, lead) for c, lead in rivals if c.effect_at not in known]
    return replace(
        step, ambiguous=(*step.ambiguous, *((c.effect_at, max(-lead, 0.0)) for c, lead in new)),
        members=(*step.members, *(proposal_of(c) for c, _ in new)),
    )  # fmt: skip


def _remark(
    accepted: FittedCandidate, ranking: Sequence[FittedCandidate], competition: Competition, options: Options
) -> str:
    """What is reported of an effect whose shapes were held, of one that held-out data confirm by its size alone, and of
    larger members of its class that explain the fitted data better."""
    effect = competition.builder.effect(accepted.effect_at)
    lenience = options.lenience(hits=accepted.has_minima)
    by_what = held_out_remark(competition.fit, accepted.fit, seed=options.seed, lenience=lenience)
    told = [_held_remark(accepted), by_what]
    if is_untold(accepted, competition.fit, options):
        told.append(
            "the held-out runs are nearly as warm as the fitted ones are on average, where it changes too little to be "
            "told; only the fitted data decided"
        )
    text = " ".join(f"{effect.title} on joint {accepted.effect_at.joint}: {one}." for one in told if one)
    if not told[1]:
        return text
    for other in ranking:
        ahead = other.delta_bic - accepted.delta_bic
        larger = competition.builder.effect(other.effect_at)
        alike = other.effect_at.joint == accepted.effect_at.joint and larger.class_name == effect.class_name
        is_ahead = alike and other.cost > accepted.cost and ahead > options.threshold
        if is_ahead and unconfirmed(accepted.fit, other.fit, seed=options.seed):
            text += (
                f" {larger.title} explains the fitted data better, by a BIC difference of {ahead:.0f}; held-out data "
                "do not confirm what it has more."
            )
    return text


def _held_remark(accepted: FittedCandidate) -> str:
    """What is reported of shapes that were held at the values of the screening."""
    model = accepted.fit.model
    own = [
        p for p in model.free_parameters
        if p.effect is not None and p.is_shape and model.added_effects[p.effect] == accepted.effect_at
    ]  # fmt: skip
    held = [f"{p.name} = {p.value:.3g}" for p in own if p.is_held]
    if not held:
        return ""
    return (
        f"{', '.join(held)} was held as it was screened, because the effect was refused with it free; intervals do not "
        "count what another value would move"
    )
