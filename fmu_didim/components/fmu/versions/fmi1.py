"""FMI 1.0, co-simulation.

Source: "Functional Mock-up Interface for Co-Simulation", version 1.0. There is no initialisation mode: what is set
before ``fmiInitializeSlave`` counts for it, and outputs can be asked for only afterwards.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from fmu_didim.components.fmu.binding import Binding, Function
from fmu_didim.components.fmu.description import CO_SIMULATION, FmuDescription, Interface
from fmu_didim.components.fmu.versions.base import TRUE, DescriptionFile, FmiVersion, Signatures
from fmu_didim.components.fmu.versions.with_fmpy import bits_or_tuple, callbacks, description

_FALSE, _TRUE = b"\0", b"\1"


class Binding1(Binding):
    """FMI 1.0; value types are those of ``fmiPlatformTypes.h``, Boolean is a char."""

    prefix = "fmi1"
    real_type = "Real"
    enumeration_type = "Integer"
    gives_initial_outputs = False
    array_types: Mapping[str, Any] = {
        "Real": np.float64, "Integer": np.int32, "Enumeration": np.int32, "Boolean": np.int8
    }  # fmt: skip

    def _instantiate(self) -> int | None:
        d = self.description
        self._start_time = 0.0
        self._is_running = False
        self._callbacks = callbacks("fmi1", self.messages.log)
        where = d.folder.resolve().as_uri().encode()
        tool = self.interface.needs_execution_tool
        kind = b"application/x-fmu-sharedlibrary" if not tool else b"application/x-fmu-tool-wrapper"
        more = (0.0, _FALSE, _FALSE, self._callbacks, _FALSE)
        address: int | None = self.library["fmi1InstantiateSlave"](
            self.interface.identifier.encode(), d.token.encode(), where, kind, *more
        )
        return address

    def step_call(self) -> tuple[Function, tuple[Any, ...]]:
        return self.library["fmi1DoStep"], (_TRUE,)

    def enter_initialisation(self, time: float) -> None:
        self._start_time = time

    def exit_initialisation(self) -> None:
        self.call("InitializeSlave", self._start_time, _FALSE, 0.0)
        self._is_running = True

    def reset(self) -> None:
        self.call("ResetSlave")
        self._is_running = False

    def _free(self) -> None:
        if self._is_running:
            self.library["fmi1TerminateSlave"](self.c)
        self.library["fmi1FreeSlaveInstance"](self.c)


@cache
def _signatures(kind: str) -> Signatures:
    """Written out, as FMPy's have wrong result types."""
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


def _symbol(name: str, identifier: str) -> str:
    """``fmi1DoStep`` is ``<model identifier>_fmiDoStep``."""
    return name.replace("fmi1", f"{identifier}_fmi", 1)


def _refusal(root: ET.Element) -> str:
    return "" if root.find("Implementation") is not None else "model exchange only"


def _describe(file: DescriptionFile) -> FmuDescription:
    variables = file.root.iterfind("ModelVariables/ScalarVariable[@alias='negatedAlias']")
    found = description(file, "1.0", negated=frozenset(e.attrib["name"] for e in variables))
    return replace(found, interfaces=(_interface(file.root),), dependencies=_dependencies(file.root))


def _interface(root: ET.Element) -> Interface:
    """Section 3.3 of the standard."""
    tool = root.find("Implementation/CoSimulation_Tool")
    able = root.find("Implementation/*/Capabilities")
    stated = able.attrib if able is not None else {}
    return Interface(
        kind=CO_SIMULATION,
        identifier=root.get("modelIdentifier", ""),
        needs_execution_tool=tool is not None,
        once_per_process=stated.get("canBeInstantiatedOnlyOncePerProcess") in TRUE,
        has_variable_step=stated.get("canHandleVariableCommunicationStepSize") in TRUE,
    )


def _dependencies(root: ET.Element) -> dict[str, tuple[str, ...] | None]:
    found: dict[str, tuple[str, ...] | None] = {}
    for variable in root.iterfind("ModelVariables/ScalarVariable[@causality='output']"):
        stated = variable.find("DirectDependency")
        found[variable.attrib["name"]] = (
            None if stated is None else tuple(e.text or "" for e in stated.iterfind("Name"))
        )
    return found


FMI_1 = FmiVersion(
    name="1.0",
    describe=_describe,
    binding=Binding1,
    required={
        CO_SIMULATION: "InstantiateSlave InitializeSlave TerminateSlave FreeSlaveInstance SetReal GetReal DoStep"
    },
    signatures=_signatures,
    platform_folders=bits_or_tuple,
    symbol=_symbol,
    refusal=_refusal,
)
