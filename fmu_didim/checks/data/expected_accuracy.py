"""The accuracy of the parameters that a motion and a log allow, predicted before the identification.

The covariance (S'S)^-1 of the whitened sensitivity S at a start is the Cramér-Rao bound there: standard deviations that
an identification will come near to, and correlations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, REMARK, Diagnostic
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.data.reference import STANDSTILL
from fmu_didim.data.signals import Array
from fmu_didim.fit.confounding import confounded
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.exploration.local import LocalSensitivity, local_sensitivity
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.noise.weighting import noise_floor, whitened
from fmu_didim.fit.statistics import correlation, covariance_white
from fmu_didim.model.loop_model import LoopModel

LOOSE = 1e-9
"""[1] Singular value, relative to the largest, of directions along which no step is made."""
SIGNIFICANT = 2.0
"""[standard deviations] Of a value, from which it differs clearly from zero."""
CORRELATED = 0.9
"""[1] Correlation from which the partner of a parameter is shown."""
RINGING_S = 2.0
"""[s] After a kick in which a loop is watched: many periods of any resonance."""
KICK = 1e-3
"""[1] Of the range of a reference column, by which its first value is changed."""
SLOWEST = 3
"""[frequencies] Of a spectrum, whose mean stands for its beginning."""
STANDS_OUT = 4.0
"""[1] Power of a peak against the beginning of the spectrum from which it rings: twice in size."""

NOT_SIGNIFICANT = CATALOGUE(
    "parameters-not-significant", REMARK, rank=60,
    meaning="This motion and this log will not distinguish some parameters from zero: their predicted standard "
    "deviation is more than half of their value.",
    next_step="Excite them more (faster or longer motion, lower noise, higher rate), or leave them out.",
)  # fmt: skip
RESONANCE = CATALOGUE(
    "resonance-above-log", REMARK, rank=61,
    meaning="The loop of a joint rings at a frequency that the log cannot show: above half its rate. Several inertias "
    "may explain such a log equally well.",
    next_step="Log at more than twice that frequency, or give a start value near the truth for the inertia of "
    "the joint.",
)  # fmt: skip


@dataclass(frozen=True)
class ExpectedAccuracy:
    """The predicted accuracy of the parameters.

    Attributes:
        names, units: (p,); values, deviation: (p,) at the start, and their predicted standard deviation.
        partner: (p,) the parameter that each is correlated with most, and the coefficient; empty and 0 without one.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    deviation: Array
    partner: tuple[tuple[str, float], ...]

    @property
    def insignificant(self) -> tuple[str, ...]:
        """Parameters whose 95 % interval will hold zero."""
        small = np.abs(self.values) < SIGNIFICANT * self.deviation
        return tuple(name for name, is_small in zip(self.names, small, strict=True) if is_small)


def predict_accuracy(
    model: LoopModel, values: Array, torque: Array
) -> tuple[tuple[str, ...], ExpectedAccuracy | None, LocalSensitivity | None]:
    """Parameters that the data cannot tell apart, the accuracy of all, and what each does to the outputs, from a start
    with this torque (N, n); None where no prediction is possible.

    Without a known noise, that of the residual after one linear step is taken; of filtered torques as much as there was
    before the filter, since their samples are not independent: the filter takes off noise, and nothing of what is told.
    """
    measured, outputs, known = model.measured, torque, model.torque_deviation
    try:
        if model.experiments.channels:
            measured, outputs, known = model.measured_outputs, model.outputs(values), model.stated_deviations
        columns, residual = sensitivity(model, values, outputs), measured - outputs
    except SimulationError:
        return (), None, None  # so near to divergence nothing can be predicted
    left = residual - columns @ np.linalg.lstsq(columns.reshape(-1, values.size), residual.reshape(-1), rcond=LOOSE)[0]
    counts = model.output_counts if model.experiments.channels else left.shape[0]
    found = np.maximum(np.sqrt((left**2).sum(axis=0) / counts), noise_floor(measured))
    found[: model.joint_count] /= np.sqrt(_share_of_noise(model))
    deviation = found if known is None else np.where(np.isfinite(known), known, found)
    white, size = model.beside_prior(whitened(columns, deviation)), float(np.linalg.norm(measured / deviation))
    ahead = predicted(model, values, white)
    effects = local_sensitivity(model, values, columns, None if ahead is None else covariance_white(white))
    return confounded(white, values, model.names, torque=size), ahead, effects


