"""Numbers that decide whether data can be those of a loop."""

from __future__ import annotations

import math

from fmu_didim.thresholds import Table

TABLE = Table("data")

# The reference alone -------------------------------------------------------------------------------------------------
CONTRADICTION = TABLE(
    "CONTRADICTION", 0.05, "1",
    "Of what a signal and the integral of its derivative vary by, from which the two contradict each other: far beyond "
    "the error of the trapezoidal rule at control rates.",
)  # fmt: skip
STANDSTILL = TABLE("STANDSTILL", 1e-9, "SI", "Variation below which a signal counts as constant.")
REFERENCE_STEP = TABLE(
    "REFERENCE_STEP", 0.01, "1", "Of a control period by which stamps of a reference may lie off, as in the master."
)
LARGEST_LENGTH = TABLE(
    "LARGEST_LENGTH", 20.0, "m", "Of a link, beyond which millimetres are suspected: no machine with joints has it."
)

# The torque log alone ------------------------------------------------------------------------------------------------
SAME = TABLE("SAME", 1e-9, "1", "Of the range of a column within which values count as equal: rounding.")
STRAIGHT = TABLE(
    "STRAIGHT", 1e-5, "1",
    "Of the range of a column within which three samples lie on a straight line: the rounding of a text file.",
)  # fmt: skip
FEWEST_STAIRS = TABLE("FEWEST_STAIRS", 10, "steps", "Of equal length, below which a staircase may be chance.")
ON_STAIRS = TABLE("ON_STAIRS", (1.0, 99.0), "%", "Between which the ends of its steps must lie on their grid.")
NEARLY_CONTROL_RATE = TABLE(
    "NEARLY_CONTROL_RATE", 0.9, "1",
    "Of the control rate, from which stairs in a log are those of the held command, as they should be.",
)  # fmt: skip
JITTER = TABLE("JITTER", 0.05, "1", "Of a sample period by which stamps may scatter: rounding of clocks is less.")
COARSE = TABLE(
    "COARSE", 256, "steps",
    "Steps in the range of a column up to which it is said to be quantised: 8 bits; finer ones are below usual noise.",
)  # fmt: skip
TOO_COARSE = TABLE(
    "TOO_COARSE", 24, "steps",
    "Steps in the range up to which it is doubted that quantisation acts as noise: it is above 1 % of the torque.",
)  # fmt: skip
ON_GRID = TABLE("ON_GRID", 0.02, "1", "Of a step by which values may lie off the grid of a quantised log: rounding.")
CLIPPED = TABLE("CLIPPED", 0.01, "1", "Part of the samples at an extreme value from which a log may be saturated,")
FEWEST_CLIPPED = TABLE("FEWEST_CLIPPED", 5, "samples", "and their smallest number,")
CLIPPED_SPREAD = TABLE(
    "CLIPPED_SPREAD", 0.1, "1",
    "and the part of its range by which the expected torque varies at those samples: at rest, or where the controller "
    "saturates in the model too, it does not.",
)  # fmt: skip
SPIKE = TABLE(
    "SPIKE", 0.5, "1",
    "Of the range of a column (its 5 % to 95 % quantile) by which a sample must leave the median of its neighbours: a "
    "reversal of friction that comes at another moment leaves less.",
)  # fmt: skip
NEIGHBOURS = TABLE("NEIGHBOURS", 5, "samples", "Of that median: one or two of them may be spikes.")
QUANTILES = TABLE("QUANTILES", (5.0, 95.0), "%", "Between which the range of a column is taken, free of outliers.")
MOST_SPIKES = TABLE("MOST_SPIKES", 0.1, "1", "Part of the samples above which they are no outliers but the rule.")

# Several experiments -------------------------------------------------------------------------------------------------
COPIED = TABLE("COPIED", 0.5, "1", "Part of the rows of a held-out log that stand in a fitted one, to the last digit.")

# The plant -----------------------------------------------------------------------------------------------------------
TICKS_LOOKED_AT = TABLE(
    "TICKS_LOOKED_AT", 2000, "ticks", "Of the loop, from its start: two seconds at 1 kHz, a fraction of an experiment."
)
FEWEST_CHANGES = TABLE(
    "FEWEST_CHANGES", 10, "changes", "Of the outputs of a plant, for a word on how long it usually holds them."
)

