"""Whether the residual torque still depends on the motion: then it is not noise, whatever its size.

The residual r of a joint is regressed on its sensitivities S, which the fit has used up, and on functions F of the
simulated motion that the model does not have:

    r = S a + F b + e,      all filtered by the autoregression of the noise, so that e is white.

Two tests ask whether noise alone explains b: Fisher's F for all columns together, and Student's t for the strongest of
the m columns, times m (Bonferroni). The smaller p value counts, twice because there are two. Neither a known noise nor
periods that repeat are needed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from scipy import linalg

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.base.distributions import f_sf, t_sf
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.data.timing import CLOCK_EARLY, CLOCK_LATE
from fmu_didim.cosim import Indices
from fmu_didim.data.signals import Array
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.log_noise import STANDSTILL
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.noise.weighting import noise_floor, whitened
from fmu_didim.fit.statistics import influence_efficient, noise_deviation
from fmu_didim.fit.uncertainty import Colour, nominal_rate, stretches, uncertainty
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.loop_model import LoopModel, Simulation

MOTION_CHANCE = 1e-3
"""[1] Probability, for all joints together, with which noise alone may be said to depend on the motion."""
BAND = 1.8
"""[samples] Of filtered data in a period of the cut-off frequency that are tested: the output of a Butterworth filter
of order 4, forwards and backwards, is white at that rate, to a tenth."""
ENDS = 1
"""[samples] Of those at each end of a log that are left out: there the filter extrapolates."""
SAMPLES_A_FUNCTION = 8.0
"""[samples] At least, for each function of the motion that a residual is compared with."""
CLOCK_ALONE = 0.8
"""[1] Share in the explained part of a residual from which the rate of the torque is the only cause: a clock 5 ms late
gives 0.9 and more, steeper friction or other gains less than 0.6."""
SIGNIFICANT = 2.0
"""[standard deviations] From which a value is different from zero."""
OWN_PART = 1e-6
"""[1] Least fraction of a column that is independent of the others."""
TURNING = 0.05
"""[1] Fraction of the largest speed of a joint over which its direction changes."""
CREEPING = 0.005
"""[1] The same near standstill, for steeper friction."""

DEPENDS_ON_MOTION = CATALOGUE(
    "residual-depends-on-motion", DOUBT, rank=60,
    meaning="The residual torque depends on the motion, which noise does not: some physics, the controller's gains or "
    "the clock of the log differ from the model. The identified values absorb a part of it.",
    next_step="Run fmu-didim discover CASE.yaml, which names what is missing; check the controller and the delay.",
)  # fmt: skip

UNTESTED = CATALOGUE(
    "motion-untested", DOUBT, rank=62,
    meaning="There are too few samples to test whether the residual torque depends on the motion: missing physics, a "
    "wrong clock or a wrong controller would go unnoticed.",
    next_step="Measure for longer or log at a higher rate; with low_pass, raise its cut-off frequency.",
)  # fmt: skip

TORQUE_RATE = "rate of the torque"
"""The function of the motion by which a shifted clock of the log shows."""


@dataclass(frozen=True)
class Dependence:
    """How the residual of a joint depends on the motion.

    Attributes:
        joint: from 1; p_value: of as much by noise alone; share: of the sum of squares that the motion explains.
        most: the function of the motion that explains most by itself; most_share: its share in the explained part.
        slope, deviation: of the residual over that function, with its standard deviation.
        samples: their number where they are too few for a test.
    """

    joint: int
    p_value: float
    share: float
    most: str
    most_share: float
    slope: float = 0.0
    deviation: float = 0.0
    samples: int | None = None

    @staticmethod
    def untested(joint: int, samples: int) -> Dependence:
        return Dependence(joint, 1.0, 0.0, "", 0.0, samples=samples)


def motion_diagnostics(found: Sequence[Dependence]) -> list[Diagnostic]:
    """The joints whose residual depends on the motion beyond chance, by another clock or otherwise, or is untested."""
    level = MOTION_CHANCE / max(len(found), 1)
    clock = [d for d in found if d.p_value < level and d.most == TORQUE_RATE and d.most_share > CLOCK_ALONE]
    return [_clock(d) for d in clock] + [
        Diagnostic(
            DEPENDS_ON_MOTION,
            f"{100 * d.share:.2g} % of the squared residual follows the motion (p = {max(d.p_value, TINY):.1e}), most "
            f"with the {d.most}.",
            place=f"joint {d.joint}", value=d.p_value, bound=level, unit="1",
        )
        for d in found
        if d.p_value < level and d not in clock
    ] + [
        Diagnostic(UNTESTED, f"{d.samples} sample{' is' if d.samples == 1 else 's are'} too few.", f"joint {d.joint}")
        for d in found if d.samples is not None
    ]  # fmt: skip


def _clock(found: Dependence) -> Diagnostic:
    late, deviation = -1000 * found.slope, 1000 * found.deviation  # r = tau(t - late) - tau(t)
    text = f"The log is {abs(late):.3g} ± {deviation:.1g} ms {'late' if late > 0 else 'early'}, or the loop is."
    bound = SIGNIFICANT * deviation
    return Diagnostic(CLOCK_LATE if late > 0 else CLOCK_EARLY, text, f"joint {found.joint}", late, bound, "ms")


def motion_dependence(
    model: LoopModel,
    values: Array,
    residuals: Mapping[str, Array],
    sensitivities: Mapping[str, Array],
    coefficients: Mapping[tuple[int, float], Array],
    rows: Mapping[str, Indices] = MappingProxyType({}),
) -> list[Dependence]:
    """How the residual of each joint depends on the simulated motion; nothing where the simulation fails.

    Args:
        residuals, sensitivities: label of each fitted experiment -> (N, n) and (N, n, p).
        coefficients: joint, from 1, and rate of the log in Hz -> (order,) of the autoregression of its noise.
        rows: label -> those samples of the log, where residuals and sensitivities are of some of them.
    """
    try:
        tables = {label: functions_of_motion(model.simulation(values, label)) for label in residuals}
    except SimulationError:  # after the last sample of a log
        return []
    found = []
    logs = {label: _at(model.experiments[label], rows.get(label)) for label in residuals}
    for j in range(model.joint_count):
        named = [list(tables[label][j]) for label in residuals]
        names = [name for name in named[0] if all(name in others for others in named)]
        parts = []
        for label, residual in residuals.items():
            motion = np.column_stack([tables[label][j][name] for name in names])
            motion = motion[rows[label]] if label in rows else motion
            stacked = np.column_stack([residual[:, j], sensitivities[label][:, j], motion])
            own = coefficients.get((j + 1, nominal_rate(logs[label].rate_hz)), np.zeros(0))
            parts.append(filtered(stacked, own, logs[label]))
        whole = np.concatenate(parts)
        found.append(dependence(whole[:, 0], whole[:, 1 : -len(names)], whole[:, -len(names) :], names, joint=j + 1))
    return found


def dependence_of_fit(fit: Fit, colours: Sequence[Colour]) -> list[Dependence]:
    """How the residual of each joint depends on the motion at a point of the closed loop.

    A filtered log is tested at as many samples as its band holds, without its ends.

    Args:
        colours: of the noise of the log as it is.
    """
    if fit.model.experiments.low_pass is not None:
        return _dependence_in_band(fit, fit.model.experiments.low_pass.cutoff_hz)
    rows, residual = fit.model.experiments.rows, fit.residual
    return motion_dependence(
        fit.model, fit.values, {label: residual[part] for label, part in rows.items()},
        {label: fit.jacobian[part] for label, part in rows.items()},
        {(colour.joint, colour.rate_hz): colour.coefficients for colour in colours},
    )  # fmt: skip


def _dependence_in_band(fit: Fit, cutoff_hz: float) -> list[Dependence]:
    """How the residual of a filtered fit depends on the motion."""
    model, chosen, times, residuals, sensitivities = fit.model, {}, [], {}, {}
    for label, part in model.experiments.rows.items():
        experiment = model.experiments[label]
        every = max(round(experiment.rate_hz / (BAND * cutoff_hz)), 1)
        rows = np.flatnonzero(experiment.places % every == 0)[ENDS:-ENDS]
        if rows.size * model.joint_count < 2 * fit.values.size:
            return [Dependence.untested(j + 1, rows.size) for j in range(model.joint_count)]
        chosen[label] = rows
        times.append(experiment.time[rows])
        residuals[label], sensitivities[label] = fit.residual[part][rows], fit.jacobian[part][rows]
    residual, sensitivity = (np.concatenate(list(table.values())) for table in (residuals, sensitivities))
    influence = influence_efficient(whitened(sensitivity, fit.deviation)).reshape(sensitivity.shape)
    influence = influence / fit.deviation[:, None]
    leverage = np.einsum("mjp,mjp->mj", sensitivity, influence)
    deviation = noise_deviation(residual, leverage, floor=noise_floor(model.measured))
    colours = uncertainty(residual, sensitivity, influence, deviation, stretches(times)).colours
    coefficients = {(colour.joint, colour.rate_hz): colour.coefficients for colour in colours}
    return motion_dependence(model, fit.values, residuals, sensitivities, coefficients, chosen)


def _at(experiment: Experiment, rows: Indices | None) -> Experiment:
    """An experiment with these samples alone; its operator remains that of all."""
    if rows is None:
        return experiment
    return replace(experiment, time=experiment.time[rows], torque=experiment.torque[rows])


def dependence(residual: Array, nuisance: Array, motion: Array, names: Sequence[str], *, joint: int) -> Dependence:
    """How a residual (N,) with white noise depends on functions (N, m) of the motion, beside nuisances (N, p).

    As many of the first functions are used as the samples allow.
    """
    known = _basis(nuisance)
    room = int((residual.size - known.shape[1]) / SAMPLES_A_FUNCTION)
    if room < 1:
        return Dependence.untested(joint, max(residual.size - known.shape[1], 0))
    columns = motion[:, :room]
    rest, own = residual - known @ (known.T @ residual), columns - known @ (known.T @ columns)
    kept = np.linalg.norm(own, axis=0) > OWN_PART * np.maximum(np.linalg.norm(columns, axis=0), TINY)
    total = float(rest @ rest)
    if not kept.any() or total <= TINY:
        return Dependence(joint, 1.0, 0.0, "", 0.0)
    own, left = own[:, kept], [name for name, keep in zip(names, kept, strict=False) if keep]
    basis = _basis(own)
    explained = float(np.sum((basis.T @ rest) ** 2))
    first, second = basis.shape[1], residual.size - known.shape[1] - basis.shape[1]
    ratio = (explained / first) / (max(total - explained, TINY) / second)
    power, product = np.sum(own**2, axis=0), own.T @ rest
    most = int(np.argmax(product**2 / power))
    deviation = float(np.sqrt(max(total - explained, 0.0) / second / power[most]))
    largest, freedom = float(product[most] ** 2 / power[most]), second + first - 1
    student = np.sqrt(largest / (max(total - largest, TINY) / freedom))
    both = (f_sf(ratio, first, second), power.size * 2 * t_sf(student, freedom))
    return Dependence(
        joint, float(min(2 * min(both), 1.0)), explained / total, left[most], largest / max(explained, TINY),
        slope=float(product[most] / power[most]), deviation=deviation,
    )  # fmt: skip


def _basis(columns: Array) -> Array:
    """(N, r) orthonormal basis of columns (N, m), without those that depend on others."""
    length = np.linalg.norm(columns, axis=0)
    nonzero = length > TINY
    if not nonzero.any():
        return np.zeros((columns.shape[0], 0))
    q, r, _ = linalg.qr(columns[:, nonzero] / length[nonzero], mode="economic", pivoting=True)
    size = np.abs(np.diag(r))
    return np.asarray(q[:, : int(np.sum(size > OWN_PART * size[0]))])


def filtered(table: Array, coefficients: Array, experiment: Experiment) -> Array:
    """The columns (N, m) of an experiment, whitened by an autoregression; rows whose past is missing are left out."""
    whitening = np.append(1.0, -coefficients)
    on_grid = experiment.with_gaps(table)
    count = on_grid.shape[0] - coefficients.size
    parts = (a * on_grid[coefficients.size - k : coefficients.size - k + count] for k, a in enumerate(whitening))
    left = np.asarray(sum(parts))
    return np.asarray(left[np.isfinite(left).all(axis=1)])


def functions_of_motion(run: Simulation) -> list[dict[str, Array]]:
    """Functions (N,) of the simulated motion of each joint at the samples, by name, the most significant ones first.

    Velocities and positions are included as far as the plant gives them; raises SimulationError.
    """
    recording, model = run.record(all_ticks=True), run.model
    offered = {v.name for v in model.loop.plant.outputs}

    def sampled(signal: Array) -> Array:
        return np.asarray(run.sampled(signal[run.operator.ticks, None])[:, 0])

    torque, step = run.logged_torque(recording), recording.spacing
    found = []
    for j in range(model.joint_count):
        rate = np.gradient(torque[:, j], step)
        functions = {TORQUE_RATE: rate}
        if f"dq{j + 1}" in offered:
            dq = recording.table([f"{model.loop.plant_name}.dq{j + 1}"])[:, 0]
            fast = max(float(np.abs(dq).max()), STANDSTILL)
            acceleration = np.gradient(dq, step)
            functions |= {
                "direction of motion": np.tanh(dq / (TURNING * fast)),
                "square of the velocity": dq * np.abs(dq),
                "acceleration": acceleration,
                "velocity": dq,
            }
        functions |= {
            "offset": np.ones(torque.shape[0]),
            "torque": torque[:, j],
            "size of the torque": np.abs(torque[:, j]),
        }
        if f"dq{j + 1}" in offered:
            functions |= {
                "velocity near standstill": np.tanh(dq / (CREEPING * fast)),
                "cube of the velocity": dq**3,
                "kinetic energy": dq**2,
                "jerk": np.gradient(acceleration, step),
            }
        if f"q{j + 1}" in offered:
            q = recording.table([f"{model.loop.plant_name}.q{j + 1}"])[:, 0]
            q = q - q.mean()
            functions |= {"position": q, "square of the position": q**2, "cube of the position": q**3}
        functions |= {
            "time": recording.time - recording.time.mean(),
            "curvature of the torque": np.gradient(rate, step),
        }
        found.append({name: sampled(signal) for name, signal in functions.items()})
    return found
