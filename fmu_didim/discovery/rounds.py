"""The rounds of discovery: compete, decide, add, refit, test backwards; until nothing more is worth a name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.discovery.augment import Proposal, Workshop
from fmu_didim.discovery.compete import Contender, contend, contender, proposal_of, refit, screen, shortlist
from fmu_didim.discovery.fit import Fit, minimise
from fmu_didim.discovery.gap import BLOCK_S, Ratio, delta_bic, explained, joint_gaps, rms_ratio
from fmu_didim.discovery.library import Library
from fmu_didim.discovery.loop_model import LOG, Addition
from fmu_didim.discovery.noise import Noise
from fmu_didim.effects.spliced import SplicedEffect
from fmu_didim.errors import SimulationError
from fmu_didim.signals import Array

Say = Callable[[str], None]
HELD_OUT = "test"
BASIC = frozenset({"motor_inertia", "viscous", "coulomb"})
"""Effects of the base model, never proposed."""
COMPOSED = frozenset({"lugre"})
"""Effects made of others, which are proposed one by one; they are still told as members of their class."""

NEAR = 0.02
"""Part of the gain in BIC by which contenders may differ and still be ambiguous."""


@dataclass(frozen=True)
class Options:
    """How to discover.

    Attributes:
        forbid: effects that are not proposed; prefer: effects taken first out of an ambiguous set.
        rounds: largest number of effects; threshold: BIC difference from which a larger model is accepted.
        smallest_size: how much an effect must change the torque at least, in units of the noise of a joint, when it is
            switched off and nothing else changes.
        smallest_gain: what it must explain at least that nothing else in the model can, in the same units.
        smallest_share: and as a part of the gap.
        seed: of the bootstrap.
    """

    forbid: frozenset[str] = frozenset()
    prefer: tuple[str, ...] = ()
    rounds: int = 5
    threshold: float = 10.0
    smallest_size: float = 0.6
    smallest_gain: float = 0.2
    smallest_share: float = 0.05
    seed: int = 0


@dataclass(frozen=True)
class Step:
    """One effect that was added.

    Attributes:
        addition, delta_bic, size, share: as of :class:`~fmu_didim.discovery.compete.Contender`.
        ambiguous: further contenders that the data cannot tell from it, with the BIC by which they are behind, and the
            other members of its class; a shift of the log and a lag of the loop only where their fits are that close.
        before, after: label -> (n,) gap of each joint; ratio: of the held-out RMS, None without held-out data.
        members: the effect and those ambiguous ones that were fitted, with their values.
    """

    addition: Addition
    delta_bic: float
    size: float
    share: float
    ambiguous: tuple[tuple[Addition, float], ...]
    before: dict[str, Array]
    after: dict[str, Array]
    ratio: Ratio | None
    members: tuple[Proposal, ...] = ()


@dataclass(frozen=True)
class Discovery:
    """What the rounds came to.

    Attributes:
        base, final: fits without and with the effects; steps: one an effect that stayed.
        refused: contenders that were best in the last round but not accepted, and why.
    """

    base: Fit
    final: Fit
    steps: tuple[Step, ...]
    refused: tuple[tuple[Addition, str], ...] = ()


def run_rounds(workshop: Workshop, base: Fit, noise: Noise, options: Options, say: Say) -> Discovery:
    """Add effects to the base model as long as the data ask for them."""
    fit, steps = base, []
    saturated = saturation(workshop, base, noise, options, say)
    if saturated is not None:
        step, fit = saturated
        steps.append(step)
    candidates = _candidates(workshop, options)
    say(f"signatures of {len(candidates)} candidates")
    library = Library(workshop, fit, candidates=candidates)
    refused: tuple[tuple[Addition, str], ...] = ()
    while len(steps) < options.rounds:
        screened = screen(library, workshop, fit, noise)
        contenders = contend(shortlist(screened, workshop), workshop, fit, noise, progress=say)
        accepted = _decide(contenders, workshop, fit, noise, options)
        if isinstance(accepted, Contender):
            # The competition's fits are short; what is missing next is looked for from the minimum.
            accepted = replace(accepted, fit=minimise(accepted.fit.model, noise, renew=1))
            step = _step(accepted, contenders, workshop, fit, noise, options)
            say(f"added: {accepted.addition.effect} on joint {accepted.addition.joint}")
            steps.append(step)
            fit, steps = _backward(workshop, accepted.fit, noise, steps, options, say)
            if _shifts_log(fit) != _shifts_log(library.fit):  # signatures at other samples
                left = [c for c in candidates if c not in fit.model.additions]
                library = Library(workshop, fit, candidates=left)
        else:
            refused = accepted
            break
    return Discovery(base, fit, tuple(steps), refused)


def _shifts_log(fit: Fit) -> bool:
    return any(knob.owner == LOG for knob in fit.model.knobs)


def _candidates(workshop: Workshop, options: Options) -> list[Addition]:
    names = [
        name
        for name in workshop.effects
        if name not in BASIC | COMPOSED
        and name not in options.forbid
        and name != "torque_saturation"  # the pre-check's
    ]
    present = _present(workshop)
    return [Addition(name, j) for name in names for j in workshop.joints(name) if (name, j) not in present]


def _present(workshop: Workshop) -> set[tuple[str, int]]:
    """Effects that the base model has already."""
    if workshop.description is None:
        return set()
    return {(e, j) for j, joint in enumerate(workshop.description.joints, start=1) for e in joint.effects}


def _decide(
    contenders: Sequence[Contender], workshop: Workshop, fit: Fit, noise: Noise, options: Options
) -> Contender | tuple[tuple[Addition, str], ...]:
    """The contender to add, or why none is."""
    reasons: list[tuple[Addition, str]] = []
    for candidate in contenders:
        reason = _objection(candidate, fit, noise, options)
        if not reason:
            return _simplest(candidate, contenders, workshop, fit, noise, options)
        reasons.append((candidate.addition, reason))
    return tuple(reasons)


def _objection(candidate: Contender, fit: Fit, noise: Noise, options: Options) -> str:
    """Why a contender is not accepted, or an empty string."""
    if candidate.delta_bic < options.threshold:
        return f"BIC difference {candidate.delta_bic:.1f} below {options.threshold:g}"
    if candidate.raw_size < options.smallest_size:
        return f"changes the torque by {candidate.raw_size:.2f} of the noise, less than {options.smallest_size:g}"
    if candidate.size < options.smallest_gain:
        return f"explains {candidate.size:.2f} of the noise, less than {options.smallest_gain:g}"
    if candidate.share < options.smallest_share:
        return f"explains {100 * candidate.share:.0f} % of the gap, less than {100 * options.smallest_share:g} %"
    ratio = held_out_ratio(fit, candidate.fit, noise, options)
    if ratio is not None and ratio.high >= 1.0:
        return f"held-out RMS ratio {ratio.value:.3f}, its interval reaches {ratio.high:.3f}"
    return ""


def _simplest(
    winner: Contender, contenders: Sequence[Contender], workshop: Workshop, fit: Fit, noise: Noise, options: Options
) -> Contender:
    """Of the ambiguous set: what the user prefers, else the member with the fewest parameters."""
    near = [
        c
        for c in contenders
        if c.delta_bic > winner.delta_bic - _nearness(winner, options) and not _objection(c, fit, noise, options)
    ]
    for name in options.prefer:
        for c in near:
            if c.addition.effect == name:
                return c
    return min(near, key=lambda c: (c.cost, -c.delta_bic))


def _nearness(winner: Contender, options: Options) -> float:
    """BIC difference within which contenders are ambiguous: no form is exact, so that a small part of a large gain
    decides nothing."""
    return max(options.threshold, NEAR * winner.delta_bic)


def held_out_ratio(before: Fit, after: Fit, noise: Noise, options: Options) -> Ratio | None:
    """Ratio of the held-out RMS of two models; None without held-out data, worse than any if one cannot be run."""
    if HELD_OUT not in before.model.runs:
        return None
    try:
        second = after.model.residual(after.values, HELD_OUT)
    except SimulationError:
        return Ratio(np.inf, np.inf, np.inf)
    first = before.model.residual(before.values, HELD_OUT)
    rate = before.model.runs[HELD_OUT].problem.experiment.rate_hz
    return rms_ratio(first, second, noise, block=max(round(BLOCK_S * rate), 1), seed=options.seed)


def gaps(fit: Fit, noise: Noise) -> dict[str, Array]:
    """Label of each experiment -> (n,) gap of each joint; infinite where the model cannot be run."""
    result = {}
    for label in fit.model.runs:
        try:
            result[label] = joint_gaps(fit.model.residual(fit.values, label), noise)
        except SimulationError:
            result[label] = np.full(fit.model.joint_count, np.inf)
    return result


def _step(
    accepted: Contender, contenders: Sequence[Contender], workshop: Workshop, fit: Fit, noise: Noise, options: Options
) -> Step:
    best = contenders[0].delta_bic
    near = [
        (c.addition, best - c.delta_bic)
        for c in contenders
        if c.addition != accepted.addition and c.delta_bic > accepted.delta_bic - _nearness(contenders[0], options)
    ]
    named = {a for a, _ in near} | {accepted.addition}
    fitted = [accepted, *(c for c in contenders if c.addition in named and c.addition != accepted.addition)]
    effect = workshop.effect(accepted.addition)
    for name, other in workshop.effects.items():
        member = Addition(name, accepted.addition.joint)
        # Whether a shift of the log may stand for a lag of the loop, or the other way round, only their fits tell.
        alike = other.class_name == effect.class_name and "measurement" not in (other.place, effect.place)
        if alike and member not in named:
            near.append((member, float("nan")))
    return Step(
        addition=accepted.addition,
        delta_bic=accepted.delta_bic,
        size=accepted.size,
        share=accepted.share,
        ambiguous=tuple(near),
        before=gaps(fit, noise),
        after=gaps(accepted.fit, noise),
        ratio=held_out_ratio(fit, accepted.fit, noise, options),
        members=tuple(proposal_of(c) for c in fitted),
    )


def _backward(
    workshop: Workshop, fit: Fit, noise: Noise, steps: list[Step], options: Options, say: Say
) -> tuple[Fit, list[Step]]:
    """Take out effects that the newest one has made superfluous."""
    for step in steps[:-1]:
        index = fit.model.additions.index(step.addition)
        kept = [i for i, knob in enumerate(fit.model.knobs) if knob.effect != index]
        smaller = workshop.without(fit.model, index)
        try:
            without = minimise(smaller, noise, jacobian=fit.jacobian[:, :, kept], renew=1)
        except SimulationError:
            continue
        worth = delta_bic(without.residual, fit.residual, workshop.cost(step.addition), noise)
        size, _ = explained(without.residual, fit.residual, noise)
        if worth < options.threshold or size < 0.5 * options.smallest_gain:
            say(f"taken out again: {step.addition.effect} on joint {step.addition.joint}")
            fit = minimise(without.model, noise)
            steps = [s for s in steps if s is not step]
    return fit, steps


def saturation(workshop: Workshop, fit: Fit, noise: Noise, options: Options, say: Say) -> tuple[Step, Fit] | None:
    """The pre-check for a limit of the torque, to which linear screening is blind: limits at the upper quantiles of the
    measured torque of each joint are tried in full simulations."""
    effect = workshop.effects.get("torque_saturation")
    if not isinstance(effect, SplicedEffect) or "torque_saturation" in options.forbid:
        return None
    say("pre-check: saturation")
    measured = fit.model.runs["train"].measured
    cost = float(np.sum((fit.residual * noise.weight) ** 2))
    tried: list[tuple[float, Addition, float]] = []
    for joint in range(1, fit.model.joint_count + 1):
        addition = Addition("torque_saturation", joint)
        for part in (0.98, 0.99, 0.995, 0.998):
            limit = float(np.quantile(np.abs(measured[:, joint - 1]), part))
            model = workshop.build(fit.model, [Proposal(addition, {"limit": limit})])
            try:
                reached = float(np.sum((model.residual(model.start) * noise.weight) ** 2))
            except SimulationError:
                continue
            tried.append((reached, addition, limit))
    best = min(tried, default=None, key=lambda t: t[0])
    if best is None or best[0] > 0.9 * cost:
        return None
    found: list[Contender] = []
    for addition in dict.fromkeys(a for _, a, _ in sorted(tried, key=lambda t: t[0])[:4]):
        limit = min((t for t in tried if t[1] == addition), key=lambda t: t[0])[2]
        fitted = refit(Proposal(addition, {"limit": limit}, {"limit": limit}), workshop, fit, noise)
        if fitted is not None:
            found.append(contender(addition, fitted, workshop, fit, noise))
    found.sort(key=lambda c: -c.delta_bic)
    if not found or _objection(found[0], fit, noise, options):
        return None
    say(f"added: torque_saturation on joint {found[0].addition.joint}")
    return _step(found[0], found, workshop, fit, noise, options), found[0].fit
