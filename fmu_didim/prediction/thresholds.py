"""Numbers that decide in the prediction: noise, repetition, steps of differences, the solver."""

from __future__ import annotations

from fmu_didim.thresholds import Table

TABLE = Table("prediction")

# Periods and noise ---------------------------------------------------------------------------------------------------
REPEATS_WITHIN = TABLE(
    "REPEATS_WITHIN", 1e-6, "1",
    "Two periods of a reference are the same when they differ by less than this fraction of its range: what a file "
    "with seven digits keeps. The search for the lag allows the same of the mean square.",
)  # fmt: skip
SHORTEST_PERIOD = TABLE("SHORTEST_PERIOD", 10, "ticks", "A shorter period would be one of the control.")
LONGEST_PERIOD = TABLE(
    "LONGEST_PERIOD", 0.75, "1", "Fraction of a reference that a period may last: a quarter must be there twice."
)
FEWEST_DIFFERENCES = TABLE(
    "FEWEST_DIFFERENCES", 30, "samples",
    "Fewer differences of two periods give no noise: the deviation of 30 is known to 13 %.",
)  # fmt: skip
LARGEST_CORRELATION = TABLE(
    "LARGEST_CORRELATION", 0.98, "1",
    "Correlation of neighbouring samples that is believed at most, so that one sample of a hundred still counts.",
)  # fmt: skip
SEGMENTS = TABLE("SEGMENTS", 6, "segments", "A residual's spectrum comes from at least as many, for their median.")
SEGMENT = TABLE("SEGMENT", (32, 256), "samples", "Shortest and longest of those segments.")
ABOVE_MOTION = TABLE(
    "ABOVE_MOTION", 4.0, "1",
    "From this many times the highest frequency of the motion on, a residual counts as noise: what friction adds to "
    "the motion has faded there.",
)  # fmt: skip
HIGHEST_CUT = TABLE(
    "HIGHEST_CUT", 0.3, "1", "Of the sample rate: the noise is looked for from there at the latest; half is the most."
)
FEWEST_FREQUENCIES = TABLE(
    "FEWEST_FREQUENCIES", 4, "frequencies", "With fewer above the cut, the upper half of the spectrum is taken."
)
UPPER_HALF = TABLE("UPPER_HALF", 0.5, "1", "That half, as a fraction of the highest frequency.")
CORRELATIONS = TABLE("CORRELATIONS", (-0.5, 0.9), "1", "Range of those tried for the colour of a residual.")
CORRELATION_COUNT = TABLE("CORRELATION_COUNT", 57, "correlations", "Tried in that range, in steps of 0.025.")
USUAL = TABLE("USUAL", (0.2, 0.2), "1", "Correlation of neighbouring samples that noise usually has, and its spread.")
SLOW_S = TABLE("SLOW_S", 0.05, "s", "Noise of a current sensor has forgotten itself after this time.")
LEAST_NOISE = TABLE(
    "LEAST_NOISE", 1e-9, "1",
    "Smallest noise, as a fraction of the torque: a simulated log may repeat exactly, its weight must stay finite.",
)  # fmt: skip
BLOCKS = TABLE("BLOCKS", 20, "blocks", "In a period, to find those in which something happened once.")
SHORTEST_BLOCK = TABLE("SHORTEST_BLOCK", 10, "samples", "A block is not shorter: the power of fewer samples is chance.")
OUTLIER = TABLE("OUTLIER", 6.0, "1", "A block of this many times the usual power is no noise.")
MOST_OUTLIERS = TABLE(
    "MOST_OUTLIERS", 0.4, "1", "Unless so large a fraction of them is: then the motion has loud and quiet parts."
)
OUTLIER_ROUNDS = TABLE("OUTLIER_ROUNDS", 4, "rounds", "Blocks are left out at most so often.")
SMOOTHED = TABLE(
    "SMOOTHED", (0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005), "1",
    "Cut-offs of the low-pass of a reference from which accelerations are computed, of its rate, tried in this order; "
    "half of it is none. The last one is 5 Hz at 1 kHz, about where the motion of an arm ends.",
)  # fmt: skip
SMOOTHED_ORDER = TABLE("SMOOTHED_ORDER", 4, "1", "Of that filter, a Butterworth one run forward and backward.")
NOISE_OF_ACCELERATION = TABLE(
    "NOISE_OF_ACCELERATION", 0.1, "1",
    "Fraction of the deviation of an acceleration that its noise may have: 1 % of its power.",
)  # fmt: skip
MOTION_POWER = TABLE(
    "MOTION_POWER", 0.999, "1", "Fraction of the power of the velocities below the highest frequency of a motion."
)
NOISE_FLOOR = TABLE(
    "NOISE_FLOOR", 1e-12, "1",
    "Fraction of the torque below which a residual is rounding, so that data without noise have weights, too.",
)  # fmt: skip
HALF_OF_RESIDUAL = TABLE(
    "HALF_OF_RESIDUAL", 0.5, "1",
    "Fraction of its residual that a joint is weighted with at least in a projection: repeatable model error is no "
    "precision.",
)  # fmt: skip
DEPENDENT = TABLE(
    "DEPENDENT", 1e-9, "1",
    "Singular value, relative to the largest one, of columns of length one that depend on others: rounding of the "
    "sensitivities lies above it, that of the arithmetic below.",
)  # fmt: skip

