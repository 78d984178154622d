"""From a block to an .fmu file, built once and then taken from the cache."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
import uuid
import zipfile
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path

from fmu_didim.block import Block
from fmu_didim.cache import cached_folder
from fmu_didim.export.build import (
    Compiler,
    compile_shared_library,
    find_compiler,
    library_suffix,
    platform_folder,
)
from fmu_didim.export.c_code import CONFIG_FILE, EQUATIONS_FILE, check_exportable, generate_c, generate_config
from fmu_didim.export.model_description import model_description

MAIN_SOURCE = "fmi2.c"
_WRAPPER_FILES = ("block.h", "block.c", MAIN_SOURCE)
_GENERATORS = ("c_code.py", "model_description.py", "fmu.py")
_ZIP_TIME = (1980, 1, 1, 0, 0, 0)  # the earliest a zip file can hold; the same content gives the same bytes


def build_fmu(block: Block, *, directory: Path | None = None) -> Path:
    """An FMI 2.0 FMU of a block, for co-simulation and model exchange, with binary and sources.

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

    Returns:
        The file: the copy if ``directory`` is given, else the one in the cache.

    Raises:
        InputError: a name or a start value cannot be exported.
        BuildError: there is no compiler, or it reports an error.

    Source: "Functional Mock-up Interface for Model Exchange and Co-Simulation", version 2.0.
    """
    check_exportable(block)
    content = _content_digest(block)
    compiler = find_compiler()
    file_name = f"{block.name}.fmu"
    folder = cached_folder(
        "exported", _key(content, compiler), lambda new: _build(block, content, compiler, new / file_name)
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


def _content_digest(block: Block) -> str:
    """SHA-256 of everything that decides what the FMU computes, whatever compiler builds it.

    The source of the exporter itself is part of it: whoever changes it never meets files of the old one.
    """
    state = hashlib.sha256(f"{_package_version()} casadi {version('casadi')}".encode())
    state.update(block.digest().encode())
    state.update(block.description.encode())
    state.update(generate_config(block, guid="").encode())  # holds the constants of the substep rule
    for name in _WRAPPER_FILES:
        state.update(_wrapper_source(name).encode())
    for name in _GENERATORS:
        state.update((files("fmu_didim.export") / name).read_bytes())
    return state.hexdigest()


def _key(content: str, compiler: Compiler) -> str:
    parts = (content, platform_folder(), *compiler.command, *compiler.flags, compiler.version)
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]


def _build(block: Block, content: str, compiler: Compiler, path: Path) -> None:
    guid = f"{{{uuid.UUID(content[:32])}}}"
    sources = {name: _wrapper_source(name) for name in _WRAPPER_FILES}
    sources[CONFIG_FILE] = generate_config(block, guid=guid)
    sources[EQUATIONS_FILE] = generate_c(block)
    description = model_description(
        block, guid=guid, generation_tool=f"fmu_didim {_package_version()}", source_files=[MAIN_SOURCE]
    )
    with tempfile.TemporaryDirectory(prefix="fmu_didim-") as name:
        source_dir = Path(name)
        for file_name, text in sources.items():
            (source_dir / file_name).write_text(text, encoding="utf-8", newline="\n")
        library = source_dir / f"{block.name}{library_suffix()}"
        compile_shared_library(source_dir, library, main=MAIN_SOURCE, compiler=compiler)
        with zipfile.ZipFile(path, "w", compression=zipfile.ZIP_DEFLATED) as archive:
            _add(archive, "modelDescription.xml", description.encode())
            _add(archive, f"binaries/{platform_folder()}/{library.name}", library.read_bytes())
            for file_name in sorted(sources):
                _add(archive, f"sources/{file_name}", sources[file_name].encode())


def _add(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    entry = zipfile.ZipInfo(name, date_time=_ZIP_TIME)
    entry.compress_type = zipfile.ZIP_DEFLATED
    entry.external_attr = 0o644 << 16
    archive.writestr(entry, content)


def _wrapper_source(name: str) -> str:
    return (files("fmu_didim.export") / "wrapper" / name).read_text(encoding="utf-8")


def _package_version() -> str:
    try:
        return version("fmu_didim")
    except PackageNotFoundError:  # run from a folder that is not installed
        return "0"
