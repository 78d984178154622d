"""Display units: pages show what the tool of a model shows, everything else is in the units of its variables."""

from __future__ import annotations

import json
import re
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest

from fmu_didim import identify
from fmu_didim.components.fmu.reading import read_description
from fmu_didim.data.signals import trajectory
from fmu_didim.data.units import DisplayUnit
from fmu_didim.report.identification.display import in_display_units, table_in_display_units
from fmu_didim.workflow.output.result import Result
from tests.conftest import ROOT

HOUSE = ROOT / "examples/house"
DISPLAYED = {"T": ("degC", "degF"), "T_out": ("degC", "degF"), "R1": ("K/W", "K/kW"), "C": ("J/K", "kJ/K")}
"""Variable -> its unit and the one in which it is shown."""


def displayed(folder: Path, difference: str = "", inverse: str = "") -> Path:
    """The example with such an FMU; ``difference``: a variable that is one; ``inverse``: a display unit."""
    shutil.copytree(HOUSE, folder, dirs_exist_ok=True)
    (folder / "house.fmu").unlink()
    with zipfile.ZipFile(HOUSE / "house.fmu") as given, zipfile.ZipFile(folder / "house.fmu", "w") as made:
        for entry in given.namelist():
            content = given.read(entry)
            if entry == "modelDescription.xml":
                content = described(content.decode(), difference, inverse).encode()
            made.writestr(entry, content)
    return folder / "identify.yaml"


def described(text: str, difference: str, inverse: str) -> str:
    for name, display in (
        ("degC", '<DisplayUnit name="degF" factor="1.8" offset="32"/>'),
        ("J/K", '<DisplayUnit name="kJ/K" factor="0.001"/>'),
        ("K/W", '<DisplayUnit name="K/kW" factor="1000"/>'),
    ):
        text = re.sub(rf'(<Unit name="{name}">\s*<BaseUnit[^>]*/>)', rf"\1{display}", text)
    text = text.replace(f'<DisplayUnit name="{inverse}"', f'<DisplayUnit name="{inverse}" inverse="true"')
    for name, (_, unit) in DISPLAYED.items():
        more = f'displayUnit="{unit}"' + (' relativeQuantity="true"' if name == difference else "")
        text = re.sub(rf'(<ScalarVariable name="{name}"[^>]*>\s*<Real )', rf"\1{more} ", text)
    return text


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("displayed")


@pytest.fixture(scope="module")
def found(folder: Path) -> Result:
    return identify(displayed(folder), out=folder / "out")


def test_values_are_those_of_the_units_of_the_variables(found: Result) -> None:
    plain = identify(HOUSE / "identify.yaml")
    assert plain.document.displays == {}
    assert found.parameters["R1"].value == pytest.approx(plain.parameters["R1"].value, rel=1e-9)
    shown = {name: unit for name, (_, unit) in DISPLAYED.items() if name != "C"}  # C keeps its value: not shown
    assert {name: unit.name for name, unit in found.document.displays.items()} == shown


def test_the_page_shows_display_units(found: Result, folder: Path) -> None:
    page = (folder / "out/report.html").read_text(encoding="utf-8")
    assert "in its display unit" in page
    r1 = found.parameters["R1"]
    assert re.search(rf"{1000 * r1.value:.2f}\d* ± [\d.]+ K/kW", page), r1
    saved = json.loads((folder / "out/result.json").read_text(encoding="utf-8"))
    assert saved["displays"]["T"] == {"name": "degF", "factor": 1.8, "offset": 32.0}
    assert "display unit" not in found.summary()


def test_charts_are_converted_and_differences_have_no_offset(found: Result) -> None:
    document = found.document
    shown = in_display_units(document)
    assert shown.torque_unit == ["degF"] and shown.inputs["T_out"] == "degF" and shown.inputs["T_beside"] == "degC"
    assert shown.noise_std[0] == pytest.approx(1.8 * document.noise_std[0])
    pair = document.table_columns[0]
    table = trajectory(np.array([0.0, 1.0]), {pair[0]: [20.0, 21.0], pair[1]: [20.5, 21.0], "T_beside": [1.0, 2.0]})
    made = table_in_display_units(document, "any.csv", table)
    assert made.column(pair[0]).tolist() == pytest.approx([68.0, 69.8])
    assert (made.column(pair[1]) - made.column(pair[0])).tolist() == pytest.approx([0.9, 0.0])
    assert made.column("T_beside").tolist() == [1.0, 2.0]


def test_a_difference_has_no_offset_and_an_inverse_unit_is_not_taken(tmp_path: Path) -> None:
    made = read_description(displayed(tmp_path, difference="T", inverse="K/kW").with_name("house.fmu"))
    own = {variable.name: variable.display for variable in made.variables}
    assert own["T"] == DisplayUnit("degF", 1.8) and own["T_out"] == DisplayUnit("degF", 1.8, 32.0)
    assert own["R1"] is None and own["C"] == DisplayUnit("kJ/K", 0.001)
