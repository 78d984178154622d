"""Numbers that decide around the rounds of discovery: the base model, what is left out, the verdict."""

from __future__ import annotations

from fmu_didim.thresholds import Table

TABLE = Table("discovery")

SMOOTHING = TABLE(
    "SMOOTHING", (0.003, 0.05), "1",
    "Range of the smoothing velocity of Coulomb friction, as fractions of the largest speed of the joint; the value "
    "of the description is always within.",
)  # fmt: skip
SMOOTHING_SCALE = TABLE("SMOOTHING_SCALE", 0.5, "1", "Noticeable change of it, as a fraction of its value.")
FEWEST_SAMPLES = TABLE(
    "FEWEST_SAMPLES", 5, "samples", "For each parameter of the base model; with fewer nothing more can be found."
)
FIRST_NOISE = TABLE(
    "FIRST_NOISE", 1e-9, "N.m or N", "Smallest deviation of a torque with which the first fit weights a joint."
)
FIRST_S = TABLE(
    "FIRST_S", 0.25, "s",
    "Left out at the beginning of each experiment: the state in which the machine starts is not known (gears in their "
    "play, friction's deflection, the loop before the first sample). Where nothing is found, gears are looked for "
    "with it.",
)  # fmt: skip
SAID_EVERY_S = TABLE("SAID_EVERY_S", 5.0, "s", "Time between two lines that tell how far a piece of work is.")
SHOWN_UNTRIED = TABLE("SHOWN_UNTRIED", 4, "candidates", "Named in the sentence; findings.json lists all of them.")
OF_THE_DATA = TABLE(
    "OF_THE_DATA", 16, "rank",
    "Diagnostics of the data before this rank hold whatever the model is; a torque that is limited, pushes, a clock or "
    "a delay, which come after, are what discovery itself names.",
)  # fmt: skip
REMAINDER = TABLE(
    "REMAINDER", 0.6, "standard deviations",
    "Gap of a joint, in units of its noise, above which a model that found no more effects still counts as "
    "incomplete: the clutter that is planted on clean plants in the blind benchmark reaches as far.",
)  # fmt: skip
CURVE_POINTS = TABLE("CURVE_POINTS", 161, "points", "Of a friction curve on the page: a line without visible corners.")
CURVE_DENSITY = TABLE(
    "CURVE_DENSITY", 4.0, "1",
    "c of the velocities sinh(c x) / sinh(c): where friction turns they are seven times as dense as if equally spaced.",
)  # fmt: skip
CURVE_STEP = TABLE(
    "CURVE_STEP", 1e-5, "1",
    "Step of the differences that give its band, as a fraction of a value or, where that is larger, of its standard "
    "deviation: between what rounding and what curvature would spoil.",
)  # fmt: skip
CURVE_SMALLEST = TABLE("CURVE_SMALLEST", 1e-9, "1", "Smallest size of a value for that step, in its unit.")
