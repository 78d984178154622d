"""From the estimate of a part of long logs to that of all their samples.

The part gives the values to within its own standard deviations, some of those of all samples. From there few steps of
Gauss and Newton lead to the minimum of all samples,

    theta + (S'S)^-1 S' r(theta),

with the sensitivity S of the first of them: near a minimum it hardly changes. What must be summed over all samples is
summed block by block, and no second table as large as S is ever there.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.distributions import DEVIATION_OF_MEDIAN
from fmu_didim.cosim import grid_places
from fmu_didim.data.signals import Array
from fmu_didim.estimators.base import Estimator, Progress
from fmu_didim.estimators.didim import Didim
from fmu_didim.estimators.finish import NEXT_STEP, degrees_of_freedom, remarks_of_limits, unlimited_by
from fmu_didim.fit.derivatives.sensitivity import sensitivity
from fmu_didim.fit.estimate import Estimate, Stage, Status
from fmu_didim.fit.exploration.all_samples import AllSamples, BlockOfLog, FarSamples
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.iteration import Iteration
from fmu_didim.fit.linear_problem import LinearProblem
from fmu_didim.fit.noise.weighting import NoiseOfResidual
from fmu_didim.fit.region import Region
from fmu_didim.fit.statistics import relative_error_percent
from fmu_didim.fit.uncertainty import Colour, Stretch, Uncertainty, covariance_of, stretches_of_outputs
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.stretches import PartOfLogs, part_of_logs, whole_logs

STEPS = 10
"""[steps] Of Gauss and Newton at most: two or three are usual."""
BLOCKS = 20
"""[blocks] Of a log, between which what changes shows; tables over one are small beside that of the sensitivities."""
SEAM = 0.05
"""[standard deviations] Of the residual, by which the simulated torque of a part may differ from that of the whole logs
at its samples, root mean square: less than a noise of a twentieth added."""
FAR, MOST_FAR = 3.0, 20_000
"""[standard deviations] Of the residual, from which a sample may be an outlier; [samples] of a joint that are kept."""
STAGE = "all samples"


def part_to_judge(model: LoopModel, estimator: Estimator) -> PartOfLogs | None:
    """The part of a model's logs that an estimator begins with and that is judged; None where all samples are."""
    if not isinstance(estimator, Didim) or not estimator.finish or estimator.estimate_delay or model.prior is not None:
        return None
    robot = model.parameters.has_regressor and not model.parameters.is_probed
    if not robot or model.joint_weights != "estimated":
        return None
    return part_of_logs(model)


def on_all_samples(found: Estimate, part: PartOfLogs, whole: LoopModel, progress: Progress) -> Estimate | None:
    """The estimate of all samples from that of a part of them; None where the part is no part of these logs, because
    the loop has not forgotten a seam, or the steps do not settle.

    Raises:
        SimulationError: the whole logs cannot be simulated with the values of the part.
    """
    if found.minimum is None:
        return None
    minimum = _Minimum.near(found.minimum, whole_logs(found.minimum.model, whole))
    if _seam(found.minimum, part, minimum) > SEAM or not minimum.settle(progress):
        return None
    return _estimate(found, part, minimum)


@dataclass
class _Minimum:
    """The steps on all samples: outputs and residual (N, n) at the values (p,), the sensitivity (N, n, p) where they
    began, and deviations (n,) of the residual."""

    model: LoopModel
    values: Array
    outputs: Array
    table: Array
    measured: Array
    iterations: list[Iteration]

    @classmethod
    def near(cls, fit: Fit, model: LoopModel) -> _Minimum:
        """At the values of a fit of a part."""
        outputs = _torque(model, fit.values)
        table = sensitivity(model, fit.values, outputs, steps=dict(fit.steps))
        return cls(model, fit.values, outputs, table, model.measured, [])

    @property
    def residual(self) -> Array:
        return self.measured - self.outputs

    def settle(self, progress: Progress) -> bool:
        """Take steps until they are far below the standard deviations; whether they are."""
        residual = self.residual
        self.deviation = NoiseOfResidual(self.model).deviation(residual, self.table)
        for number in range(1, STEPS + 1):
            self.equations = LinearProblem.of(self.table, residual, deviation=self.deviation)
            region = Region.of(self.model.with_values(self.values))
            step, _ = self.equations.step(self.values, region, 0.0)
            size = float(np.max(np.abs(step) / self.equations.deviations()))
            error = float(relative_error_percent(self.measured, self.outputs)[0])
            one = Iteration(STAGE, number, self.values, error, size)
            self.iterations.append(one)
            progress(one)
            if size < NEXT_STEP:
                return True
            self.values = self.values + step
            self.outputs = _torque(self.model, self.values)
            residual = self.residual
            stated = ~np.isnan(self.model.stated_deviations)
            self.deviation = np.where(stated, self.deviation, _deviation(residual, self.table))
        return False


def _torque(model: LoopModel, values: Array) -> Array:
    """(N, n) simulated torque of all logs, of which nothing else is recorded."""
    runs = [model.simulation(values, label) for label in model.estimation_labels]
    return np.concatenate([run.sampled_torque(run.record(signals=model.loop.logged)) for run in runs])


def _deviation(residual: Array, table: Array) -> Array:
    """(n,) of a residual (N, n) that so many values are fitted to, shared by the joints."""
    count = len(residual) - table.shape[2] / residual.shape[1]
    return np.asarray(np.sqrt((residual**2).sum(axis=0) / count))


