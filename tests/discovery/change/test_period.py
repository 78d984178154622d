"""How often a log of an unchanged machine is called changed, and that a changed one is seen."""

from __future__ import annotations

import numpy as np
import pytest

from fmu_didim import InputError
from fmu_didim.data.signals import Array
from fmu_didim.discovery.change.difference import CHANGED
from fmu_didim.discovery.change.period import LogValues, Period

NAMES = tuple("abcdefgh")


def noise(rng: np.random.Generator, count: int = len(NAMES)) -> Array:
    """A covariance of correlated values of other units."""
    table = rng.normal(size=(count, count))
    size = np.geomspace(1e-3, 10, count)
    return np.asarray((table @ table.T / count + 0.1 * np.eye(count)) * np.outer(size, size))


def drawn(rng: np.random.Generator, covariance: Array, between: Array, *, shift: float | Array = 0.0) -> LogValues:
    own = np.linalg.cholesky(covariance) @ rng.normal(size=len(covariance))
    return LogValues(own + between * rng.normal(size=between.size) + shift, covariance, np.inf)


def alarms(logs: int, ratio: float, *, alone: bool, references: int = 40, each: int = 50, seed: int = 3) -> int:
    """How many of references times each logs of an unchanged machine are called changed, with a spread between logs
    that is a multiple of the noise, of one value or of all."""
    rng, count = np.random.default_rng(seed), 0
    covariance = noise(rng)
    between = ratio * np.sqrt(np.diag(covariance)) * (np.arange(len(NAMES)) == 2 if alone else 1.0)
    for _ in range(references):
        period = Period(NAMES, [drawn(rng, covariance, between) for _ in range(logs)])
        count += sum(period.distance(drawn(rng, covariance, between)).p_value < CHANGED for _ in range(each))
    return count


@pytest.mark.parametrize(
    "logs", [pytest.param(6, marks=pytest.mark.gate), pytest.param(20, marks=pytest.mark.gate), 10]
)
@pytest.mark.parametrize(("ratio", "alone"), [(0.0, True), (1.0, False), (5.0, True), (20.0, False)])
def test_an_unchanged_machine_is_called_changed_once_in_a_thousand(logs: int, ratio: float, *, alone: bool) -> None:
    # of 1 000 logs 1 is expected at most; logs that share a reference are not independent, so that 6 may be
    assert alarms(logs, ratio, alone=alone, references=20) <= 6


@pytest.mark.slow
@pytest.mark.parametrize("logs", [4, 5, 6, 8, 10, 20])
def test_the_rate_holds_for_any_spread(logs: int) -> None:
    total = 0
    for ratio in (0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 100.0):
        for alone in (True, False):
            count = alarms(logs, ratio, alone=alone, references=1000, each=20, seed=int(10 * ratio) + logs)
            assert count <= 3 * CHANGED * 20_000
            total += count
    assert total <= 1.2 * CHANGED * 14 * 20_000


def test_what_varies_is_allowed_and_what_does_not_is_seen() -> None:
    rng = np.random.default_rng(0)
    covariance = np.diag(np.full(3, 1.0))
    between = np.array([10.0, 0.0, 0.0])
    period = Period(("a", "b", "c"), [drawn(rng, covariance, between) for _ in range(12)])
    assert period.between[0] == pytest.approx(10, rel=0.5)
    assert (period.between[1:] < 2).all()
    far = np.array([15.0, 0.0, 0.0])
    mean, _ = period.mean
    assert period.distance(LogValues(mean + far, covariance, np.inf)).p_value > CHANGED
    assert period.distance(LogValues(mean + far[[1, 0, 2]], covariance, np.inf)).p_value < CHANGED
    seen = period.least_seen(LogValues(mean, covariance, np.inf), CHANGED)
    for k in range(3):
        step = np.eye(3)[k] * seen[k]
        assert period.distance(LogValues(mean + 1.2 * step, covariance, np.inf)).p_value < CHANGED
        assert period.distance(LogValues(mean + 0.5 * step, covariance, np.inf)).p_value > CHANGED


def test_a_combination_that_is_known_well_is_seen_though_no_value_is() -> None:
    covariance = np.array([[1.0, 0.999], [0.999, 1.0]])
    rng = np.random.default_rng(1)
    period = Period(("a", "b"), [drawn(rng, covariance, np.zeros(2)) for _ in range(20)])
    mean, _ = period.mean
    found = period.distance(LogValues(mean + np.array([0.6, -0.6]), covariance, np.inf))
    assert found.p_value < CHANGED
    assert (found.of_each > 0.1).all()


def test_a_few_logs_see_less_and_three_know_no_spread() -> None:
    covariance, zero = np.eye(2), np.zeros(2)
    sizes = {}
    for count in (3, 4, 6, 10, 30):
        rng = np.random.default_rng(5)
        period = Period(("a", "b"), [drawn(rng, covariance, zero) for _ in range(count)])
        assert period.knows_spread == (count > 3)
        sizes[count] = float(np.mean(period.least_seen(LogValues(zero, covariance, np.inf), CHANGED)))
    assert sizes[4] > 2 * sizes[6] > 2 * sizes[10] > sizes[30] > 3
    assert sizes[3] < 6  # by their noise alone


def test_logs_of_other_noise_count_by_what_they_are_worth() -> None:
    rng = np.random.default_rng(2)
    fine, coarse = np.eye(1), 100.0 * np.eye(1)
    logs = [*(drawn(rng, fine, np.zeros(1)) for _ in range(8)), drawn(rng, coarse, np.zeros(1), shift=5.0)]
    period = Period(("a",), logs)
    mean, covariance = period.mean
    assert abs(mean[0]) < 1
    assert covariance[0, 0] < 1
    assert period.noise_alone > 0.001
    near = mean[0] + 12
    assert period.distance(LogValues(np.array([near]), fine, np.inf)).p_value < CHANGED
    assert period.distance(LogValues(np.array([near]), coarse, np.inf)).p_value > CHANGED


def test_a_covariance_that_is_none_is_refused() -> None:
    log = LogValues(np.zeros(2), np.array([[1.0, 1.0], [1.0, 1.0]]), np.inf)
    with pytest.raises(InputError, match="do not tell how far"):
        Period(("a", "b"), [log] * 5).distance(log)
