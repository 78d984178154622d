"""Whether experiments that were fitted together agree on the parameters that they share.

Each experiment in turn gets values of its own for all that it shares with the others. With the whitened sensitivity
S_e and residual r_e of experiment e at the common minimum, A_e = S_e' S_e and A the sum of all A_e, that would lower
the sum of squares to first order by

    gain_e = g' (A_e - A_e A^-1 A_e)^+ g,      g = S_e' r_e,

which by noise alone is a chi-square of the rank of the bracket (the score test). Source: C. R. Rao, Proceedings of the
Cambridge Philosophical Society 44 (1948).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from fmu_didim.diagnosis import thresholds as limits
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.prediction.noise import TINY, effective_fraction
from fmu_didim.signals import Array


@dataclass(frozen=True)
class Agreement:
    """How an experiment agrees with the others.

    Attributes:
        label: of the experiment.
        p_value: of as much disagreement by noise alone; agrees: whether it is above the level for so many experiments.
        parameter: the shared one that would change most, by ``change_in_std`` standard deviations, if it were its own.
    """

    label: str
    p_value: float
    agrees: bool
    parameter: str
    change_in_std: float

    def warning(self) -> str:
        """What the user should know where it does not agree."""
        return (
            f"Experiment {self.label} does not agree with the others on shared parameters (p = {self.p_value:.1e}): "
            f"{self.parameter} would differ most, by {self.change_in_std:.1f} standard deviations. If it changed in "
            f"between, say so: experiments: {{{self.label}: {{own: [{self.parameter}]}}}}."
        )


def agreement(model: LoopModel, torque: Array, jacobian: Array, deviation: Array) -> Mapping[str, Agreement]:
    """Label of each experiment -> how it agrees with the others; empty where fewer than two are fitted.

    Args:
        torque: (N, n) simulated; jacobian: (N, n, p), both at the common minimum.
        deviation: (n,) noise of each joint.
    """
    rows = model.rows
    if len(rows) < 2:
        return {}
    # Residuals with a colour of their own hold fewer independent samples.
    residual = model.measured - torque
    weight = {label: np.sqrt(effective_fraction(residual[part])) / deviation for label, part in rows.items()}
    count = jacobian.shape[2]
    tables = {label: (jacobian[part] * weight[label][:, None]).reshape(-1, count) for label, part in rows.items()}
    scale = np.maximum(np.sqrt(sum((t**2).sum(axis=0) for t in tables.values())), TINY)
    grams = {label: (t / scale).T @ (t / scale) for label, t in tables.items()}
    inverse = np.linalg.pinv(np.asarray(sum(grams.values())), hermitian=True)
    shared = np.array([parameter.experiment is None for parameter in model.free_parameters])
    found = {}
    for label, part in rows.items():
        score = (tables[label] / scale).T @ (residual[part] * weight[label]).ravel()
        bracket = grams[label] - grams[label] @ inverse @ grams[label]
        found[label] = _judged(label, model.names, score * shared, bracket * np.outer(shared, shared), len(rows))
    return found


def _judged(label: str, names: tuple[str, ...], score: Array, bracket: Array, count: int) -> Agreement:
    values, vectors = np.linalg.eigh(bracket)
    kept = values > limits.RANK * max(float(values.max()), TINY)
    if not kept.any():
        return Agreement(label, 1.0, True, "", 0.0)
    along = vectors[:, kept].T @ score
    p_value = float(stats.chi2.sf(float(np.sum(along**2 / values[kept])), int(kept.sum())))
    change = vectors[:, kept] @ (along / values[kept])
    spread = np.sqrt(np.maximum(np.sum(vectors[:, kept] ** 2 / values[kept], axis=1), TINY))
    most = int(np.argmax(np.abs(change) / spread))
    agrees = p_value >= limits.SIGNIFICANCE / count
    return Agreement(label, p_value, agrees, names[most], float(abs(change[most]) / spread[most]))
