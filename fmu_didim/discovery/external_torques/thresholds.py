"""Numbers that decide whether torques from outside acted, and when. On EMPS with 25 pulses all of them are found,
their edges within 0.6 ms (docs/discovery.md)."""

from __future__ import annotations

from fmu_didim.diagnosis.thresholds import MAXIMUM_WINDOWS
from fmu_didim.thresholds import Table

TABLE = Table("external_torques")

# The search to first order -------------------------------------------------------------------------------------------
MOST = TABLE("MOST", 2 * MAXIMUM_WINDOWS, "external torques", "Looked for on a joint: twice as many as windows.")
STEP_COST = TABLE("STEP_COST", 2.0, "parameters", "That one step counts as: instant and size.")
INDEPENDENT = TABLE(
    "INDEPENDENT", 0.05, "1", "Smallest fraction of the samples that counts as independent in the cost of a step."
)
WEAKEST = TABLE(
    "WEAKEST", 0.02, "1",
    "Of the largest power of a shifted response: steps at the end of the log, which hardly show, count as that much.",
)  # fmt: skip
SMALLEST_GAIN = TABLE(
    "SMALLEST_GAIN", 0.003, "1", "Fraction of the sum of squares that a step must explain to be looked at."
)
UNSETTLED = TABLE(
    "UNSETTLED", 0.2, "1", "Fraction of its largest value by which a response may be off its end, to count as settled."
)
NEAR = TABLE(
    "NEAR", 5.0, "samples",
    "Of the log, beyond the time in which the loop settles, within which steps are taken for one.",
)  # fmt: skip
UNPAIRED = TABLE(
    "UNPAIRED", 0.35, "1",
    "Fraction of a step up by which the step down may differ, so that both bound one external torque.",
)  # fmt: skip
LEAST = TABLE(
    "LEAST", 0.05, "1", "Fraction of the largest step below which a step only corrects the instant of another."
)
LINEAR_SHARE = TABLE(
    "LINEAR_SHARE", 0.5, "1",
    "Fraction of the gap that external torques must explain to first order, whose times are those of control periods.",
)  # fmt: skip

# What is no external torque ------------------------------------------------------------------------------------------
LONGEST = TABLE(
    "LONGEST", 0.5, "1",
    "Fraction of the data that external torques may last: what lasts longer, or does not end, may as well be an "
    "offset or a load.",
)  # fmt: skip
UNBOUNDED = TABLE("UNBOUNDED", 0.5, "1", "Fraction of their time that may lie in those without a visible edge.")
STAIRCASE = TABLE(
    "STAIRCASE", 0.25, "1",
    "Fraction of the external torques that may follow each other without a pause: more of them only copy what else is "
    "missing.",
)  # fmt: skip
COMES_BACK = TABLE(
    "COMES_BACK", 0.5, "1",
    "Fraction of the impulse that is there again one period later, from which it belongs to the machine.",
)  # fmt: skip
SAME_PHASE = TABLE("SAME_PHASE", 0.05, "1", "Fraction of a period within which two phases are the same,")
SAME_PHASE_S = TABLE("SAME_PHASE_S", 0.1, "s", "but no longer than this.")

# The fit in the closed loop ------------------------------------------------------------------------------------------
SHARE = TABLE(
    "SHARE", 0.6, "1", "Fraction of the gap that external torques must explain to be taken for what is missing."
)
DELAY_START = TABLE("DELAY_START", 0.1, "control periods", "Added to the known delay of the loop where its fit starts.")
DELAY_ROOM = TABLE("DELAY_ROOM", 3.0, "control periods", "By which the delay of the loop may be longer than known.")
FIRST_STEPS = TABLE("FIRST_STEPS", 12, "steps", "Of the fit of times and torques, and after an edge was moved.")
FURTHER_STEPS = TABLE("FURTHER_STEPS", 8, "steps", "Once more, with the noise that is left.")
UPDATES = TABLE("UPDATES", 2, "sensitivities", "Taken anew at most in each of those fits.")
LAST_STEPS = TABLE("LAST_STEPS", 6, "steps", "Of the last fit, beside the effects that were found.")
EDGE_MOVES = TABLE(
    "EDGE_MOVES", (-0.6, -0.3, 0.3, 0.6), "control periods",
    "Tried of each edge: its instant has a minimum in each control period.",
)  # fmt: skip
EDGE_GAIN = TABLE("EDGE_GAIN", 1.0, "chi-square", "That such a move must gain.")
EDGE_ROOM = TABLE(
    "EDGE_ROOM", 4.0, "samples or control periods", "How far a fit may take an edge; the longer of the two."
)
EDGE_SLOPE = TABLE(
    "EDGE_SLOPE", 0.5, "control periods", "Over which slopes of edges are taken: at an instant they change abruptly."
)

# What is written down ------------------------------------------------------------------------------------------------
LISTED = TABLE(
    "LISTED", 3, "external torques", "Up to which all are listed as parameters; the windows list them in any case."
)
SMALLEST_DEVIATION = TABLE("SMALLEST_DEVIATION", 1e-12, "N.m or N", "By which a torque is divided for its score.")
