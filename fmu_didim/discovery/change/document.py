"""The comparison of two answers as it is saved."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from fmu_didim.base.constants import recorded
from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.version import __version__
from fmu_didim.checks.judgement import judgement
from fmu_didim.discovery.change import answers, contest, difference, log_fit, worlds
from fmu_didim.discovery.change.answers import (
    CHANGE_IN_PART,
    CHANGE_LACKS,
    CHANGE_REST,
    Answer,
    known,
    machine,
    refuse,
    refuse_same_data,
    residual_changes,
    residual_diagnostics,
)
from fmu_didim.discovery.change.causes import JOINT_TORQUE_SCALE
from fmu_didim.discovery.change.contest import Contest, Explanation
from fmu_didim.discovery.change.difference import CHANGED, SEEN, Difference
from fmu_didim.discovery.change.explain import explained
from fmu_didim.discovery.change.log_fit import Known, LogFit, not_widely_searched
from fmu_didim.discovery.change.words import cause_text
from fmu_didim.discovery.progress import Progress
from fmu_didim.discovery.selection import decide
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.dynamics.effects.inserted import InsertedEffect
from fmu_didim.results.comparison import (
    AmountResult,
    CausePart,
    CauseResult,
    Change,
    ChangedParameter,
    ComparedResult,
    ComparisonDocument,
    ParameterSet,
    ResidualChange,
)

DECIDING = (
    (difference, ("CHANGED", "SEEN")),
    (contest, ("LACK", "PAIRED", "LARGEST_SET")),
    (decide, ("BIC", "NEAR")),
    (worlds, worlds.DECIDE),
    (log_fit, log_fit.DECIDE),
    (answers, ("SAME_ROWS", "SAME_VALUE", "FOLLOWS")),
)
"""Constants on which a comparison depends, by module."""
LARGE_PART = 0.8
"""[1] Of a change whose cause is unknown, from which a single cause that explains so much of it is told: what something
else does is a quarter of it at most."""
MOST_NAMED = 6
"""[parameters] Whose visible change is stated in one sentence."""
WITHOUT_ROBOT = (
    "Without a robot description that both results follow, causes such as a payload are not looked for: only single "
    "parameters and sets of them."
)
WITHOUT_MOTION = (
    "The motion of the log was not saved closely enough to tell the share of each joint: a torque scale of one joint "
    "is not looked for."
)


SCALED_LOG = (
    "The gain of the controller and the torque scale of joint {0} are one factor: so acts a torque log of this joint "
    "that says that much more than the drive gives (a current sensor, a unit), with controller and drive as before."
)
ONE_FACTOR = 3.0
"""[standard deviations] Up to which two gains are taken for one factor."""
OF_SIGNALS = (
    "Of a model without controller only its values are compared, one by one and in sets: what it lacks in either log "
    "(fmu-didim discover) is not looked for."
)
WITHOUT_LOGS = (
    "Effects that have come, gone or grown, such as backlash, another gain of the controller or a late clock, were not "
    "looked for: {0}."
)


def compared(
    before: Answer,
    after: Answer,
    logs: tuple[LogFit, LogFit] | None = None,
    *,
    progress: Progress | None = None,
    why_no_logs: str = "",
) -> ComparisonDocument:
    """What has changed between two answers.

    Args:
        logs: both with their loops, in which effects are looked for, too; why_no_logs: why they are not there.

    Raises:
        InputError: they cannot be compared.
    """
    for answer in (before, after):
        refuse(answer)
    found, left = answers.difference(before, after)
    refuse_same_data(before, after)
    robot = machine(before, after)
    values = (_known(before, found), _known(after, found))
    result, failed = explained(found, values, robot, logs, progress or Progress())
    if failed:
        logs, why_no_logs = None, failed
    is_changed = result.is_changed
    residual = residual_changes(before, after, result.named[0].world.residual if result.named else None)
    notes = [f"{name} {why}, and is not compared." for name, why in left.items()]
    if before.document.outputs:
        notes.append(OF_SIGNALS)
    elif logs is None:
        notes.append(WITHOUT_LOGS.format(why_no_logs))
    if is_changed and robot is None and not before.document.outputs:
        notes.append(WITHOUT_ROBOT)
    elif is_changed and robot is not None and robot.logged is None and robot.parameters.joint_count > 1:
        notes.append(WITHOUT_MOTION)
    notes += _scaled_logs(result)
    if logs is not None:
        notes += not_widely_searched(logs, {kind for e in result.named for kind, _, _ in e.causes})
    judged = judgement([*known(before, after, left), *_rest(result), *_lacks(result), *residual_diagnostics(residual)])
    change = _answer(result)
    return ComparisonDocument(
        name=f"{before.document.name} → {after.document.name}",
        answer=change, text=_text(change, found, result) + _beside(result, residual),
        verdict=judged.verdict, reasons=judged.saved(),
        conditions=[*_visible(found, change, logs), *judged.conditions] if judged.verdict == "valid" else [],
        before=_side(before), after=_side(after),
        parameters=_parameters(found, before, after), left_out=left,
        chi_square=found.total, freedom=len(found.names), samples=found.freedom, p_value=found.p_value,
        causes=[_cause(e, result) for e in result.named], others=[_cause(e, result) for e in result.others],
        sets=[ParameterSet(names=list(names), p_value=p) for names, p in result.sets],
        residual=residual, remarks=[*map(str, judged.remarks), *notes],
        provenance={
            "made": datetime.now(UTC).isoformat(timespec="seconds"), "fmu_didim": __version__,
            "thresholds": recorded(DECIDING),
        },
    )  # fmt: skip


def _answer(result: Contest) -> Change:
    if not result.is_changed:
        return "unchanged"
    if not result.named:
        return "unknown"
    return "named" if len(result.named) == 1 else "ambiguous"


def _text(answer: Change, found: Difference, result: Contest) -> str:
    """The answer in words."""
    chance = f"chi-square {found.total:.4g} of {len(found.names)} values, p = {found.p_value:.1e}"
    moved = [name for name, is_moved in zip(found.names, found.moved, strict=True) if is_moved]
    which = f"{', '.join(moved)} moved" if moved else "no value by itself moved, but all together have"
    if found.p_value >= CHANGED:
        which = "the values differ by no more than noise"
    if result.lacks or any(e.world.fixed for e in result.named[:1]):
        which = f"in the model as it is, {which}"
    if answer == "unchanged" and result.lacks:
        return f"beside {_listed(result)}, the values differ by no more than noise; {which} ({chance})"
    if answer == "unchanged":
        return f"{which} ({chance})"
    if answer == "unknown":
        return (
            f"{which} ({chance}); no cause that was tried explains that, alone or with a second one"
            f"{_largest_part(result)}"
        )
    causes = "; or ".join(cause_text(e) for e in result.named)
    if answer == "named":
        return f"{causes}; {which} ({chance})"
    return f"one of {len(result.named)}: {causes}; {which} ({chance})"


def _largest_part(result: Contest) -> str:
    """What a single cause does of a change that none explains: machines differ by more than what was done to them."""
    alone = [e for e in result.others if len(e.forms) == 1]
    most = min(alone, key=lambda e: e.bic, default=None)
    if most is None or most.share < LARGE_PART:
        return ""
    share = f"{100 * most.share:.0f} %"
    return f"; {cause_text(most)} explains {share} of it, and what that leaves of the values is more than noise"


def _beside(result: Contest, residual: Sequence[ResidualChange]) -> str:
    """What may have changed though no value and no effect says so."""
    if result.in_part is not None:
        return f"; but {_of_part(result.in_part)}"
    labels = [r.label for r in residual if r.changed]
    if result.is_changed or not labels:
        return ""
    return (
        f"; but the residual of {', '.join(labels)} is not as large as before, and nothing that was tried explains that"
    )


def _of_part(found: Explanation) -> str:
    return (
        f"{cause_text(found)} would explain the logs far better, and leaves values that differ by more than noise "
        f"(chi-square {found.left:.4g} of {found.count})"
    )


def _known(answer: Answer, found: Difference) -> Known:
    return Known(found.names, *answer.values_of(found.names))


def _lacks(result: Contest) -> list[Diagnostic]:
    """What both logs have and the model lacks."""
    if not result.lacks:
        return []
    return [Diagnostic(CHANGE_LACKS, f"The model lacks {_listed(result)}.")]


def _listed(result: Contest) -> str:
    """What both logs have and the model lacks, in words."""
    parts = []
    for is_sure, which in ((True, "which both logs show"), (False, "which one log shows, and the other may have, too")):
        titles = [lack.title for lack in result.lacks if lack.is_sure == is_sure]
        if titles:
            parts.append(f"{' and '.join(titles)}, {which}")
    return ", and ".join(parts)


def _rest(result: Contest) -> list[Diagnostic]:
    """What a cause leaves that is more than noise."""
    if result.in_part is not None:
        text = f"{_of_part(result.in_part)}."
        return [Diagnostic(CHANGE_IN_PART, text[0].upper() + text[1:], "causes", result.in_part.left)]
    if not result.named or not (result.named[0].leaves_more_than_noise or result.further):
        return []
    best = result.named[0]
    text = f"What the best cause leaves is more than noise (chi-square {best.left:.4g} of {best.count} values)."
    if not best.leaves_more_than_noise:
        text = "The best cause leaves a small part of the change in the logs."
    if result.further is not None:
        second = cause_text(result.further)
        text += f" Most of that would be explained by a second one: {second}."
    return [Diagnostic(CHANGE_REST, text, "causes", best.left, float(best.count))]


def _scaled_logs(result: Contest) -> list[str]:
    """Of a gain of a controller and a torque scale of its joint that are one factor: a log that is scaled."""
    found = []
    for explanation in result.named:
        parts = {
            (form.kind, form.joint): (amounts[0], spread[0])
            for form, amounts, spread in zip(
                explanation.forms, explanation.amounts, explanation.deviations, strict=True
            )
            if form.kind == JOINT_TORQUE_SCALE or _is_gain_of_controller(form.kind)
        }
        for joint in sorted({joint for _, joint in parts}):
            scaled = parts.get((JOINT_TORQUE_SCALE, joint))
            gains = [parts[kind, place] for kind, place in parts if place == joint and _is_gain_of_controller(kind)]
            if scaled is None or not gains:
                continue
            (gain, of_gain), (scale, of_scale) = gains[0], scaled
            apart = min(abs(gain - factor) for factor in (1 + scale, 1 / (1 + scale)))  # new, or gone
            if apart < ONE_FACTOR * np.hypot(of_gain, of_scale):
                found.append(SCALED_LOG.format(joint))
    return found


def _is_gain_of_controller(kind: str) -> bool:
    """Whether an effect is one factor before what the log shows."""
    effect = EFFECTS.get(kind)
    is_before = isinstance(effect, InsertedEffect) and effect.logged == "after"
    return is_before and [p.unit for p in effect.own_parameters] == ["1"]  # type: ignore[union-attr]


def _visible(found: Difference, answer: Change, logs: tuple[LogFit, LogFit] | None) -> list[str]:
    """What an answer that nothing has changed rests on."""
    if answer != "unchanged":
        return []
    sizes = [
        f"{name} by {least:.2g} {'' if unit == '1' else unit}".rstrip()
        + (f" ({100 * least / abs(value):.0f} %)" if value else "")
        for name, unit, least, value in zip(found.names, found.units, found.least_seen, found.before, strict=True)
    ]
    more = f", nor {len(sizes) - MOST_NAMED} more by less than the table says" if len(sizes) > MOST_NAMED else ""
    return [
        f"no change is smaller than these data show (alone, with {100 * SEEN:.0f} %): {', '.join(sizes[:MOST_NAMED])}"
        f"{more}",
        *([] if logs is None else ["no effect that came or went is too small to show in these logs"]),
    ]


def _side(answer: Answer) -> ComparedResult:
    document = answer.document
    return ComparedResult(
        name=document.name, source=answer.source, verdict=document.verdict,
        made=str(document.provenance.get("made", "")), samples=answer.samples,
        files=dict(document.provenance.get("files", {})),
    )  # fmt: skip


def _parameters(found: Difference, before: Answer, after: Answer) -> dict[str, ChangedParameter]:
    change, wide = found.change, found.bounds * found.deviation
    return {
        name: ChangedParameter(
            unit=found.units[i], before=float(found.before[i]), before_std=before.shared[name].std,
            after=float(found.after[i]), after_std=after.shared[name].std, change=float(change[i]),
            std=float(found.deviation[i]), interval=(float(change[i] - wide[i]), float(change[i] + wide[i])),
            p_value=float(found.holm[i]), moved=bool(found.moved[i]), least_seen=float(found.least_seen[i]),
        )
        for i, name in enumerate(found.names)
    }  # fmt: skip


def _cause(found: Explanation, result: Contest) -> CauseResult:
    best = min(e.bic for e in (*result.named, *result.others))
    return CauseResult(
        parts=[
            CausePart(
                kind=form.kind, joint=form.joint, title=form.title, same_as=form.same_as,
                amounts=[
                    AmountResult(name=name, value=float(v), std=float(s), unit=unit)
                    for name, unit, v, s in zip(form.names, form.units, amounts, spread, strict=True)
                ],
            )
            for form, amounts, spread in zip(found.forms, found.amounts, found.deviations, strict=True)
        ],
        left=found.left, freedom=found.count, p_value=found.p_value, share=found.share, bic=found.bic - best,
        explains=found.explains,
    )  # fmt: skip
