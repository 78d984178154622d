"""What the final model of a discovery on signals leaves, where it is no white noise: slow noise, or something missing.

    gap = sqrt(mean(r^2) / s^2 - 1),      s^2 = mean (r_(i-1) - 2 r_i + r_(i+1))^2 / 6

s is what neighbouring samples show of the noise. Noise of a sensor that drifts has such a gap, too, and no test of the
same data tells it from what a model lacks; so that it is told, unless the case states the noise.
"""

from __future__ import annotations

import numpy as np

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.discovery.judge import REMAINDER
from fmu_didim.discovery.signals.search import quick_noise
from fmu_didim.fit.fit import Fit

BY_CHANCE = 8.0
"""[1] Times the root of 1 / N, up to which the square of this gap comes from white noise: four standard deviations."""

SLOW_REMAINDER = CATALOGUE(
    "slow-remainder", DOUBT, rank=51,
    meaning="What the final model leaves changes slowly, beside the noise that neighbouring samples show: a sensor "
    "that drifts does so, and so does what a model lacks. None of the candidates explains it.",
    next_step="If the noise of the sensor is slow, state its size (std:); else look for an input that was not "
    "recorded, or a state that the model lacks.",
)  # fmt: skip
SLOW_TEXT = "what remains is slow: noise of a sensor that drifts, or something that none of the candidates explains"


def slow_remainders(fit: Fit) -> list[Diagnostic]:
    """The outputs of which a fit leaves more than neighbouring samples show, and whose noise is not stated."""
    quick, stated, counts = quick_noise(fit).deviation, fit.model.stated_deviations, fit.model.output_counts
    whole = np.sqrt(np.concatenate([np.mean(own**2, axis=0) for _, own in fit.model.experiments.blocks(fit.residual)]))
    squares = (whole / quick) ** 2 - 1
    names = (*fit.model.loop.output_names, *fit.model.experiments.channels)
    return [
        Diagnostic(
            SLOW_REMAINDER, f"What remains is {np.sqrt(squares[k] + 1):.2g} times what neighbouring samples show of "
            "the noise.", name, float(np.sqrt(squares[k])), REMAINDER, "1",
        )
        for k, name in enumerate(names)
        if np.isnan(stated[k]) and squares[k] > max(REMAINDER**2, BY_CHANCE / np.sqrt(max(counts[k], 1.0)))
    ]  # fmt: skip