def _seam(fit: Fit, part: PartOfLogs, minimum: _Minimum) -> float:
    """Largest difference of the simulated torque of the part from that of the whole logs, at the values of the part, in
    standard deviations of the residual."""
    largest, of_part, of_whole = 0.0, fit.model.experiments.rows, minimum.model.experiments.rows
    for label, rows in part.rows.items():
        if label not in of_whole:
            continue
        apart = fit.torque[of_part[label]] - minimum.outputs[of_whole[label]][rows]
        largest = max(largest, float(np.max(np.sqrt((apart**2).mean(axis=0)) / fit.deviation)))
    return largest


def _estimate(found: Estimate, part: PartOfLogs, minimum: _Minimum) -> Estimate:
    fit, model, residual = found.minimum, minimum.model, minimum.residual
    assert fit is not None
    ratio = (minimum.deviation / fit.deviation) ** 2
    scaled = [1.0 if found.known_noise is not None and found.noise_is_stated else float(r) for r in ratio]
    colours = tuple(
        replace(
            c,
            variance=c.variance * scaled[c.joint - 1],
            residual_variance=c.residual_variance * float(ratio[c.joint - 1]),
        )
        for c in found.colours
    )
    blocks = tuple(_blocks(fit, part, minimum, residual, colours))
    inverse = np.linalg.pinv(np.asarray(sum(b.gram for b in blocks)), hermitian=True)
    covariance = inverse @ np.asarray(sum(b.scatter for b in blocks)) @ inverse
    deviation, values = np.sqrt(np.diag(covariance)), minimum.values
    unlimited = unlimited_by(minimum.equations, model, values)
    inflation = max([1.0, *(c.inflation for c in colours)])
    told = AllSamples(
        len(residual), len(fit.residual), part.spans, blocks,
        _loudest(fit, part), _far(minimum, residual, inverse), found.standard_deviation,
    )  # fmt: skip
    of_part = remarks_of_limits(fit.model, fit.values, found.standard_deviation, found.unlimited)
    remarks = [remark for remark in found.remarks if remark not in of_part]
    return replace(
        found, model=model.with_values(values).with_loop(substeps=None, substep_factor=1), covariance=covariance,
        freedom=degrees_of_freedom(model, values.size, inflation), time=model.experiments.time,
        measured=minimum.measured, simulated=minimum.outputs, noise=minimum.deviation,
        condition_number=minimum.equations.condition, status=Status.CONVERGED,
        iterations=(*found.iterations, *minimum.iterations),
        stages={**found.stages, STAGE: Stage(values, deviation)},
        integration_shift=found.integration_shift * found.standard_deviation / deviation, colours=colours,
        unlimited=unlimited, all_samples=told,
        remarks=(*remarks, *remarks_of_limits(model, values, deviation, unlimited)),
    )  # fmt: skip


def _loudest(fit: Fit, part: PartOfLogs) -> Array:
    """(n,) root mean square of the residual of each joint, in the stretch of the part where it is largest."""
    largest = np.zeros(fit.residual.shape[1])
    for label, own in fit.model.experiments.rows.items():
        rows = part.rows.get(label, np.arange(own.stop - own.start))
        for stretch in np.split(fit.residual[own], np.flatnonzero(np.diff(rows) > 1) + 1):
            largest = np.maximum(largest, np.sqrt((stretch**2).mean(axis=0)))
    return largest


def _far(minimum: _Minimum, residual: Array, inverse: Array) -> dict[tuple[str, int], FarSamples]:
    """The samples of each log and joint whose residual is far above the noise, the largest of them."""
    found = {}
    for label, own in minimum.model.experiments.rows.items():
        for j, column in enumerate(residual[own].T):
            sizes = np.abs(column)
            rows = np.flatnonzero(sizes > FAR * DEVIATION_OF_MEDIAN * np.median(sizes))
            rows = np.sort(rows[np.argsort(-sizes[rows])[:MOST_FAR]])
            influence = minimum.table[own][rows, j] @ inverse / minimum.deviation[j] ** 2
            found[label, j] = FarSamples(rows, influence)
    return found


def _blocks(
    fit: Fit, part: PartOfLogs, minimum: _Minimum, residual: Array, colours: Sequence[Colour]
) -> Iterator[BlockOfLog]:
    """The blocks of all logs, with noise of the colour that the part has."""
    experiments, weight = minimum.model.experiments, minimum.deviation**-2
    counted = tuple(_as_loud(c) if c.is_louder else c for c in colours)
    rates = {
        s: one.rate_hz
        for s, one in zip(fit.model.experiments.rows, stretches_of_outputs(fit.model.experiments), strict=True)
    }
    for label, rows in experiments.rows.items():
        time, count = experiments[label].time, rows.stop - rows.start
        edges = np.linspace(0, count, BLOCKS + 1 if label in part.rows else 2).astype(int)
        for begin, end in itertools.pairwise(edges):
            own = slice(rows.start + begin, rows.start + end)
            table, left = minimum.table[own], residual[own]
            scores = table * weight[:, None]
            noise = Uncertainty(np.zeros((0, 0)), counted, np.ones_like(left))
            stretch = Stretch(slice(None), grid_places(time[begin:end]), rates[label])
            flat = scores.reshape(-1, table.shape[2])
            yield BlockOfLog(
                label, float(time[begin]), float(time[end - 1]), flat.T @ left.ravel(),
                flat.T @ table.reshape(-1, table.shape[2]), covariance_of(scores, noise, [stretch]),
                np.sqrt((left**2).mean(axis=0)),
            )  # fmt: skip


def _as_loud(colour: Colour) -> Colour:
    """Noise that is louder in places as noise of one size that brings as large deviations."""
    return replace(colour, variance=colour.variance * colour.inflation**2, coefficients=np.zeros(0))
