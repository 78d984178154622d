"""Effects that joints have in common: one lubricant, at one temperature, bends the friction of all gears alike.

Where such an effect is named on one joint, it is fitted beside it on the others that gain by it. Held-out data must
confirm all of these together, and the error as a whole, and of each of these joints, must fall with each further one:
whether it falls for certain they may be too short to tell of one joint alone. On 3 s of a measured TX40 the friction of
joint 2 is confirmed by itself, that of joint 3, which gains twice as much, is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from fmu_didim.discovery.selection.candidates import FittedCandidate
from fmu_didim.discovery.selection.competition import Competition, proposal_of
from fmu_didim.discovery.selection.decide import Options, objection
from fmu_didim.discovery.selection.held_out import FAILS_HELD_OUT, held_out_objection
from fmu_didim.discovery.selection.parts import Part
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import held_out_ratio, held_out_ratios

AS_ON = "{0} on {1}, as on joint {2}: held-out data confirm these together; of one joint alone they may not tell."
"""Remark on the first of the further joints."""


def on_further_joints(
    competition: Competition, ranking: Sequence[FittedCandidate], named: FittedCandidate, base: Fit, options: Options,
    room: int,
) -> tuple[Part, ...]:  # fmt: skip
    """The same effect on other joints, to add beside one that was just named, one after the other.

    Args:
        named: at its minimum; room: how many effects may still be named.
    """
    builder, effect = competition.builder, named.effect_at.effect
    if not builder.effect(named.effect_at).is_shared:
        return ()
    of_any_share = replace(options, smallest_share=0.0, smallest_part=0.0)  # what counts is what they explain together
    found, here = list[Part](), Competition(builder, named.fit)
    for other in (c for c in ranking if c.effect_at.effect == effect and c.effect_at != named.effect_at):
        if len(found) == room or other.delta_bic < options.threshold or other.implausible or other.unusual:
            continue
        fit = here.refit(proposal_of(other))
        if fit is None:
            continue
        candidate = here.finished(here.assess(other.effect_at, fit))
        why = objection(candidate, here.fit, of_any_share, base=base)
        if (why and not why.startswith(FAILS_HELD_OUT)) or not _falls(here.fit, candidate, options):
            continue
        if held_out_objection(competition.fit, candidate.fit, seed=options.seed):
            continue
        found.append(Part(here, candidate))
        here = Competition(builder, candidate.fit)
    return tuple(found)


def shared_remark(title: str, named: FittedCandidate, further: Sequence[Part]) -> str:
    """What is said of the effect on the further joints, with the first of them.

    Args:
        title: of the effect.
    """
    joints = " and ".join(f"joint {part.candidate.effect_at.joint}" for part in further)
    return AS_ON.format(title, joints, named.effect_at.joint)


def _falls(before: Fit, candidate: FittedCandidate, options: Options) -> bool:
    """Whether the error on held-out data falls, as a whole and on the joint of a candidate; so it does without any."""
    whole = held_out_ratio(before, candidate.fit, seed=options.seed)
    of_joints = held_out_ratios(before, candidate.fit, seed=options.seed)
    own = [ratio for joint, ratio in of_joints if joint == candidate.effect_at.joint]
    return whole is None or all(ratio.value < 1.0 for ratio in (whole, *own))
