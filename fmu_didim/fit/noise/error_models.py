"""What a fit compares where the noise of an output is no normal one of one deviation: its samples and their scales.

With e_i = (y_i - y_s,i) / s_i, of logarithms log y_i - log y_s,i, at what is simulated now, a fit takes for a sample

    y*_i = y_s,i + s_i e*_i,     e* = e,  or of Student's t with nu degrees of freedom  c psi(e / c) / mean psi'(e / c)

with its scale c,
    psi(t) = (nu + 1) t / (nu + t^2),

divided by s_i. Where nothing moves any more, sum d y_s / d values psi / s = 0: the maximum of the likelihood with
s held. The residuals of that fit have the variance  c^2 mean psi^2 / (mean psi')^2  that belongs to the values, so
that its covariance holds as it is. c and nu are those of the largest likelihood of all e of an output, unless they are
stated. That is generalised least squares, whose weights never follow the noise of single samples, as weights by what
was measured would.

Sources: R. J. Carroll, D. Ruppert, Transformation and Weighting in Regression, 1988, chapter 2; P. J. Huber, Robust
Statistics, 1981, 7.8 (modified residuals); K. L. Lange, R. J. A. Little, J. M. G. Taylor, J. Am. Stat. Assoc. 84
(1989).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln

from fmu_didim.data.signals import Array
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.signals.channel import Channel
from fmu_didim.model.signals.error_model import ErrorModel

FREEDOMS = (
    1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.5, 2.8, 3.2, 3.6, 4.0, 4.5, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0, 15.0, 20.0, 30.0,
    60.0, 120.0,
)  # fmt: skip
"""[1] Degrees of freedom that are tried: 1 has no variance, 120 is normal for any number of samples that there is."""
NORMAL_FROM = 60.0
"""[1] Degrees of freedom from which noise counts as normal: its outliers are those of chance."""
SCALE_ROUNDS = 100
"""[rounds] Of the scale of Student's t at most; its error falls by a factor a round, by 1 + 2 / nu at worst."""
SETTLED_SCALE = 1e-6
"""[1] Relative change of that scale at which it has settled."""
LEAST_SLOPE = 0.1
"""[1] Part of the usual mean of psi' below which it does not fall, however many outliers there are."""
COUNTS_LITTLE = 0.2
"""[1] Weight (nu + 1) / (nu + t^2) of a sample below which it is reported as an outlier: three scales off and more."""


@dataclass(frozen=True)
class Student:
    """Noise of Student's t: its scale, and degrees of freedom."""

    scale: float
    freedom: float

    @property
    def information(self) -> float:
        """Fisher's, of a location, over that of normal noise with the variance scale^2."""
        return (self.freedom + 1) / (self.freedom + 3)

    def weights(self, errors: Array) -> Array:
        """(N,) by which samples count, over ordinary ones."""
        return np.asarray((self.freedom + 1) / (self.freedom + (errors / self.scale) ** 2))

    def modified(self, errors: Array) -> Array:
        """(N,) e* of errors e (N,)."""
        nu, t = self.freedom, errors / self.scale
        slopes = (nu + 1) * (nu - t**2) / (nu + t**2) ** 2
        slope = max(float(np.mean(slopes)), LEAST_SLOPE * self.information)
        return np.asarray(self.weights(errors) * errors / slope)


@dataclass(frozen=True)
class Reweighted:
    """A model with samples and scales by what it simulates; noises: name of each robust output -> its noise; outliers:
    name -> experiment and instant of each sample that counts little, the farthest one first."""

    model: LoopModel
    noises: Mapping[str, Student]
    outliers: Mapping[str, Sequence[tuple[str, float]]]


def student_noise(errors: Array, model: ErrorModel) -> Student:
    """The noise of errors (N,) by the largest likelihood, as far as the error model does not state it."""
    freedoms = FREEDOMS if model.freedom is None else (model.freedom,)
    found = [Student(_scale(errors, nu) if model.stated is None else model.stated, nu) for nu in freedoms]
    return max(found, key=lambda one: _likelihood(errors, one))


def _scale(errors: Array, nu: float) -> float:
    """c with mean of e psi(e / c) = c."""
    size = float(np.median(np.abs(errors))) or float(np.sqrt(np.mean(errors**2))) or np.finfo(float).tiny
    for _ in range(SCALE_ROUNDS):
        weights = (nu + 1) / (nu + (errors / size) ** 2)
        last, size = size, float(np.sqrt(np.mean(weights * errors**2))) or np.finfo(float).tiny
        if abs(size - last) <= SETTLED_SCALE * last:
            break
    return size


def _likelihood(errors: Array, noise: Student) -> float:
    nu, t = noise.freedom, errors / noise.scale
    constant = gammaln((nu + 1) / 2) - gammaln(nu / 2) - 0.5 * np.log(nu * np.pi) - np.log(noise.scale)
    return float(errors.size * constant - (nu + 1) / 2 * np.sum(np.log1p(t**2 / nu)))