# The colour of a residual ---------------------------------------------------------------------------------------------
GATE_LAGS = TABLE(
    "GATE_LAGS", 3, "samples", "A residual is white if its correlations up to this lag are: colour shows there first."
)
NOT_WHITE = TABLE(
    "NOT_WHITE", 0.05, "1",
    "Probability of the correlations of all joints by chance, below which they have a colour. A false alarm costs "
    "little, since what is then estimated is nearly white; a colour that is not seen costs coverage.",
)  # fmt: skip
CLEARLY_NOT_WHITE = TABLE(
    "CLEARLY_NOT_WHITE", 0.01, "1", "The same of one joint where all together look white; there are several to ask."
)
LONGEST_GAP = TABLE(
    "LONGEST_GAP", 1000, "samples", "A longer gap in a log counts as so long: nothing remembers across."
)
FEWEST_COLOURED = TABLE("FEWEST_COLOURED", 20, "samples", "Fewer are too few to see a colour in.")
ORDERS = TABLE(
    "ORDERS", 10.0, "1",
    "Largest order of an autoregression, over the decimal logarithm of the samples: usual, and enough for noise of "
    "50 ms at 200 Hz, which needs about seven.",
)  # fmt: skip
SAMPLES_A_COEFFICIENT = TABLE("SAMPLES_A_COEFFICIENT", 5.0, "samples", "At least, for each coefficient tried.")
COLOUR_ROUNDS = TABLE(
    "COLOUR_ROUNDS", 3, "rounds", "Of colour and what the fit takes from it: a fourth moves no deviation by 1 %."
)
WHITENESS_LAGS = TABLE(
    "WHITENESS_LAGS", 10, "samples", "Correlations, beyond the order of the colour, that are tested after it."
)
EXCESS = TABLE(
    "EXCESS", 0.001, "1",
    "Probability of as large a residual by chance, below which a joint is said to be off by more than its known noise.",
)  # fmt: skip

# A log that repeats --------------------------------------------------------------------------------------------------
REPEATS_TORQUE = TABLE(
    "REPEATS_TORQUE", 1e-5, "1",
    "Two periods of a torque are the same when they differ by less than this fraction of its root mean square.",
)  # fmt: skip
MARGIN = TABLE(
    "MARGIN", 0.1, "1", "Fraction of a period after which a column of sensitivities repeats, once the torque does."
)
REPEATS_COLUMN = TABLE("REPEATS_COLUMN", 1e-3, "1", "The same for columns of sensitivities, which are differences.")
OVERLAP = TABLE(
    "OVERLAP", 0.1, "1", "Fraction of a period simulated twice, to see whether a column repeats like the torque."
)
WHOLE_SAMPLES = TABLE(
    "WHOLE_SAMPLES", 1e-6, "samples", "A period that is farther from a whole number of samples is not continued."
)
FEWEST_PERIODS = TABLE("FEWEST_PERIODS", 1.5, "periods", "A log of fewer is simulated to its end.")
WORTHWHILE = TABLE(
    "WORTHWHILE", 0.8, "1", "Fraction of a log up to which its first part is simulated alone: beyond, nothing is saved."
)