# The log against the torque that is expected -------------------------------------------------------------------------
SUBSTEPS = TABLE(
    "SUBSTEPS", 4, "substeps",
    "Of the plant, or as many as are stable: a torque to 1e-3, fifteen times as fast as one to 1e-6.",
)  # fmt: skip
EXPLAINS = TABLE(
    "EXPLAINS", 0.5, "1",
    "Error of a free linear fit along the reference, of the deviation of the torque, below which the reference belongs "
    "to the log: three quarters of its variance are explained.",
)  # fmt: skip
CHANCE = TABLE(
    "CHANCE", 0.6, "1",
    "Of the error that the same fit leaves of the log rolled to other instants, the median of SHIFTS of them, above "
    "which it explains no more than chance: 52 parameters explain a third of any log. Right data: at most 0.6 in all "
    "examples, with pushes and effects that the model lacks; other runs of the same robot: from 0.65.",
)  # fmt: skip
SHIFTS = TABLE("SHIFTS", (0.13, 0.23, 0.31, 0.43, 0.57, 0.69, 0.77), "1", "Of the length of the log: no whole periods.")
OTHER_JOINT = TABLE(
    "OTHER_JOINT", 0.5, "1",
    "By which the correlation with another joint must be higher, mean over the joints that change places.",
)  # fmt: skip
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
    "OTHER_UNIT", 8.0, "1",
    "Ratio of measured to simulated torque beyond which another unit is suspected, up or down: start values of a "
    "machine may be wrong by a factor of three; 8.85 in-lb and 10.2 kgf cm are 1 N.m.",
)  # fmt: skip
GAIN_RATIO = TABLE(
    "GAIN_RATIO", 2.0, "1",
    "Ratio of measured to simulated torque, up or down, from which it is asked whether the drive gain explains it.",
)  # fmt: skip
GAIN_FITS = TABLE(
    "GAIN_FITS",
    0.5,
    "1",
    "Part of the logarithm of that ratio that may be left, joints together, if the gain explains it.",
)
UNLIKE = TABLE(
    "UNLIKE", 1.0, "1",
    "Unlikeness of the log to the torque of the nominal values along the reference, 1 - correlation + |ln ratio| / ln "
    "OTHER_UNIT, mean over the joints, from which other units of the reference are tried,",
)  # fmt: skip
LIKE = TABLE("LIKE", 0.5, "1", "and below which they explain the log.")
LARGEST_RANGE = TABLE(
    "LARGEST_RANGE",
    4 * math.pi,
    "rad",
    "Of a joint, two turns: if degrees explain the log, they are taken for granted.",
)
LARGEST_STROKE = TABLE("LARGEST_STROKE", 20.0, "m", "Of a joint: if millimetres explain the log, they are as well.")
DEPENDENT = TABLE(
    "DEPENDENT",
    1e-12,
    "1",
    "Eigenvalue of the normal equations, of the largest one, below which columns depend on others.",
)

# Along a simulated motion --------------------------------------------------------------------------------------------
DIDIM_STEPS = TABLE("DIDIM_STEPS", 5, "simulations", "Towards the measured motion at most: DIDIM takes two or three.")
NEAR = TABLE("NEAR", 0.7, "1", "Error, of the deviation of the log, from which a motion is near enough to judge by it.")
HELPS = TABLE("HELPS", 0.98, "1", "Of the error that a step must leave at most for another one to be worth it.")
EXACT = TABLE(
    "EXACT", 1e-4, "1",
    "Of the deviation of a torque, below which a residual is the error of the simulation, not noise of the log.",
)  # fmt: skip
SHIFTS_S = TABLE(
    "SHIFTS_S", (0.002, 0.006, 0.018, 0.054, 0.16, 0.5), "s",
    "Shifts of a log that are tried, late and early; between the best and its neighbours the least misfit is searched.",
)  # fmt: skip
SHIFT_PASSES = TABLE("SHIFT_PASSES", 4, "fits", "Of the motion with the shift that was found, until it stands still.")
RIVALS = TABLE("RIVALS", 2, "explanations", "That are told where the data cannot decide between more.")
SHIFT_ACCURACY = TABLE("SHIFT_ACCURACY", 0.02, "control periods", "To which the least misfit is searched.")
CURVATURE = TABLE("CURVATURE", 0.5, "control periods", "Beside the least misfit at which its curvature is taken.")
SHIFT_SIGMAS = TABLE("SHIFT_SIGMAS", 4.0, "standard deviations", "Of a shift from which it is told,")
LEAST_SHIFT = TABLE("LEAST_SHIFT", 0.3, "control periods", "and its size: less is how a command is held.")
CLEARLY = TABLE(
    "CLEARLY", 20.0, "1", "BIC difference from which an explanation is told: twice that of very strong evidence."
)
WORTH_IT = TABLE("WORTH_IT", 0.97, "1", "Of the mean square residual that an explanation must leave at most.")

FINE = TABLE("FINE", 0.1, "1", "Of the step to its sides, to which the least misfit is searched.")
LEAST_SCALE = TABLE("LEAST_SCALE", 0.05, "1", "Relative change of a scale or a length from which it is told.")
LARGEST_SCALE = TABLE("LARGEST_SCALE", 4.0, "1", "Up to which a scale is looked for, up and down.")
LARGEST_CHANGE = TABLE("LARGEST_CHANGE", 0.6, "1", "Relative change up to which a length is looked for.")
SHORT_LINK = TABLE("SHORT_LINK", 0.2, "1", "Of the longest length, below which none is doubted: it hardly shows.")

# What the data can tell ----------------------------------------------------------------------------------------------
LOOSE = TABLE("LOOSE", 1e-9, "1", "Singular value, of the largest one, of directions along which no step is made.")
SIGNIFICANT = TABLE("SIGNIFICANT", 2.0, "standard deviations", "Of a value, from which it will be told from zero.")
CORRELATED = TABLE("CORRELATED", 0.9, "1", "Correlation from which the partner of a parameter is shown.")
RINGING_S = TABLE("RINGING_S", 2.0, "s", "After a kick in which a loop is watched: many periods of any resonance.")
KICK = TABLE("KICK", 1e-3, "1", "Of the range of a reference column, by which its first value is changed.")
SLOWEST = TABLE("SLOWEST", 3, "frequencies", "Of a spectrum, whose mean stands for its beginning.")
STANDS_OUT = TABLE(
    "STANDS_OUT", 4.0, "1", "Power of a peak against the beginning of the spectrum from which it rings: twice in size."
)
