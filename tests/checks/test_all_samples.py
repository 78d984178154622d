"""Whether the parts of a long log agree: how often by chance they do not, and what is told of one that does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmu_didim.checks.agreement import SIGNIFICANCE, parts_agree
from fmu_didim.data.signals import Array
from fmu_didim.fit.exploration.all_samples import BlockOfLog

NAMES = ("a", "b", "c")
BLOCKS, SAMPLES = 20, 200
TRUE = np.array([1.0, -2.0, 0.5])


def blocks(rng: np.random.Generator, changed: Array | None = None, colour: float = 0.0) -> list[BlockOfLog]:
    """The parts of a log whose noise has deviation one, at the least squares values of all of them.

    Args:
        changed: values in the seventh of them; colour: of a first-order autoregression, which the parts are told.
    """
    tables = rng.normal(size=(BLOCKS, SAMPLES, 3)) * [1.0, 3.0, 0.2]
    noise = rng.normal(size=(BLOCKS, SAMPLES))
    for k in range(1, SAMPLES):
        noise[:, k] = colour * noise[:, k - 1] + np.sqrt(1 - colour**2) * noise[:, k]
    values = np.tile(TRUE, (BLOCKS, 1))
    values[7] = TRUE if changed is None else changed
    measured = np.einsum("bnp,bp->bn", tables, values) + noise
    found = np.linalg.lstsq(tables.reshape(-1, 3), measured.ravel(), rcond=None)[0]
    omega = colour ** np.abs(np.subtract.outer(np.arange(SAMPLES), np.arange(SAMPLES))) if colour else np.eye(SAMPLES)
    return [
        BlockOfLog("run", 10.0 * i, 10.0 * (i + 1), s.T @ (y - s @ found), s.T @ s, s.T @ omega @ s, np.ones(1))
        for i, (s, y) in enumerate(zip(tables, measured, strict=True))
    ]


@pytest.mark.parametrize("colour", [0.0, 0.8])
def test_parts_that_agree_are_hardly_ever_said_not_to(colour: float) -> None:
    rng = np.random.default_rng(0)
    p = np.array([[result.p_value for result in parts_agree(NAMES, blocks(rng, colour=colour))] for _ in range(150)])
    assert (p < 0.05).mean() == pytest.approx(0.05, abs=0.015)
    assert (p.min(axis=1) < SIGNIFICANCE / BLOCKS).sum() <= 2


@pytest.mark.parametrize(("name", "size"), [("a", 0.5), ("b", 0.25), ("c", 2.5)])
def test_a_part_that_does_not_is_told(name: str, size: float) -> None:
    changed = TRUE + size * (np.array(NAMES) == name)
    results = parts_agree(NAMES, blocks(np.random.default_rng(1), changed))
    assert [i for i, result in enumerate(results) if not result.agrees] == [7]
    assert results[7].differs_most == name
    deviation = size / np.sqrt(1 / SAMPLES) * {"a": 1.0, "b": 3.0, "c": 0.2}[name]
    assert results[7].change_in_std == pytest.approx(deviation, rel=0.35)


def test_what_acts_in_one_part_alone_has_nothing_to_agree_with() -> None:
    parts = blocks(np.random.default_rng(1))
    start = [replace(p, score=np.append(p.score, 5.0 * (i == 0)), gram=_wider(p.gram, 4.0 * (i == 0)),
                     scatter=_wider(p.scatter, 4.0 * (i == 0))) for i, p in enumerate(parts)]  # fmt: skip
    assert all(result.agrees for result in parts_agree((*NAMES, "q1[run]"), start))


def _wider(table: Array, corner: float) -> Array:
    return np.pad(table, ((0, 1), (0, 1))) + np.diag([0.0, 0.0, 0.0, corner])


def test_one_part_has_nothing_to_agree_with() -> None:
    assert parts_agree(NAMES, blocks(np.random.default_rng(1))[:1]) == []
