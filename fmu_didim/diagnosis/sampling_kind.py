"""Whether the torque log shows points or averages, other than the case says.

An average over the preceding sample period lies half of it late and is smoothed; taken for a point it looks like a log
whose clock is late, or like a lag. So the model that was found, without a shift of the log, is simulated once more and
sampled in each way, y_k = S_k tau; what its parameters can absorb is projected out of the residuals, and the best way
is fitted and compared with the model that was found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.diagnosis.gap import delta_bic
from fmu_didim.errors import InputError, SimulationError
from fmu_didim.master import SampleOperator, sample_operator
from fmu_didim.master.sampling import Kind, Window
from fmu_didim.prediction.base_projection import BaseProjection
from fmu_didim.prediction.least_squares import Fit, minimise
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.prediction.noise import Noise

WAYS: tuple[tuple[Kind, Window], ...] = (
    ("point", "preceding"), ("average", "preceding"), ("average", "centred"), ("average", "following"),
)  # fmt: skip
NEARLY = 1.1
"""Instead of a shift, a way is fitted if it leaves less than this many times the chi-square of what was found."""
WORDS = {"preceding": "before", "centred": "around", "following": "after"}


@dataclass(frozen=True)
class Way:
    """A way of sampling.

    Attributes:
        gain: BIC by which it is better than the model that was found.
        instead: whether that model has a shift of the log, which it does without.
    """

    kind: Kind
    window: Window
    gain: float
    instead: bool

    def text(self, seconds: float) -> str:
        """What is said of it; ``seconds``: sample period."""
        shows, entry = "points", "sampling: point"
        if self.kind == "average":
            shows = f"averages over the {1000 * seconds:.4g} ms {WORDS[self.window]} each stamp"
            entry = f"sampling: average, window: {self.window}"
        how = "without a shift, and as well" if self.instead else "better than what was found"
        return (
            f"The log may show {shows}, other than the case says: that explains it {how} (BIC difference "
            f"{self.gain:.0f}). Find out how the logger samples; if so, write torque: {{{entry}}}."
        )


def other_sampling(fit: Fit, model: LoopModel, noise: Noise, *, saved: float, threshold: float) -> Way | None:
    """A way of sampling that explains the log better than the model that was found, or as well and without its shift.

    Args:
        fit: that model; model: the same without a shift of the log, ``fit.model`` itself if it has none.
        saved: parameters that the shift counted as; threshold: BIC difference from which another way is better.
    """
    instead = model is not fit.model
    try:
        ways = _sampled(model, fit, noise, NEARLY if instead else 1.0)
        if not ways:
            return None
        way, operator = min(ways, key=lambda one: one[0])[1:]
        other = {"train": replace(model.runs["train"], operator=operator)}  # held-out data are not looked at
        found = minimise(replace(model, runs=other), noise)
    except SimulationError:
        return None
    gain = delta_bic(fit.residual, found.residual, -saved, noise)
    return Way(*way, gain, instead) if gain >= (0.0 if instead else threshold) else None


def _sampled(
    model: LoopModel, fit: Fit, noise: Noise, most: float
) -> list[tuple[float, tuple[Kind, Window], SampleOperator]]:
    """Other ways that leave less than ``most`` times what the fit leaves: chi-square to first order, way, operator."""
    run = model.runs["train"]
    experiment, step, start = run.problem.experiment, run.problem.system.step_size, model.start
    count = experiment.reference.time.size
    torque = model.logged_torque(model.record(start, all_ticks=True), start)
    base = BaseProjection.of_fit(fit, noise)
    limit = most * float(np.sum(base.rest_of(base.weighted(fit.residual)) ** 2))
    found = []
    for kind, window in WAYS:
        try:
            operator = sample_operator(
                experiment.time, start=float(experiment.reference.time[0]), step=step,
                tick_count=count, kind=kind, window=window,
            ).stamped_later(experiment.operator.lag, count)  # fmt: skip
        except InputError:  # an instant at the end of the data, where a point or a window has no tick
            continue
        residual = run.measured - run.problem.filtered(operator.apply(torque[operator.ticks]))
        size = float(np.sum(base.rest_of(base.weighted(residual)) ** 2))
        if size < limit and not _same(operator, run.operator):
            found.append((size, (kind, window), operator))
    return found


def _same(one: SampleOperator, other: SampleOperator) -> bool:
    return np.array_equal(one.ticks, other.ticks) and abs(one.matrix - other.matrix).max() < 1e-9
