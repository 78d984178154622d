"""Single samples of an output that lie far from a fitted model: errors of a sensor or a file."""

from __future__ import annotations

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.distributions import DEVIATION_OF_MEDIAN, t_sf
from fmu_didim.checks.data.log import FEW_OUTLIERS, LOG_OUTLIERS
from fmu_didim.checks.judgement import MATTERS
from fmu_didim.checks.motion.colour import orthonormal, rest_of
from fmu_didim.checks.motion.dependence import independent
from fmu_didim.checks.outputs.residuals import OutputResiduals
from fmu_didim.data.signals import Array
from fmu_didim.fit.noise.noise import TINY

FAR = 6.0
"""[standard deviations] By the median of the residuals, from which a sample is an outlier: of a million normal ones
none."""
KNOWN_FROM = 0.37
"""[1] Of the samples, from which a mean square would be known as well as that deviation."""
CHANCE = 1e-3
"""[1] Probability by white normal noise of a single sample that is as far from what the others leave (Grubbs), below
which it is an outlier: six such deviations of 8 samples are nothing."""
MOST = 0.02
"""[1] Of the samples that may be outliers: more of them are no exceptions."""


def outlier_diagnostics(found: OutputResiduals) -> list[Diagnostic]:
    """The outliers of each output, a doubt where they move the values."""
    told = []
    for k in found.judged:
        name, rows = found.names[k], found.rows(k)
        residual = found.residual[rows, k]
        spread = DEVIATION_OF_MEDIAN * float(np.median(np.abs(residual - np.median(residual))))
        far = np.flatnonzero(np.abs(residual - np.median(residual)) > FAR * spread)
        if not spread or not 0 < far.size <= max(MOST * residual.size, 1):
            continue
        wrong = np.zeros(residual.size)
        wrong[far] = residual[far] / spread
        basis = orthonormal(independent(found.jacobian[rows, k]))
        if far.size == 1 and _by_chance(residual, basis, int(far[0])) > CHANCE:
            continue
        moved = float(np.linalg.norm(basis.T @ wrong))
        first = found.times(k)[far[0]]
        count = f"{far.size} of {residual.size} samples {'lies' if far.size == 1 else 'lie'}"
        text = (
            f"{count} up to {np.abs(wrong).max():.3g} standard deviations from the model, the first at t = {first:.6g} "
            f"s; they move the values by {moved:.2g} standard deviations, all together."
        )
        code = LOG_OUTLIERS if moved > MATTERS else FEW_OUTLIERS
        advice = (
            f"Look at them; empty the cells of those that are errors of the sensor, or let the fit count what is far "
            f"off less: measured: {{columns: {{{name}: {{robust: true}}}}}}."
        )
        told.append(Diagnostic(code, text, name, moved, MATTERS, "1", next_step=advice))
    return told


def _by_chance(residual: Array, basis: Array, place: int) -> float:
    """Probability by white noise that one of the samples (N,) lies as far from what the others leave beside a basis
    (N, r) as this one: Grubbs, Ann. Math. Stat. 21 (1950), with the leverage of each."""
    left = rest_of(residual, basis)
    own = max(1 - float(np.sum(basis[place] ** 2)), TINY)
    freedom = max(residual.size - basis.shape[1] - 1, 1)
    squares = max(float(left @ left) - float(left[place] ** 2) / own, TINY)
    return 2 * residual.size * float(t_sf(abs(float(left[place])) / np.sqrt(own * squares / freedom), freedom))
