"""What a valid answer may hide: misfits that the data would not show, and by how much they move the values.

A misfit a s of the outputs moves the values by the influence Phi of the data, a Phi's, whether it shows or not. What
shows is the part beside the sensitivities; where that is small, a size that no test finds moves values by many of their
standard deviations, which know of noise alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from fmu_didim.base.diagnostics import CATALOGUE, REMARK, Diagnostic
from fmu_didim.checks.judgement import CONDITIONAL, Judgement
from fmu_didim.checks.motion.dependence import JointResidual
from fmu_didim.checks.motion.misfits import Misfits
from fmu_didim.checks.power.statement import PowerResult, StatedResult, TrustResult, power_of_fit
from fmu_didim.data.signals import Array
from fmu_didim.fit.fit import Fit

MOVES = 1.0
"""[standard deviations] By which a misfit that does not show moves a value, from which that is said."""
NAMED = 3
"""[kinds] Of misfits that a remark names, each where it moves most; result and page list all."""
RESTED_ON = 2
"""[kinds] Of misfits that the verdict names: a scale that is off is nearly always the first."""

UNSEEN_MOVES = CATALOGUE(
    "unseen-moves", REMARK, rank=67,
    meaning="An error of the machine, the case or the log that these data would not show moves a value by more than "
    "its standard deviation, which knows of noise alone. Each is named with the size from which it would have been "
    "doubted, and by how much it moves which value there; sigma is the standard deviation.",
    next_step="Rule out at the machine what matters to you: the zero of the torque at standstill, the marks of the "
    "joints, the tilt of the base, the load; or choose a motion that tells more apart (docs/howto/choose-a-motion.md).",
)  # fmt: skip


def with_power(
    judged: Judgement,
    fit: Fit | None,
    misfits: Misfits,
    deviation: Array | None = None,
    joints: Sequence[JointResidual] | None = None,
) -> tuple[Judgement, PowerResult | None]:
    """A judgement of the values of a fit with what it rests on, and what it excludes; as it is, and None, where it is
    not valid, or that is not known.

    Args:
        misfits: of the fit; none: they are asked for here.
        deviation: (p,) standard deviations of the values; by default those of the noise.
        joints: what the test for the motion looked at beside these misfits, where it is known.
    """
    if judged.verdict != "valid" or fit is None or fit.model.loop.torque_is_given or not fit.model.loop.shows_torque:
        return judged, None
    misfits, joints = (misfits, joints) if misfits.stated else (Misfits.of(fit), None)
    power = power_of_fit(fit, misfits, deviation, joints)
    if power is None:
        return judged, None
    return replace(judged, remarks=(*judged.remarks, *unseen_diagnostics(power))), power


def unseen_diagnostics(power: PowerResult) -> list[Diagnostic]:
    """The remark on what would move a value noticeably and not show, with what the verdict rests on; nothing where all
    that does would show."""
    listed: list[StatedResult | TrustResult] = [*power.stated, *power.trusted]
    found = sorted((one for one in listed if _deviations(one) > MOVES), key=_deviations, reverse=True)
    if not found:
        return []
    named = [f"{_hidden(one)}, {_moves(one)}" for one in _worst_of_kinds(found)[:NAMED]]
    text = f"It would not show, but move values: {'; '.join(named)}."
    if len(found) > len(named):
        text += f" So would {len(found) - len(named)} more by more than {MOVES:g} sigma (power in result.json)."
    return [
        Diagnostic(
            UNSEEN_MOVES, text, "", _deviations(found[0]), MOVES, "standard deviations", condition=_condition(found)
        )
    ]


def _condition(found: list[StatedResult | TrustResult]) -> str:
    """What a valid verdict rests on, the worst of what moves values, with those that move them as far; empty where none
    moves a value so far. What no size of shows moves them as far as it is large: its check stands beside it."""
    far = [one for one in found if one.size is not None and _deviations(one) > CONDITIONAL]
    named = _worst_of_kinds(far)[:RESTED_ON]
    if not named:
        return ""
    texts = [f"{_hidden(one)}, which would move {_moves(one)}" for one in named]
    texts += [f"{len(far) - len(named)} more"] if len(far) > len(named) else []
    return f"the data do not hide {', nor '.join(texts)} (What valid excludes)"


def _worst_of_kinds(found: Sequence[StatedResult | TrustResult]) -> list[StatedResult | TrustResult]:
    """The first one of each kind."""
    kinds = dict[str, StatedResult | TrustResult]()
    for one in found:
        kinds.setdefault(one.what, one)
    return list(kinds.values())


def _deviations(one: StatedResult | TrustResult) -> float:
    return 0.0 if one.moves is None else abs(one.moves.deviations)


def _hidden(one: StatedResult | TrustResult) -> str:
    """What would not show, with its place and size."""
    where = f"{one.what} ({one.place})" if one.place else one.what
    return f"{where} of any size" if one.size is None else f"{where} below {one.size:.2g} {one.unit}"


def _moves(one: StatedResult | TrustResult) -> str:
    """The value that it moves most."""
    assert one.moves is not None
    return one.moves.text if one.size is not None else f"{one.moves.text} for each {one.unit}"
