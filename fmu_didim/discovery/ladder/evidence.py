"""What each run says of an effect: its size there, as a multiple of the fitted one, and whether the run is predicted
better with it. The model with all effects is compared with the same without this one, all else fitted anew."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.ladder.facts import columns_in
from fmu_didim.discovery.selection.decide import SMALLEST_GAIN
from fmu_didim.discovery.selection.held_out import HELD_OUT, NEARER, Amplitude, amplitude
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.gap import Ratio, block_in, rms_ratio

Says = Literal["yes", "no", "hardly excited", "undecided", "not run"]
VALUE_DIFFERS = 3.0
"""[standard deviations] Between the size of an effect in a run and the fitted one, from which they differ: noise alone
brings them so far once in 370 times."""
IN_INTERVAL = 3.92
"""[standard deviations] Width of a 95 % interval."""


@dataclass(frozen=True)
class Evidence:
    """What a run says of an effect.

    Attributes:
        ratio: of the RMS with and without it; None where a model cannot be run there.
        amplitude: its size there; None where the log is too short to tell, or does not show it at all.
        deviation: standard deviation of the fitted size, as a part of it.
        failure: why the model with the effect cannot be run.
    """

    ratio: Ratio | None
    amplitude: Amplitude | None
    deviation: float = 0.0
    failure: str = ""

    @property
    def says(self) -> Says:
        """Whether the effect is there.

        A run that hardly excites it says nothing, however much better it is predicted: then other parameters, fitted
        anew, have done that. One that excites it says *no* where the prediction is worse for certain, or where the
        effect has certainly less than half of its size; *yes* where it has certainly more, or is certainly there and
        the prediction certainly better.
        """
        if self.failure:
            return "no"
        if self.ratio is None:
            return "not run"
        if self.amplitude is None or self.amplitude.size < SMALLEST_GAIN:
            return "hardly excited"
        if self.ratio.low > HELD_OUT or self.amplitude.high < NEARER:
            return "no"
        is_better = self.ratio.high < HELD_OUT and self.amplitude.low > 0
        return "yes" if self.amplitude.low > NEARER or is_better else "undecided"

    @property
    def differs(self) -> bool:
        """Whether it has another size there than in the fit, beyond the standard deviations of both."""
        if self.amplitude is None or self.says not in ("yes", "undecided"):
            return False
        own = (self.amplitude.high - self.amplitude.low) / IN_INTERVAL
        return abs(self.amplitude.value - 1) > VALUE_DIFFERS * float(np.hypot(own, self.deviation))

    @property
    def text(self) -> str:
        """The figures in words."""
        if self.failure:
            return f"the model with it cannot be run there: {self.failure}"
        if self.ratio is None:
            return "the model without it cannot be run there, so that nothing can be compared"
        better = f"RMS {self.ratio.value:.3g} times that without it ({self.ratio.low:.3g} to {self.ratio.high:.3g})"
        if self.amplitude is None:
            return f"the log is too short to tell, or does not show it; {better}"
        if self.says == "hardly excited":
            return (
                f"hardly excited: what only it can make is {self.amplitude.size:.2g} of the noise, and "
                f"{SMALLEST_GAIN:g} are needed"
            )
        told = f"it has {self.amplitude}, {better}"
        return told + ("; another size than in the fit, beyond both deviations" if self.differs else "")


def evidence_in(label: str, without: Fit, after: Fit, *, deviation: float = 0.0, seed: int = 0) -> Evidence:
    """What a run says of an effect.

    Args:
        without: the fit without it; after: with it; deviation: of its fitted size, as a part of it.
        seed: of the bootstrap.
    """
    try:
        second = _residual(after, label)
    except SimulationError as error:
        return Evidence(None, None, failure=error.what)
    try:
        first, columns = _residual(without, label), columns_in(without, label)
    except SimulationError:
        return Evidence(None, None)
    free = [i for i, parameter in enumerate(without.model.free_parameters) if not parameter.is_held]
    block = block_in(without.model, label)
    ratio = rms_ratio(first, second, without.noise, block=block, seed=seed)
    shown = amplitude(first, second, columns[:, :, free], without, block=block, seed=seed)
    return Evidence(ratio, shown, deviation)


def _residual(fit: Fit, label: str) -> Array:
    """(M, m) residual of all outputs of one experiment."""
    experiments = fit.model.experiments
    if label in experiments.estimation_labels:
        return fit.residual[experiments.output_rows[label]]
    if not experiments.channels:
        return fit.residual_in(label)
    return experiments.measured_outputs_in(label) - fit.simulation(label).outputs()


def scale_deviation(fit: Fit, effect: int, neutral: Mapping[str, float]) -> float:
    """Standard deviation of the size of an effect as a part of it: 1 / sqrt(a' C^-1 a) with the covariance C of its
    amplitudes, which are a above their neutral values; zero where it has none."""
    free = fit.model.free_parameters
    own = [i for i, k in enumerate(free) if k.effect == effect and not k.is_shape and not k.is_held]
    above = np.array([fit.values[i] - neutral.get(free[i].key, 0.0) for i in own])
    if not own or not np.isfinite(above).all():
        return 0.0
    wald = float(above @ np.linalg.pinv(fit.covariance[np.ix_(own, own)]) @ above)
    return 1 / float(np.sqrt(wald)) if wald > 0 else 0.0
