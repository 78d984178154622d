"""Numbers that decide what is believed of an FMU."""

from __future__ import annotations

from fmu_didim.thresholds import Table

TABLE = Table("fmu")

READ_BACK = TABLE(
    "READ_BACK", 1e-6, "1",
    "Relative difference between a value that was set and what is read back, above which the FMU has not taken it: "
    "ten times what is lost where it is kept in single precision.",
)  # fmt: skip
HALF_STEP = TABLE(
    "HALF_STEP", 0.02, "1",
    "Change of an output by half the communication step, as a fraction of its largest value, above which the FMU is "
    "said to compute something else: what one step of a coarse solver more or less does stays below it.",
)  # fmt: skip
QUICK = TABLE(
    "QUICK", 0.1, "1",
    "Fraction of the time limit of a trial that a single instance may take, so that the time limit of the trial with "
    "two of them is no fault of a busy machine.",
)  # fmt: skip
