"""Shared libraries of FMUs: found, loaded once in a process, their functions with the signatures of the standard."""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import re
import threading
from pathlib import Path
from xml.etree import ElementTree as ET

from fmu_didim.base.cache import cached_folder
from fmu_didim.base.errors import BuildError, FmuError, LibraryError
from fmu_didim.base.files import is_file
from fmu_didim.components.fmu import wine
from fmu_didim.components.fmu.archive import DESCRIPTION, check_description
from fmu_didim.components.fmu.binding import Function, Library
from fmu_didim.components.fmu.description import CO_SIMULATION, FmuDescription, Interface
from fmu_didim.components.fmu.versions.base import FmiVersion
from fmu_didim.export import compile_sources, source_compiler


def library_file(fmi: FmiVersion, description: FmuDescription, interface: Interface) -> Path:
    """The library of an interface for this machine.

    Raises:
        FmuError: there is no binary for this platform and no sources that compile, or its name is not the model
            identifier.
    """
    import fmpy

    if not re.fullmatch(r"\w[\w.-]*", interface.identifier):  # no path
        raise FmuError(
            "The modelIdentifier of the FMU is not a valid name.", where=f"{description.path}, {interface.kind}",
            got=interface.identifier, valid="letters, digits and underscores", next_step="Ask its maker.",
        )  # fmt: skip
    folders = fmi.platform_folders()
    suffix = str(fmpy.sharedLibraryExtension)
    places = [description.folder / "binaries" / f for f in folders]
    for place in places:
        file = place / f"{interface.identifier}{suffix}"
        if is_file(file):
            return file
    where = f"{description.path}, {interface.kind}"
    others = sorted(f.name for place in places if place.is_dir() for f in place.iterdir() if f.suffix == suffix)
    if others:
        raise FmuError(
            "The shared library of the FMU has a wrong name, so it cannot be loaded.",
            where=where,
            got=", ".join(others),
            valid=f"{interface.identifier}{suffix}, after the modelIdentifier",
            next_step="Rename the file in the FMU, or correct the modelIdentifier in its modelDescription.xml.",
        )
    advice, failed = _EXPORT, "The FMU holds no binary for this platform, and its sources could not be compiled."
    try:
        if names := source_files(description.folder, interface):
            return _compiled(description, interface, *names, suffix=suffix)
        if wine.is_for_windows(fmi.name, description, interface):
            advice = f"{wine.INSTALL}; or export it with a binary for this platform."
            failed = "The FMU holds a library for Windows only, and the bridge to Wine could not be compiled."
            if wine.is_installed():
                _log.info("%s holds a library for Windows only: Wine runs it.", description.path.name)
                return wine.bridge(interface)
    except BuildError as error:
        got = f"binaries for {', '.join(description.platforms) or 'no platform'}; {_first_error(str(error.got))}"
        raise FmuError(failed, where=where, got=got, next_step=_EXPORT) from error
    missing = "" if description.interface(CO_SIMULATION) else " The FMU has no co-simulation interface either."
    raise FmuError(
        f"The FMU cannot be loaded: it holds no binary for this platform.{missing}",
        where=where,
        got=", ".join(description.platforms) or "no binaries at all",
        valid=folders,
        next_step=advice,
    )


_log = logging.getLogger(__name__)
_EXPORT = "Export it with a binary for this platform (as the exporting tool calls it, e.g. Linux 64 bit)."
_INCLUDED = re.compile(r'^\s*#\s*include\s*"([^"]+\.c)"', re.MULTILINE)
LONGEST_SOURCE = 2**20
"""[bytes] Part of a source file that is searched for its includes."""


