"""What sensitivities between the bounds say before a fit."""

from __future__ import annotations

from fmu_didim.base.diagnostics import CATALOGUE, REMARK, Diagnostic
from fmu_didim.estimators.search.screening import NOTHING, GlobalSensitivity

IDLE_BETWEEN_BOUNDS = CATALOGUE(
    "parameter-without-influence", REMARK, rank=57,
    meaning="Between its bounds a parameter changes the misfit by less than a hundredth of what the most influential "
    "one does: these data will not tell its value.",
    next_step="Leave it out of identify: (its value is then taken as known), or record data that excite it: inputs "
    "that change, another initial state, a longer record.",
)  # fmt: skip


def idle_between_bounds(found: GlobalSensitivity) -> list[Diagnostic]:
    """Parameters that do nothing between their bounds."""
    if not found.idle:
        return []
    text = f"Between their bounds these parameters do nearly nothing to the misfit: {', '.join(found.idle)}."
    return [Diagnostic(IDLE_BETWEEN_BOUNDS, text, "identify", bound=NOTHING, unit="1")]
