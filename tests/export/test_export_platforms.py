"""FMUs for other machines: folders, file formats, and the functions that their libraries show."""

from __future__ import annotations

import re
import struct
import zipfile
from pathlib import Path

import pytest
from fmpy.validation import validate_fmu

from fmu_didim.base.errors import BuildError, InputError
from fmu_didim.export import build_fmu
from fmu_didim.export.build import find_compiler
from fmu_didim.export.platforms import PLATFORMS, Platform, host_platform, select_platforms
from fmu_didim.export.versions import VERSIONS
from tests.export.helpers import gain

FOLDERS = {
    "2.0": ("linux64", "aarch64-linux", "win64", "darwin64", "aarch64-darwin"),
    "3.0": ("x86_64-linux", "aarch64-linux", "x86_64-windows", "x86_64-darwin", "aarch64-darwin"),
}
FORMATS = {
    "linux-x86_64": ("ELF", 62),  # e_machine, System V ABI
    "linux-arm64": ("ELF", 183),
    "windows-x86_64": ("PE", 0x8664),  # Machine, Microsoft PE format
    "macos-x86_64": ("Mach-O", 0x01000007),  # cputype, Apple's mach/machine.h
    "macos-arm64": ("Mach-O", 0x0100000C),
}


def binary_format(data: bytes) -> tuple[str, int]:
    """Kind and processor of a 64-bit shared library, from its header."""
    if data[:6] == b"\x7fELF\x02\x01":
        return "ELF", struct.unpack_from("<H", data, 18)[0]
    if data[:2] == b"MZ":
        header = struct.unpack_from("<I", data, 0x3C)[0]
        assert data[header : header + 4] == b"PE\0\0"
        return "PE", struct.unpack_from("<H", data, header + 4)[0]
    magic, cpu = struct.unpack_from("<II", data)
    assert magic == 0xFEEDFACF
    return "Mach-O", cpu


def shown_functions(data: bytes) -> set[str]:
    """Names of the symbols that a shared library defines for others."""
    return {"ELF": _elf_symbols, "PE": _pe_symbols, "Mach-O": _macho_symbols}[binary_format(data)[0]](data)


def _text(data: bytes, start: int) -> str:
    return data[start : data.index(b"\0", start)].decode()


def _elf_symbols(data: bytes) -> set[str]:
    table, count = struct.unpack_from("<Q", data, 0x28)[0], struct.unpack_from("<H", data, 0x3C)[0]
    sections = [struct.unpack_from("<IIQQQQIIQQ", data, table + 64 * i) for i in range(count)]
    names = set()
    for section in sections:
        if section[1] == 11:  # SHT_DYNSYM
            offset, size, strings = section[4], section[5], sections[section[6]][4]
            for start in range(offset, offset + size, 24):
                name, info, _other, where = struct.unpack_from("<IBBH", data, start)
                if where and info & 15 in (1, 2):  # defined objects and functions
                    names.add(_text(data, strings + name))
    return names


def _pe_symbols(data: bytes) -> set[str]:
    header = struct.unpack_from("<I", data, 0x3C)[0] + 4
    section_count, optional_size = (struct.unpack_from("<H", data, header + at)[0] for at in (2, 16))
    optional = header + 20
    sections = [struct.unpack_from("<8sIIII", data, optional + optional_size + 40 * i) for i in range(section_count)]

    def offset(address: int) -> int:
        return next(raw + address - at for _, size, at, _, raw in sections if at <= address < at + size)

    exports = offset(struct.unpack_from("<I", data, optional + 112)[0])
    count, names = struct.unpack_from("<I", data, exports + 24)[0], struct.unpack_from("<I", data, exports + 32)[0]
    addresses = struct.unpack_from(f"<{count}I", data, offset(names))
    return {_text(data, offset(address)) for address in addresses}


def _macho_symbols(data: bytes) -> set[str]:
    names, start = set(), 32
    for _ in range(struct.unpack_from("<I", data, 16)[0]):
        command, size = struct.unpack_from("<II", data, start)
        if command == 2:  # LC_SYMTAB
            offset, count, strings = struct.unpack_from("<III", data, start + 8)
            for index in range(count):
                name, kind = struct.unpack_from("<IB", data, offset + 16 * index)
                if kind & 0x1F == 0x0F:  # N_SECT and N_EXT, not N_PEXT
                    names.add(_text(data, strings + name).removeprefix("_"))
        start += size
    return names - {"__dso_handle", "_mh_dylib_header"}  # every library of zig's linker has these two


