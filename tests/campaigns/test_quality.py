"""Bias, sigma and coverage of groups, and what is told with them: tables with known answers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom

from fmu_didim.campaigns.reporting.page import write_campaign_report
from fmu_didim.campaigns.reporting.quality import by_parameter, proportion_interval
from fmu_didim.campaigns.reporting.results import Results
from fmu_didim.campaigns.running.store import Journal, Store
from tests.campaigns.helpers import plan_of


@pytest.mark.parametrize(("hits", "count"), [(0, 5), (5, 5), (19, 20), (96, 100), (1, 3)])
def test_interval_of_a_proportion(hits: int, count: int) -> None:
    """By its definition: at either end as few, or as many, hits have a probability of 2.5 %."""
    low, high = (float(end) for end in proportion_interval(hits / count, count))
    assert low == 0 if hits == 0 else binom.sf(hits - 1, count, low) == pytest.approx(0.025, rel=1e-6)
    assert high == 1 if hits == count else binom.cdf(hits, count, high) == pytest.approx(0.025, rel=1e-6)


def test_without_data_the_interval_is_everything() -> None:
    low, high = proportion_interval([0.5, np.nan], [0, 3])
    np.testing.assert_array_equal([low, high], [[0, 0], [1, 1]])


def parameters(**columns: Any) -> pd.DataFrame:
    return pd.DataFrame({"parameter": "p", "unit": "kg", **columns})


def test_a_group_by_hand() -> None:
    """Three usable answers at truth 2: errors -1, 0, 4, the last interval misses; a fourth run was refused."""
    runs = pd.DataFrame({"status": ["answered"] * 3 + ["refused", "open"]})
    table = parameters(
        id=["a", "b", "c"], data=["x", "y", "y"], verdict=["valid", "doubtful", "valid"], value=[1.0, 2.0, 6.0],
        std=[1.0, 1.0, 2.0], low=[-1.0, 0.0, 2.5], high=[3.0, 4.0, 9.0], true=[2.0, 2.0, 2.0],
    )  # fmt: skip
    row = by_parameter(runs, table, []).iloc[0]
    assert (row["used"], row["ran"], row["data"], row["true"]) == (3, 4, 2, 2)
    assert row["bias"] == pytest.approx(1.0)
    assert row["sigma"] == pytest.approx(np.std([-1, 0, 4], ddof=1))
    assert row["stated"] == pytest.approx(np.sqrt(2))
    assert row["coverage"] == pytest.approx(2 / 3)
    assert row["coverage_least"] == pytest.approx(2 / 4)


def test_values_of_another_truth_are_no_scatter() -> None:
    table = parameters(
        id=["a", "b"], data=["x", "y"], verdict="valid", value=[1.0, 5.0], std=1.0, low=0.0, high=9.0, true=[1.0, 5.0]
    )
    runs = pd.DataFrame({"status": ["answered"] * 2})
    assert by_parameter(runs, table, []).iloc[0]["sigma"] == 0
    measured = by_parameter(runs, table.assign(true=np.nan), []).iloc[0]
    assert measured["sigma"] == pytest.approx(np.std([1, 5], ddof=1))
    assert np.isnan(measured["coverage"]) and np.isnan(measured["bias"])


@pytest.mark.parametrize("verdict", ["not_settled", "refused"])
def test_what_may_not_be_used_does_not_count(verdict: str) -> None:
    table = parameters(id=["a"], data=["x"], verdict=verdict, value=1.0, std=1.0, low=0.0, high=2.0, true=1.0)
    assert by_parameter(pd.DataFrame({"status": ["answered"]}), table, []).empty


def results(
    folder: Path,
    verdicts: Sequence[str | None],
    *,
    names: Sequence[str] = ("p",),
    scatter: float = 0.0,
    conditions: Sequence[str] = (),
    **entries: Any,
) -> Results:
    """Results with these verdicts (None: crashed) in the order of the plan; answers are right within ``scatter``, and
    valid ones rest on ``conditions``."""
    plan = plan_of(**entries)
    store, journal = Store(folder), Journal(folder)
    store.begin(plan)
    random = np.random.default_rng(5)
    for run, verdict in zip(plan.runs, verdicts, strict=False):
        p = {"unit": "kg", "std": 1.0, "low": 0.0, "high": 2.0, "true": 1.0}
        found = [p | {"name": name, "value": 1.0 + scatter * random.normal()} for name in names]
        row = {"id": run.id, "attempt": 1, "started": "2026", "status": "crashed" if verdict is None else "answered"}
        row |= {"conditions": list(conditions)} if verdict == "valid" else {}
        journal.write({**row, "verdict": verdict, "parameters": found if verdict in ("valid", "doubtful") else None})
    journal.close()
    return Results(store)


def test_how_many_failed_stands_beside_the_coverage(tmp_path: Path) -> None:
    """Every interval holds, but a third of the runs gave none: a user must not read 100 %."""
    vary = {"train.torque.rate_hz": [10]}
    found = results(tmp_path, ["valid"] * 20 + ["doubtful"] * 4 + ["refused"] * 6 + [None] * 6, vary=vary, seeds=40)
    row = found.groups().iloc[0]
    assert (row["coverage"], row["coverage_least"]) == (1.0, 24 / 36)
    assert row[["valid", "doubtful", "refused", "failed", "open"]].tolist() == [20, 4, 6, 6, 4]
    text = found.summary()
    assert "12 of 36 runs gave no answer that may be used (6 refused, 6 crashed)" in text
    assert "0.667" in text
    assert "4 answers are doubtful" in text
    assert "4 of 40 runs have not run yet" in text
    assert "fewer than" not in text


CLAUSES = ("the data do not hide an offset below 0.3 %", "C = < 2 J/K is right")


def test_what_valid_answers_rest_on_is_told_wherever_they_are(tmp_path: Path) -> None:
    """Once in the remarks of terminal, notebook and page, of each run in its row, in the tables and in its groups."""
    vary = {"train.torque.rate_hz": [10, 20]}
    found = results(tmp_path, ["valid", "doubtful", "valid", None], vary=vary, seeds=2, conditions=CLAUSES)
    joined = "; ".join(CLAUSES)
    remark = f"2 of 2 valid answers rest on what their data do not show (conditions of each run), the first of them: " \
        f"provided that {joined}."  # fmt: skip
    text = " ".join(found.summary().split())
    assert remark in text and "conditional" in text
    assert found.groups()["conditional"].tolist() == [1, 1]
    assert found.to_frame()["conditions"].tolist() == [joined, "", joined, ""]
    assert f"conditions: {joined}" in found.describe(found.to_frame()["id"].iloc[0])
    write_campaign_report(found)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    escaped = joined.replace("<", "&lt;")
    assert page.count(escaped) == 3, "in the remark and in the row of each of two runs"
    assert "provided that</th>" in page and escaped in found._repr_html_()
    assert pd.read_csv(tmp_path / "runs.csv")["conditions"].fillna("").tolist() == [joined, "", joined, ""]


def test_nothing_is_told_where_valid_answers_rest_on_nothing(tmp_path: Path) -> None:
    found = results(tmp_path, ["valid", "doubtful"], seeds=2)
    write_campaign_report(found)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "provided that" not in page and "conditional" not in page + found.summary()


def test_few_and_shared_data_are_told(tmp_path: Path) -> None:
    """Twenty starts on one log are one trial."""
    starts = {f"start {k}": {"ZZ1R": 3.0 + 0.01 * k} for k in range(20)}
    found = results(tmp_path, ["valid"] * 20, vary={"estimator.start": starts})
    assert "20 runs are on 1 different data" in found.summary()
    assert "20 groups have fewer than 20 data" in found.summary()
    pooled = found.by_parameter("estimator.start")
    assert pooled["coverage_low"].tolist() == pytest.approx([0.025] * 20)
