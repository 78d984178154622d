"""Numbers that decide in the diagnosis of a log, a plant, a fit and what it leaves."""

from __future__ import annotations

from fmu_didim.thresholds import Table

TABLE = Table("diagnosis")

# Points or averages --------------------------------------------------------------------------------------------------
NEARLY = TABLE(
    "NEARLY", 1.1, "1",
    "Instead of a shift, a way of sampling is fitted if it leaves less than this many times the chi-square of what "
    "was found.",
)  # fmt: skip
SAME_OPERATOR = TABLE("SAME_OPERATOR", 1e-9, "1", "Ways of sampling whose weights differ by less are the same.")

# Noise by periods that repeat ----------------------------------------------------------------------------------------
NOT_NOISE = TABLE(
    "NOT_NOISE", 1.25, "1",
    "Periods whose difference is this many times the noise at high frequencies differ by more than noise.",
)  # fmt: skip
SLOW = TABLE("SLOW", 0.25, "1", "So do those whose difference is that correlated over a time in which noise is not,")
CHANCE = TABLE(
    "CHANCE", 3.0, "standard deviations", "unless a correlation as large comes about by chance in so many samples."
)
TRANSIENT = TABLE(
    "TRANSIENT", 0.1, "1",
    "Fraction of a period that is left out when periods are compared: the first one may begin with a transient.",
)  # fmt: skip
WHOLE_SAMPLES = TABLE(
    "WHOLE_SAMPLES", 1e-3, "samples",
    "A period that is farther from a whole number of samples is not compared: the difference would show the shift.",
)  # fmt: skip
REVERSAL = TABLE(
    "REVERSAL", 0.01, "1",
    "Fraction of the largest speed over which the sign of a speed changes, in the columns along which friction drifts.",
)  # fmt: skip

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

# The judgement -------------------------------------------------------------------------------------------------------
HELD_OUT_RATIO = TABLE(
    "HELD_OUT_RATIO", 1.25, "1",
    "Residual of a joint in a held-out experiment over that of the fit, from which it is predicted worse: half of what "
    "anybody would see in a plot.",
)  # fmt: skip
HELD_OUT_CHANCE = TABLE(
    "HELD_OUT_CHANCE", 1e-3, "1", "Probability, for all joints together, with which noise alone may make it so."
)

MOTION_CHANCE = TABLE(
    "MOTION_CHANCE", 1e-3, "1",
    "Probability, for all joints together, with which noise alone may be said to depend on the motion.",
)  # fmt: skip
BAND = TABLE(
    "BAND", 1.8, "samples",
    "Of filtered data in a period of the cut-off frequency that the test for motion looks at: what a Butterworth "
    "filter of order 4 passes forwards and backwards is white at that rate, to a tenth.",
)  # fmt: skip
ENDS = TABLE(
    "ENDS", 1, "samples", "Of those at each end of a log that are left out: there the filter makes up what it lacks."
)
SAMPLES_A_FUNCTION = TABLE(
    "SAMPLES_A_FUNCTION", 8.0, "samples", "At least, for each function of the motion that a residual is compared with."
)
CLOCK_ALONE = TABLE(
    "CLOCK_ALONE", 0.8, "1",
    "Share of what the motion explains of a residual, from which the rate of the torque alone is the cause: a clock "
    "5 ms late gives 0.9 and more, steeper friction or other gains less than 0.6.",
)  # fmt: skip
SIGNIFICANT = TABLE("SIGNIFICANT", 2.0, "standard deviations", "From which a value is different from zero.")
OWN_PART = TABLE(
    "OWN_PART", 1e-6, "1", "Part of a column that others must leave of it, if it is to say anything of its own."
)
TURNING = TABLE("TURNING", 0.05, "1", "Fraction of the largest speed of a joint over which its direction changes.")
CREEPING = TABLE("CREEPING", 0.005, "1", "The same of what happens at standstill only, such as steeper friction.")

# The residual against the noise ---------------------------------------------------------------------------------------
SLOW_SHARE = TABLE(
    "SLOW_SHARE", 0.5, "1",
    "Of the power of a residual that lies in the band of the motion, from which it is doubted: noise with a memory of "
    "50 ms has 12 to 25 % below 1.25 Hz.",
)  # fmt: skip
SLOW_CONTRAST = TABLE(
    "SLOW_CONTRAST", 30.0, "1",
    "Density of its spectrum there over that above: noise with a memory of 50 ms at 200 Hz has up to 23, a missing "
    "offset of five times the noise 900.",
)  # fmt: skip
MOTION_BAND = TABLE(
    "MOTION_BAND",
    0.5,
    "1",
    "Of the frequencies of a log that the motion may fill: there must be others to compare with.",
)
SPECTRUM_POINTS = TABLE("SPECTRUM_POINTS", 1000, "points", "Of the spectrum of an autoregression in a band.")
STILL_NOT_WHITE = TABLE(
    "STILL_NOT_WHITE", 1e-4, "1",
    "Probability, by Ljung and Box, below which what the colour of a residual leaves is said to be no white noise.",
)  # fmt: skip
COMPARED = TABLE(
    "COMPARED", 1 / 3, "1",
    "Fraction of the samples of a log that repeats by which its noise is known: one and a half periods, the fewest "
    "that are compared, have a third in their difference.",
)  # fmt: skip

EIGENVALUE_TOLERANCE = TABLE(
    "EIGENVALUE_TOLERANCE", 1e-9, "1", "To which the smallest scaled eigenvalue of the inertia matrix is searched for."
)

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
POPULATION = TABLE(
    "POPULATION", 15, "points a joint", "Of positions among which the smallest eigenvalue is searched: usual."
)
GENERATIONS = TABLE("GENERATIONS", 60, "generations", "Of them: more move the eigenvalue by less than 1 % of its size.")
