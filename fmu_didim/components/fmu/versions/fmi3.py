"""FMI 3.0.

Source: "Functional Mock-up Interface Specification", version 3.0.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from fmu_didim.components.fmu.binding import (
    Binding,
    EventResult,
    Function,
    StepResult,
    event_iterations,
    pointer,
    references,
)
from fmu_didim.components.fmu.description import CO_SIMULATION, MODEL_EXCHANGE, ClockVariable, FmuDescription
from fmu_didim.components.fmu.versions.base import DescriptionFile, FmiVersion
from fmu_didim.components.fmu.versions.with_fmpy import description, platform_tuple, signatures
from fmu_didim.components.native import FMI3
from fmu_didim.data.signals import Array


class Binding3(Binding):
    """FMI 3.0."""

    prefix = "fmi3"
    real_type = "Float64"
    enumeration_type = "Int64"
    array_types: Mapping[str, Any] = {
        **{f"{sign}{bits}": np.dtype(f"{sign}{bits}".lower()) for sign in ("Int", "UInt") for bits in (8, 16, 32, 64)},
        "Float64": np.float64,
        "Float32": np.float32,
        "Enumeration": np.int64,
        "Boolean": np.bool_,
    }
    truth_type = ctypes.c_bool
    passes_sizes = True
    state_word = "FMUState"
    derivatives_function = "GetContinuousStateDerivatives"
    native_kind = FMI3

    def _instantiate(self) -> int | None:
        from fmpy import fmi3

        d = self.description
        self._flags = (ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool())
        self._last_time = ctypes.c_double()
        self._log = fmi3.fmi3LogMessageCallback(self.messages.log)
        name, token = self.interface.identifier.encode(), d.token.encode()
        where = f"{d.resources}/".encode() if d.resources.is_dir() else None
        address: int | None
        if self.co_simulation:
            self._update = fmi3.fmi3IntermediateUpdateCallback()
            # An early return is of use only where its event can be handled.
            events = (self.event_mode, self.event_mode)
            options = (False, False, *events, references([]), 0, None, self._log, self._update)
            address = self.library["fmi3InstantiateCoSimulation"](name, token, where, *options)
        else:
            more = (False, False, None, self._log)
            address = self.library["fmi3InstantiateModelExchange"](name, token, where, *more)
        return address

    def step_call(self) -> tuple[Function, tuple[Any, ...]]:
        return self.library["fmi3DoStep"], (True, *(ctypes.byref(x) for x in (*self._flags, self._last_time)))

    def step_result(self) -> StepResult | None:
        event, terminate, early = self._flags
        if not (terminate.value or early.value or event.value):
            return None
        return StepResult(event.value, terminate.value, early.value, self._last_time.value)

    def set_clock(self, reference: int) -> None:
        self.call("SetClock", references([reference]), 1, (ctypes.c_bool * 1)(True))

    def enter_initialisation(self, time: float) -> None:
        self.call("EnterInitializationMode", *self.tolerance, time, False, 0.0)

    def update_discrete_states(self) -> EventResult:
        need, terminate, nominals, values, defined = (ctypes.c_bool() for _ in range(5))
        following = ctypes.c_double()
        arguments = [ctypes.byref(x) for x in (need, terminate, nominals, values, defined, following)]
        for _ in event_iterations(self):
            self.call("UpdateDiscreteStates", *arguments)
            if not need.value or terminate.value:
                break
        return EventResult(terminate.value, following.value if defined.value else None)

    def directional_derivative(self, unknowns: Sequence[int], known: int, result: Array) -> None:
        seed = np.ones(1)
        head = (references(unknowns), len(unknowns), references([known]), 1)
        self.call("GetDirectionalDerivative", *head, pointer(seed), 1, pointer(result), result.size)


def _describe(file: DescriptionFile) -> FmuDescription:
    clocks = tuple(_clock(e) for e in file.root.iterfind("ModelVariables/Clock"))
    return replace(description(file, "3.0"), clocks=clocks)


def _clock(element: ET.Element) -> ClockVariable:
    """Interval and shift in s, as decimals or as counters of a resolution."""
    resolution = float(element.get("resolution") or 1)

    def seconds(what: str) -> float | None:
        if element.get(f"{what}Decimal") is not None:
            return float(element.attrib[f"{what}Decimal"])
        counter = element.get(f"{what}Counter")
        return None if counter is None else int(counter) / resolution

    return ClockVariable(
        name=element.attrib["name"],
        reference=int(element.attrib["valueReference"]),
        causality=element.get("causality", "local"),
        variability=element.get("intervalVariability", ""),
        interval=seconds("interval"),
        shift=seconds("shift") or 0.0,
    )


_COMMON = "FreeInstance EnterInitializationMode ExitInitializationMode SetFloat64 GetFloat64"
_EQUATIONS = (
    "EnterEventMode UpdateDiscreteStates EnterContinuousTimeMode CompletedIntegratorStep SetTime "
    "SetContinuousStates GetContinuousStates GetContinuousStateDerivatives GetEventIndicators"
)

FMI_3 = FmiVersion(
    name="3.0",
    describe=_describe,
    binding=Binding3,
    required={
        CO_SIMULATION: f"{_COMMON} InstantiateCoSimulation DoStep",
        MODEL_EXCHANGE: f"{_COMMON} InstantiateModelExchange {_EQUATIONS}",
    },
    signatures=partial(signatures, major=3),
    platform_folders=platform_tuple,
    has_minors=True,
)
