"""Fits of outputs whose error models follow what is simulated: again with new scales until the values stay."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fmu_didim.base.errors import SimulationError, listed
from fmu_didim.estimators.finish import Minimum
from fmu_didim.fit.estimate import Estimate, Status
from fmu_didim.fit.noise.error_models import NORMAL_FROM, Reweighted, reweighted
from fmu_didim.model.loop_model import LoopModel

ROUNDS = 40
"""[fits] With scales of their own: each divides what the last one moved by some ten; with many outliers, as long as
they are weighted, by two."""
NEAR = 0.3
"""[standard deviations] A round with weights that moved no value by more is followed by those that end at the answer
fast; where these go astray, by a tenth."""
STAYS = 0.01
"""[standard deviations] By which a round may move a value at the end: it changes no conclusion."""
SHOWN = 6
"""[samples] Outliers whose instants are reported."""


def with_error_models(
    model: LoopModel, fit: Callable[[LoopModel], Minimum], conclude: Callable[[Minimum], Estimate]
) -> Estimate:
    """The estimate of a model whose error models follow what is simulated.

    Args:
        fit: the minimum with scales held; conclude: the estimate at the last one.

    Raises:
        RefusedError, IdentificationError: as of these.
    """
    minimum = fit(model)
    if not model.experiments.has_error_models:
        return conclude(minimum)
    iterations, moved, found = list(minimum.iterations), np.inf, None
    by_weights, near = True, NEAR
    for _ in range(ROUNDS):
        values = minimum.fit.values
        try:
            found = reweighted(
                minimum.fit.model.with_loop(substeps=None, substep_factor=1), values, by_weights=by_weights
            )
        except SimulationError:
            break
        last, minimum = moved, fit(found.model)
        iterations += minimum.iterations
        moved = float(np.max(np.abs(minimum.fit.values - values) / minimum.known.deviation))
        if moved <= STAYS and not (by_weights and found.noises):
            break
        if by_weights:
            by_weights = moved > near
        elif moved > last:
            by_weights, near = True, near / 10
    estimate = conclude(replace(minimum, iterations=tuple(iterations)))
    estimate = replace(estimate, remarks=(*estimate.remarks, *(() if found is None else _words(found))))
    if moved <= STAYS:
        return estimate
    advice = (
        f"The weights of the error models had not settled after {ROUNDS} fits: the last one moved a value by "
        f"{moved:.2g} standard deviations. Start nearer to the truth (start: {{name: value}}), or state the noise."
    )
    return replace(estimate, status=Status.MAXIMUM_ITERATIONS, advice=advice)


def _words(found: Reweighted) -> list[str]:
    """What the noise of robust outputs is, and which samples count little."""
    told = []
    for name, noise in found.noises.items():
        if noise.freedom >= NORMAL_FROM:
            told.append(f"{name}: the residual has no more outliers than normal noise; robust: changes nothing.")
            continue
        several = len({label for label, _ in found.outliers[name]}) > 1
        off = [f"{time:g} s{f' of {label}' if several else ''}" for label, time in found.outliers[name]]
        where = f": t = {listed(off, SHOWN)}" if off else ""
        told.append(
            f"{name}: noise of Student's t with {noise.freedom:.2g} degrees of freedom; {len(off)} outliers count less "
            f"than a fifth of an ordinary sample{where}."
        )
    return told