def check(path: Path, fmi_version: str, names: list[str]) -> None:
    """The FMU is valid and has a right library for each platform, which shows FMI's functions alone."""
    assert validate_fmu(str(path)) == []
    prefix = f"fmi{fmi_version[0]}"
    with zipfile.ZipFile(path) as archive:
        found = {name.split("/")[1]: name for name in archive.namelist() if name.startswith("binaries/")}
        folders = dict(zip(PLATFORMS, FOLDERS[fmi_version], strict=True))
        assert set(found) == {folders[name] for name in names}
        for name in names:
            assert found[folders[name]].endswith(f"/gain{PLATFORMS[name].suffix}")
            library = archive.read(found[folders[name]])
            assert binary_format(library) == FORMATS[name]
            functions = shown_functions(library)
            assert {f"{prefix}DoStep", f"{prefix}GetVersion", f"{prefix}EnterEventMode"} <= functions
            assert all(function.startswith(prefix) for function in functions), functions


@pytest.mark.parametrize("fmi_version", ["2.0", "3.0"])
def test_linux_on_both_processors(fmi_version: str) -> None:
    names = ["linux-arm64", "linux-x86_64"]
    check(build_fmu(gain(), fmi_version=fmi_version, platforms=names), fmi_version, names)


@pytest.mark.parametrize("fmi_version", ["2.0", "3.0"])
def test_all_platforms(fmi_version: str) -> None:
    path = build_fmu(gain(), fmi_version=fmi_version, platforms=list(PLATFORMS))
    check(path, fmi_version, list(PLATFORMS))


def test_on_windows_only_its_own_c_library_is_needed() -> None:
    with zipfile.ZipFile(build_fmu(gain(), platforms=["windows-x86_64"])) as archive:
        library = archive.read("binaries/win64/gain.dll")
    needed = set(re.findall(rb"[\w.-]+\.dll", library)) - {b"gain.dll"}
    assert needed and all(name.startswith(b"api-ms-win-crt-") for name in needed), needed


def test_platform_folders() -> None:
    for version, folders in FOLDERS.items():
        found = VERSIONS[version].folders(list(PLATFORMS.values()), Platform("other", "linux", "riscv64"))
        assert tuple(found) == folders


def test_platform_names() -> None:
    assert select_platforms(None) == (host_platform(),)
    assert [p.name for p in select_platforms(["macos-arm64", "linux-x86_64", "macos-arm64"])] == [
        "linux-x86_64",
        "macos-arm64",
    ]
    message = r"(?s)no platform named 'linux-arm65'.*windows-x86_64.*Did you mean 'linux-arm64'"
    with pytest.raises(InputError, match=message):
        build_fmu(gain(), platforms=["linux-arm65"])
    with pytest.raises(InputError, match="no platform"):
        build_fmu(gain(), platforms=[])


@pytest.mark.parametrize(
    ("system", "machine", "expected"),
    [
        ("linux", "x86_64", "linux-x86_64"),
        ("linux", "aarch64", "linux-arm64"),
        ("win32", "AMD64", "windows-x86_64"),
        ("darwin", "arm64", "macos-arm64"),
        ("linux", "riscv64", "linux-riscv64"),
    ],
)
def test_host(monkeypatch: pytest.MonkeyPatch, system: str, machine: str, expected: str) -> None:
    monkeypatch.setattr("sys.platform", system)
    monkeypatch.setattr("platform.machine", lambda: machine)
    assert host_platform().name == expected


def test_an_arm_machine_finds_its_own_fmu() -> None:
    arm, intel = PLATFORMS["macos-arm64"], PLATFORMS["macos-x86_64"]
    assert VERSIONS["2.0"].folders([arm], arm) == {"aarch64-darwin": arm, "darwin64": arm}
    assert VERSIONS["2.0"].folders([arm, intel], arm) == {"aarch64-darwin": arm, "darwin64": intel}
    assert VERSIONS["3.0"].folders([arm], arm) == {"aarch64-darwin": arm}


def test_the_chosen_compiler_is_for_this_machine_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler-here")
    other = next(p for p in PLATFORMS.values() if p != host_platform())
    assert "ziglang" in find_compiler(other).command
    with pytest.raises(BuildError, match="Unset CC"):
        find_compiler()


def test_an_unknown_machine_is_built_for_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    odd = Platform("linux-riscv64", "linux", "riscv64")
    monkeypatch.setattr("fmu_didim.export.build.host_platform", lambda: odd)
    assert "-target" not in find_compiler(odd).flags
    assert "-target" in find_compiler(PLATFORMS["linux-x86_64"]).flags