@dataclass(frozen=True, eq=False)
class _Output:
    """An output of an experiment: what was measured and is simulated, (N,) each."""

    label: str
    name: str
    errors: ErrorModel
    time: Array
    measured: Array
    simulated: Array
    is_fitted: bool

    @property
    def own(self) -> Array:
        return self.errors.errors(self.measured, self.simulated)


def reweighted(model: LoopModel, values: Array, *, by_weights: bool = False) -> Reweighted:
    """The model with samples and scales by what it simulates with values (p,).

    Args:
        by_weights: whether samples of robust outputs stay as they are and their scales are divided by the roots of
            their weights: that comes nearer from anywhere, to the same values, but by half the way a time, and the
            covariance there is not that of the values.

    Raises:
        SimulationError: an experiment cannot be simulated.
    """
    tables = {label: _outputs(model, values, label) for label in model.experiments}
    every = [one for outputs in tables.values() for one in outputs]
    noises = dict[str, Student]()
    for name in dict.fromkeys(one.name for one in every if one.errors.is_robust):
        fitted = [one for one in every if one.name == name and one.is_fitted]
        if fitted:
            noises[name] = student_noise(np.concatenate([one.own for one in fitted]), fitted[0].errors)
    experiments = model.experiments
    for label, outputs in tables.items():
        experiments = experiments.with_experiment(label, _compared(experiments[label], outputs, noises, by_weights))
    changed = replace(model, experiments=experiments, torque_deviation=_stated_of_log(model, tables, noises))
    return Reweighted(changed, noises, {name: _outliers(every, name, noise) for name, noise in noises.items()})


def _outliers(every: Sequence[_Output], name: str, noise: Student) -> list[tuple[str, float]]:
    """Experiment and instant of the samples of an output that count little, the farthest one first."""
    if noise.freedom >= NORMAL_FROM:
        return []
    weighed = [
        (float(weight), one.label, float(time))
        for one in every if one.name == name and one.is_fitted
        for weight, time in zip(noise.weights(one.own), one.time, strict=True)
    ]  # fmt: skip
    return [(label, time) for weight, label, time in sorted(weighed) if weight < COUNTS_LITTLE]


def _outputs(model: LoopModel, values: Array, label: str) -> list[_Output]:
    """All outputs of an experiment, those of the log first."""
    run, experiment = model.simulation(values, label), model.experiments[label]
    log, further = experiment.unscaled(run.torque()), run.channels() if experiment.channels else {}
    recorded = experiment.torque if experiment.recorded is None else experiment.recorded
    is_fitted = experiment.role == "estimation"
    columns = zip(model.loop.labels, experiment.errors, recorded.T, log.T, strict=True)
    found = [_Output(label, name, errors, experiment.time, y, ys, is_fitted) for name, errors, y, ys in columns]
    for c in experiment.channels:
        found.append(_Output(label, c.name, c.errors, c.time, c.measured, further[c.name], is_fitted))
    return found


def _compared(
    experiment: Experiment, outputs: Sequence[_Output], noises: Mapping[str, Student], by_weights: bool
) -> Experiment:
    """The experiment with what a fit takes for its samples, and their scales."""
    pairs = [_sample(one, noises.get(one.name), by_weights) for one in outputs]
    n = len(experiment.errors)
    channels = tuple(
        _channel(channel, one, *pair, noises.get(one.name))
        for channel, one, pair in zip(experiment.channels, outputs[n:], pairs[n:], strict=True)
    )
    return replace(
        experiment,
        torque=np.column_stack([values for values, _ in pairs[:n]]),
        scale=np.column_stack([scale for _, scale in pairs[:n]]),
        recorded=np.column_stack([one.measured for one in outputs[:n]]),
        channels=channels,
    )


def _channel(channel: Channel, one: _Output, values: Array, scale: Array, noise: Student | None) -> Channel:
    if one.errors.is_plain:
        return channel
    deviation = _stated(one.errors, noise)
    return replace(channel, values=values, scale=scale, recorded=one.measured, deviation=deviation)


def _sample(one: _Output, noise: Student | None, by_weights: bool) -> tuple[Array, Array]:
    """(N,) what a fit takes for the samples of an output, and their scales; of a held-out one its own samples."""
    scale = one.errors.scale(one.simulated)
    if not one.is_fitted or one.errors.is_plain:
        return one.measured, scale
    errors = one.own
    if noise is None:
        return one.simulated + scale * errors, scale
    if by_weights:
        return one.simulated + scale * errors, scale / np.sqrt(noise.weights(errors))
    return one.simulated + scale * noise.modified(errors), scale


def _stated(errors: ErrorModel, noise: Student | None) -> float | None:
    """The stated deviation of what a fit takes for samples divided by their scales."""
    if errors.stated is None or noise is None:
        return errors.stated
    return errors.stated / float(np.sqrt(noise.information))


def _stated_of_log(
    model: LoopModel, tables: Mapping[str, Sequence[_Output]], noises: Mapping[str, Student]
) -> Array | None:
    """(n,) the same of the columns of the log; None where it is not stated."""
    if model.torque_deviation is None:
        return None
    outputs = tables[model.estimation_labels[0]][: model.joint_count]
    stated = [_stated(one.errors, noises.get(one.name)) for one in outputs]
    return np.array([np.nan if value is None else value for value in stated])
