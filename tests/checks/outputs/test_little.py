"""A little of a long residual that follows something: whether it matters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmu_didim import identify
from fmu_didim.checks.judgement import MATTERS
from fmu_didim.checks.outputs.following import LEAST, matters
from tests.room import room_case, write_room

LONG = 20_000
"""[samples] In which a fifth of a per cent of the squared residual is six standard deviations."""


@pytest.mark.parametrize(
    ("shares", "moved", "doubted"),
    [
        ([1.1 * LEAST], 0.0, True),
        ([0.9 * LEAST], 0.9 * MATTERS, False),
        ([0.9 * LEAST], 1.1 * MATTERS, True),
        ([0.1 * LEAST, 1.1 * LEAST], 0.0, True),
        ([0.0], 0.0, False),
    ],
)
def test_what_follows_something_is_doubted_by_its_share_or_by_what_it_moves(
    shares: list[float], moved: float, doubted: bool
) -> None:
    assert matters(shares, moved) is doubted


@pytest.mark.gate
@pytest.mark.parametrize("wrong", [{"offset": 0.015}, {"drift": 0.02}, {"third": (20.0, 15.0)}])
def test_a_little_that_moves_a_value_is_doubted_in_a_long_record(tmp_path: Path, wrong: dict[str, float]) -> None:
    """Noise of 0.1 K and an offset of 0.015 K: they were valid, at up to seven standard deviations of the offset."""
    write_room(tmp_path, seed=7002, count=LONG, **wrong)  # type: ignore[arg-type]
    assert [r.code for r in identify(room_case(tmp_path)).reasons] == ["residual-follows"]


@pytest.mark.gate
@pytest.mark.parametrize("step", [pytest.param(0.05, marks=pytest.mark.slow), 0.2])
def test_the_rounding_of_a_file_is_no_doubt(tmp_path: Path, step: float) -> None:
    """Noise of 0.1 K in steps of half and of twice that."""
    for seed in range(3):
        write_room(tmp_path, seed=7100 + seed, count=LONG)
        table = np.loadtxt(tmp_path / "room.csv", delimiter=",", skiprows=1)
        table[:, 1] = np.round(table[:, 1] / step) * step
        np.savetxt(tmp_path / "room.csv", table, delimiter=",", header="t,T", comments="", fmt="%.9f")
        assert identify(room_case(tmp_path)).verdict == "valid"
