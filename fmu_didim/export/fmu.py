"""From a block to an .fmu file, built once and then taken from the cache."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
import uuid
import zipfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib.resources import files
from pathlib import Path

from fmu_didim.base.cache import cached_folder
from fmu_didim.base.files import file_name, whole_file
from fmu_didim.base.version import __version__, release_of
from fmu_didim.dynamics.block import Block
from fmu_didim.export.build import Compiler, compile_shared_library, find_compiler, wrapper_source
from fmu_didim.export.c_code import CONFIG_FILE, EQUATIONS_FILE, check_exportable, generate_c, generate_config
from fmu_didim.export.platforms import Platform, host_platform, select_platforms
from fmu_didim.export.versions import DEFAULT_VERSION, WrittenVersion, written_version

_WRAPPER = ("block.h", "block.c", "common.c")
_ZIP_TIME = (1980, 1, 1, 0, 0, 0)  # the earliest a zip file can hold; the same content gives the same bytes


def build_fmu(
    block: Block,
    *,
    directory: Path | None = None,
    fmi_version: str = DEFAULT_VERSION,
    platforms: Sequence[str] | None = None,
    directional: bool = True,
) -> Path:
    """An FMU of a block, for co-simulation and model exchange, with binaries and sources.

    A continuous block is integrated in co-simulation with ``substeps`` equal substeps in a communication
    step and the input held constant: by the linearly implicit method of
    :mod:`fmu_didim.dynamics.linearly_implicit` where the block knows its stiff part, else by the classical
    Runge-Kutta method of fourth order. By default their number, and which of the two methods needs less, follow
    :func:`fmu_didim.dynamics.block.choose_steps` from the block's rates at the initial state. Outputs follow
    inputs and tunable parameters at once. A sampled block samples at t_start + n T: at such an instant
    its outputs follow its inputs at once, between them they are held. In model exchange those instants
    are time events.

    The file is kept in the cache (:func:`fmu_didim.base.cache.cache_directory`) under the digest of
    the block, the wrapper and the compiler. Several processes may build the same block at once.

    Args:
        block: the equations; its variables are in SI units.
        directory: also copy the file there, as ``<name of the block>.fmu``; a name that Windows keeps for a device
            (``aux``) gets a ``_`` behind it.
        fmi_version: one of :data:`fmu_didim.export.versions.VERSIONS`; all compute the same.
        platforms: the machines it is for, names in :data:`fmu_didim.export.platforms.PLATFORMS`; default:
            this one. This machine's binary is built by the compiler CC if that is set, those of the others
            always by ``ziglang``.
        directional: whether it gives directional derivatives, two fifths of the code of a robot; one that is only run
            compiles faster without.

    Returns:
        The file: the copy if ``directory`` is given, else the one in the cache.

    Raises:
        InputError: a name or a start value cannot be exported, or there is no such FMI version or platform.
        BuildError: there is no compiler, or it reports an error.

    Source: "Functional Mock-up Interface for Model Exchange and Co-Simulation", version 2.0;
    "Functional Mock-up Interface Specification", version 3.0.
    """
    fmi = written_version(fmi_version)
    check_exportable(block, own_names=fmi.own_names)
    compilers = {platform: find_compiler(platform) for platform in select_platforms(platforms)}
    content = _content_digest(block, fmi, directional=directional)
    name = f"{file_name(block.name)}.fmu"
    folder = cached_folder(
        "exported",
        _key(content, compilers),
        lambda new: _build(block, fmi, content, compilers, new / name, directional=directional),
    )
    path = folder / name
    return path if directory is None else copied(path, directory)


def copied(path: Path, directory: Path) -> Path:
    """A copy of an FMU in a folder, under its name."""
    directory.mkdir(parents=True, exist_ok=True)
    copy = directory / path.name
    with whole_file(copy) as temporary:
        shutil.copyfile(path, temporary)
    return copy


def _content_digest(block: Block, fmi: WrittenVersion, *, directional: bool) -> str:
    """SHA-256 of everything that decides what the FMU computes, the compiler aside.

    The source of the exporter itself is part of it, so that a changed exporter takes no file of the old one.
    """
    state = hashlib.sha256(f"{__version__} casadi {release_of('casadi')} FMI {fmi.name}".encode())
    state.update(block.digest().encode())
    state.update(block.description.encode())
    # Holds the constants of the substep rule, and what it is built with.
    state.update(generate_config(block, guid="", directional=directional).encode())
    state.update(_exporter_digest(fmi.main).encode())
    return state.hexdigest()


@cache
def _exporter_digest(main: str) -> str:
    """SHA-256 of the sources of the exporter, which this process has already imported."""
    state = hashlib.sha256()
    for name in (*_WRAPPER, main):
        state.update(wrapper_source(name).encode())
    for package in ("fmu_didim.export", "fmu_didim.export.versions"):
        for source in sorted(files(package).iterdir(), key=lambda entry: entry.name):
            state.update(source.read_bytes() if source.name.endswith(".py") else b"")
    return state.hexdigest()


def _key(content: str, compilers: dict[Platform, Compiler]) -> str:
    parts = [content, *(platform.name for platform in compilers)]
    for compiler in compilers.values():
        parts += [*compiler.flags, *compiler.libraries, *compiler.lean, compiler.version]
        parts += [wrapper_source(compiler.runtime)] if compiler.runtime else []
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]


def _build(
    block: Block,
    fmi: WrittenVersion,
    content: str,
    compilers: dict[Platform, Compiler],
    path: Path,
    *,
    directional: bool,
) -> None:
    guid = f"{{{uuid.UUID(content[:32])}}}"
    tool = f"fmu_didim {__version__}"
    sources = {name: wrapper_source(name) for name in (*_WRAPPER, fmi.main)}
    sources[CONFIG_FILE] = generate_config(block, guid=guid, directional=directional)
    sources[EQUATIONS_FILE] = generate_c(block, directional=directional)
    sources.update(fmi.sources(block))
    with tempfile.TemporaryDirectory(prefix="sources-", dir=path.parent) as name:  # gone with it, if this is killed
        source_dir = Path(name)
        for source, text in sources.items():
            (source_dir / source).write_text(text, encoding="utf-8", newline="\n")

        def compiled(platform: Platform) -> Path:
            library = source_dir / platform.name / f"{path.stem}{platform.suffix}"
            library.parent.mkdir()
            compile_shared_library(source_dir, library, main=fmi.main, compiler=compilers[platform])
            return library

        with ThreadPoolExecutor(os.cpu_count()) as workers:
            libraries = dict(zip(compilers, workers.map(compiled, compilers), strict=True))
        with zipfile.ZipFile(path, "w", compression=zipfile.ZIP_DEFLATED) as archive:
            add_member(archive, "modelDescription.xml", fmi.describe(block, guid, tool, directional).encode())
            for folder, platform in sorted(fmi.folders(list(compilers), host_platform()).items()):
                library = libraries[platform]
                add_member(archive, f"binaries/{folder}/{library.name}", library.read_bytes())
            for source in sorted(sources):
                add_member(archive, f"sources/{source}", sources[source].encode())


def add_member(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    """Add a file to an FMU; the same content gives the same bytes."""
    entry = zipfile.ZipInfo(name, date_time=_ZIP_TIME)
    entry.compress_type = zipfile.ZIP_DEFLATED
    entry.external_attr = 0o644 << 16
    archive.writestr(entry, content)
