"""Numbers that decide how effects are put into a loop, and how far their shapes may go."""

from __future__ import annotations

from fmu_didim.thresholds import Table

TABLE = Table("augmentation")

SUBDIVISIONS = TABLE(
    "SUBDIVISIONS",
    (4, 16),
    "ticks",
    "In a control period that are tried: with one, the torque comes half a period late.",
)
SETTLED = TABLE(
    "SETTLED", 1e-3, "1",
    "RMS change of the torque of a joint, as a fraction of its RMS, by four times shorter steps, below which the "
    "longer ones do: little beside the noise of any drive.",
)  # fmt: skip
LIKELY_SIZE = TABLE(
    "LIKELY_SIZE", 0.1, "1", "Of the steepest effects, with which that is tried, as a fraction of the torque."
)
SMALLEST_SCALE = TABLE("SMALLEST_SCALE", 1e-3, "SI", "Noticeable change of a parameter that is proposed as zero.")
WINDOW_EDGES = TABLE("WINDOW_EDGES", 24, "instants", "Edges of a force window that are tried.")
SHORTEST_WAY = TABLE(
    "SHORTEST_WAY", 0.1, "1", "Smallest length of a shape, as a fraction of the way of one control period."
)
LOWEST_SPEED = TABLE("LOWEST_SPEED", 0.003, "1", "Smallest speed of a shape, as a fraction of the joint's largest.")
WIDEST = TABLE("WIDEST", 2.0, "1", "A logarithmic range ends at least at so many times its lowest value.")
MARGIN = TABLE("MARGIN", 0.02, "1", "Fraction of the positions at each end where no place of an effect is tried.")
BEYOND_GRID = TABLE("BEYOND_GRID", 3.0, "1", "By which factor a fit may take a shape beyond its logarithmic grid,")
BEYOND_RANGE = TABLE("BEYOND_RANGE", 0.5, "1", "and by which fraction of its range beyond another one,")
BELOW_RANGE = TABLE("BELOW_RANGE", 0.8, "1", "or down to which fraction of its lowest value where it has one sign.")
