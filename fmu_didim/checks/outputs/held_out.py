"""Whether held-out experiments of a model are predicted as well as the fitted ones, output by output."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.checks.held_out import NO_HELD_OUT, not_simulated
from fmu_didim.checks.held_out_channels import held_out_channel_diagnostics
from fmu_didim.checks.validation import ChannelValidation, Validation
from fmu_didim.fit.estimate import Estimate
from fmu_didim.model.loop_model import LoopModel


def outputs_of(model: LoopModel, found: Validation) -> dict[str, ChannelValidation]:
    """Name of each output of an experiment -> measured and simulated."""
    stated = model.torque_deviation
    log = {
        name: ChannelValidation(
            model.parameters.torque_units[j], np.asarray(found.time), found.measured[:, j], found.simulated[:, j],
            None if stated is None else float(stated[j]),
        )
        for j, name in enumerate(model.loop.output_names)
    }  # fmt: skip
    return log | dict(found.channels)


def held_out_output_diagnostics(estimate: Estimate, validations: Sequence[Validation]) -> list[Diagnostic]:
    """What held-out experiments say of the values."""
    model = estimate.model
    fitted = [outputs_of(model, v) for v in validations if v.role == "estimation" and not v.failure]
    held = {v.label: outputs_of(model, v) for v in validations if v.role == "validation" and not v.failure}
    failures = {v.label: v.failure for v in validations if v.failure}
    found = not_simulated(failures)
    found += held_out_channel_diagnostics(model, estimate.covariance, fitted, held)
    if not held and not failures:
        text = "No experiment was held out: the prediction of another one is untested."
        found.append(Diagnostic(NO_HELD_OUT, text))
    return found
