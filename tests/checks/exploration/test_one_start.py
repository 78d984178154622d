"""An answer from one start that is a wrong local minimum is never valid; a right one is not doubted for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fmu_didim import Result, identify
from fmu_didim.base.errors import IdentificationError
from fmu_didim.checks.exploration.one_start import lower_elsewhere, one_start_diagnostics
from fmu_didim.checks.identification import residual_tests
from fmu_didim.fit.exploration.minima import misfit, squares_of
from tests.estimators.search.waves import NOISE, wave_case

TOLD_APART = 4.0
"""[chi-square] By which the truth must fit better, so that an answer is wrong by these data: 5 % by chance."""
CODES = {"lower-minimum"}
"""Of the doubt that is about it."""


def reasons(result: Result) -> set[str]:
    return {reason.code for reason in result.document.reasons} & CODES


def test_a_wrong_minimum_is_doubted_and_told_what_fits_better() -> None:
    result = identify(wave_case(samples=26))
    assert abs(result.values["f"] - 1) > 0.2
    assert reasons(result) == CODES
    text = next(r.text for r in result.document.reasons if r.code == "lower-minimum")
    assert "fits better" in text
    assert result.verdict in ("doubtful", "not_settled")


def test_the_best_minimum_is_not_and_the_one_start_is_remarked() -> None:
    result = identify(wave_case(identify={"f": {"start": 1.02}}))
    assert reasons(result) == set()
    assert any("other minima were not looked for" in remark for remark in result.document.remarks)


def test_after_a_search_it_is_not_asked_again() -> None:
    result = identify(wave_case(search={"starts": 8}))
    assert reasons(result) == set()
    assert not any("other minima were not looked for" in remark for remark in result.document.remarks)


def test_without_bounds_it_looks_within_a_factor_of_two_and_keeps_one_sided_limits() -> None:
    case = wave_case(samples=26, identify={"f": {"start": 0.75, "minimum": 0.1}})
    found = lower_elsewhere(case.estimator.estimate(case.model))
    assert found is not None
    assert found[0][0] == pytest.approx(1.0, abs=0.12)
    assert found[1] > 30  # 26 ln 4: of misfits four times as large at least


def test_a_residual_as_small_as_its_stated_noise_needs_no_look() -> None:
    case = wave_case(identify={"f": {"start": 1.02}})
    estimate = case.estimator.estimate(replace(case.model, torque_deviation=np.array([2 * NOISE])))
    assert one_start_diagnostics(estimate, residual_tests(estimate)) == []


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.1, 1.0])
@pytest.mark.parametrize("samples", [26, 51, 501, 2001])
def test_no_start_and_no_draw_makes_a_wrong_minimum_valid(samples: int, noise: float) -> None:
    for seed in range(5):
        for start in (0.65, 0.75, 0.82, 0.88, 1.15, 1.25, 1.33):
            bounds = {"f": {"start": start, "minimum": 0.6, "maximum": 1.4}}
            try:
                result = identify(wave_case(seed, samples=samples, noise=noise, identify=bounds))
            except IdentificationError:
                continue
            case = wave_case(seed, samples=samples, noise=noise, identify=bounds)
            here, there = (
                misfit(case.model, squares_of(case.model, np.array([f])), np.array([f]))
                for f in (result.values["f"], 1.0)
            )
            if there < here - TOLD_APART:
                assert reasons(result), (seed, start)