# Steps of differences ------------------------------------------------------------------------------------------------
STEP = TABLE(
    "STEP", 1e-4, "1",
    "Step of the forward differences of a search, in units of a parameter's scale: our loops are smooth to 1e-10, "
    "truncation rules.",
)  # fmt: skip
SHORTER_STEP = TABLE(
    "SHORTER_STEP", 30.0, "1", "Where neither that step nor its opposite can be simulated, one so many times shorter."
)
SMOOTH_STEP = TABLE(
    "SMOOTH_STEP", 3e-7, "1",
    "Of the value at which a parameter alone would make up the whole torque. The simulations of our own plants are "
    "smooth in the parameters, so that truncation and rounding both stay at some 1e-6 of the sensitivity.",
)  # fmt: skip
DIFFERENCE_STEPS = TABLE(
    "DIFFERENCE_STEPS", (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.03, 0.1, 0.3), "1",
    "Relative steps tried on a loop whose integrator is not ours, from rounding to where no parameter acts linearly; "
    "denser where the torque jitters that much.",
)  # fmt: skip
ROUGHNESS = TABLE(
    "ROUGHNESS", 0.1, "1", "Error of a column, relative to its norm, that a search among many models goes on with."
)
SMOOTH = TABLE("SMOOTH", 1e-3, "1", "The same of a fit, until the columns are known that a column has to be told from.")
SHARE_OF_SINGULAR = TABLE(
    "SHARE_OF_SINGULAR", 0.02, "1",
    "Errors of the columns, of length one, over the smallest singular value of all of them: no deviation is wrong by a "
    "larger part. Shorter or longer steps are tried where it is more.",
)  # fmt: skip
KEPT_STEP = TABLE(
    "KEPT_STEP", 3.0, "1", "A step that was found is kept until its column errs by so many times as much as then."
)
SHOWS_SOMETHING = TABLE(
    "SHOWS_SOMETHING", 0.3, "1", "A column that errs by more of its norm does not tell whether a shorter step is right."
)
KNOWN_WITHIN = TABLE(
    "KNOWN_WITHIN", 3.0, "1", "Columns of two steps agree within so many times what the longer one errs by."
)
TRUNCATED = TABLE(
    "TRUNCATED", 0.1, "1",
    "Part of a column beyond that by which a longer step may differ: its truncation, which second differences of "
    "symmetric functions do not show.",
)  # fmt: skip

# What may be simulated and returned ----------------------------------------------------------------------------------
CHECKED_POSITIONS = TABLE(
    "CHECKED_POSITIONS", 200, "positions", "Along the reference, at which the inertia matrix is checked."
)
POSITIVE = TABLE(
    "POSITIVE", 1e-9, "1", "Smallest eigenvalue of the scaled inertia matrix that counts as positive: above rounding."
)
FARTHEST = TABLE(
    "FARTHEST", 1.0, "1",
    "Relative error of the torque beyond which a model explains less than nothing: zero would be nearer.",
)  # fmt: skip

# The motion that a torque implies ------------------------------------------------------------------------------------
BANDWIDTH = TABLE(
    "BANDWIDTH", 0.25, "rad",
    "Phase in a period of the slowest component at which a light plant still follows the torque: sampled loops of half "
    "that speed are stable.",
)  # fmt: skip
BANDWIDTHS = TABLE("BANDWIDTHS", 6, "bandwidths", "Tried, each half of the one before, for drives with lag or delay.")
DAMPING_RATIO = TABLE("DAMPING_RATIO", 0.7, "1", "Of the loop with a light plant, at its bandwidth: no resonance.")
PERIODS = TABLE("PERIODS", 12, "periods", "Of the oscillation by which the response of a controller is measured.")
SHARE_OF_RANGE = TABLE(
    "SHARE_OF_RANGE", 1e-4, "1", "Size of that oscillation, of the range of a joint: no drive saturates by it."
)
NOT_FOLLOWED = TABLE(
    "NOT_FOLLOWED", 0.3, "1",
    "Part of the measured torque of a joint that the loop with a light plant may leave: with more it does not follow.",
)  # fmt: skip
SERIES = TABLE("SERIES", 1e-6, "1", "Decay in a step below which it is computed by its series.")

