"""Numbers that decide in the diagnosis of a log, a plant, a fit and what it leaves."""

from __future__ import annotations

from fmu_didim.thresholds import Table

TABLE = Table("diagnosis")

# The torque log ------------------------------------------------------------------------------------------------------
AGAINST = TABLE("AGAINST", -0.7, "1", "Correlation below which a torque counts as turned round.")
FOLLOWS = TABLE(
    "FOLLOWS", 0.7, "1", "Correlation above which a torque follows the simulated one, so that their ratio counts."
)
OTHER_ORDER = TABLE(
    "OTHER_ORDER", 0.1, "1", "Fraction of the error to which another order of the joints must bring it down."
)
WRONG_ORDER = TABLE(
    "WRONG_ORDER", 0.5, "1",
    "Error for each joint below which the order of the joints is not doubted: half of the mean square of the torque.",
)  # fmt: skip
OTHER_UNIT = TABLE(
    "OTHER_UNIT", 30.0, "1",
    "Ratio of measured to simulated torque beyond which another unit is suspected, up or down: more than the "
    "start values of a machine are wrong by.",
)  # fmt: skip

# Points or averages --------------------------------------------------------------------------------------------------
NEARLY = TABLE(
    "NEARLY", 1.1, "1",
    "Instead of a shift, a way of sampling is fitted if it leaves less than this many times the chi-square of what "
    "was found.",
)  # fmt: skip
SAME_OPERATOR = TABLE("SAME_OPERATOR", 1e-9, "1", "Ways of sampling whose weights differ by less are the same.")

# Where a model disagrees ---------------------------------------------------------------------------------------------
BINS = TABLE("BINS", 12, "bins", "Of each quantity, with the same number of samples: enough to see where.")
FEWEST_EDGES = TABLE("FEWEST_EDGES", 3, "edges", "A quantity that does not fill two bins says nothing.")
FALSE_DISCOVERIES = TABLE("FALSE_DISCOVERIES", 0.01, "1", "Expected fraction of the regions named that are none.")
WINDOW_SCORE = TABLE(
    "WINDOW_SCORE", 8.0, "standard deviations",
    "By which the mean of a window must differ before it counts as a force of its own: far beyond chance, because "
    "model error is no noise.",
)  # fmt: skip
MAXIMUM_WINDOWS = TABLE("MAXIMUM_WINDOWS", 24, "windows", "Looked for on a joint: hardly more are events.")
LONGEST_WINDOW = TABLE(
    "LONGEST_WINDOW", 0.3, "1", "Fraction of the log that a window may last: a longer one is no event of its own."
)
SHORTEST_WINDOW = TABLE("SHORTEST_WINDOW", 3, "samples", "A window of fewer is an outlier of the logger.")
WINDOW_GRID = TABLE(
    "WINDOW_GRID", 800, "instants", "At the edges of windows in the first search; then they are polished."
)

# What a comparison is worth ------------------------------------------------------------------------------------------
BOOTSTRAP = TABLE("BOOTSTRAP", 2000, "draws", "Of the bootstrap: the ends of a 95 % interval then stand still.")
BLOCK_S = TABLE(
    "BLOCK_S", 0.5, "s", "Length of the blocks of the bootstrap: longer than the memory of friction and of the loop."
)
VARIANCE_FLOOR = TABLE(
    "VARIANCE_FLOOR", 0.25, "1",
    "Of the variance of the noise, below which no residual counts as better: a BIC difference is that of model error. "
    "Half of the noise in size, which may be an upper bound.",
)  # fmt: skip

# What the data cannot tell apart -------------------------------------------------------------------------------------
COLLINEAR = TABLE(
    "COLLINEAR", 1e-6, "1",
    "Singular value, of columns of length one over the square root of their number, below which errors of the "
    "derivatives (1e-6 of a column) decide what is identified.",
)  # fmt: skip
UNKNOWN_SIZE = TABLE(
    "UNKNOWN_SIZE", 1.0, "1",
    "A parameter is not known at all if its standard deviation is more than this fraction of its value,",
)  # fmt: skip
UNKNOWN_TORQUE = TABLE(
    "UNKNOWN_TORQUE", 0.05, "1",
    "and moves the torque by more than this fraction of it: that many a small parameter is not significant says "
    "nothing yet.",
)  # fmt: skip
INFLATION = TABLE(
    "INFLATION", 10.0, "1",
    "Ratio of the standard deviation to that with all others known, from which a parameter is unknown because of "
    "others.",
)  # fmt: skip

