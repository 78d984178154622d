"""Numbers that decide which motion would separate members of an ambiguous set. How the motions themselves look, their
paces and places, is written where they are made: it is searched over."""

from __future__ import annotations

from fmu_didim.thresholds import Table

TABLE = Table("next_experiment")

GRID = TABLE("GRID", 24, "shapes", "Tried of one effect before refinement.")
SHAPE_STEP = TABLE(
    "SHAPE_STEP", 1e-3, "1", "Relative step of the differences by which the slopes of the base's shapes are found."
)
DISPLACEMENT = TABLE("DISPLACEMENT", 1e-5, "rad or m", "Of a link, by which the change of its torque is found.")
SMALLEST_DISPLACEMENT = TABLE("SMALLEST_DISPLACEMENT", 1e-12, "rad or m", "By which that is divided.")
BASE_DEPENDENT = TABLE(
    "BASE_DEPENDENT",
    1e-7,
    "1",
    "Singular value of columns of the base, relative to the largest, that tell nothing more.",
)
BASE_IDLE = TABLE("BASE_IDLE", 1e-9, "1", "Length of a column of the base, relative to the longest, that is rounding.")
ABSORBED = TABLE("ABSORBED", 1e-6, "1", "Fraction of a column below which the base absorbs it whole.")
REFINEMENTS = TABLE("REFINEMENTS", 6, "evaluations", "Of the golden-section search of a shape.")
REFINED = TABLE("REFINED", 0.02, "1", "Relative accuracy at which that search ends.")
SAME = TABLE(
    "SAME", 1e-4, "1",
    "Members are the same to first order when less than this fraction of a signature is left on every motion.",
)  # fmt: skip
MEAN_PART = TABLE("MEAN_PART", 0.1, "1", "Weight of the mean separation beside the smallest one.")
MOST_SAMPLES = TABLE("MOST_SAMPLES", 600, "samples", "That the search looks at; the result is computed with all.")
DRAWS = TABLE("DRAWS", 3, "motions", "Fourier series among the first candidates.")
EVALUATIONS = TABLE("EVALUATIONS", 30, "motions", "Tried to improve the best candidates.")
FIRST_MOVE = TABLE("FIRST_MOVE", 0.35, "1", "Of a design variable from 0 to 1, in the first simplex of that search;")
TURNED = TABLE("TURNED", 0.6, "1", "from this value of the variable on it goes down.")
MOTION_SETTLED = TABLE("MOTION_SETTLED", 0.01, "1", "Change of design and of the logarithm of the score that ends it.")
SMALLEST_SCORE = TABLE("SMALLEST_SCORE", 1e-12, "standard deviations", "Of which that logarithm is taken.")
TRAVELLED = TABLE("TRAVELLED", (0.02, 0.98), "1", "Quantiles of the positions between which effects have their place.")
WITHIN = TABLE("WITHIN", 0.999, "1", "Fraction of the limits of a motion that is used.")
