"""A version of FMI that does not exist, "9.0": one row in a table is all it takes to read it, and one to write it."""

from __future__ import annotations

import pickle
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmu_didim import simulate
from fmu_didim.base.errors import FmuError, InputError
from fmu_didim.cli.main import main
from fmu_didim.components import ModelComponent, load_fmu
from fmu_didim.components.fmu import probe_fmu, read_description
from fmu_didim.components.fmu.versions import VERSIONS, version_of
from fmu_didim.components.fmu.versions.fmi3 import FMI_3, Binding3
from fmu_didim.export import build_fmu
from fmu_didim.export.versions import VERSIONS as WRITTEN
from tests.awkward.build import DEFAULTS, SLAVE, pack
from tests.cases import SCARA, scara_case
from tests.components.fmu.helpers import exported
from tests.helpers import PERIOD, drive, scara

U = np.sin(np.arange(60)[:, None] * np.array([0.03, 0.05]))


class Binding9(Binding3):
    """The calls of 9.0."""

    used = 0

    def enter_initialisation(self, time: float) -> None:
        type(self).used += 1
        super().enter_initialisation(time)


@pytest.fixture
def read_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(VERSIONS, "9.0", replace(FMI_3, name="9.0", binding=Binding9, has_minors=False))


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Processes of FMUs find no modules in the current folder; this one lies in the project."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def written_too(monkeypatch: pytest.MonkeyPatch) -> None:
    third = WRITTEN["3.0"]

    def describe(*arguments: object) -> str:
        return third.describe(*arguments).replace('fmiVersion="3.0"', 'fmiVersion="9.0"')  # type: ignore[arg-type]

    monkeypatch.setitem(WRITTEN, "9.0", replace(third, name="9.0", describe=describe))


def stated(source: Path, target: Path, version: str) -> Path:
    """A copy of an FMU of FMI 3.0 whose description states another version."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for member in old.infolist():
            content = old.read(member)
            if member.filename == "modelDescription.xml":
                content = content.replace(b'fmiVersion="3.0"', f'fmiVersion="{version}"'.encode())
            new.writestr(member, content)
    return target


@pytest.mark.gate
@pytest.mark.parametrize("kind", ["co-simulation", "model-exchange"])
@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.usefixtures("read_too", "elsewhere")
def test_a_row_in_the_table_is_enough_to_read_a_version(tmp_path: Path, kind: str, isolated: bool) -> None:
    path = stated(exported("scara", "3.0"), tmp_path / "nine.fmu", "9.0")
    third = load_fmu(exported("scara", "3.0"), interface=kind, isolated=isolated)
    ninth, before = load_fmu(path, interface=kind, isolated=isolated), Binding9.used
    np.testing.assert_array_equal(drive(ninth, U, PERIOD), drive(third, U, PERIOD))
    assert ninth.describe()["fmi_version"] == "9.0"
    assert pickle.loads(pickle.dumps(ninth)) == ninth
    assert Binding9.used == before + (not isolated)


@pytest.mark.slow
@pytest.mark.usefixtures("read_too", "elsewhere")
def test_a_new_version_is_tried_out_and_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = stated(exported("pd", "3.0"), tmp_path / "nine.fmu", "9.0")
    found = probe_fmu(load_fmu(path), step_size=PERIOD)
    assert (found.facts.failure, found.rerun.strategy, found.facts.reset) == ("", "reset", "restores")
    assert main(["fmu", "info", str(path)]) == 0
    assert "FMI 9.0" in capsys.readouterr().out
    with pytest.raises(FmuError, match=r"valid: 2\.0, 3\.0, 9\.0, 1\.0 for co-simulation[\s\S]*2\.0 or 3\.0 or 9\.0"):
        load_fmu(stated(exported("pd", "3.0"), tmp_path / "eight.fmu", "8.0"))


@pytest.mark.gate
@pytest.mark.usefixtures("read_too", "written_too")
def test_a_row_in_the_table_is_enough_to_write_a_version(tmp_path: Path) -> None:
    block = scara().block({"q_start1": 0.3})
    made = load_fmu(build_fmu(block, fmi_version="9.0"))
    assert made.describe()["fmi_version"] == "9.0"
    wanted = drive(ModelComponent(block), U, PERIOD)
    np.testing.assert_allclose(drive(made, U, PERIOD), wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())
    assert main(["export", "fmus/scara/robot.yaml", "--out", str(tmp_path), "--fmi", "9.0"]) == 0
    assert read_description(tmp_path / "scara.fmu").version == "9.0"


@pytest.mark.gate
@pytest.mark.usefixtures("read_too", "written_too")
def test_a_case_knows_a_new_version(tmp_path: Path) -> None:
    wanted = simulate(SCARA)
    found = simulate(scara_case(tmp_path, plant={"fmi": "9.0"}, controller={"fmi": "9.0"}))
    np.testing.assert_allclose(found.values, wanted.values, rtol=0, atol=1e-11 * np.abs(wanted.values).max())


@pytest.mark.gate
def test_versions_that_cannot_be_written_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match=r"cannot be exported[\s\S]*got:   9\.0[\s\S]*valid: 2\.0, 3\.0"):
        build_fmu(scara().block(), fmi_version="9.0")
    assert main(["export", "fmus/scara/robot.yaml", "--out", str(tmp_path), "--fmi", "9.0"]) == 1
    assert "valid: 2.0, 3.0" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"plant\.fmi[\s\S]*cannot be exported; valid: 2\.0, 3\.0"):
        simulate(scara_case(tmp_path, plant={"fmi": "9.0"}))


# ---- what fmiVersion may say -------------------------------------------------------------------------


@pytest.mark.gate
@pytest.mark.parametrize("text", ["3.1", "3.0.1", "3.12.3"])
def test_minor_versions_of_fmi_3_are_read(tmp_path: Path, text: str) -> None:
    made = load_fmu(stated(exported("scara", "3.0"), tmp_path / "later.fmu", text))
    assert made.describe()["fmi_version"] == text
    np.testing.assert_array_equal(drive(made, U, PERIOD), drive(load_fmu(exported("scara", "3.0")), U, PERIOD))


@pytest.mark.gate
@pytest.mark.parametrize("text", ["3.0-beta.1", "3.0-rc.2", "3.1-alpha.1"])
def test_drafts_are_refused(tmp_path: Path, text: str) -> None:
    path = stated(exported("scara", "3.0"), tmp_path / "draft.fmu", text)
    with pytest.raises(FmuError) as caught:
        load_fmu(path)
    error = caught.value
    assert error.what == "This FMI version is not supported: it is a draft of the standard."
    assert (error.where, error.got) == (str(path), text)
    assert error.valid == "2.0, 3.0, 1.0 for co-simulation"
    assert error.next_step == "Export the FMU again for FMI 2.0 or 3.0."


@pytest.mark.gate
@pytest.mark.parametrize("text", ["1.1", "2.1", "3", "3.", "3.x", "3.1 ", "30.0", "13.0", "3.01", "3.0.0.1", "3.0\n"])
def test_other_texts_are_no_version(text: str) -> None:
    with pytest.raises(FmuError, match="version is not supported"):
        version_of(text, "here")


@pytest.mark.gate
def test_fmi_2_of_another_minor_version_is_refused(tmp_path: Path) -> None:
    path = pack(tmp_path / "next.fmu", SLAVE.format(**DEFAULTS).replace('fmiVersion="2.0"', 'fmiVersion="2.1"'), None)
    with pytest.raises(FmuError, match=r"not supported[\s\S]*got:   2\.1"):
        read_description(path)