# Experiments that were fitted together -------------------------------------------------------------------------------
SIGNIFICANCE = TABLE(
    "SIGNIFICANCE", 0.001, "1",
    "Probability, for all experiments together, with which experiments that agree are said to disagree.",
)  # fmt: skip
RANK = TABLE(
    "RANK", 1e-9, "1",
    "Eigenvalues below this fraction of the largest one are directions that an experiment does not show.",
)  # fmt: skip

# The plant against the robot description -----------------------------------------------------------------------------
POINTS = TABLE("POINTS", 20, "instants", "Compared, spread over what is simulated.")
LENGTHS = TABLE(
    "LENGTHS", (2000, 200, 20, 10), "ticks",
    "Of the reference that are simulated; fewer where the loop does not run for so long.",
)  # fmt: skip
TORQUE_TOLERANCE = TABLE(
    "TORQUE_TOLERANCE", 1e-3, "1", "Relative difference of the torque from which plant and description are different."
)
COLUMN_TOLERANCE = TABLE("COLUMN_TOLERANCE", 1e-2, "1", "The same of a column of the regressor.")
DIFFERENCE_TOLERANCE = TABLE(
    "DIFFERENCE_TOLERANCE", 5e-2, "1", "The same of both where accelerations are differences of velocities."
)
QUIET_JOINT = TABLE(
    "QUIET_JOINT", 1e-3, "1",
    "Fraction of the torque of all joints with which a joint is compared that hardly needs any itself.",
)  # fmt: skip
UNEXCITED = TABLE("UNEXCITED", 1e-12, "SI", "A column that is nowhere larger is not excited by the motion.")
SILENT_COLUMN = TABLE(
    "SILENT_COLUMN", 1e-6, "1", "Fraction of a column below which the plant's is what differences leave of nothing."
)
EXPLAINED = TABLE("EXPLAINED", 0.05, "1", "A cause is named if it leaves less than this fraction of the difference.")
SHOWN_GRAVITY = TABLE(
    "SHOWN_GRAVITY", 1e-6, "1", "Components of gravity below this fraction of the largest are shown as zero: rounding."
)
CHANGE = TABLE(
    "CHANGE", 1e-2, "1",
    "Relative change of a parameter by which its column is found, and whether it acts at all: large against the "
    "jitter of any integrator.",
)  # fmt: skip

# Before long work ----------------------------------------------------------------------------------------------------
FIRST_TICKS = TABLE("FIRST_TICKS", 200, "ticks", "Simulated first; what shows no effect there is simulated to the end.")
COMPARED_TICKS = TABLE("COMPARED_TICKS", 50, "ticks", "At which the signals are compared.")
START_TOLERANCE = TABLE(
    "START_TOLERANCE", 1e-3, "1",
    "Distance of the plant from the start of the reference, relative to the range of the reference, from which the "
    "user is warned.",
)  # fmt: skip
STANDSTILL = TABLE("STANDSTILL", 1e-9, "SI", "Smallest range with which that is compared, of a joint that rests.")

# What physical links can have ----------------------------------------------------------------------------------------
SMALLEST_DEVIATION = TABLE(
    "SMALLEST_DEVIATION", 1e-6, "1",
    "Standard deviation of a value, relative to it, that is taken at least: data without noise have weights, too.",
)  # fmt: skip
TOUCHES = TABLE(
    "TOUCHES", 0.01, "standard deviations", "Values that are nearer to physical ones are physical: the solver's rest."
)
MASS_ALONE = TABLE(
    "MASS_ALONE", 1e-6, "1",
    "Weight of what no data show, such as the mass of the first link, against squared standard deviations: it keeps "
    "the problem bounded.",
)  # fmt: skip
NEGATIVE_FRICTION = TABLE(
    "NEGATIVE_FRICTION", 2.0, "standard deviations",
    "Friction that lies farther below zero would drive the machine: one of forty does so by chance.",
)  # fmt: skip
FALSE_UNPHYSICAL = TABLE(
    "FALSE_UNPHYSICAL", 1e-3, "1",
    "Probability with which noise alone puts a physical robot so far from physical values. The square of the distance "
    "is a chi-square of as many degrees as inequalities hold the nearest values back.",
)  # fmt: skip
POSITIONS = TABLE(
    "POSITIONS", 1024, "positions", "In the whole range of the joints, at which the inertia matrix is looked at first."
)
DESCENTS = TABLE("DESCENTS", 4, "positions", "The worst of them, from which a minimum is sought.")
