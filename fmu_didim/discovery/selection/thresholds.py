"""Numbers that decide in the competition of the candidates. Their effect as a whole is measured by the blind benchmark
(docs/discovery.md): 1 520 cases, 99 % of the classes right, no name on 40 clean plants."""

from __future__ import annotations

from fmu_didim.thresholds import Table

TABLE = Table("selection")

# Screening -----------------------------------------------------------------------------------------------------------
SURVIVING = TABLE(
    "SURVIVING", 5e-3, "1",
    "Fraction of a signature that must survive the projection; below, the base parameters absorb it whole.",
)  # fmt: skip
IDLE = TABLE("IDLE", 1e-7, "1", "Fraction of the largest column of an effect below which another one is rounding.")
DEPENDENT = TABLE(
    "DEPENDENT", 1e-8, "1", "Singular value of columns, relative to the largest, below which one tells nothing more."
)
SHORTLIST = TABLE("SHORTLIST", 6, "candidates", "Fitted in the closed loop, beside the best of each class near them.")
WORTH = TABLE(
    "WORTH", 0.25, "1",
    "Fraction of the best gain of the screening below which a candidate is not fitted: it would have to explain four "
    "times what its signature says.",
)  # fmt: skip
LEADING = TABLE(
    "LEADING", 0.75, "1",
    "Fraction of the best gain from which a candidate leads, and further shapes of it are nearly as good.",
)  # fmt: skip
FURTHER = TABLE("FURTHER", 3, "shapes", "Largest number of those further shapes.")
REACH = TABLE(
    "REACH", 4.0, "1",
    "Times what its signature explains to first order, beside the base refitted, that a candidate in the torque "
    "balance may lower chi-square by: where that is not enough for the best so far, it is not fitted. As WORTH, but "
    "against what the best has really explained.",
)  # fmt: skip

# Fits in the closed loop ---------------------------------------------------------------------------------------------
SIZES = TABLE(
    "SIZES", (0.5, 1.0, 2.0), "1",
    "Tried of an effect outside the torque balance, as multiples of what its signature says: gears rattle.",
)  # fmt: skip
ABREAST = TABLE(
    "ABREAST", 4, "candidates",
    "Fitted against the same best so far: what is left early must not depend on which of them ends first.",
)  # fmt: skip
STARTS = TABLE("STARTS", 2, "starts", "Number of those from which it is fitted.")
SMALLER = TABLE(
    "SMALLER", (1.0, 0.3, 0.03), "1",
    "Fractions of what is proposed from which a fit starts, one after the other, until one can be simulated.",
)  # fmt: skip
LEAST = TABLE(
    "LEAST", 5.0, "chi-square",
    "What a candidate must promise to lower chi-square by, for its fit to be carried to the end: less is no BIC "
    "difference of 10.",
)  # fmt: skip

# The decision --------------------------------------------------------------------------------------------------------
ROUNDS = TABLE("ROUNDS", 5, "effects", "Largest number that is named.")
BIC = TABLE(
    "BIC", 10.0, "BIC",
    "Difference from which a larger model is accepted, or one member of a set: 'very strong' evidence by Kass and "
    "Raftery, Journal of the American Statistical Association 90 (1995).",
)  # fmt: skip
SMALLEST_SIZE = TABLE(
    "SMALLEST_SIZE", 0.6, "standard deviations",
    "How much an effect must change the torque at least, in units of the noise of a joint, when it is switched off "
    "and nothing else changes: as much as the clutter that is planted on clean plants in the blind benchmark.",
)  # fmt: skip
SMALLEST_GAIN = TABLE(
    "SMALLEST_GAIN", 0.2, "standard deviations",
    "What it must explain at least that nothing else in the model can, in the same units.",
)  # fmt: skip
KEPT_GAIN = TABLE(
    "KEPT_GAIN", 0.5, "1", "Fraction of that which an effect must still explain when later ones are in the model."
)
SMALLEST_SHARE = TABLE("SMALLEST_SHARE", 0.05, "1", "And as a fraction of the gap.")
SMALLEST_PART = TABLE(
    "SMALLEST_PART", 0.03, "1",
    "And as a fraction of the gap that the base model had on the joint where it explains most: a refinement of what "
    "was found is not another effect. On EMPS four further forms of friction and ripple explain less than 3 % each.",
)  # fmt: skip
WORSE_JOINT = TABLE(
    "WORSE_JOINT", 1.02, "1",
    "Lower end of the interval of the held-out RMS ratio of a joint above which an effect makes that joint worse; the "
    "base parameters, fitted anew, may move others by a little.",
)  # fmt: skip
ZERO = TABLE(
    "ZERO", 0.05, "1",
    "Probability, by its covariance, with which an effect may be zero and still be named: that of a 95 % interval.",
)  # fmt: skip
HELD_OUT = TABLE(
    "HELD_OUT", 1.0, "1", "The interval of the held-out RMS ratio must lie below: else a model may be worse."
)
NEAR = TABLE(
    "NEAR", 0.02, "1",
    "Fraction of the gain in BIC by which contenders may differ and still be ambiguous: no form is exact. Measured "
    "with the blind benchmark.",
)  # fmt: skip

# The pre-check -------------------------------------------------------------------------------------------------------
FITTED = TABLE("FITTED", 4, "trials", "The best ones, whose joints are fitted.")
PROMISING = TABLE(
    "PROMISING", 0.9, "1", "Fraction of the chi-square of the base model below which the best trial must come."
)
WORSE = TABLE(
    "WORSE", 1.02, "1",
    "Held-out RMS ratio beyond which data that do not reach the value still speak against it; a little comes from the "
    "base parameters, which are fitted along.",
)  # fmt: skip
