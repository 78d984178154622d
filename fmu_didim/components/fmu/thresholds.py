"""Numbers that decide what is believed of an FMU."""

from __future__ import annotations

from fmu_didim.thresholds import Table

TABLE = Table("fmu")

READ_BACK = TABLE(
    "READ_BACK", 1e-6, "1",
    "Relative difference between a value that was set and what is read back, above which the FMU has not taken it: "
    "ten times what is lost where it is kept in single precision.",
)  # fmt: skip
