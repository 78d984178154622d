"""The look at FMUs of others: what becomes of each content is told once, and other repositories keep their rows."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from fmu_didim.export import build_fmu
from tests.helpers import scara_pd
from tests.tools.foreign.__main__ import main, texts
from tests.tools.foreign.look import _first, fmu, system


@pytest.fixture
def checkouts(tmp_path: Path) -> Path:
    """A repository with an FMU that runs, its copy, and a file that is none."""
    folder = tmp_path / "checkouts" / "owner" / "name"
    folder.mkdir(parents=True)
    made = build_fmu(scara_pd(), directory=tmp_path)
    shutil.copy(made, folder / "law.fmu")
    shutil.copy(made, folder / "same.fmu")
    (folder / "text.fmu").write_text("no archive", encoding="utf-8")
    return tmp_path / "checkouts"


@pytest.mark.slow
def test_each_content_is_looked_at_once_and_other_rows_stay(checkouts: Path, tmp_path: Path) -> None:
    file = tmp_path / "foreign.json"
    assert main([str(checkouts), "--figures", str(file)]) == 0
    held = json.loads(file.read_text(encoding="utf-8"))
    good, bad = held["data"]
    assert (good["names"], good["answer"], good["fmi"]) == (["law"], "runs", "2.0")
    assert good["made_by"].startswith("fmu_didim") and good["says"].startswith("again by reset")
    assert (bad["names"], bad["answer"], bad["peer"]) == (["text"], "refused", "does not run")
    assert "not a zip archive" in bad["says"] and str(tmp_path) not in json.dumps(held["data"])
    assert (held["figures"]["run"], held["figures"]["refused"], held["figures"]["fmus"]) == ("1", "1", "2")
    assert any(row.startswith("| owner/name | law | ") for row in held["figures"]["table"])

    (checkouts / "owner" / "other").mkdir()
    assert main([str(checkouts), "--only", "owner/other", "--figures", str(file)]) == 0
    again = json.loads(file.read_text(encoding="utf-8"))
    assert again["data"] == held["data"] and again["figures"] == texts(held["data"])
    with pytest.raises(SystemExit):
        main([str(checkouts), "--only", "owner/none", "--figures", str(file)])


@pytest.mark.gate
def test_an_fmu_that_runs_and_one_that_is_refused(checkouts: Path) -> None:
    assert fmu(checkouts / "owner/name/law.fmu")["answer"] == "runs"
    assert fmu(checkouts / "owner/name/text.fmu")["answer"] == "refused"


@pytest.mark.gate
def test_a_system_that_holds_no_component_is_refused(tmp_path: Path) -> None:
    structure = tmp_path / "SystemStructure.ssd"
    structure.write_text(
        '<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" '
        'version="1.0" name="x"><ssd:System name="x"/></ssd:SystemStructureDescription>',
        encoding="utf-8",
    )
    found = system(structure)
    assert found["answer"] == "refused" and found["says"]


def test_places_of_this_machine_are_left_out() -> None:
    assert _first("It failed. /tmp/x/y.fmu\nmore") == "It failed."
    assert _first("N.m/rad is no unit") == "N.m/rad is no unit"
