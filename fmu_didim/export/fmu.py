"""From a block to an .fmu file, built once and then taken from the cache."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
import uuid
import zipfile
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path

from fmu_didim.block import Block
from fmu_didim.cache import cached_folder
from fmu_didim.errors import InputError
from fmu_didim.export import fmi2, fmi3
from fmu_didim.export.build import Compiler, compile_shared_library, find_compiler
from fmu_didim.export.c_code import CONFIG_FILE, EQUATIONS_FILE, check_exportable, generate_c, generate_config
from fmu_didim.export.platforms import Platform, host_platform, select_platforms

MAIN_SOURCES = {"2.0": "fmi2.c", "3.0": "fmi3.c"}
"""The file that is compiled, for each FMI version that can be written."""

_GENERATORS = ("c_code.py", "fmi2.py", "fmi3.py", "fmu.py", "platforms.py", "structure.py", "units.py", "xml_file.py")
_ZIP_TIME = (1980, 1, 1, 0, 0, 0)  # the earliest a zip file can hold; the same content gives the same bytes


def build_fmu(
    block: Block, *, directory: Path | None = None, fmi_version: str = "2.0", platforms: Sequence[str] | None = None
) -> Path:
    """An FMU of a block, for co-simulation and model exchange, with binaries and sources.

    A continuous block is integrated in co-simulation by the classical Runge-Kutta method of fourth
    order, with ``substeps`` equal substeps in a communication step and the input held constant; by
    default their number follows :func:`fmu_didim.block.choose_substeps` from the block's rate bound
    at the initial state. Outputs follow inputs and tunable parameters at once. A sampled block samples
    at t_start + n T: at such an instant its outputs follow its inputs at once, between them they are
    held. In model exchange those instants are time events.

    The file is kept in the cache (:func:`fmu_didim.cache.cache_directory`) under the digest of
    the block, the wrapper and the compiler. Several processes may build the same block at once.

    Args:
        block: the equations; its variables are in SI units.
        directory: also copy the file there, as ``<name of the block>.fmu``.
        fmi_version: ``2.0`` or ``3.0``; both compute the same.
        platforms: the machines it is for, names in :data:`fmu_didim.export.platforms.PLATFORMS`; default:
            this one. This machine's binary is built by the compiler CC if that is set, those of the others
            always by ``ziglang``.

    Returns:
        The file: the copy if ``directory`` is given, else the one in the cache.

    Raises:
        InputError: a name or a start value cannot be exported, or there is no such FMI version or platform.
        BuildError: there is no compiler, or it reports an error.

    Source: "Functional Mock-up Interface for Model Exchange and Co-Simulation", version 2.0;
    "Functional Mock-up Interface Specification", version 3.0.
    """
    if fmi_version not in MAIN_SOURCES:
        raise InputError("This FMI version cannot be exported.", got=fmi_version, valid=MAIN_SOURCES)
    check_exportable(block, fmi_version=fmi_version)
    compilers = {platform: find_compiler(platform) for platform in select_platforms(platforms)}
    content = _content_digest(block, fmi_version)
    file_name = f"{block.name}.fmu"
    folder = cached_folder(
        "exported",
        _key(content, compilers),
        lambda new: _build(block, fmi_version, content, compilers, new / file_name),
    )
    path = folder / file_name
    if directory is None:
        return path
    directory.mkdir(parents=True, exist_ok=True)
    copy = directory / path.name
    # Through a temporary name: a process that has the old file open keeps it, none sees half a file.
    with tempfile.NamedTemporaryFile(dir=directory, prefix=f".{block.name}.", delete=False) as stream:
        temporary = Path(stream.name)
    try:
        shutil.copyfile(path, temporary)
        temporary.chmod(0o644)
        temporary.replace(copy)
    finally:
        temporary.unlink(missing_ok=True)
    return copy


def _content_digest(block: Block, fmi_version: str) -> str:
    """SHA-256 of everything that decides what the FMU computes, whatever compiler builds it.

    The source of the exporter itself is part of it: whoever changes it never meets files of the old one.
    """
    state = hashlib.sha256(f"{_package_version()} casadi {version('casadi')} FMI {fmi_version}".encode())
    state.update(block.digest().encode())
    state.update(block.description.encode())
    state.update(generate_config(block, guid="").encode())  # holds the constants of the substep rule
    for name in _wrapper_files(fmi_version):
        state.update(_wrapper_source(name).encode())
    for name in _GENERATORS:
        state.update((files("fmu_didim.export") / name).read_bytes())
    return state.hexdigest()


def _key(content: str, compilers: dict[Platform, Compiler]) -> str:
    parts = [content, *_folders(list(compilers), "2.0")]
    for compiler in compilers.values():
        parts += [*compiler.command, *compiler.flags, *compiler.libraries, compiler.version]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]


def _folders(platforms: Sequence[Platform], fmi_version: str) -> dict[str, Platform]:
    """Folders in ``binaries/`` and what is in them.

    An ARM machine's own binary of FMI 2.0 is also put where the tools on that machine look for it that only
    know ``linux64`` and ``darwin64`` (FMPy 0.3 is one), unless the standard's owner of that folder is there.
    """
    folders = {platform.folder(fmi_version): platform for platform in platforms}
    host = host_platform()
    if fmi_version == "2.0" and host in platforms:
        folders.setdefault(host.bits_folder, host)
    return folders


def _build(block: Block, fmi_version: str, content: str, compilers: dict[Platform, Compiler], path: Path) -> None:
    guid = f"{{{uuid.UUID(content[:32])}}}"
    main = MAIN_SOURCES[fmi_version]
    tool = f"fmu_didim {_package_version()}"
    sources = {name: _wrapper_source(name) for name in _wrapper_files(fmi_version)}
    sources[CONFIG_FILE] = generate_config(block, guid=guid)
    sources[EQUATIONS_FILE] = generate_c(block)
    if fmi_version == "2.0":
        description = fmi2.model_description(block, guid=guid, generation_tool=tool, source_files=[main])
    else:
        description = fmi3.model_description(block, token=guid, generation_tool=tool)
        sources["buildDescription.xml"] = fmi3.build_description(block, source_files=[main])
    with tempfile.TemporaryDirectory(prefix="fmu_didim-") as name:
        source_dir = Path(name)
        for file_name, text in sources.items():
            (source_dir / file_name).write_text(text, encoding="utf-8", newline="\n")
        libraries = {}
        for platform, compiler in compilers.items():
            library = source_dir / platform.name / f"{block.name}{platform.suffix}"
            library.parent.mkdir()
            compile_shared_library(source_dir, library, main=main, compiler=compiler)
            libraries[platform] = library
        with zipfile.ZipFile(path, "w", compression=zipfile.ZIP_DEFLATED) as archive:
            _add(archive, "modelDescription.xml", description.encode())
            for folder, platform in sorted(_folders(list(compilers), fmi_version).items(), key=lambda item: item[0]):
                library = libraries[platform]
                _add(archive, f"binaries/{folder}/{library.name}", library.read_bytes())
            for file_name in sorted(sources):
                _add(archive, f"sources/{file_name}", sources[file_name].encode())


def _add(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    entry = zipfile.ZipInfo(name, date_time=_ZIP_TIME)
    entry.compress_type = zipfile.ZIP_DEFLATED
    entry.external_attr = 0o644 << 16
    archive.writestr(entry, content)


def _wrapper_files(fmi_version: str) -> tuple[str, ...]:
    return ("block.h", "block.c", MAIN_SOURCES[fmi_version])


def _wrapper_source(name: str) -> str:
    return (files("fmu_didim.export") / "wrapper" / name).read_text(encoding="utf-8")


def _package_version() -> str:
    try:
        return version("fmu_didim")
    except PackageNotFoundError:  # run from a folder that is not installed
        return "0"
