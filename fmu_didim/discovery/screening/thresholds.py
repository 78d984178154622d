"""Numbers that decide with which shapes and sizes effects are screened."""

from __future__ import annotations

from fmu_didim.thresholds import Table

TABLE = Table("screening")

GRID_LIMIT = TABLE("GRID_LIMIT", 400, "shapes", "Tried of one effect at most; a finer grid is thinned.")
REPEATS = TABLE(
    "REPEATS", 0.05, "1",
    "Two periods of the change that an effect makes are the same, for its signature, when they differ by less than "
    "this fraction of the root mean square of that change: elastic gears ring for a while.",
)  # fmt: skip
TOGETHER = TABLE("TOGETHER", 32, "shapes", "Whose loads the closed loop answers in one go.")
ABREAST = TABLE("ABREAST", 16, "candidates", "Whose signatures are made side by side before the time is looked at.")
SEEN = TABLE(
    "SEEN", 0.1, "1",
    "Fraction of the largest column of an effect below which another one is of second order, such as a tilt out of the "
    "plane of an arm.",
)  # fmt: skip
LARGEST_COLUMN = TABLE(
    "LARGEST_COLUMN", 1e12, "SI", "A larger column comes from states that the offline integration could not follow."
)
STIFFEST = TABLE("STIFFEST", 1e-12, "SI", "Smallest compliance that is turned into a stiffness.")
TORQUE_TRIALS = TABLE(
    "TORQUE_TRIALS",
    (0.03, 0.2),
    "1",
    "Sizes simulated of an effect that is a torque, as fractions of that of the joint.",
)
TRIALS = TABLE(
    "TRIALS", (0.35, 0.75), "1", "Places simulated of a parameter on a logarithmic range: a smaller and a larger one."
)
STIFFNESS_TRIALS = TABLE(
    "STIFFNESS_TRIALS", (0.35, 0.5, 0.65, 0.8), "1", "More of them for a stiffness, with which the loop resonates."
)
LINEAR_TRIAL = TABLE("LINEAR_TRIAL", 0.75, "1", "Place simulated on a range that is not logarithmic.")
APART = TABLE("APART", 1e-9, "SI", "A trial this near to the neutral value is none.")
SAME_SHAPE = TABLE("SAME_SHAPE", 12, "decimal places", "In which shapes that are the same agree.")
SPACING_S = TABLE(
    "SPACING_S", 0.005, "s",
    "Largest spacing of the instants at which loads are looked at, unless the control period is longer.",
)  # fmt: skip
MEMORY_S = TABLE("MEMORY_S", 0.5, "s", "Time after which a lasting load is made up for.")
MOST_TAPS = TABLE("MOST_TAPS", 200, "taps", "Of the answer to a load.")
MOST_OF_LOG = TABLE("MOST_OF_LOG", 4, "1", "The answer is at most one part in so many of the log.")
SIZE = TABLE("SIZE", 0.02, "1", "Of the random two-level test torque, as a fraction of the torque of the joint.")
DWELL_S = TABLE("DWELL_S", (0.01, 0.2), "s", "Range of the times between its changes.")
