"""The trials of FMUs of others: what counts as an edit, what the user writes, and one trial with an FMU of our own."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.awkward.build import by
from tests.tools.benchmarks.calibration import fmu
from tests.tools.calibrated import __main__ as command
from tests.tools.calibrated.outcome import counted, edited
from tests.tools.calibrated.trials import COVERED, TRIALS, Trial

HOUSE = Trial(
    "house", "owner/name", "house.fmu", "fmu_didim", {"T": 0.1}, np.linspace(0.0, 4e5, 201), {"R1": 0.02, "R2": 0.01},
    inputs={"T_out": (5.0, 86400.0), "T_beside": (1.0, 40000.0)}, level=12.0,
)  # fmt: skip
MADE = """# Made by fmu-didim init.
schema: 1
model: house.fmu
measured: room.csv
identify:  # a guess
  R1: {}  # 0.05
  # R2: {}  # 0.05
  # T.start: {}  # where it starts
"""


@pytest.mark.parametrize(
    ("text", "lines", "edits"),
    [
        (MADE, 5, 0),
        (MADE.replace("  # R2", "  R2"), 6, 1),
        (MADE.replace("room.csv", "{file: room.csv, columns: {T: {std: 0.1}}}"), 5, 1),
        (MADE.replace("  R1: {}  # 0.05\n", ""), 4, 1),
        (MADE.replace("# a guess", "# what is sought") + "# nothing\n", 5, 0),
    ],
)
def test_lines_and_edits_count_without_comments(text: str, lines: int, edits: int) -> None:
    assert counted(MADE, text) == (lines, edits)


def test_the_user_states_the_noise_and_what_is_sought() -> None:
    text = edited(MADE, HOUSE)
    case = yaml.safe_load(text)
    assert case["measured"] == {"file": "room.csv", "columns": {"T": {"std": 0.1}}}
    assert case["identify"] == {"R1": {}, "R2": {}}
    assert counted(MADE, text) == (6, 2)


def test_trials_have_names_of_their_own() -> None:
    names = [trial.name for trial in TRIALS]
    assert len(set(names)) == len(names) and set(COVERED) <= set(names)


@pytest.mark.slow
def test_a_trial_ends_at_the_optimum(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the command line and by scipy, whose simulation of an FMU is another one; and the row of the page."""
    folder = tmp_path / "checkouts" / "owner" / "name"
    folder.mkdir(parents=True)
    shutil.copy(by("Vendor 1.0", fmu("house")), folder / "house.fmu")
    monkeypatch.setattr(command, "TRIALS", (HOUSE,))
    monkeypatch.setattr(command, "COVERED", ("house",))
    file = tmp_path / "calibrated.json"
    given = [str(tmp_path / "checkouts"), "--only", "house", "--draws", "2", "--discover", "--figures", str(file)]
    assert command.main(given) == 0
    told = [line.rpartition(": ") for line in capsys.readouterr().out.splitlines() if "processor" in line]
    assert [line[0] for line in told] == ["house | identify", "house | discover"]
    assert all(float(seconds.split()[0]) > 1 for *_, line in told for seconds in line.split(", "))
    figures = json.loads(file.read_text(encoding="utf-8"))["figures"]
    assert str(tmp_path) not in json.dumps(figures["trials"]) and len(figures["coverage"]) == 3
    _, _, sought, lines, verdict, apart, ratio, _ = (
        part.strip() for part in figures["trials"][-1].strip("| ").split("|")
    )
    assert (sought, lines, verdict) == ("R1, R2", "8 (3)", "valid")
    assert float(apart.split()[0]) < 1e-3
    assert [float(part) for part in ratio.split("–")] == pytest.approx([1, 1], abs=2e-3)


def test_a_repository_that_is_not_there_is_said_and_no_page_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "calibrated.json"
    assert command.main([str(tmp_path), "--only", "Growth", "--figures", str(file)]) == 1
    assert "is not there" in capsys.readouterr().err and not file.exists()
