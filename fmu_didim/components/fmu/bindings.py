"""FMI 2.0 and 3.0."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fmu_didim.components.fmu.binding import (
    MAXIMUM_ITERATIONS,
    Binding,
    Call,
    EventResult,
    StepResult,
    endless,
    pointer,
    references,
)
from fmu_didim.components.fmu.library import Function
from fmu_didim.signals import Array


class Binding2(Binding):
    """FMI 2.0."""

    major = 2
    array_types: Mapping[str, Any] = {
        "Real": np.float64, "Integer": np.int32, "Enumeration": np.int32, "Boolean": np.int32
    }  # fmt: skip

    def type_name(self, kind: str) -> str:
        return "Integer" if kind == "Enumeration" else kind

    def _instantiate(self) -> int | None:
        d = self.description
        name = self.interface.identifier.encode()
        where = d.resources.as_uri().encode()
        kind = 1 if self.co_simulation else 0
        callbacks = ctypes.byref(self.messages.callbacks_2)
        address: int | None = self.library["fmi2Instantiate"](name, kind, d.token.encode(), where, callbacks, 0, 0)
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

    def derivatives_call(self, values: Array) -> Call:
        return self.exchange_call("GetDerivatives", values)

    def directional_derivative(self, unknowns: Sequence[int], known: int, result: Array) -> None:
        seed = (ctypes.c_double * 1)(1.0)
        arguments = (references(unknowns), len(unknowns), references([known]), 1, seed, pointer(result))
        self.call("GetDirectionalDerivative", *arguments)


class Binding3(Binding):
    """FMI 3.0."""

    major = 3
    array_types: Mapping[str, Any] = {
        **{f"{sign}{bits}": np.dtype(f"{sign}{bits}".lower()) for sign in ("Int", "UInt") for bits in (8, 16, 32, 64)},
        "Float64": np.float64,
        "Float32": np.float32,
        "Enumeration": np.int64,
        "Boolean": np.bool_,
    }

    def type_name(self, kind: str) -> str:
        return "Int64" if kind == "Enumeration" else kind

    def _instantiate(self) -> int | None:
        d = self.description
        self._flags = (ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool())
        self._last_time = ctypes.c_double()
        name, token = self.interface.identifier.encode(), d.token.encode()
        where = f"{d.resources}/".encode() if d.resources.is_dir() else None
        address: int | None
        if self.co_simulation:
            from fmpy.fmi3 import fmi3IntermediateUpdateCallback

            self._update = fmi3IntermediateUpdateCallback()
            # An early return is of use only where its event can be handled.
            options = (
                False,
                False,
                self.event_mode,
                self.event_mode,
                references([]),
                0,
                None,
                self.messages.callback_3,
                self._update,
            )
            address = self.library["fmi3InstantiateCoSimulation"](name, token, where, *options)
        else:
            more = (False, False, None, self.messages.callback_3)
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
        """Let a clock tick, in event mode."""
        self.call("SetClock", references([reference]), 1, (ctypes.c_bool * 1)(True))

    def enter_initialisation(self, time: float) -> None:
        self.call("EnterInitializationMode", False, 0.0, time, False, 0.0)

    def update_discrete_states(self) -> EventResult:
        need, terminate, nominals, values, defined = (ctypes.c_bool() for _ in range(5))
        following = ctypes.c_double()
        arguments = [ctypes.byref(x) for x in (need, terminate, nominals, values, defined, following)]
        for _ in range(MAXIMUM_ITERATIONS):
            self.call("UpdateDiscreteStates", *arguments)
            if not need.value or terminate.value:
                break
        else:
            raise endless(self)
        return EventResult(terminate.value, following.value if defined.value else None)

    def derivatives_call(self, values: Array) -> Call:
        return self.exchange_call("GetContinuousStateDerivatives", values)

    def directional_derivative(self, unknowns: Sequence[int], known: int, result: Array) -> None:
        seed = np.ones(1)
        head = (references(unknowns), len(unknowns), references([known]), 1)
        self.call("GetDirectionalDerivative", *head, pointer(seed), 1, pointer(result), result.size)
