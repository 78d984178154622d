"""The constants on which a discovery depends, as they go into ``findings.json``."""

from __future__ import annotations

from fmu_didim.discovery import base_model, beginning, harmonics, judge, localise, run
from fmu_didim.discovery.external_torques import search
from fmu_didim.discovery.form import curve
from fmu_didim.discovery.form import names as form
from fmu_didim.discovery.ladder import evidence, facts, motions
from fmu_didim.discovery.screening import catalogue
from fmu_didim.discovery.selection import (
    beside_others,
    competition,
    decide,
    gears,
    held_out,
    plausible,
    pre_check,
    rivals,
    rounds,
    wide_search,
)
from fmu_didim.discovery.signals import kinds, remainder, windows
from fmu_didim.discovery.signals import search as signal_search
from fmu_didim.fit import base_projection, gap
from fmu_didim.results.provenance import ENGINE

DECIDING = (
    *ENGINE,
    (base_projection, ("DEPENDENT",)),
    (gap, ("BOOTSTRAP", "BLOCK_S")),
    (localise, ("FALSE_DISCOVERIES", "WINDOW_SCORE")),
    (base_model, ("FIRST_NOISE", "MOSTLY", "ABSORBED")),
    (run, ("TORN",)),
    (harmonics, ("OF_ONE_PERIOD",)),
    (catalogue, ("REPEATS", "TOGETHER", "SEEN", "LARGEST_COLUMN", "STIFFEST", "SAME_SHAPE")),
    (
        competition,
        (
            "SURVIVING",
            "IDLE",
            "DEPENDENT",
            "SHORTLIST",
            "WORTH",
            "FORESEEN",
            "USUAL",
            "LEADING",
            "FURTHER",
            "REACH",
            "GROWN",
            "ABREAST",
            "KEPT",
        ),
    ),
    (
        decide,
        ("ROUNDS", "BIC", "SMALLEST_SIZE", "SMALLEST_GAIN", "SMALLEST_SHARE", "SMALLEST_PART", "NEAR", "NEAR_STATED"),
    ),
    (gears, ("STIFFNESSES", "EVERY", "FAR", "STARTS")),
    (curve, ("OWN", "PENALTIES", "PER_PARAMETER", "TURNS")),
    (form, ("LEAD", "LEAD_ALONE", "LEAD_SURE")),
    (held_out, ("HELD_OUT", "WORSE_JOINT", "NEARER", "OWN_SIZE", "FEWEST_BLOCKS", "EACH_OF", "GLITCH")),
    (plausible, ("ZERO", "UNTOLD", "LONGEST", "FEWEST_REPEATS", "MOSTLY_TOUCHED", "STILL", "MOSTLY_STILL")),
    (
        pre_check,
        ("FITTED", "PROMISING", "WORTH_A_TRIAL", "LINES", "ON_LINE", "STARTS", "APART", "VALLEYS", "STEPS", "WORSE"),
    ),
    (beside_others, ("KEPT_GAIN",)),
    (rivals, ("PROMISED",)),
    (rounds, ("PAIRED", "VALLEY")),
    (wide_search, ("PEOPLE", "GENERATIONS", "MOST_STEPS")),
    (beginning, ("SAME_VALUES",)),
    (search, ("STEP_COST", "WEAKEST", "SMALLEST_GAIN", "LEAST")),
    (judge, ("REMAINDER", "SMALLEST_WHOLE", "MUCH")),
    (facts, ("OTHER_SPEED", "OTHER_LOAD", "OTHER_GAIN")),
    (motions, ("STRETCH_S", "SAME_MOTION", "MOSTLY_NEW")),
    (evidence, ("VALUE_DIFFERS",)),
    (signal_search, ("STARTS", "LEAST", "FEWEST_CLIPPED")),
    (remainder, ("BY_CHANCE",)),
    (windows, ("TURNS", "LEFT_OUT")),
    (kinds, ("LAGS", "DELAYS", "FADING", "LONGEST", "ROOM", "LEVELS")),
)
"""Constants on which a discovery depends, by module."""
