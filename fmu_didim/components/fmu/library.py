"""Shared libraries of FMUs: found, loaded once in a process, their functions with the signatures of the standard.

The signatures are FMPy's, read from the annotations of its classes; the functions are called without FMPy in between.
"""

from __future__ import annotations

import ctypes
import inspect
import os
import threading
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from fmu_didim.components.fmu.description import CO_SIMULATION, FmuDescription, Interface
from fmu_didim.errors import FmuError

Function = Callable[..., Any]

_COMMON_2 = [
    "fmi2Instantiate",
    "fmi2FreeInstance",
    "fmi2SetupExperiment",
    "fmi2EnterInitializationMode",
    "fmi2ExitInitializationMode",
    "fmi2SetReal",
    "fmi2GetReal",
]
_COMMON_3 = [
    "fmi3FreeInstance",
    "fmi3EnterInitializationMode",
    "fmi3ExitInitializationMode",
    "fmi3SetFloat64",
    "fmi3GetFloat64",
]
_EXCHANGE_2 = [
    "fmi2EnterEventMode",
    "fmi2NewDiscreteStates",
    "fmi2EnterContinuousTimeMode",
    "fmi2CompletedIntegratorStep",
    "fmi2SetTime",
    "fmi2SetContinuousStates",
    "fmi2GetDerivatives",
    "fmi2GetEventIndicators",
    "fmi2GetContinuousStates",
]
_EXCHANGE_3 = [
    "fmi3InstantiateModelExchange",
    "fmi3EnterEventMode",
    "fmi3UpdateDiscreteStates",
    "fmi3EnterContinuousTimeMode",
    "fmi3CompletedIntegratorStep",
    "fmi3SetTime",
    "fmi3SetContinuousStates",
    "fmi3GetContinuousStateDerivatives",
    "fmi3GetEventIndicators",
    "fmi3GetContinuousStates",
]
REQUIRED = {
    (1, True): (
        "fmi1InstantiateSlave",
        "fmi1InitializeSlave",
        "fmi1TerminateSlave",
        "fmi1FreeSlaveInstance",
        "fmi1SetReal",
        "fmi1GetReal",
        "fmi1DoStep",
    ),
    (2, True): (*_COMMON_2, "fmi2DoStep"),
    (2, False): (*_COMMON_2, *_EXCHANGE_2),
    (3, True): (*_COMMON_3, "fmi3InstantiateCoSimulation", "fmi3DoStep"),
    (3, False): (*_COMMON_3, *_EXCHANGE_3),
}
"""Functions without which an FMU cannot be run, by FMI version and whether it is co-simulation."""


@dataclass(frozen=True)
class Library:
    """A loaded library: its functions by name; those it does not have are missing."""

    functions: Mapping[str, Function]

    def __getitem__(self, name: str) -> Function:
        return self.functions[name]

    def get(self, name: str) -> Function | None:
        """The function, None if the library does not have it."""
        return self.functions.get(name)


def platform_folders(major: int) -> tuple[str, ...]:
    """Names under which binaries for this machine may lie in ``binaries/``, the standard's own first."""
    import fmpy

    bits, pair = str(fmpy.platform), str(fmpy.platform_tuple)
    if major == 3:
        return (pair,)
    return (bits, pair) if pair.startswith("x86") else (pair, bits)


def library_file(description: FmuDescription, interface: Interface) -> Path:
    """The library of an interface for this machine.

    Raises:
        FmuError: there is no binary for this platform, or its name is not the model identifier.
    """
    import fmpy

    folders = platform_folders(description.major)
    suffix = str(fmpy.sharedLibraryExtension)
    places = [description.folder / "binaries" / f for f in folders]
    for place in places:
        file = place / f"{interface.identifier}{suffix}"
        if file.is_file():
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


def load_library(description: FmuDescription, interface: Interface) -> Library:
    """The functions of an FMU's library; loaded once in a process, since that costs more than a short run.

    Raises:
        FmuError: there is no library for this machine, it does not load, or a function is missing.
    """
    key = (description.folder, description.major, interface.kind, interface.identifier)
    with _one_at_a_time:  # the working directory, which is changed for a moment, belongs to all threads
        if key not in _loaded:
            file = library_file(description, interface)
            # The functions of FMI 1.0 bear its name.
            prefix = f"{interface.identifier}_fmi" if description.major == 1 else ""
            _loaded[key] = _load(
                file, description.major, interface.kind == CO_SIMULATION, prefix, str(description.path)
            )
        return _loaded[key]


_one_at_a_time = threading.Lock()
_loaded: dict[tuple[Path, int, str, str], Library] = {}


