"""The constants on which a discovery depends, as they go into ``findings.json``."""

from __future__ import annotations

from fmu_didim.checks.data import log, timing, torque_channel
from fmu_didim.data.tables import clock
from fmu_didim.discovery import base_model, judge, localise
from fmu_didim.discovery.external_torques import search
from fmu_didim.discovery.screening import catalogue
from fmu_didim.discovery.selection import competition, decide, plausible, pre_check, rounds
from fmu_didim.fit import base_projection, gap, log_noise, statistics, uncertainty
from fmu_didim.fit.noise import noise, residual_noise
from fmu_didim.fit.solver import search as trial_search
from fmu_didim.fit.solver import termination

DECIDING = (
    (clock, ("STAMP_ROUNDING", "SAME_RATE")),
    (statistics, ("CONDITION_LIMIT", "CONFIDENCE")),
    (noise, ("REPEATS_WITHIN", "FEWEST_DIFFERENCES", "LARGEST_CORRELATION", "ABOVE_MOTION", "USUAL", "OUTLIER")),
    (residual_noise, ("NOT_WHITE", "CLEARLY_NOT_WHITE", "FEWEST_COLOURED")),
    (uncertainty, ("WHITENESS_LAGS", "EXCESS")),
    (trial_search, ("KEPT_PROMISE", "EQUAL")),
    (termination, ("ITERATIONS", "STALE", "CONTRACTION")),
    (base_projection, ("DEPENDENT",)),
    (log, ("CLIPPED", "SPIKE", "JITTER", "COARSE")),
    (torque_channel, ("CHANCE", "OTHER_JOINT", "AGAINST")),
    (timing, ("SHIFT_SIGMAS", "LEAST_SHIFT")),
    (log_noise, ("NOT_NOISE", "CHANCE")),
    (gap, ("BOOTSTRAP", "BLOCK_S")),
    (localise, ("FALSE_DISCOVERIES", "WINDOW_SCORE")),
    (base_model, ("FIRST_NOISE",)),
    (catalogue, ("REPEATS", "TOGETHER", "SEEN", "LARGEST_COLUMN", "STIFFEST", "SAME_SHAPE")),
    (competition, ("SURVIVING", "IDLE", "DEPENDENT", "SHORTLIST", "WORTH", "LEADING", "FURTHER", "REACH", "ABREAST")),
    (decide, ("ROUNDS", "BIC", "SMALLEST_SIZE", "SMALLEST_GAIN", "SMALLEST_SHARE", "SMALLEST_PART", "WORSE_JOINT")),
    (decide, ("HELD_OUT", "NEAR")),
    (plausible, ("ZERO",)),
    (pre_check, ("FITTED", "PROMISING", "WORSE")),
    (rounds, ("KEPT_GAIN",)),
    (search, ("STEP_COST", "WEAKEST", "SMALLEST_GAIN", "LEAST")),
    (judge, ("REMAINDER",)),
)
"""Constants on which a discovery depends, by module."""
