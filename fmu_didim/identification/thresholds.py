"""Numbers that decide where an identification ends."""

from __future__ import annotations

from fmu_didim.thresholds import Table

TABLE = Table("identification")

INTEGRATION_TOLERANCE = TABLE(
    "INTEGRATION_TOLERANCE", 1e-5, "1",
    "Change of the torque by twice the substeps of the rule, relative to its size, that is allowed in any case.",
)  # fmt: skip
CLEARLY_BETTER = TABLE(
    "CLEARLY_BETTER",
    0.5,
    "1",
    "Residual with twice the substeps over that before, below which they explain the data better.",
)
INTEGRATION_SHIFT = TABLE(
    "INTEGRATION_SHIFT", 0.02, "standard deviations",
    "Twice the substeps may move no value by more: nobody would see it beside the noise.",
)  # fmt: skip
MAXIMUM_REFINEMENTS = TABLE("MAXIMUM_REFINEMENTS", 4, "refinements", "Of the integration, by twice the substeps each.")
FINISH_ITERATIONS = TABLE("FINISH_ITERATIONS", 15, "steps", "Of the efficient finish.")
AT_LIMIT = TABLE(
    "AT_LIMIT",
    0.01,
    "standard deviations",
    "A value so near to a limit lies at it: there the solver stops.",
)
VISIBLE_SHIFT = TABLE(
    "VISIBLE_SHIFT", 0.2, "standard deviations",
    "A value that finer steps would move by more is told as too coarsely integrated: a tenth of a 95 % interval.",
)  # fmt: skip
