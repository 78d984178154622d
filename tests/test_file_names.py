"""Names that one of Linux, macOS and Windows does not take: one rule, and what it names."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path, PurePosixPath

import fmpy
import pytest
from fmpy.validation import validate_fmu

from fmu_didim.base.files import file_name
from fmu_didim.campaigns.campaign import campaign
from fmu_didim.components import load_fmu
from fmu_didim.cosim import Connection, System
from fmu_didim.export import build_fmu
from fmu_didim.export.versions import VERSIONS
from fmu_didim.ssp import write_ssp
from tests.export.helpers import gain
from tests.helpers import ROOT


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("scara", "scara"),
        ("Läufe τ (2)", "Läufe τ (2)"),
        ("a/b\\c", "a_b_c"),
        ('<a>:"b"|c?*', "_a___b__c__"),
        ("tab\tnull\0del\x7f", "tab_null_del_"),
        ("ends with a dot.", "ends with a dot_"),
        ("and a space. ", "and a space__"),
        (".", "_"),
        ("..", "__"),
        ("", "_"),
        (".hidden", ".hidden"),
        ("aux", "aux_"),
        ("AUX.csv", "AUX_.csv"),
        ("Com1", "Com1_"),
        ("lpt9.tar.gz", "lpt9_.tar.gz"),
        ("com²", "com²_"),
        ("nul .txt", "nul_ .txt"),
        ("conout$", "conout$_"),
        ("con:", "con_"),
        ("auxiliary", "auxiliary"),
        ("com10", "com10"),
        ("my aux", "my aux"),
        ("console", "console"),
    ],
)
def test_the_rule(text: str, name: str) -> None:
    assert file_name(text) == name
    assert file_name(name) == name


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("device", ["aux", "CON", "com1"])
def test_a_robot_with_the_name_of_a_device(version: str, device: str, tmp_path: Path) -> None:
    path = build_fmu(replace(gain(), name=device), directory=tmp_path, fmi_version=version)
    assert path.name == f"{device}_.fmu"
    assert validate_fmu(str(path)) == []
    with zipfile.ZipFile(path) as archive:
        parts = {part for name in archive.namelist() for part in PurePosixPath(name).parts}
    assert {part for part in parts if file_name(part) != part} == set()
    assert fmpy.read_model_description(str(path)).modelName == device
    result = fmpy.simulate_fmu(str(path), start_values={"u": 2.0}, stop_time=0.1, output=["y"])
    assert result["y"][-1] == 6.0


def test_a_system_whose_parts_are_named_so(tmp_path: Path) -> None:
    component = load_fmu(build_fmu(gain(), directory=tmp_path)).with_parameters({"K": 2.0})
    system = System({"aux": component}, (Connection("reference.r", "aux.u"),), ("aux",), 0.01)
    path = write_ssp(system, tmp_path / "system.ssp", name="aux")
    with zipfile.ZipFile(path) as archive:
        assert "resources/aux_.ssv" in archive.namelist()


@pytest.mark.parametrize(
    ("name", "folder"), [("drift: 5 %", "drift_ 5 %"), ("last.", "last_"), ("prn", "prn_"), ("../up", ".._up")]
)
def test_the_folder_of_a_campaign(name: str, folder: str) -> None:
    content = {"name": name, "case": str(ROOT / "examples/scara/identify.yaml"), "noise": {"relative": 0.05}}
    assert campaign(content).out == Path("results") / folder