# The solver ----------------------------------------------------------------------------------------------------------
DAMPINGS = TABLE(
    "DAMPINGS", (0.0, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0), "1",
    "Tried one after the other, for columns of the Jacobian of length one.",
)  # fmt: skip
ITERATIONS = TABLE("ITERATIONS", 8, "steps", "Largest number of a fit that does not ask for another.")
PROMISE = TABLE(
    "PROMISE", 0.02, "chi-square",
    "A step of a search that promises to lower chi-square by less is not made: a BIC difference of 10 decides.",
)  # fmt: skip
UPDATES = TABLE(
    "UPDATES", 3, "sensitivities", "Taken anew at most, in a fit that does not ask for another number: the costly part."
)
HOPE = TABLE("HOPE", 2.0, "1", "A fit is given up when not even so many times what a step promises would be enough.")
CREEPING = TABLE(
    "CREEPING", 0.01, "1", "Fraction of the cost that a step must gain along the edge of what can be simulated."
)
STALE = TABLE(
    "STALE", 0.02, "standard deviations",
    "Farther than this from where it was taken, a sensitivity is not the one that ends the steps: what it leaves of "
    "the error is this fraction times its relative change, of a standard deviation.",
)  # fmt: skip
CONTRACTION = TABLE(
    "CONTRACTION", 0.1, "1",
    "A step that is at most this fraction of the one before shows that the sensitivity still serves.",
)  # fmt: skip
KEPT_PROMISE = TABLE(
    "KEPT_PROMISE", (0.5, 1.5), "1",
    "Gain of a step over what the linear model promised: outside, its slopes are stale.",
)  # fmt: skip
ROUNDING = TABLE(
    "ROUNDING", 1e-6, "1", "A step that would lower the cost by a smaller fraction may fail by rounding alone."
)
FAR_BELOW = TABLE(
    "FAR_BELOW", 0.01, "standard deviations",
    "A step that small changes no conclusion: when it cannot be made in full, the fit has settled all the same.",
)  # fmt: skip
TINY_CHANGES = TABLE(
    "TINY_CHANGES", (1e-6, 2e-6, 5e-6), "1",
    "Of all values, to see whether the torque jitters: it changes by as little where it does not, a thousand times as "
    "much where it does; three, since by chance one may show none.",
)  # fmt: skip
SMOOTHER = TABLE(
    "SMOOTHER", 0.1, "1", "Fraction of its jitter below which a loop that is wired otherwise is said to be smoother."
)
HIDDEN = TABLE(
    "HIDDEN", 0.1, "standard deviations",
    "Where a step does not gain what it promised although the sensitivity was taken there, the torque is rough: a step "
    "that small is then hidden by it, and changes no conclusion.",
)  # fmt: skip
BROKEN_PROMISE = TABLE(
    "BROKEN_PROMISE", 0.1, "1",
    "Fraction of what a step promised below which it gained nothing: damped until the cost grows no more, it moves "
    "nothing, and the next one would not either (a co-simulated drivetrain gained 0.04 and less for 36 steps).",
)  # fmt: skip
LEFT_BY_JITTER = TABLE(
    "LEFT_BY_JITTER", 0.25, "chi-square",
    "A step that promises no more, half a standard deviation, need not be made where a jitter of the torque hides what "
    "it gains.",
)  # fmt: skip
DRAWN_BY_JITTER = TABLE(
    "DRAWN_BY_JITTER", 5.0, "standard deviations",
    "Of the difference of two costs, by which jitter may make a step miss its promise: a cost that is too low by three "
    "of its own and one that is too high by as much are 4.2 apart.",
)  # fmt: skip
EQUAL = TABLE(
    "EQUAL", 1e-9, "1",
    "Costs that differ by a smaller fraction are the same: at the minimum, rounding decides whether the cost grows.",
)  # fmt: skip
TORQUE_FLOOR = TABLE(
    "TORQUE_FLOOR", 1e-3, "1",
    "Fraction of the tolerance, in units of the torque, below which a move counts as none: a parameter that is zero, "
    "in data without noise, has neither size nor standard deviation.",
)  # fmt: skip
BLOCK = TABLE(
    "BLOCK", 32, "tables",
    "Projected in one go: the basis of a TX40, 2.5 MB, is then read once for all of them, and they still fit a cache.",
)  # fmt: skip
COLUMNS_A_THREAD = TABLE(
    "COLUMNS_A_THREAD", 16, "columns",
    "Columns of a sensitivity that are worth a run of their own: they cost about as much as the simulation does.",
)  # fmt: skip
POLISHING = TABLE(
    "POLISHING", 2, "steps",
    "From the minimum of one integration to that of a finer one, a small fraction of the noise away.",
)  # fmt: skip
INTEGRATION_SHARE = TABLE(
    "INTEGRATION_SHARE", 0.01, "standard deviations",
    "Twice the substeps of the plant may change the torque of a joint by this much of its noise: a hundredth moves no "
    "parameter by more than a hundredth of its standard deviation.",
)  # fmt: skip
SAME_DIRECTION = TABLE(
    "SAME_DIRECTION", 1e-10, "1",
    "Singular value of columns of length one, relative to the largest, below which a step leaves a direction alone.",
)  # fmt: skip
UNKNOWN_DIRECTION = TABLE(
    "UNKNOWN_DIRECTION", 1e-14, "1",
    "The same where standard deviations are taken: what can only just be told must show its large deviation.",
)  # fmt: skip
