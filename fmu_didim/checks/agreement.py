"""Whether experiments that were fitted together agree on the parameters that they share.

Each experiment in turn gets values of its own for all that it shares with the others. With the whitened sensitivity
S_e and residual r_e of experiment e at the common minimum, A_e = S_e' S_e and A the sum of all A_e, that would lower
the sum of squares to first order by

    gain_e = g' (A_e - A_e A^-1 A_e)^+ g,      g = S_e' r_e,

which by white noise of variance one is a chi-square of the rank of the bracket (the score test). Noise of another
size or colour moves the score of experiment e by J_e instead of A_e, and the bracket that g is judged by is

    J_e - A_e A^-1 J_e - J_e A^-1 A_e + A_e A^-1 J A^-1 A_e.

J_e comes from what experiment e would leave with values of its own: disagreement is not noise. Sources: C. R. Rao,
Proceedings of the Cambridge Philosophical Society 44 (1948); D. D. Boos, The American Statistician 46 (1992).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import Field

from fmu_didim.base.distributions import chi2_sf
from fmu_didim.base.documents import Saved
from fmu_didim.data.signals import Array
from fmu_didim.fit.confounding import shown_directions
from fmu_didim.fit.exploration.all_samples import BlockOfLog
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.fit_uncertainty import unfiltered_residual
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.statistics import noise_deviation
from fmu_didim.fit.uncertainty import stretches, uncertainty

SIGNIFICANCE = 0.001
"""[1] Probability, for all experiments together, with which experiments that agree are said to disagree."""
RANK = 1e-9
"""[1] Of the largest eigenvalue of what an experiment tells, below which it does not show a direction."""
SCATTERS = 1e-6
"""[1] Of the largest scatter of a score by noise, below which that of a direction is an error of the computation: what
an experiment leaves with values of its own was found for directions that it shows."""


class AgreementResult(Saved):
    """Whether an experiment agrees with the others on shared parameters.

    Attributes:
        agrees: whether the p-value is above the level of the test.
    """

    p_value: float = Field(description="of as much disagreement by noise alone")
    agrees: bool
    differs_most: str = Field(description="shared parameter that would change most if the experiment had its own")
    change_in_std: float = Field(description="by how many standard deviations")

    def warning(self, label: str) -> str:
        """The warning about an experiment of this label that does not agree."""
        return (
            f"Experiment {label} does not agree with the others on shared parameters (p = {self.p_value:.1e}): "
            f"{self.differs_most} would differ most, by {self.change_in_std:.1f} standard deviations. If it changed in "
            f"between, say so: experiments: {{{label}: {{own: [{self.differs_most}]}}}}."
        )


def agreement(fit: Fit) -> Mapping[str, AgreementResult]:
    """Label of each experiment -> how it agrees with the others at their common minimum; empty if fewer than two are
    fitted."""
    rows = fit.model.experiments.rows
    if len(rows) < 2:
        return {}
    count = fit.jacobian.shape[2]
    table, residual = fit.jacobian / fit.deviation[:, None], fit.residual / fit.deviation
    table = table / np.maximum(np.linalg.norm(table.reshape(-1, count), axis=0), TINY)
    logs = unfiltered_residual(fit) / fit.deviation
    # The pull of a prior, of further signals or of a limit is no disagreement: judged is where these alone are least.
    left, right = shown_directions(table.reshape(-1, count))
    pulled = table @ (right @ (left.T @ residual.ravel()))
    residual, logs = residual - pulled, logs - pulled
    grams = {label: np.einsum("mjp,mjq->pq", table[part], table[part]) for label, part in rows.items()}
    inverse = np.linalg.pinv(np.asarray(sum(grams.values())), hermitian=True)
    moved = {label: _moved(fit, label, table[part], residual[part], logs[part]) for label, part in rows.items()}
    every = inverse @ np.asarray(sum(moved.values())) @ inverse
    shared = np.array([parameter.experiment is None for parameter in fit.model.free_parameters])
    both, found = np.outer(shared, shared), {}
    for label, part in rows.items():
        score = np.einsum("mjp,mj->p", table[part], residual[part])
        gram, own = grams[label], grams[label] @ inverse @ moved[label]
        slope, spread = gram - gram @ inverse @ gram, moved[label] - own - own.T + gram @ every @ gram
        shown = _largest(gram)
        found[label] = _judged(fit.model.names, score * shared, slope * both, spread * both, shown, len(rows))
    return found


def parts_agree(names: tuple[str, ...], parts: Sequence[BlockOfLog]) -> list[AgreementResult]:
    """How each part of logs agrees with all others on the parameters of these names (p,), at their common minimum; none
    of fewer than two.

    The same test, where what it needs has been summed over each part. What acts in one part alone, as a start does, has
    nothing to agree with.
    """
    if len(parts) < 2:
        return []
    inverse = np.linalg.pinv(np.asarray(sum(p.gram for p in parts)), hermitian=True)
    # The pull of a limit is no disagreement.
    pulled = inverse @ np.asarray(sum(p.score for p in parts))
    every = inverse @ np.asarray(sum(p.scatter for p in parts)) @ inverse
    found = []
    for part in parts:
        gram, own = part.gram, part.gram @ inverse @ part.scatter
        slope, spread = gram - gram @ inverse @ gram, part.scatter - own - own.T + gram @ every @ gram
        found.append(_judged(names, part.score - gram @ pulled, slope, spread, _largest(gram), len(parts)))
    return found


def _moved(fit: Fit, label: str, table: Array, residual: Array, log: Array) -> Array:
    """(p, p) covariance of the score of an experiment, by its residual with values of its own.

    Args:
        table: (N, n, p) sensitivity; residual: (N, n); log: (N, n) the same without a filter.
    """
    left, sizes, right = np.linalg.svd(table.reshape(-1, table.shape[2]), full_matrices=False)
    kept = sizes > np.sqrt(RANK * SCATTERS) * sizes.max()  # more than is judged
    sensitivity = (left[:, kept] * sizes[kept]).reshape(*residual.shape, -1)
    influence = (left[:, kept] / sizes[kept]).reshape(sensitivity.shape)
    own = log - sensitivity @ np.einsum("mjp,mj->p", influence, residual)
    influence = fit.model.experiments.filtered(influence, label)
    leverage = np.einsum("mjp,mjp->mj", sensitivity, influence)
    deviation = noise_deviation(own, leverage, floor=np.full(own.shape[1], TINY))
    found = uncertainty(own, sensitivity, influence, deviation, stretches([fit.model.experiments[label].time]))
    back = right[kept].T * sizes[kept] ** 2
    return np.asarray(back @ found.covariance @ back.T)


def _largest(gram: Array) -> float:
    return float(np.linalg.eigvalsh(gram).max())


def _judged(
    names: tuple[str, ...], score: Array, slope: Array, covariance: Array, shown: float, count: int
) -> AgreementResult:
    """From the score (p,) of an experiment, its slope (p, p) and its covariance by noise alone.

    Args:
        shown: largest eigenvalue of what the experiment tells; count: of experiments.
    """
    values, vectors = np.linalg.eigh(slope)
    kept = values > RANK * max(shown, TINY)
    root = vectors[:, kept] / np.sqrt(values[kept])
    scatter, turned = np.linalg.eigh(root.T @ covariance @ root)
    if not kept.any() or scatter.max() <= 0:
        return AgreementResult(p_value=1.0, agrees=True, differs_most="", change_in_std=0.0)
    sound = scatter > SCATTERS * scatter.max()
    root, scatter = root @ turned[:, sound], scatter[sound]
    along = root.T @ score
    p_value = float(chi2_sf(float(along @ (along / scatter)), int(sound.sum())))
    # What the experiment does not show changes by rounding alone.
    change = np.where(np.diag(slope) > RANK * shown, np.abs(root @ along), 0.0)
    deviations = change / np.sqrt(np.maximum((root**2) @ scatter, TINY))
    most = int(np.argmax(deviations))
    return AgreementResult(
        p_value=p_value, agrees=p_value >= SIGNIFICANCE / count, differs_most=names[most],
        change_in_std=float(deviations[most]),
    )  # fmt: skip
