"""Temperatures that a case states and that nothing in its plant follows."""

from __future__ import annotations

from fmu_didim.base.diagnostics import CATALOGUE, REMARK, Diagnostic
from fmu_didim.model.loop_model import LoopModel

TEMPERATURE_UNUSED = CATALOGUE(
    "temperature-unused", REMARK, rank=66,
    meaning="The runs of a case state temperatures of the gears, and nothing in its plant follows them.",
    next_step="List temperature_dependent_friction among the effects of the joints that warm, or let fmu-didim "
    "discover find which do.",
)  # fmt: skip


def temperature_diagnostics(model: LoopModel) -> list[Diagnostic]:
    """A remark where experiments state temperatures that the plant does not take."""
    stated = {name for experiment in model.experiments.values() for name in experiment.measured_starts}
    if not stated or stated & model.loop.offered:
        return []
    text = "The runs state temperatures, and no effect of the plant depends on them."
    return [Diagnostic(TEMPERATURE_UNUSED, text, "temperature")]
