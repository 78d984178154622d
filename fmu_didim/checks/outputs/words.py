"""What to do about diagnostics that robots have, too, where a model has neither controller nor torque."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from fmu_didim.base.diagnostics import Diagnostic

ADVICE: Mapping[str, str] = {
    "at-limit": "Widen the limits (identify: {name: {minimum: ..., maximum: ...}}) if the value may lie beyond; else "
    "look for what the model lacks.",
    "integration-too-coarse": "State more substeps (model: {substeps: N}), or an integrator that chooses its steps "
    "(model: {solver: cvode}).",
    "residual-above-noise": "See what it follows, among the other reasons and in the report; or the stated std: is "
    "that of the sensor alone.",
    "residual-slow": "Look for an input that was not recorded or a state that the model lacks; if the sensor drifts, "
    "state that noise (std:).",
    "worse-on-held-out": "Compare the experiments: initial state (own: [...]), clocks, sensors; else the model lacks "
    "something that shows there.",
    "held-out-not-simulated": "Check the inputs of that experiment, and where it starts.",
    "channel-beyond-noise": "State the std: that the sensor really has, or none; else the model lacks something.",
    "log-upsampled": "Give the rate at which it was measured (measured: {rate_hz: ...}), or the file as it was logged.",
    "log-outliers": "Take wrong samples out of the file: a cell that is empty is a sample not taken.",
    "log-coarse": "Log with a finer resolution, or over the full range of the converter.",
    "log-constant": "Check that the column is the one of this output.",
    "log-saturated": "Leave those samples empty, or widen the range of the sensor.",
    "parameter-idle": "Leave it out, name the parameter that acts, or export the model with tunable parameters.",
    "another-minimum": "Give limits (identify: {name: {minimum: ..., maximum: ...}}) or its value.",
    "validation-copied": "Record an experiment with other inputs for the validation, or leave the validation out.",
}
"""Code -> its next step for a model; the others say nothing of robots."""


def of_a_model(found: Iterable[Diagnostic]) -> list[Diagnostic]:
    """Diagnostics with the next steps of a model."""
    return [replace(d, next_step=ADVICE.get(d.code.name, d.next_step)) for d in found]
