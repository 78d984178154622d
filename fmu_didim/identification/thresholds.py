"""Numbers that decide where an identification ends."""

from __future__ import annotations

from fmu_didim.thresholds import Table

TABLE = Table("identification")

INTEGRATION_TOLERANCE = TABLE(
    "INTEGRATION_TOLERANCE", 1e-6, "1", "Relative error of the integration that is allowed in any case."
)
INTEGRATION_SHARE = TABLE(
    "INTEGRATION_SHARE", 0.01, "1", "The integration error may reach this fraction of the relative torque error."
)
MAXIMUM_REFINEMENTS = TABLE("MAXIMUM_REFINEMENTS", 4, "refinements", "Of the integration, by twice the substeps each.")
FINISH_ITERATIONS = TABLE("FINISH_ITERATIONS", 15, "steps", "Of the efficient finish.")
