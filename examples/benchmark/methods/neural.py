"""A small neural residual: it can say that something is missing, and not what.

For each joint one hidden layer of tanh on position, velocity, acceleration and sign of the velocity of all joints,
trained on the residual of the training log. It says *unknown* where it makes the residual of the held-out log of a
joint smaller for certain.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from examples.benchmark.answer import Answer
from examples.benchmark.base import Base
from fmu_didim.data.signals import Array
from fmu_didim.model.motion import Motion

UNITS = 16
"""[units] Of the hidden layer."""
DECAYS = (0.01, 0.1, 1.0)
"""[1] Tried for the weight of the squared weights beside the mean square error of a target of RMS 1."""
FOLDS = 4
"""[parts] Of the period, each left out once to choose the decay: a part of the log would be seen in the next period."""
STEPS = 300
"""[steps] Of L-BFGS."""
SEED = 0
BLOCK_S, DRAWS = 0.5, 2000
"""[s], [draws] Of the block bootstrap: held-out blocks that are longer than what the noise remembers."""
ONE_SIDED = 2.5
"""[%] Chance that one of the joints is helped where nothing is there."""


def answer(case: Path) -> Answer:
    """*unknown* or *nothing*."""
    base = Base.of(case)
    n, scale = base.motion.joint_count, 1 / base.weight
    mean, width = (f(features(base.motion), axis=0) for f in (np.mean, np.std))
    inputs, held_out = ((features(m) - mean) / width for m in (base.motion, base.held_out))
    folds = (FOLDS * (base.motion.time / base.period_s % 1)).astype(int)
    for joint in range(n):
        target, later = (r[:, joint] / scale[joint] for r in (base.fit.residual, base.held_out_residual))
        decay = min(DECAYS, key=lambda d, y=target: _left_out(inputs, y, folds, d))
        after = later - trained(inputs, target, decay)(held_out)
        if helps(later**2, after**2, base.held_out.step, ONE_SIDED / n):
            return Answer("unknown")
    return Answer("nothing")


def _left_out(inputs: Array, target: Array, folds: Array, decay: float) -> float:
    """Mean square error in the folds that were left out."""
    parts = [(folds != k, folds == k) for k in range(FOLDS)]
    errors = [target[out] - trained(inputs[kept], target[kept], decay)(inputs[out]) for kept, out in parts]
    return float(np.mean(np.concatenate(errors) ** 2))


def features(motion: Motion) -> Array:
    """(N, 4 n)."""
    return np.column_stack([motion.q, motion.dq, motion.ddq, np.sign(motion.dq)])


def trained(inputs: Array, target: Array, decay: float) -> Callable[[Array], Array]:
    """Function of inputs (N, m) -> (N,), fitted to a target of RMS 1."""
    m, rows = inputs.shape[1], len(target)
    parts = np.cumsum([m * UNITS, UNITS, UNITS])

    def split(w: Array) -> tuple[Array, Array, Array, float]:
        a, b, c, d = np.split(w, parts)
        return a.reshape(m, UNITS), b, c, float(d[0])

    def cost(w: Array) -> tuple[float, Array]:
        a, b, c, d = split(w)
        hidden = np.tanh(inputs @ a + b)
        error = hidden @ c + d - target
        back = error[:, None] * c * (1 - hidden**2)
        slope = np.concatenate([(inputs.T @ back).ravel(), back.sum(0), hidden.T @ error, [error.sum()]])
        return float(np.mean(error**2) + decay * (w @ w) / len(w)), 2 * slope / rows + 2 * decay * w / len(w)

    start = np.random.default_rng(SEED).normal(scale=0.3, size=parts[-1] + 1)
    a, b, c, d = split(minimize(cost, start, jac=True, method="L-BFGS-B", options={"maxiter": STEPS}).x)
    return lambda x: np.tanh(x @ a + b) @ c + d


def helps(before: Array, after: Array, step: float, chance: float) -> bool:
    """Whether the sum of squares after is less than before, but for this chance in %, by a bootstrap of blocks."""
    blocks = np.array_split(np.arange(len(before)), max(2, round(len(before) * step / BLOCK_S)))
    sums = np.array([[before[rows].sum(), after[rows].sum()] for rows in blocks])
    drawn = sums[np.random.default_rng(SEED).integers(len(sums), size=(DRAWS, len(sums)))].sum(axis=1)
    return bool(np.percentile(drawn[:, 1] / drawn[:, 0], 100 - chance) < 1)
