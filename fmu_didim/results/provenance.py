"""The origin of a result: versions, hashes of the inputs, options, the loop."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from fmu_didim.base.constants import Deciding, recorded
from fmu_didim.base.version import release_of
from fmu_didim.checks import (
    channels,
    held_out,
    held_out_channels,
    identification,
    judgement,
    load,
    physical,
    prior,
    residual,
    sampling_kind,
    virtual,
)
from fmu_didim.checks.data import log, timing, torque_channel
from fmu_didim.checks.motion import colour, dependence, periods
from fmu_didim.checks.motion import suspects as suspects_in_loop
from fmu_didim.checks.outputs import following, outliers, succession, suspects, trusted
from fmu_didim.data.tables import clock
from fmu_didim.estimators import finish, idim_ls, initial_states, local_minima
from fmu_didim.estimators.search import best, places
from fmu_didim.estimators.starts import reference_start
from fmu_didim.fit import confounding, linear_problem, log_noise, statistics, uncertainty
from fmu_didim.fit.derivatives import differences
from fmu_didim.fit.exploration import profile
from fmu_didim.fit.noise import noise, residual_noise, shared, weighting
from fmu_didim.fit.solver import linear_step, search, termination
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.loop_model import LoopModel

ENGINE = (
    (clock, ("STAMP_ROUNDING", "SAME_RATE")),
    (statistics, ("CONDITION_LIMIT", "CONFIDENCE")),
    (noise, ("REPEATS_WITHIN", "FEWEST_DIFFERENCES", "LARGEST_CORRELATION", "ABOVE_MOTION", "USUAL", "OUTLIER")),
    (residual_noise, ("NOT_WHITE", "CLEARLY_NOT_WHITE", "FEWEST_COLOURED", "LOUDER")),
    (uncertainty, ("WHITENESS_LAGS", "EXCESS")),
    (search, ("KEPT_PROMISE", "EQUAL")),
    (termination, ("ITERATIONS", "STALE", "CONTRACTION")),
    (log, ("CLIPPED", "SPIKE", "JITTER", "COARSE")),
    (torque_channel, ("CHANCE", "OTHER_JOINT", "AGAINST")),
    (timing, ("SHIFT_SIGMAS", "LEAST_SHIFT")),
    (log_noise, ("NOT_NOISE", "CHANCE")),
    (judgement, ("MATTERS",)),
)
"""Constants on which every answer depends, by module: of data, noise and fits."""
DECIDING = (
    *ENGINE,
    (weighting, ("NOISE_FLOOR",)),
    (differences, ("STEP", "KNOWN_WITHIN")),
    (linear_problem, ("SAME_DIRECTION",)),
    (linear_step, ("LEFT_BY_JITTER",)),
    (reference_start, ("SMOOTHED", "NOISE_OF_ACCELERATION")),
    (finish, ("INTEGRATION_TOLERANCE", "INTEGRATION_SHIFT", "MAXIMUM_REFINEMENTS", "FINISH_TOLERANCE")),
    (finish, ("ROUNDS", "SAME_INFLATION")),
    (idim_ls, ("EVEN", "GAP", "BESIDE", "WORSE")),
    (shared, ("SHORTEST_BLOCK_S", "MEMORIES", "FEWEST_BLOCKS")),
    (channels, ("DISAGREEMENT", "EXPLAINED", "CERTAIN", "COLOURED", "LARGER")),
    (prior, ("DISAGREEMENT", "DECIDED")),
    (load, ("GAIN_KNOWN", "SURELY_THERE")),
    (virtual, ("FAR",)),
    (local_minima, ("OTHER_MINIMA", "HARDLY_WORSE")),
    (profile, ("DIFFERENT", "FARTHEST", "LOWER")),
    (places, ("SAME_VALUE", "SAME_DIGITS")),
    (best, ("HARDLY_WORSE",)),
    (initial_states, ("MOVING", "CHANCE", "STANDS_OUT", "FIRST_PART", "FORGOTTEN", "DETERMINED")),
    (identification, ("NEAR_LIMIT", "VISIBLE_SHIFT", "SECOND_STEP", "JITTER")),
    (residual, ("STILL_NOT_WHITE",)),
    (dependence, ("MOTION_CHANCE", "SIGNIFICANT", "FUNCTIONS", "SAMPLES_A_FUNCTION")),
    (colour, ("MEMORIES", "FAR_WORSE", "SETTLED", "SAMPLES_A_LAG", "WITH_PAST")),
    (suspects_in_loop, ("TRIED", "ROUNDS", "MOSTLY", "AS_WELL", "SURE")),
    (periods, ("PART_OF_PERIOD", "KNOWN_PART", "RAMP", "FEWEST_DIFFERENCES")),
    (sampling_kind, ("NEARLY",)),
    (held_out, ("HELD_OUT_RATIO", "HELD_OUT_CHANCE", "LAGS")),
    (held_out_channels, ("ROUNDING_PERCENT",)),
    (confounding, ("COLLINEAR", "INFLATION")),
    (physical, ("NEGATIVE_FRICTION", "FALSE_UNPHYSICAL")),
)
"""Constants on which an identification depends, by module."""
OF_ROBOTS = (
    torque_channel,
    timing,
    reference_start,
    initial_states,
    periods,
    dependence,
    colour,
    suspects_in_loop,
    sampling_kind,
    held_out,
    idim_ls,
)
"""Modules of which nothing is asked where a model has neither controller nor torque."""
OF_OUTPUTS = (
    *((module, names) for module, names in DECIDING if module not in OF_ROBOTS and module is not physical),
    (following, ("CHANCE", "LEAST", "AS_WELL", "MOSTLY", "BEYOND", "BEYOND_NOISE", "STEPS")),
    (suspects, ("SMALL", "MOST_INPUTS", "MOST_PARAMETERS", "TRANSIENTS")),
    (outliers, ("FAR", "CHANCE", "MOST")),
    (succession, ("ALIKE", "FEWEST_LEFT", "FEWEST_INDEPENDENT")),
    (trusted, ("TENTH", "TRIED", "UNSEEN", "MOVES")),
)
"""The same for a model."""
PACKAGES = ("fmu_didim", "numpy", "scipy", "casadi", "fmpy", "control")
PACKAGE = Path(__file__).parents[1]


def digest(value: Any) -> str:
    """The digest of a canonical value, 16 hexadecimal digits: two of a million collide with probability 3e-8."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def code_digest() -> str:
    """The digest of the source of this package and of the versions of the packages that it computes with."""
    state = hashlib.sha256(json.dumps({name: release_of(name) for name in PACKAGES[1:]}).encode())
    for path in sorted(PACKAGE.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            state.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + path.read_bytes())
    return state.hexdigest()[:16]


