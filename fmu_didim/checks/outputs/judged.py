"""All checks of a fit of the outputs of a model, which has neither controller nor torque."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.channels import noise_diagnostics
from fmu_didim.checks.outputs.before import START_ELSEWHERE
from fmu_didim.checks.outputs.following import OUTPUT_FOLLOWS, following_diagnostics
from fmu_didim.checks.outputs.held_out import held_out_output_diagnostics
from fmu_didim.checks.outputs.outliers import outlier_diagnostics
from fmu_didim.checks.outputs.residuals import OutputResiduals
from fmu_didim.checks.outputs.succession import OUTPUT_UNTESTED, few_independent, succession_diagnostics
from fmu_didim.checks.outputs.trusted import trusted_diagnostics
from fmu_didim.checks.residual import NoiseResult, large_diagnostics, residual_diagnostics, slow_diagnostics
from fmu_didim.checks.validation import Validation
from fmu_didim.data.signals import Array
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.fit_uncertainty import fit_uncertainty
from fmu_didim.fit.noise.noise import TINY

POWER = 0.95
"""[1] Of the power of a simulated output that lies below the frequency up to which it moves."""


def output_diagnostics(
    estimate: Estimate, validations: Sequence[Validation], tests: Sequence[NoiseResult], before: Iterable[Diagnostic]
) -> list[Diagnostic]:
    """What is doubted of the values of a model by its outputs; what any fit may show is reported elsewhere.

    Args:
        validations: of all experiments; tests: of the residual of each output; before: of the data and the model.
    """
    labels = estimate.model.loop.labels
    before = list(before)
    found = [*held_out_output_diagnostics(estimate, validations), *residual_diagnostics(tests, labels)]
    try:
        residuals = OutputResiduals.of(estimate)
    except SimulationError:  # after the last sample
        return [*before, *found]
    followed = following_diagnostics(residuals)
    found += [*followed, *noise_diagnostics(estimate)]
    is_told = any(d.code is OUTPUT_FOLLOWS for d in followed)
    found += [d for d in succession_diagnostics(residuals) if not is_told or d.code is OUTPUT_UNTESTED]
    found += [d for d in before if not (is_told and d.code is START_ELSEWHERE)]  # one of the suspects
    if not is_told:  # which would look like outliers, or hide what is trusted
        found += outlier_diagnostics(residuals)
        found += trusted_diagnostics(residuals, estimate.standard_deviation)
        highest = max((_highest(residuals, k) for k in range(len(labels))), default=np.inf)
        tests = [test for test in tests if test.joint - 1 in residuals.judged]
        slow = slow_diagnostics(tests, highest, labels=labels, what="where the outputs move")
        slow = slow or _large(residuals, tests, highest, labels)
        told = {d.place for d in slow}
        found += [*slow, *(d for d in _few_independent(estimate, residuals) if d.place not in told)]
    return found


def _few_independent(estimate: Estimate, residuals: OutputResiduals) -> list[Diagnostic]:
    """Outputs whose residual is worth few samples."""
    fit = estimate.minimum
    if fit is None:
        return []
    colours = fit_uncertainty(fit).colours if fit.model.experiments.channels else estimate.colours
    stated = ~np.isnan(fit.model.stated_deviations)
    return few_independent([c for c in colours if c.joint - 1 in residuals.judged], residuals.names, stated.tolist())


def _large(
    residuals: OutputResiduals, tests: Sequence[NoiseResult], highest: float, labels: Sequence[str]
) -> list[Diagnostic]:
    """Outputs whose residual is slow and a large part of what they move, and no noise that the case states: what acts
    and was not recorded need not follow anything that was."""
    unstated = [t for t in tests if not (t.noise_is_stated and t.chi_square_per_sample is not None)]
    moved = (residuals.outputs[residuals.rows(k), k].std() for k in range(len(labels)))
    errors = {k + 1: float(residuals.deviation[k] / max(size, TINY)) for k, size in enumerate(moved)}
    return large_diagnostics(
        unstated, errors, highest, labels=labels, what="about where the outputs move", of="movement of the output"
    )


def _highest(found: OutputResiduals, k: int) -> float:
    """Frequency in Hz below which most of the power of a simulated output lies."""
    highest = 0.0
    for log in found.logs(k):
        values: Array = found.outputs[found.indices(log.rows), k]
        power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(values.size))) ** 2
        step = float(np.ptp(log.time)) / max(values.size - 1, 1)
        place = int(np.searchsorted(np.cumsum(power), POWER * power.sum()))
        highest = max(highest, float(np.fft.rfftfreq(values.size, step)[min(place, power.size - 1)]))
    return highest
