"""Shared libraries of FMUs: found, loaded once in a process, their functions with the signatures of the standard."""

from __future__ import annotations

import ctypes
import os
import re
import threading
from pathlib import Path

from fmu_didim.components.fmu.binding import Function, Library
from fmu_didim.components.fmu.description import CO_SIMULATION, FmuDescription, Interface
from fmu_didim.components.fmu.versions.base import FmiVersion
from fmu_didim.errors import FmuError
from fmu_didim.files import is_file


def library_file(fmi: FmiVersion, description: FmuDescription, interface: Interface) -> Path:
    """The library of an interface for this machine.

    Raises:
        FmuError: there is no binary for this platform, or its name is not the model identifier.
    """
    import fmpy

    if not re.fullmatch(r"\w[\w.-]*", interface.identifier):  # no path
        raise FmuError(
            "The modelIdentifier of the FMU is no name.", where=f"{description.path}, {interface.kind}",
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
    missing = "" if description.interface(CO_SIMULATION) else " The FMU has no co-simulation interface either."
    raise FmuError(
        f"The FMU cannot be loaded: it holds no binary for this platform.{missing}",
        where=where,
        got=", ".join(description.platforms) or "no binaries at all",
        valid=folders,
        next_step="Export it with a binary for this platform (as the exporting tool calls it, e.g. Linux 64 bit).",
    )


def load_library(fmi: FmiVersion, description: FmuDescription, interface: Interface) -> Library:
    """The functions of an FMU's library; loaded once in a process, since that costs more than a short run.

    Raises:
        FmuError: there is no library for this machine, it does not load, or a function is missing.
    """
    key = (description.folder, fmi.name, interface.kind, interface.identifier)
    with _one_at_a_time:  # the working directory, which is changed for a moment, belongs to all threads
        if key not in _loaded:
            file = library_file(fmi, description, interface)
            _loaded[key] = _load(file, fmi, interface, str(description.path))
        return _loaded[key]


_one_at_a_time = threading.Lock()
_loaded: dict[tuple[Path, str, str, str], Library] = {}


def _load(file: Path, fmi: FmiVersion, interface: Interface, where: str) -> Library:
    here = Path.cwd()
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
        os.chdir(here)
    found: dict[str, Function] = {}
    for name, (arguments, result) in fmi.signatures(interface.kind).items():
        function = getattr(dll, fmi.symbol(name, interface.identifier), None)
        if function is not None:
            function.argtypes, function.restype = arguments, result
            found[name] = function
    required = [f"{fmi.binding.prefix}{name}" for name in fmi.required[interface.kind].split()]
    missing = [name for name in required if name not in found]
    if missing:
        raise FmuError(
            "The shared library of the FMU lacks functions that it must have.",
            where=where,
            got=f"without {', '.join(missing)}",
            next_step="Export the FMU again, or ask its maker for a complete binary.",
        )
    return found
