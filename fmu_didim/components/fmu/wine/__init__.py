"""FMUs for Windows only, run on Linux by Wine: a library for this machine passes each call to a process of Wine.

To all else such an FMU looks like any other: ``bridge.c`` has the functions of FMI 2.0 for co-simulation, starts
``host.exe`` for each instance, and that one loads the FMU's own library. Both are compiled once on a machine.
"""

from __future__ import annotations

import hashlib
import shutil
import sys
from importlib.resources import as_file, files
from pathlib import Path

from fmu_didim.base.cache import cached_folder
from fmu_didim.components.fmu.description import CO_SIMULATION, FmuDescription, Interface
from fmu_didim.export import compile_console_program, compile_sources, source_compiler
from fmu_didim.export.platforms import PLATFORMS, host_platform

FMI_VERSION = "2.0"
"""The version that the bridge implements."""
WINDOWS_FOLDER = "win64"
INSTALL = "Install Wine (Debian, Ubuntu: apt install wine), which then runs it"
_SOURCES = ("bridge.c", "host.c", "protocol.h")


def is_for_windows(fmi: str, description: FmuDescription, interface: Interface) -> bool:
    """Whether an interface has a library for 64-bit Windows that the bridge can hand calls to from this machine."""
    library = description.folder / "binaries" / WINDOWS_FOLDER / f"{interface.identifier}.dll"
    supported = sys.platform == "linux" and host_platform().architecture == "x86_64"
    return supported and fmi == FMI_VERSION and interface.kind == CO_SIMULATION and library.is_file()


def is_installed() -> bool:
    """Whether Wine is installed."""
    return shutil.which("wine") is not None


def bridge(interface: Interface) -> Path:
    """The library that hands the calls of an FMU to Wine.

    Raises:
        BuildError: there is no compiler for it, or it reports an error.
    """
    sources, compiler = files(__package__), source_compiler()
    state = hashlib.sha256(repr((interface.identifier, compiler.flags, compiler.version)).encode())
    for name in _SOURCES:
        state.update(sources.joinpath(name).read_bytes())
    library = f"{interface.identifier}.so"

    def fill(folder: Path) -> None:
        with as_file(sources) as own:
            definitions = [f'MODEL_IDENTIFIER="{interface.identifier}"']
            compile_sources(own, ["bridge.c"], folder / library, definitions=definitions, compiler=compiler)
            compile_console_program(own / "host.c", folder / "host.exe", PLATFORMS["windows-x86_64"])

    return cached_folder("compiled", f"wine-{state.hexdigest()[:32]}", fill) / library