def _load(file: Path, major: int, co_simulation: bool, prefix: str, where: str) -> Library:
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
    for name, (arguments, result) in _signatures(major, co_simulation).items():
        function = getattr(dll, name.replace("fmi1", prefix) if prefix else name, None)
        if function is not None:
            function.argtypes, function.restype = arguments, result
            found[name] = function
    missing = [name for name in REQUIRED[major, co_simulation] if name not in found]
    if missing:
        raise FmuError(
            "The shared library of the FMU lacks functions that it must have.",
            where=where,
            got=f"without {', '.join(missing)}",
            next_step="Export the FMU again, or ask its maker for a complete binary.",
        )
    return Library(found)


@cache
def _signatures(major: int, co_simulation: bool) -> dict[str, tuple[list[Any], Any]]:
    """Argument and result types of the functions of an interface."""
    if major == 1:
        return _signatures_1()
    from fmpy import fmi2, fmi3

    owner = {
        (2, True): fmi2.FMU2Slave, (2, False): fmi2.FMU2Model, (3, True): fmi3.FMU3Slave, (3, False): fmi3.FMU3Model
    }[major, co_simulation]  # fmt: skip
    found = {}
    for name, method in inspect.getmembers(owner, inspect.isfunction):
        if not name.startswith(f"fmi{major}"):
            continue
        signature = inspect.signature(method)
        annotations = [p.annotation for p in list(signature.parameters.values())[1:]]
        arguments = [typing.get_args(a)[0] if isinstance(a, types.UnionType) else a for a in annotations]
        stated = signature.return_annotation
        found[name] = (arguments, {bytes: ctypes.c_char_p, int: ctypes.c_int}.get(stated, stated))
    return found


def _signatures_1() -> dict[str, tuple[list[Any], Any]]:
    """Those of FMI 1.0 co-simulation; FMPy's have wrong results."""
    from fmpy.fmi1 import fmi1CallbackFunctions

    number, truth, text, instance = ctypes.c_double, ctypes.c_char, ctypes.c_char_p, ctypes.c_void_p
    status = ctypes.c_int
    found: dict[str, tuple[list[Any], Any]] = {
        "fmi1InstantiateSlave": (
            [text, text, text, text, number, truth, truth, fmi1CallbackFunctions, truth],
            instance,
        ),
        "fmi1InitializeSlave": ([instance, number, truth, number], status),
        "fmi1TerminateSlave": ([instance], status),
        "fmi1ResetSlave": ([instance], status),
        "fmi1FreeSlaveInstance": ([instance], None),
        "fmi1DoStep": ([instance, number, number, truth], status),
    }
    elements: dict[str, Any] = {
        "Real": ctypes.c_double,
        "Integer": ctypes.c_int,
        "Boolean": ctypes.c_char,
        "String": text,
    }
    for name, element in elements.items():
        arguments = [instance, ctypes.POINTER(ctypes.c_uint), ctypes.c_size_t, ctypes.POINTER(element)]
        found |= {f"fmi1{verb}{name}": (arguments, status) for verb in ("Get", "Set")}
    return found


class Messages:
    """What an FMU writes to its logger: the last lines, kept for error messages."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    @cached_property
    def callbacks_1(self) -> Any:
        """For FMI 1.0."""
        from fmpy import calloc, fmi1, free

        callbacks = fmi1.fmi1CallbackFunctions()
        callbacks.logger = fmi1.fmi1CallbackLoggerTYPE(self._log_2)
        callbacks.allocateMemory = fmi1.fmi1CallbackAllocateMemoryTYPE(calloc)
        callbacks.freeMemory = fmi1.fmi1CallbackFreeMemoryTYPE(free)
        return callbacks

    @cached_property
    def callbacks_2(self) -> Any:
        """For FMI 2.0."""
        from fmpy import calloc, fmi2, free

        callbacks = fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self._log_2)
        callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(calloc)
        callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(free)
        return callbacks

    @cached_property
    def callback_3(self) -> Any:
        """For FMI 3.0."""
        from fmpy import fmi3

        return fmi3.fmi3LogMessageCallback(self._log_3)

    def _log_2(self, environment: Any, name: bytes, status: int, category: bytes, message: bytes) -> None:
        self._keep(message)

    def _log_3(self, environment: Any, status: int, category: bytes, message: bytes) -> None:
        self._keep(message)

    def _keep(self, message: bytes | None) -> None:
        if message:
            self.lines.append(message.decode("utf-8", "replace"))
            del self.lines[:-20]

    def said(self) -> str | None:
        """The last lines, None if there are none."""
        return "; ".join(self.lines[-3:]) or None
