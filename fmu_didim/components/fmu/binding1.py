"""FMI 1.0, co-simulation.

Source: "Functional Mock-up Interface for Co-Simulation", version 1.0. There is no initialisation mode: what is set
before ``fmiInitializeSlave`` counts for it, and outputs can be asked for only afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fmu_didim.components.fmu.binding import Binding, Call, EventResult
from fmu_didim.components.fmu.library import Function
from fmu_didim.errors import SimulationError
from fmu_didim.signals import Array

_FALSE, _TRUE = b"\0", b"\1"


class Binding1(Binding):
    """FMI 1.0; value types are those of ``fmiPlatformTypes.h``, Boolean is a char."""

    major = 1
    array_types: Mapping[str, Any] = {
        "Real": np.float64, "Integer": np.int32, "Enumeration": np.int32, "Boolean": np.int8
    }  # fmt: skip

    def type_name(self, kind: str) -> str:
        return "Integer" if kind == "Enumeration" else kind

    def _instantiate(self) -> int | None:
        d = self.description
        self._start_time = 0.0
        self._is_running = False
        where = d.folder.resolve().as_uri().encode()
        tool = self.interface.needs_execution_tool
        kind = b"application/x-fmu-sharedlibrary" if not tool else b"application/x-fmu-tool-wrapper"
        more = (0.0, _FALSE, _FALSE, self.messages.callbacks_1, _FALSE)
        address: int | None = self.library["fmi1InstantiateSlave"](
            self.interface.identifier.encode(), d.token.encode(), where, kind, *more
        )
        return address

    @property
    def gives_initial_outputs(self) -> bool:
        return False

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

    def update_discrete_states(self) -> EventResult:
        raise self._only_steps()

    def derivatives_call(self, values: Array) -> Call:
        raise self._only_steps()

    def directional_derivative(self, unknowns: Sequence[int], known: int, result: Array) -> None:
        raise self._only_steps()

    def _only_steps(self) -> SimulationError:
        return SimulationError("FMI 1.0 co-simulation has only steps.", where=self.description.path.name)