def source_files(folder: Path, interface: Interface) -> tuple[list[str], list[str]] | None:
    """C files that an interface is made of, and definitions of the preprocessor; None if it holds none."""
    sources = folder / "sources"
    names: list[str] = []
    definitions: list[str] = []
    for file in (sources / "buildDescription.xml", folder / DESCRIPTION):
        if names or not file.is_file():
            continue
        check_description(file.read_bytes(), file)
        for element in ET.parse(file).getroot().iter():
            if element.get("modelIdentifier") == interface.identifier:
                names += [e.get("name", "") for e in (*element.iter("SourceFile"), *element.iter("File"))]
                found = element.iter("PreprocessorDefinition")
                definitions += ["=".join(filter(None, (e.get("name"), e.get("value")))) for e in found]
    listed = [name for name in dict.fromkeys(names) if name.endswith(".c") and (sources / name).is_file()]
    return (listed or _main_files(sources), definitions) if listed or any(sources.glob("*.c")) else None


def _main_files(sources: Path) -> list[str]:
    """The C files of a folder that no other file of it includes."""
    included: set[str] = set()
    for file in (*sources.glob("*.c"), *sources.glob("*.h")):
        included |= set(_INCLUDED.findall(file.read_bytes()[:LONGEST_SOURCE].decode("utf-8", "replace")))
    return sorted(path.name for path in sources.glob("*.c") if path.name not in included)


def _first_error(text: str) -> str:
    """The first error that a compiler reports."""
    lines = [line for line in text.splitlines() if "error" in line]
    return (lines or text.splitlines() or [""])[0][:500]


def _compiled(
    description: FmuDescription, interface: Interface, names: list[str], definitions: list[str], *, suffix: str
) -> Path:
    """The library of an FMU that holds sources, compiled once on a machine."""
    compiler = source_compiler()
    how = repr((interface.identifier, names, definitions, compiler.flags, compiler.version))
    key = f"{description.digest}-{hashlib.sha256(how.encode()).hexdigest()[:16]}"
    library = f"{interface.identifier}{suffix}"

    def fill(folder: Path) -> None:
        sources = description.folder / "sources"
        compile_sources(sources, names, folder / library, definitions=definitions, compiler=compiler)

    return cached_folder("compiled", key, fill) / library


def load_library(fmi: FmiVersion, description: FmuDescription, interface: Interface) -> Library:
    """The functions of an FMU's library; loaded once in a process, since that costs more than a short run.

    Raises:
        FmuError: there is no library for this machine, it does not load, or a function is missing; LibraryError: FMPy
            does not know its functions.
    """
    key = (description.folder, fmi.name, interface.kind, interface.identifier)
    with CURRENT_FOLDER:
        if key not in _loaded:
            file = library_file(fmi, description, interface)
            _loaded[key] = _load(file, fmi, interface, str(description.path))
        return _loaded[key]


CURRENT_FOLDER = threading.Lock()
"""Held while the current folder, which all threads share, is changed for a moment, and while it is read."""
_loaded: dict[tuple[Path, str, str, str], Library] = {}


def _load(file: Path, fmi: FmiVersion, interface: Interface, where: str) -> Library:
    folder = Path.cwd()
    try:
        os.chdir(file.parent)  # some libraries look there for those they depend on
        dll = ctypes.CDLL(str(file))
    except OSError as error:
        raise FmuError(
            "The shared library of the FMU cannot be loaded.",
            where=where,
            got=str(error),
            next_step="Install the libraries that it needs (ldd FILE lists them), or export it with them inside.",
        ) from error
    finally:
        os.chdir(folder)
    required = [f"{fmi.binding.prefix}{name}" for name in fmi.required[interface.kind].split()]
    signatures = fmi.signatures(interface.kind)
    if unknown := [name for name in required if name not in signatures]:
        raise LibraryError("fmpy", got=f"it does not know {', '.join(unknown)}")
    found: dict[str, Function] = {}
    for name, (arguments, result) in signatures.items():
        symbol = fmi.symbol(name, interface.identifier)
        # Functions of sources may carry the model's name, as for static linking.
        function = getattr(dll, symbol, None) or getattr(dll, f"{interface.identifier}_{symbol}", None)
        if function is not None:
            function.argtypes, function.restype = arguments, result
            found[name] = function
    missing = [name for name in required if name not in found]
    if missing:
        raise FmuError(
            "The shared library of the FMU lacks functions that it must have.",
            where=where,
            got=f"without {', '.join(missing)}",
            next_step="Export the FMU again, or ask its maker for a complete binary.",
        )
    return found
