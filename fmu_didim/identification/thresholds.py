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

SECOND_STEP = TABLE(
    "SECOND_STEP", 0.1, "1",
    "A standard deviation that a second step of the sensitivities changes by a larger part is told: 3-sigma then means "
    "2.7.",
)  # fmt: skip
JITTER = TABLE(
    "JITTER", 0.1, "standard deviations",
    "Jitter of a simulated torque, in those of its residual, that is told: the values scatter by it as by noise, and "
    "the steps end up to half a deviation from the minimum.",
)  # fmt: skip
START_MARGIN = TABLE(
    "START_MARGIN", 1e-5, "1",
    "Smallest eigenvalue of the pseudo-inertia of a link at a start, as a fraction of the robot's: what is to be "
    "simulated must have some inertia.",
)  # fmt: skip
NOMINAL_DEVIATION = TABLE(
    "NOMINAL_DEVIATION", 0.3, "1", "Relative standard deviation of the values of a description where they hold a start."
)
NOMINAL_FLOOR = TABLE(
    "NOMINAL_FLOOR", 0.01, "1",
    "Least size that they count with there, in units of the value at which a parameter alone makes up the torque.",
)  # fmt: skip
RISES = TABLE(
    "RISES", 2, "iterations", "So many in a row that do not lower the error: DIDIM hands its best one to the finish."
)
SCANNED = TABLE(
    "SCANNED", 100, "samples",
    "From the begin of a log, on which other minima are looked for first; the lowest are then compared on all.",
)  # fmt: skip
OTHER_MINIMA = TABLE("OTHER_MINIMA", 3, "minima", "Left for lower ones at most.")
FARTHEST_FACTOR = TABLE(
    "FARTHEST_FACTOR",
    6.0,
    "1",
    "Ratio of inertias up to which a resonance that is folded back is looked for elsewhere.",
)
SCAN_STEP = TABLE(
    "SCAN_STEP",
    0.15,
    "1",
    "Largest step of that search: half of the width of the valleys of a TX40's last joint at 100 Hz.",
)
SCAN_PART = TABLE(
    "SCAN_PART", 0.125, "1", "Step of it over the distance of two minima: each has four points on its slopes."
)
VALLEYS = TABLE("VALLEYS", 3, "minima", "Compared on the whole log, the lowest ones.")
HARDLY_WORSE = TABLE(
    "HARDLY_WORSE", 10.8, "chi-square",
    "By which another minimum may be worse, before its other values have been fitted, and count as one that the data "
    "do not exclude: of one degree of freedom, 0.1 % by chance.",
)  # fmt: skip
MAXIMUM_HALVINGS = TABLE("MAXIMUM_HALVINGS", 6, "halvings", "Of a step of DIDIM that leads to nothing better.")
GROWTH = TABLE("GROWTH", 1.5, "1", "A step after which the error is this many times that of the best point is halved.")
ERROR_FLOOR = TABLE(
    "ERROR_FLOOR", 1e-3, "%", "A smaller change of the relative torque error counts as none: data without noise."
)
USELESS_ERROR = TABLE(
    "USELESS_ERROR", 50.0, "%",
    "A start with a larger torque error, whose first step does not bring it below, is given up for another.",
)  # fmt: skip
SAME_MINIMUM = TABLE(
    "SAME_MINIMUM", 2, "starts",
    "So many that end in minima that no machine can have: the others would end there, too.",
)  # fmt: skip
