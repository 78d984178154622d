"""Numbers that decide how files of signals are read."""

from __future__ import annotations

from fmu_didim.thresholds import Table

TABLE = Table("tables")

STAMP_ROUNDING = TABLE(
    "STAMP_ROUNDING", 0.5, "1",
    "Of a sample period by which rounded stamps may lie off the instants of the rate that is given: a stamp that is "
    "farther off is nearer to another instant.",
)  # fmt: skip
SAME_RATE = TABLE(
    "SAME_RATE", 0.01, "1",
    "Relative difference of the rate that is given from that of the stamps, from which they contradict each other.",
)  # fmt: skip
FEWEST_ROWS = TABLE("FEWEST_ROWS", 8, "rows", "Of a reference that can be differentiated or resampled.")
DIFFERENTIATED_NOISE = TABLE(
    "DIFFERENTIATED_NOISE", 0.02, "1",
    "Scatter of a velocity (acceleration) that was computed from a position, of its own standard deviation, from which "
    "it is doubted: a planned trajectory with nine digits has less than 1e-3, an encoder of 4 096 lines at 1 kHz more.",
)  # fmt: skip
BETWEEN_ROWS = TABLE(
    "BETWEEN_ROWS", 1e-3, "1",
    "Of the range of a reference column by which a spline through every second row may miss the others, from which "
    "what lies between rows is doubted; with all rows it misses a sixteenth of that.",
)  # fmt: skip
STARTS_MOVING = TABLE(
    "STARTS_MOVING", 0.01, "1",
    "Of the deviation of a velocity, from which a motion has begun at its first row: the plant then starts with it.",
)  # fmt: skip
