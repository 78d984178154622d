"""FMUs for Windows alone, handed to Wine: what runs there, what fails there, what is told without it."""

from __future__ import annotations

import ctypes
import platform
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fmu_didim.base.errors import FmuDidimError, FmuError, SimulationError
from fmu_didim.components import FmuComponent, load_fmu
from fmu_didim.components.fmu import wine
from fmu_didim.components.fmu.description import Interface
from fmu_didim.components.fmu.reading import read_description
from fmu_didim.cosim import simulate
from fmu_didim.export import build_fmu, compile_shared_library
from fmu_didim.export.build import find_compiler
from fmu_didim.export.platforms import PLATFORMS
from tests.awkward.build import DEFAULTS, HERE, SLAVE, pack
from tests.components.fmu.helpers import ONES, H, exported, slave_outputs
from tests.helpers import drive, loop, reference, scara, scara_pd
from tests.patience import patience, wait_until

WINDOWS = PLATFORMS["windows-x86_64"]
pytestmark = pytest.mark.skipif(
    (platform.system(), platform.machine()) != ("Linux", "x86_64"), reason="Wine is for Linux, the bridge for x86-64"
)
needs_wine = pytest.mark.skipif(
    shutil.which("wine") is None, reason="needs Wine, which is not installed: on Debian, apt install wine"
)


@pytest.fixture(autouse=True)
def plain_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)


def for_windows(folder: Path, *macros: str) -> Path:
    """The slave of slave.c with some faults, as a Windows tool would export it."""
    code = "".join(f"#define {macro}\n" for macro in macros) + (HERE / "slave.c").read_text(encoding="utf-8")
    (folder / "main.c").write_text(code, encoding="utf-8")
    compile_shared_library(folder, folder / "slave.dll", main="main.c", compiler=find_compiler(WINDOWS))
    return pack(folder / "slave.fmu", SLAVE.format(**DEFAULTS), folder / "slave.dll", place="win64")


def test_without_wine_it_is_said_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wine, "is_installed", lambda: False)
    with pytest.raises(FmuError, match="Install Wine") as caught:
        load_fmu(for_windows(tmp_path))
    assert "win64" in str(caught.value.got)


@pytest.mark.parametrize(
    ("version", "kind", "place", "promised"),
    [
        ("2.0", "co-simulation", "win64", True),
        ("3.0", "co-simulation", "win64", False),
        ("2.0", "model-exchange", "win64", False),
        ("2.0", "co-simulation", "win32", False),
    ],
)
def test_what_the_bridge_runs(tmp_path: Path, version: str, kind: str, place: str, promised: bool) -> None:
    library = tmp_path / "binaries" / place / "model.dll"
    library.parent.mkdir(parents=True)
    library.touch()
    description = replace(read_description(exported("scara", "2.0")), folder=tmp_path)
    assert wine.is_for_windows(version, description, Interface(kind, "model")) is promised


def test_the_bridge_is_built_without_wine() -> None:
    library = wine.bridge(Interface("co-simulation", "model"))
    functions = ctypes.CDLL(str(library))
    functions.fmi2GetVersion.restype = ctypes.c_char_p
    assert functions.fmi2GetVersion() == b"2.0" and functions.fmi2DoStep
    assert (library.parent / "host.exe").read_bytes()[:2] == b"MZ"


@needs_wine
@pytest.mark.parametrize("isolated", [True, False])
def test_it_computes_what_its_equations_say(tmp_path: Path, isolated: bool) -> None:
    fmu = load_fmu(for_windows(tmp_path), isolated=isolated)
    np.testing.assert_allclose(drive(fmu, ONES, H), slave_outputs(ONES), rtol=1e-12)
    changed = fmu.with_parameters({"a": 3.0})
    np.testing.assert_allclose(drive(changed, ONES, H), slave_outputs(ONES, a=3.0), rtol=1e-12)


@needs_wine
def test_a_loop_of_such_fmus_is_the_one_of_those_for_this_machine(tmp_path: Path) -> None:
    def torque(plant: Path, controller: Path) -> np.ndarray:
        parts = [replace(load_fmu(path), isolated=None) for path in (plant, controller)]
        assert all(isinstance(part, FmuComponent) for part in parts)
        motion = reference(0.5)
        recording = simulate(loop(parts[0], parts[1], motion), motion)
        return np.column_stack([recording.inputs[f"plant.tau{j}"] for j in (1, 2)])

    here = torque(exported("scara", "2.0"), exported("pd", "2.0"))
    blocks = (scara().block({"q_start1": 0.3}), scara_pd())
    there = torque(*(build_fmu(block, directory=tmp_path, platforms=["windows-x86_64"]) for block in blocks))
    assert np.abs(here).max() > 1
    np.testing.assert_allclose(there, here, rtol=1e-9, atol=1e-9 * np.abs(here).max())


@needs_wine
@pytest.mark.parametrize(
    ("macro", "told"), [("CRASH_IN_STEP", "Wine"), ("EXIT_IN_STEP", "Wine"), ("ERROR_IN_STEP", "DoStep")]
)
def test_what_fails_there_is_told_here(tmp_path: Path, macro: str, told: str) -> None:
    with pytest.raises(SimulationError) as caught:
        drive(load_fmu(for_windows(tmp_path, macro), isolated=True), ONES, H)
    assert told in str(caught.value)


@needs_wine
def test_one_that_hangs_ends_by_the_time_limit_and_leaves_nothing(tmp_path: Path) -> None:
    limit = patience(2.0)
    fmu = load_fmu(for_windows(tmp_path, "HANG_IN_STEP"), isolated=True, time_limit_s=limit)
    with pytest.raises(FmuDidimError, match=f"no answer within {limit:g} s"):
        drive(fmu, ONES, H)
    wait_until(lambda: not [p for p in Path("/proc").glob("[0-9]*/cmdline") if str(tmp_path) in _read(p)])


def _read(path: Path) -> str:
    try:
        return path.read_bytes().decode(errors="replace").replace("\\", "/")
    except OSError:
        return ""