def made_by(packages: Sequence[str]) -> dict[str, Any]:
    """When, with which releases of these packages, and on what an answer was made."""
    return {
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {"python": platform.python_version(), **{name: release_of(name) for name in packages}},
        "platform": f"{platform.system()} {platform.machine()}",
    }


def provenance(
    model: LoopModel, estimator: Mapping[str, Any], *, files: Mapping[str, str], deciding: Deciding = DECIDING
) -> dict[str, Any]:
    """The record that goes with an answer.

    Args:
        estimator: its name and options.
        files: name -> SHA-256 of the files read; deciding: the constants on which the answer depends.
    """
    shows_torque = model.loop.shows_torque
    if deciding is DECIDING and not shows_torque:
        deciding = OF_OUTPUTS
    found = {
        **made_by(PACKAGES),
        "estimator": dict(estimator),
        "joint_weights": model.joint_weights,
        "low_pass_hz": model.experiments.low_pass.cutoff_hz if model.experiments.low_pass else None,
        "substep_factor": model.loop.substep_factor,
        "files": dict(files),
        "experiments": {label: _experiment(experiment) for label, experiment in model.experiments.items()},
        "shape_parameters": model.parameters.shape_values(),
        "thresholds": recorded(deciding),
    }
    if shows_torque:
        return found
    own = {label: _of_a_model(experiment) for label, experiment in model.experiments.items()}
    return {k: v for k, v in found.items() if k not in ("joint_weights", "shape_parameters")} | {"experiments": own}


def _of_a_model(experiment: Experiment) -> dict[str, Any]:
    found = {"inputs_sha256" if k == "reference_sha256" else k: v for k, v in _experiment(experiment).items()}
    return {k.replace("torque_", ""): v for k, v in found.items()}


def _experiment(experiment: Experiment) -> dict[str, Any]:
    return {
        "role": experiment.role,
        "reference_sha256": experiment.reference.digest(),
        "torque_samples": int(experiment.time.size),
        "torque_rate_hz": round(experiment.rate_hz, 6),
        "first_s": float(experiment.time[0]),
        "last_s": float(experiment.time[-1]),
    }