def _share_of_noise(model: LoopModel) -> float:
    """Part of the variance of white noise of the torque that the filter leaves; one without a filter."""
    experiments, low_pass = model.experiments, model.experiments.low_pass
    if low_pass is None:
        return 1.0
    fitted = [experiments[label] for label in model.estimation_labels]
    shares = [low_pass.noise_share(one.rate_hz) for one in fitted]
    return float(np.average(shares, weights=[one.time.size for one in fitted]))


def predicted(model: LoopModel, values: Array, columns: Array) -> ExpectedAccuracy | None:
    """The accuracy by the whitened sensitivity (r, p) at values (p,); None where it is singular."""
    if not np.abs(columns).any(axis=0).all():
        return None
    try:
        covariance = covariance_white(columns)
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(covariance).all():
        return None
    related = np.abs(correlation(covariance)) - np.eye(values.size)
    most = related.argmax(axis=1)
    partner = tuple(
        (model.names[k], float(related[i, k])) if related[i, k] > CORRELATED else ("", 0.0) for i, k in enumerate(most)
    )
    return ExpectedAccuracy(model.names, model.free_parameters.units, values, np.sqrt(np.diag(covariance)), partner)


def accuracy_diagnostics(found: ExpectedAccuracy) -> list[Diagnostic]:
    """Parameters that will not be significant."""
    names = found.insignificant
    if not names:
        return []
    text = f"These data will not distinguish {', '.join(names)} from zero."
    return [Diagnostic(NOT_SIGNIFICANT, text, value=float(len(names)), unit="parameters")]


def resonance_diagnostics(model: LoopModel, values: Array) -> list[Diagnostic]:
    """Joints whose loop rings above half the rate of the slowest log that is fitted; none where it cannot run."""
    try:
        found = resonances(model, values)
    except SimulationError:
        return []
    half = 0.5 * min(model.experiments[label].rate_hz for label in model.estimation_labels)
    return [
        Diagnostic(
            RESONANCE, f"Its loop rings at {frequency:.3g} Hz, above half the rate of the log ({half:.4g} Hz).",
            f"joint {j + 1}", float(frequency), half, "Hz",
        )
        for j, frequency in enumerate(found)
        if frequency > half
    ]  # fmt: skip


def resonances(model: LoopModel, values: Array) -> Array:
    """(n,) frequency in Hz at which the loop of each joint rings after a small kick, 0 where it does not ring.

    The kick is a small change of the first velocity, or position, of the reference. Where a pair of poles of the
    sampled loop, drives and delay included, is weakly damped, the spectrum of the response of the torque has a peak.
    """
    run = model.simulation(values)
    reference, step = run.experiment.reference, run.step_size
    ticks = np.arange(min(reference.time.size, round(RINGING_S / step)))
    before = run.logged_torque(run.record(ticks=ticks))
    found = np.zeros(model.joint_count)
    for j in range(model.joint_count):
        name = next((n for n in (f"dq{j + 1}", f"q{j + 1}") if n in reference.names), None)
        if name is None:
            continue
        kicked = reference.values.copy()
        column = reference.names.index(name)
        kicked[0, column] += KICK * max(float(np.ptp(kicked[:, column])), STANDSTILL)
        other = run.on(replace(run.experiment, reference=replace(reference, values=kicked)))
        after = other.logged_torque(other.record(ticks=ticks))
        # The first tick shows the jump of the reference itself.
        found[j] = ringing((after - before)[1:, j], step)
    return found


def ringing(response: Array, step: float) -> float:
    """Frequency in Hz of the peak in the spectrum of a response (K,), 0 where it does not stand out."""
    power = np.abs(np.fft.rfft(response)) ** 2
    peak = int(power.argmax())
    slow = float(np.mean(power[:SLOWEST]))
    if power[peak] <= STANDS_OUT * max(slow, TINY):
        return 0.0
    return float(np.fft.rfftfreq(response.size, step)[peak])
