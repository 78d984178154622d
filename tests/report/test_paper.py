"""The charts of a page as files for a paper."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from fmu_didim import identify
from fmu_didim.report.paper import write_figures
from tests.report import test_discovery, test_report


@pytest.mark.slow
def test_identify_writes_each_chart_and_the_next_run_without_takes_them_away(tmp_path: Path) -> None:
    identify("examples/scara/identify.yaml", tmp_path, figures=True)
    names = {path.stem for path in tmp_path.glob("figure_*.svg")}
    assert {
        "figure_torque-1",
        "figure_torque-2",
        "figure_binned-1-2-velocity",
        "figure_spectrum-1",
        "figure_iterations",
    } <= names
    assert {path.stem for path in tmp_path.glob("figure_*.png")} == names
    for path in tmp_path.glob("figure_*.png"):
        assert path.read_bytes().startswith(b"\x89PNG")
    text = (tmp_path / "figure_torque-1.svg").read_text(encoding="utf-8")
    shown = re.findall(r"<text[^>]*>([^<]*)</text>", text)
    assert {"Joint 1, relative error 4.83 %", "time (s)", "measured", "simulated"} <= set(shown)
    identify("examples/scara/identify.yaml", tmp_path)
    assert not list(tmp_path.glob("figure_*"))


@pytest.mark.slow
def test_a_discovery_and_a_refusal_have_theirs(tmp_path: Path) -> None:
    folder = tmp_path / "discover"
    folder.mkdir()
    test_discovery.saved(folder, test_discovery.document(), count=300)
    assert folder / "figure_binned-1-1-velocity.png" in write_figures(folder)
    refused = test_report.saved(tmp_path / "refused", test_report.refused())
    assert [path.name for path in write_figures(refused)] == ["figure_iterations.png", "figure_iterations.svg"]
