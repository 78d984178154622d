"""FMI 2.0.

Source: "Functional Mock-up Interface for Model Exchange and Co-Simulation", version 2.0.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from fmu_didim.components.fmu.binding import (
    MAXIMUM_ITERATIONS,
    Binding,
    EventResult,
    Function,
    endless,
    pointer,
    references,
)
from fmu_didim.components.fmu.description import CO_SIMULATION, MODEL_EXCHANGE, FmuDescription
from fmu_didim.components.fmu.versions.base import DescriptionFile, FmiVersion, Signatures
from fmu_didim.components.fmu.versions.with_fmpy import (
    bits_or_tuple,
    callbacks,
    dependencies,
    description,
    interfaces,
    parsed,
    signatures,
)
from fmu_didim.components.native import FMI2
from fmu_didim.signals import Array


class Binding2(Binding):
    """FMI 2.0."""

    prefix = "fmi2"
    real_type = "Real"
    enumeration_type = "Integer"
    array_types: Mapping[str, Any] = {
        "Real": np.float64, "Integer": np.int32, "Enumeration": np.int32, "Boolean": np.int32
    }  # fmt: skip
    truth_type = ctypes.c_int
    state_word = "FMUstate"
    derivatives_function = "GetDerivatives"
    native_kind = FMI2

    def _instantiate(self) -> int | None:
        from fmpy import fmi2

        d = self.description
        self._callbacks = callbacks(fmi2, "fmi2", self.messages.log)
        name = self.interface.identifier.encode()
        where = d.resources.as_uri().encode()
        kind = 1 if self.co_simulation else 0
        address: int | None = self.library["fmi2Instantiate"](
            name, kind, d.token.encode(), where, ctypes.byref(self._callbacks), 0, 0
        )
        return address

    def step_call(self) -> tuple[Function, tuple[Any, ...]]:
        return self.library["fmi2DoStep"], (1,)

    def enter_initialisation(self, time: float) -> None:
        self.call("SetupExperiment", 0, 0.0, time, 0, 0.0)
        self.call("EnterInitializationMode")

    def update_discrete_states(self) -> EventResult:
        from fmpy.fmi2 import fmi2EventInfo

        info = fmi2EventInfo()
        for _ in range(MAXIMUM_ITERATIONS):
            self.call("NewDiscreteStates", ctypes.byref(info))
            if not info.newDiscreteStatesNeeded or info.terminateSimulation:
                break
        else:
            raise endless(self)
        return EventResult(bool(info.terminateSimulation), info.nextEventTime if info.nextEventTimeDefined else None)

    def directional_derivative(self, unknowns: Sequence[int], known: int, result: Array) -> None:
        seed = (ctypes.c_double * 1)(1.0)
        arguments = (references(unknowns), len(unknowns), references([known]), 1, seed, pointer(result))
        self.call("GetDirectionalDerivative", *arguments)


@cache
def _signatures(kind: str) -> Signatures:
    from fmpy.fmi2 import FMU2Model, FMU2Slave

    return signatures({CO_SIMULATION: FMU2Slave, MODEL_EXCHANGE: FMU2Model}[kind], "fmi2")


def _describe(file: DescriptionFile) -> FmuDescription:
    own = parsed(file, "2.0")
    return description(file, own, interfaces=tuple(interfaces(own, file.root)), dependencies=dependencies(own))


_COMMON = (
    "fmi2Instantiate",
    "fmi2FreeInstance",
    "fmi2SetupExperiment",
    "fmi2EnterInitializationMode",
    "fmi2ExitInitializationMode",
    "fmi2SetReal",
    "fmi2GetReal",
)

FMI_2 = FmiVersion(
    name="2.0",
    describe=_describe,
    binding=Binding2,
    required={
        CO_SIMULATION: (*_COMMON, "fmi2DoStep"),
        MODEL_EXCHANGE: (
            *_COMMON,
            "fmi2EnterEventMode",
            "fmi2NewDiscreteStates",
            "fmi2EnterContinuousTimeMode",
            "fmi2CompletedIntegratorStep",
            "fmi2SetTime",
            "fmi2SetContinuousStates",
            "fmi2GetDerivatives",
            "fmi2GetEventIndicators",
            "fmi2GetContinuousStates",
        ),
    },
    signatures=_signatures,
    platform_folders=bits_or_tuple,
)
