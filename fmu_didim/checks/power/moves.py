"""What a valid answer may hide: misfits that the data would not show, and by how much they move the values.

A misfit a s of the outputs moves the values by the influence Phi of the data, a Phi's, whether it shows or not. What
shows is the part beside the sensitivities; where that is small, a size that no test finds moves values by many of their
standard deviations, which know of noise alone.
"""

from __future__ import annotations

from fmu_didim.base.diagnostics import CATALOGUE, REMARK, Diagnostic
from fmu_didim.checks.power.statement import MovedResult, PowerResult, StatedResult, TrustResult

MOVES = 1.0
"""[standard deviations] By which a misfit that does not show moves a value, from which that is said."""
NAMED = 3
"""[kinds] Of misfits that a remark names, each where it moves most; result and page list all."""

UNSEEN_MOVES = CATALOGUE(
    "unseen-moves", REMARK, rank=67,
    meaning="An error of the machine, the case or the log that these data would not show moves a value by more than "
    "its standard deviation, which knows of noise alone. Each is named with the size from which it would have been "
    "doubted, and by how much it moves which value there; sigma is the standard deviation.",
    next_step="Rule out at the machine what matters to you: the zero of the torque at standstill, the marks of the "
    "joints, the tilt of the base, the load; or choose a motion that tells more apart (docs/howto/choose-a-motion.md).",
)  # fmt: skip


def unseen_diagnostics(power: PowerResult) -> list[Diagnostic]:
    """The remark on what would move a value noticeably and not show; nothing where all that does would show."""
    listed: list[StatedResult | TrustResult] = [*power.stated, *power.trusted]
    found = [
        (abs(moves.deviations), one.what, _text(one.what, one.place, one.size, one.unit, moves))
        for one in listed
        if (moves := one.moves) is not None and abs(moves.deviations) > MOVES
    ]
    if not found:
        return []
    worst = dict[str, str]()
    for _, what, text in sorted(found, reverse=True):
        worst.setdefault(what, text)
    named = list(worst.values())[:NAMED]
    text = f"It would not show, but move values: {'; '.join(named)}."
    if len(found) > len(named):
        text += f" So would {len(found) - len(named)} more by more than {MOVES:g} sigma (power in result.json)."
    return [Diagnostic(UNSEEN_MOVES, text, "", max(found)[0], MOVES, "standard deviations")]


def _text(what: str, place: str, size: float | None, unit: str, moves: MovedResult) -> str:
    where = f"{what} ({place})" if place else what
    if size is None:
        return f"{where} of any size, {moves.text} for each {unit}"
    return f"{where} below {size:.2g} {unit}, {moves.text}"
