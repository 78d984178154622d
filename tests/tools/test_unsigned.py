"""The tool that counts the intervals of logs without signs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.tools.unsigned import TIMES, logs, pair, share, texts


def test_coverage_and_its_deviation_come_from_the_shares_of_runs() -> None:
    """Three runs of which 4/4, 3/4 and 2/4 intervals hold."""
    found = share([[True] * 4, [True] * 3 + [False], [True] * 2 + [False] * 2])
    np.testing.assert_allclose(found, (75.0, 25 / np.sqrt(3)))


def test_sizes_are_those_of_the_log_with_signs() -> None:
    sizes, signed = logs(7), logs(7, signed=True)
    for label, log in sizes.items():
        np.testing.assert_array_equal(log.column("tau1"), np.abs(signed[label].column("tau1")))
        assert (signed[label].column("tau1") < 0).any() and log.time[1] - log.time[0] == pytest.approx(0.05)


def test_a_run_that_is_refused_counts_as_one_that_does_not_converge() -> None:
    ended = {"converged": True, "verdict": "valid", "errors": [0.5, -2.5], "names": ["ZZ1R", "MY2"]}
    refused = {"converged": False, "verdict": "refused", "errors": [], "inside": []}
    rows: list[dict[str, Any]] = [
        {"seed": seed, "times": times, "signed": signed, **(refused if seed == 2 else ended)}
        | ({"inside": [True, seed == 1]} if seed != 2 else {})
        for times in TIMES for signed in (False, True) for seed in (1, 2, 3)
    ]  # fmt: skip
    found = texts(rows, [pair("1-3")])
    assert found["unsigned_1.converged"] == "2 of 3" and found["unsigned_1"] == "75.0 ± 25.0 %"
    assert "50 % (MY2)" in found["table"][2]
