"""Whether the torque log shows points or averages, unlike the case states.

An average over the preceding sample period lies half of it late and is smoothed; taken for a point it looks like a late
clock or a lag. So the final model, without a shift of the log, is simulated again and sampled in each way, y_k = S_k
tau; what its parameters can absorb is projected out of the residuals, and the best way is fitted and compared with the
final model.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.errors import InputError, SimulationError
from fmu_didim.cosim import SampleOperator, sample_operator
from fmu_didim.cosim.sampling import Kind, Window
from fmu_didim.fit.base_projection import BaseProjection
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import delta_bic
from fmu_didim.fit.solver.least_squares import minimise
from fmu_didim.model.loop_model import LoopModel, Simulation

NEARLY = 1.1
"""[1] Instead of a shift, a way of sampling is fitted if its chi-square is below so many times that of the model."""
SAME_OPERATOR = 1e-9
"""[1] Ways of sampling whose weights differ by less are the same."""

WAYS: tuple[tuple[Kind, Window], ...] = (
    ("point", "preceding"), ("average", "preceding"), ("average", "centred"), ("average", "following"),
)  # fmt: skip
WORDS = {"preceding": "before", "centred": "around", "following": "after"}


@dataclass(frozen=True)
class Way:
    """A way of sampling.

    Attributes:
        gain: BIC by which it is better than the model that was found; instead: whether it replaces a shift of the log.
    """

    kind: Kind
    window: Window
    gain: float
    instead: bool

    def text(self, seconds: float) -> str:
        """The sentence about it; ``seconds``: sample period."""
        shows, entry = way_text(self.kind, self.window, 1000 * seconds)
        how = "without a shift, and as well" if self.instead else "better than the final model"
        return (
            f"The log may show {shows}, unlike the case states: that explains it {how} (BIC difference "
            f"{self.gain:.0f}). Find out how the logger samples; if so, write torque: {{{entry}}}."
        )


def other_sampling(fit: Fit, model: LoopModel, *, saved: float, threshold: float) -> Way | None:
    """A way of sampling that explains the log better than the model that was found, or as well and without its shift.

    Args:
        fit: that model; model: the same without a shift of the log, ``fit.model`` itself if it has none.
        saved: parameters that the shift counted as; threshold: BIC difference from which another way is better.
    """
    instead = model is not fit.model
    try:
        ways = _sampled(model, fit, NEARLY if instead else 1.0)
        if not ways:
            return None
        way, operators = min(ways, key=lambda one: one[0])[1:]
        other = model.on(*model.estimation_labels)  # held-out data are not looked at
        for label, operator in operators.items():
            other = other.with_experiment(label, replace(other.experiments[label], operator=operator))
        found = minimise(other, fit.noise)
    except SimulationError:
        return None
    gain = delta_bic(fit.residual, found.residual, -saved, fit.noise)
    return Way(*way, gain, instead) if gain >= (0.0 if instead else threshold) else None


def _sampled(
    model: LoopModel, fit: Fit, most: float
) -> list[tuple[float, tuple[Kind, Window], Mapping[str, SampleOperator]]]:
    """Other ways with less than ``most`` times the chi-square of the fit: chi-square to first order, way, operators."""
    runs = {label: model.simulation(model.start, label) for label in model.estimation_labels}
    commands = {label: run.logged_torque(run.record(all_ticks=True)) for label, run in runs.items()}
    base = BaseProjection.of_fit(fit)
    limit = most * float(np.sum(base.rest_of(base.weighted(fit.residual)) ** 2))
    found: list[tuple[float, tuple[Kind, Window], Mapping[str, SampleOperator]]] = []
    for kind, window, operators in other_ways(runs):
        simulated = [
            model.experiments.filtered(o.apply(commands[label][o.ticks]), label) for label, o in operators.items()
        ]
        residual = model.measured - np.concatenate(simulated)
        size = float(np.sum(base.rest_of(base.weighted(residual)) ** 2))
        if size < limit:
            found.append((size, (kind, window), operators))
    return found


def way_text(kind: Kind, window: Window, period_ms: float) -> tuple[str, str]:
    """The values of a log that is sampled in this way, in words, and the entry of a case for it."""
    if kind == "point":
        return "points", "sampling: point"
    return f"averages over the {period_ms:.4g} ms {WORDS[window]} each stamp", f"sampling: average, window: {window}"


def other_ways(runs: Mapping[str, Simulation]) -> Iterator[tuple[Kind, Window, dict[str, SampleOperator]]]:
    """The ways of sampling that differ from those of these experiments, with their operators by label."""
    for kind, window in WAYS:
        try:
            operators = {label: sampled_as(run, kind, window) for label, run in runs.items()}
        except InputError:  # an instant at the end of the data, where a point or a window has no tick
            continue
        if not all(_is_same(o, runs[label].experiment.operator) for label, o in operators.items()):
            yield kind, window, operators


def sampled_as(run: Simulation, kind: Kind, window: Window) -> SampleOperator:
    """The operator of an experiment's log if it were sampled in this way; raises InputError at the end of the data."""
    experiment, count = run.experiment, run.experiment.reference.time.size
    operator = sample_operator(
        experiment.time, start=float(experiment.reference.time[0]), step=run.step_size, tick_count=count, kind=kind,
        window=window, instants=run.instants,
    )  # fmt: skip
    return operator.stamped_later(experiment.operator.lag, count)


def _is_same(one: SampleOperator, other: SampleOperator) -> bool:
    return np.array_equal(one.ticks, other.ticks) and abs(one.matrix - other.matrix).max() < SAME_OPERATOR
