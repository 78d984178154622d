"""An FMU that is built twice is the same to the byte, wherever and whenever, and tells nothing of where."""

from __future__ import annotations

import os
import shutil
import struct
import zipfile
from pathlib import Path

import pytest

from fmu_didim.base.cache import COMPILER, own_folder
from fmu_didim.dynamics.block import Block
from fmu_didim.export import build_fmu, build_modelica
from fmu_didim.export.platforms import PLATFORMS
from tests.export.helpers import gain, pendulum
from tests.helpers import ROOT

VERSIONS = ("2.0", "3.0")
LC_ID_DYLIB = 0x0D
"""The command of a Mach-O file with the name of a library: Apple's mach-o/loader.h."""


def built_at(place: Path, monkeypatch: pytest.MonkeyPatch, block: Block, version: str, platforms: list[str]) -> Path:
    """An FMU from a cache of its own."""
    monkeypatch.setenv("FMU_DIDIM_CACHE", str(place / "cache"))
    return build_fmu(block, directory=place, fmi_version=version, platforms=platforms)


def content(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.mark.slow
@pytest.mark.parametrize("version", [pytest.param("2.0", marks=pytest.mark.slow), "3.0"])
def test_twice_the_same_for_all_platforms(version: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From folders of other names and depths, by a compiler that has kept nothing, hours apart and in another zone."""
    monkeypatch.delenv("CC", raising=False)
    first = built_at(tmp_path / "one", monkeypatch, gain(), version, list(PLATFORMS))
    for name in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"):
        monkeypatch.setenv(name, str(tmp_path / "kept" / "nothing"))
    monkeypatch.setenv("TZ", "Pacific/Auckland")
    before = os.umask(0o077)
    try:
        second = built_at(tmp_path / "another" / "way down", monkeypatch, gain(), version, list(PLATFORMS))
    finally:
        os.umask(before)
    assert {name for name, data in content(first).items() if content(second)[name] != data} == set()
    assert first.read_bytes() == second.read_bytes()


def shared_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the compiler has kept is used, so that only the FMU is built anew."""
    kept = str(own_folder(COMPILER))
    for name in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"):
        monkeypatch.setenv(name, kept)


@pytest.mark.gate
@pytest.mark.parametrize("version", VERSIONS)
def test_nothing_tells_where_and_when_it_was_built(
    version: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared_compiler(monkeypatch)
    found = content(built_at(tmp_path / "builder", monkeypatch, pendulum(), version, list(PLATFORMS)))
    for place in (str(tmp_path), "sources-", "objects-"):
        assert {name for name, data in found.items() if place.encode() in data} == set()
    assert b"generationDateAndTime" not in found["modelDescription.xml"]


def install_name(data: bytes) -> str:
    """The name under which others load a library of macOS."""
    start = 32
    for _ in range(struct.unpack_from("<I", data, 16)[0]):
        command, size = struct.unpack_from("<II", data, start)
        if command == LC_ID_DYLIB:
            offset = struct.unpack_from("<I", data, start + 8)[0]
            return data[start + offset : start + size].split(b"\0")[0].decode()
        start += size
    raise AssertionError("it has no name")


def test_a_library_for_macos_is_found_wherever_it_lies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shared_compiler(monkeypatch)
    found = content(built_at(tmp_path, monkeypatch, gain(), "2.0", ["macos-arm64", "macos-x86_64"]))
    names = [install_name(data) for name, data in found.items() if name.endswith(".dylib")]
    assert names == ["@rpath/gain.dylib"] * 2


@pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc here")
def test_twice_the_same_by_another_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "gcc")
    paths = []
    for place in ("one", "another"):
        monkeypatch.setenv("FMU_DIDIM_CACHE", str(tmp_path / place / "cache"))
        paths.append(build_fmu(pendulum(), directory=tmp_path / place))
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_twice_the_same_from_modelica(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rumoca", reason="pip install 'fmu-didim[modelica]'")
    shared_compiler(monkeypatch)
    paths = []
    for place in ("one", "another"):
        monkeypatch.setenv("FMU_DIDIM_CACHE", str(tmp_path / place / "cache"))
        paths.append(build_modelica(ROOT / "fmus" / "scara" / "modelica" / "PD.mo", directory=tmp_path / place))
    assert paths[0].read_bytes() == paths[1].read_bytes()
