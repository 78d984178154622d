"""Errors of libraries are told as theirs, not as those of the user's files."""

from __future__ import annotations

import pickle
import sys
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

import pytest

from fmu_didim.base.errors import InputError, LibraryError, loading
from fmu_didim.components import load_fmu
from fmu_didim.components.fmu import library
from fmu_didim.components.fmu.versions import with_fmpy
from fmu_didim.data import units
from fmu_didim.data.tables import read_table, read_trajectory
from fmu_didim.export import build_fmu
from tests.helpers import scara_pd


class Broken:
    """Makes a module raise while it is imported."""

    def __init__(self, name: str, error: Exception) -> None:
        self._name, self._error = name, error

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        if name == self._name:
            raise self._error


def broken(monkeypatch: pytest.MonkeyPatch, name: str, error: Exception) -> None:
    for module in [m for m in sys.modules if m == name or m.startswith(f"{name}.")]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setattr(sys, "meta_path", [Broken(name, error), *sys.meta_path])


FILES = {
    "pint": ("a.csv", b"t [s],q1 [furlong]\n0,1\n1,2\n", TypeError("cannot inherit frozen dataclass")),
    "pyarrow": ("a.parquet", b"PAR1", AttributeError("_ARRAY_API not found")),
    "h5py": ("a.h5", b"\x89HDF\r\n\x1a\n", ValueError("numpy.dtype size changed")),
    "asammdf": ("a.mf4", b"MDF     4.10    ", ImportError("DLL load failed")),
    "rosbags": ("a.mcap", b"\x89MCAP0\r\n", ImportError("apsw: wrong ELF class")),
}


@pytest.mark.parametrize("name", FILES)
def test_a_library_that_does_not_load_is_not_the_fault_of_the_file(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, content, error = FILES[name]
    (tmp_path / file).write_bytes(content)
    pytest.importorskip(name, reason=f"needs {name}")
    units._registry.cache_clear()
    units.known_unit.cache_clear()
    broken(monkeypatch, name, error)
    with pytest.raises(LibraryError) as caught:
        read_trajectory(tmp_path / file, time="t")
    told = str(caught.value)
    assert f"The library {name} does not work as it is installed." in told
    assert f"{name} {version(name)}, Python 3." in told
    assert str(error) in told
    assert f'pip install --upgrade "{name}' in told
    assert file not in told
    assert pickle.loads(pickle.dumps(caught.value)).args == caught.value.args


@pytest.mark.parametrize(("name", "extra"), [("h5py", "hdf5"), ("asammdf", "mf4"), ("rosbags", "ros")])
def test_a_library_that_is_absent_is_named_with_its_extra(
    name: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / FILES[name][0]
    path.write_bytes(FILES[name][1])
    broken(monkeypatch, name, ModuleNotFoundError(f"No module named '{name}'", name=name))
    with pytest.raises(InputError, match=rf"need {name}[\s\S]*pip install fmu_didim\[{extra}\]"):
        read_table(path)


def test_what_a_library_lacks_itself_is_its_own_fault() -> None:
    """An absent part of an installed library is not the absence of the library."""
    absent = InputError("absent", next_step="Change it.")
    with pytest.raises(LibraryError, match=r"No module named 'numpy\.core'"), loading("h5py", absent=absent):
        raise ModuleNotFoundError("No module named 'numpy.core'", name="numpy.core")


def test_versions_that_are_needed_are_told() -> None:
    """As the package states them; the library may not be installed at all."""
    assert LibraryError("pint", got="x").valid.startswith("pint>=")
    absent = LibraryError("nowhere", got="x")
    assert (absent.valid, absent.where.split(",")[0]) == ("", "nowhere not installed")


def test_an_old_fmpy_is_not_the_fault_of_the_fmu(monkeypatch: pytest.MonkeyPatch) -> None:
    """FMPy 0.3.24 and 0.3.25 annotate other methods, so that functions of every FMU seemed to be missing."""
    import fmpy.fmi2

    fmu = load_fmu(build_fmu(scara_pd()))
    old = ModuleType("fmpy.fmi2")
    old.FMU2Slave = type("FMU2Slave", (), {})  # type: ignore[attr-defined]
    monkeypatch.setattr(with_fmpy, "import_module", lambda name: old if name == "fmpy.fmi2" else fmpy)
    monkeypatch.setattr(library, "_loaded", {})
    with_fmpy.signatures.cache_clear()
    try:
        with pytest.raises(LibraryError, match=r"library fmpy[\s\S]*fmi2DoStep"):
            fmu.instantiate()
    finally:
        with_fmpy.signatures.cache_clear()
