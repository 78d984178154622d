"""Figures of a campaign and its view in a notebook: what the tables say is drawn, what is missing is told."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.campaigns.reporting.charts import field_chart, page_figures
from fmu_didim.campaigns.reporting.page import write_campaign_report
from fmu_didim.cli.main import main
from tests.campaigns.test_quality import results

NAN = float("nan")


def quality(**columns: Any) -> pd.DataFrame:
    """Two parameters at two values of a field, the larger value first."""
    base = {
        "parameter": ["a", "b", "a", "b"], "rate": [20, 20, 5, 5], "value": 5.0, "true": 4.0, "sigma": 0.2,
        "bias": -0.4, "bias_in_sigma": -2.0,
    }  # fmt: skip
    return pd.DataFrame(base | columns)


def test_sigma_and_bias_over_numbers_in_percent_of_the_true_value() -> None:
    chart = field_chart(quality(sigma=[0.2, 0.4, 0.8, 1.2]), "rate")
    assert chart.log and not chart.ticks
    sigma, bias = chart.panels
    (a, b), _ = sigma.series, bias.series
    np.testing.assert_allclose([a.x, a.y, b.y], [[5, 20], [20, 5], [30, 10]])
    np.testing.assert_allclose([line.y for line in bias.series], 10.0)
    assert {line.kind for line in (*sigma.series, *bias.series)} == {"line"}


def test_values_that_are_names_are_places_with_these_names() -> None:
    names = ["pd.yaml", "pd.yaml", "pid.yaml", "pid.yaml"]
    chart = field_chart(quality(rate=names), "rate")
    assert chart.ticks == [(0.0, "pd.yaml"), (1.0, "pid.yaml")]
    assert not chart.log
    assert {series.kind for panel in chart.panels for series in panel.series} == {"points"}
    ((_, none, shown),) = page_figures({"rate": quality(rate=names)})
    assert none is None and shown is not None and shown.rows[0][1][0].text == "-2.0"


def test_what_is_not_known_is_not_drawn_as_nothing() -> None:
    """Measured data have no bias, and a single answer has no scatter: an empty diagram would look like zero."""
    measured = quality(true=NAN, bias=NAN, bias_in_sigma=NAN)
    (panel,) = field_chart(measured, "rate").panels
    assert panel.head.startswith("Standard deviation")
    np.testing.assert_allclose(panel.series[0].y, 4.0)  # of the mean value
    assert "bias" not in field_chart(measured, "rate").title
    with pytest.raises(InputError, match="neither scatter nor bias"):
        field_chart(measured.assign(sigma=NAN), "rate")
    assert page_figures({"rate": measured.assign(sigma=NAN)}) == []


def test_results_show_themselves_in_a_notebook(tmp_path: Path) -> None:
    found = results(tmp_path, ["valid"] * 30 + [None] * 10, vary={"train.torque.rate_hz": [10, 20]}, seeds=20)
    text = found._repr_html_()
    assert "COMPLETE, WITH FAILURES" in text
    assert "10 of 40 runs gave no answer that may be used" in text
    assert "train.torque.rate_hz" in text and "coverage (95 % interval)" in text
    assert "<script" not in text and "http" not in text
    figure = found.plot()
    assert figure.axes[-1].get_xlabel() == "train.torque.rate_hz"
    with pytest.raises(UnknownNameError):
        found.plot("train.torque.rate")


def test_seeds_alone_are_no_axis(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="only the seeds vary"):
        results(tmp_path, ["valid"] * 3, seeds=3).plot()


def test_the_page_leaves_out_what_is_zero_everywhere(tmp_path: Path) -> None:
    """Such columns would push the coverage out of sight; one refusal in one group brings its column back."""

    def heads(out: Path, verdicts: list[str | None]) -> list[str]:
        write_campaign_report(results(out, verdicts, vary={"train.torque.rate_hz": [10, 20]}, seeds=2))
        return re.findall(r"<th[^>]*>([^<]*)</th>", (out / "report.html").read_text(encoding="utf-8"))

    found = heads(tmp_path / "all", ["valid"] * 4)
    assert {"runs", "valid", "coverage (95 % interval)"} <= set(found)
    assert not {"data", "doubtful", "not settled", "refused", "failed", "open"} & set(found)
    found = heads(tmp_path / "some", ["valid", "refused", "valid", None])
    assert {"refused", "failed"} <= set(found) and "open" not in found


def test_status_for_scripts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results(tmp_path, ["valid"] * 3 + [None], seeds=6)
    assert main(["campaign", "status", str(tmp_path), "--json"]) == 3
    found = json.loads(capsys.readouterr().out)
    assert (found["planned"], found["open"], found["verdicts"]["valid"], found["failures"]["crashed"]) == (6, 2, 3, 1)
