"""FMI 2.0.

Source: "Functional Mock-up Interface for Model Exchange and Co-Simulation", version 2.0.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from fmu_didim.components.fmu.binding import Binding, EventResult, Function, event_iterations, pointer, references
from fmu_didim.components.fmu.description import CO_SIMULATION, MODEL_EXCHANGE
from fmu_didim.components.fmu.versions.base import FmiVersion
from fmu_didim.components.fmu.versions.with_fmpy import bits_or_tuple, callbacks, description, signatures
from fmu_didim.components.native import FMI2
from fmu_didim.data.signals import Array


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
        d = self.description
        self._callbacks = callbacks("fmi2", self.messages.log)
        name = self.interface.identifier.encode()
        where = d.resources_uri
        kind = 1 if self.co_simulation else 0
        address: int | None = self.library["fmi2Instantiate"](
            name, kind, d.token.encode(), where, ctypes.byref(self._callbacks), 0, 0
        )
        return address

    def step_call(self) -> tuple[Function, tuple[Any, ...]]:
        return self.library["fmi2DoStep"], (1,)

    def set_up_experiment(self, time: float) -> None:
        self.call("SetupExperiment", *self.tolerance, time, 0, 0.0)

    def enter_initialisation(self, time: float) -> None:
        self.call("EnterInitializationMode")

    def update_discrete_states(self) -> EventResult:
        from fmpy.fmi2 import fmi2EventInfo

        info = fmi2EventInfo()
        for _ in event_iterations(self):
            self.call("NewDiscreteStates", ctypes.byref(info))
            if not info.newDiscreteStatesNeeded or info.terminateSimulation:
                break
        return EventResult(bool(info.terminateSimulation), info.nextEventTime if info.nextEventTimeDefined else None)

    def directional_derivative(self, unknowns: Sequence[int], known: int, result: Array) -> None:
        seed = (ctypes.c_double * 1)(1.0)
        arguments = (references(unknowns), len(unknowns), references([known]), 1, seed, pointer(result))
        self.call("GetDirectionalDerivative", *arguments)


_COMMON = "Instantiate FreeInstance SetupExperiment EnterInitializationMode ExitInitializationMode SetReal GetReal"
_EQUATIONS = (
    "EnterEventMode NewDiscreteStates EnterContinuousTimeMode CompletedIntegratorStep SetTime "
    "SetContinuousStates GetContinuousStates GetDerivatives GetEventIndicators"
)

FMI_2 = FmiVersion(
    name="2.0",
    describe=partial(description, version="2.0"),
    binding=Binding2,
    required={CO_SIMULATION: f"{_COMMON} DoStep", MODEL_EXCHANGE: f"{_COMMON} {_EQUATIONS}"},
    signatures=partial(signatures, major=2),
    platform_folders=bits_or_tuple,
)
