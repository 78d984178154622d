"""How often logs of a simulated machine, whose friction varies from day to day, are wrongly called changed; and whether
causes and first logs of changes are right."""

from __future__ import annotations

from collections import Counter
from datetime import datetime, timedelta
from typing import Any

import numpy as np
import pytest

from fmu_didim.discovery.change.answers import Answer
from fmu_didim.discovery.change.watched import Entry, watched
from fmu_didim.results.watch import WatchDocument
from tests.discovery.change.pairs import answer, identified, log_of
from tests.discovery.change.test_rates import FRICTION, KINDS

REFERENCE, STILL, CHANGED_LOGS = 10, 40, 3
SPREAD = 0.03
"""[1] Standard deviation of the Coulomb friction of each joint from day to day, of its value."""
UNCHANGED = 3
"""[logs] Between the reference and a change."""


def of_day(seed: int, rate_hz: float, drawn: dict[str, Any]) -> Answer:
    """A log of a day."""
    rng = np.random.default_rng(90_000 + seed)
    values = dict(FRICTION) | dict(drawn.get("values", {}))
    for name in ("Fc1", "Fc2"):
        values[name] *= 1 + SPREAD * rng.normal()
    return answer(f"log{seed}", identified(log_of(rate_hz, seed, **{**drawn, "values": values})))


def history(answers: list[Answer]) -> WatchDocument:
    first = datetime(2024, 1, 1)
    return watched("arm", [
        Entry(f"log{k}", first + timedelta(days=k), str(k), k < REFERENCE, True, one) for k, one in enumerate(answers)
    ], order="date")  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [20.0, 100.0])
def test_false_alarms_causes_and_onsets_of_a_simulated_machine(rate_hz: float) -> None:
    still = [of_day(k, rate_hz, {}) for k in range(REFERENCE + STILL)]
    assert [log.state for log in history(still).logs[REFERENCE:]] == ["unchanged"] * STILL
    counts = Counter[str]()
    for k, kind in enumerate(KINDS):
        rng = np.random.default_rng(8000 + k)
        drawn, truth = KINDS[kind](rng)
        later = [of_day(1000 + 10 * k + i, rate_hz, drawn) for i in range(CHANGED_LOGS)]
        before = still[REFERENCE + UNCHANGED * k : REFERENCE + UNCHANGED * (k + 1)]
        found = history([*still[:REFERENCE], *before, *later])
        place = REFERENCE + UNCHANGED
        counts["logs"] += len(later)
        counts["seen"] += sum(log.state == "changed" for log in found.logs[place:])
        counts["false"] += sum(log.state == "changed" for log in found.logs[:place])
        counts["right"] += sum(log.causes[:1] == [" and ".join(sorted(truth))] or
                               (bool(log.causes) and set(log.causes[0].split(" and ")) == truth)
                               for log in found.logs[place:])  # fmt: skip
        onset = found.onset
        print(kind, truth, [(log.state, f"{log.p_value:.1e}", log.causes) for log in found.logs[place:]],
              None if onset is None else (onset.kind, onset.log, onset.rivals))  # fmt: skip
        counts["histories"] += onset is not None
        counts["onset"] += onset is not None and abs(int(onset.log[3:]) - place) <= 1
    print(dict(counts))
    assert counts["false"] == 0
    assert counts["onset"] == counts["histories"]
    assert counts["seen"] >= 0.9 * counts["logs"]
    assert counts["right"] >= 0.9 * counts["seen"]
