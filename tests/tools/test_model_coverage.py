"""Right models, calibrated again and again: their intervals hold, and replicates of one model agree."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from fmu_didim import identify
from tests.tools.model_coverage import MODELS, batch, draw, main, row


def test_a_row_counts_what_held_and_what_was_valid() -> None:
    draws = [draw("clutch", seed) for seed in range(2)]
    name, held, scatter, valid = row("clutch", draws)
    assert name == "clutch"
    assert float(held.split()[0]) == 25 * sum(sum(one.holds) for one in draws)
    errors = np.array([one.errors for one in draws])
    assert float(scatter) == pytest.approx(np.sqrt(np.mean(errors**2)), abs=0.005)
    assert valid == f"{sum(one.verdict == 'valid' for one in draws)} of 2"


@pytest.mark.gate
def test_the_tool_writes_its_table(tmp_path: Path) -> None:
    file = tmp_path / "models.json"
    main(["--seeds", "2", "--only", "clutch", "--figures", str(file)])
    figures = json.loads(file.read_text(encoding="utf-8"))["figures"]
    assert figures["table"][2].startswith("| clutch |")
    assert figures["seeds"] == "2"


@pytest.mark.gate
def test_replicates_agree_although_another_output_pulls_at_what_they_share() -> None:
    """The growth shows in X and in S: the best values of X alone are elsewhere, which is no disagreement."""
    told = []
    for seed in range(12):
        found = identify(batch(np.random.default_rng([5, seed])))
        told += [reason.code for reason in found.document.reasons]
    assert "experiments-disagree" not in told
    other = identify(batch(np.random.default_rng([5, 0]), mu_max=(0.45, 0.48)))
    assert "experiments-disagree" in [reason.code for reason in other.document.reasons]


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_intervals_of_models_hold_as_often_as_they_say(name: str) -> None:
    """95 % of 100 draws, and right models are valid."""
    draws = [draw(name, seed) for seed in range(100)]
    holds = np.array([one.holds for one in draws])
    assert 92 <= round(100 * holds.mean()) <= 97
    assert (holds.mean(axis=0) > 0.88).all()  # 95 +- 2.2
    assert sum(one.verdict == "valid" for one in draws) >= 95
