"""FMI 2.0 and 3.0 behind one set of calls; each works on one instance of an FMU.

Where the loop spends its time (real values, steps, derivatives) a binding hands out the C function and its
arguments, made once, so that nothing of this module is in the way.
"""

from __future__ import annotations

import ctypes
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmu_didim.components.fmu.description import CO_SIMULATION, INTEGER_TYPES, FmuDescription, Interface
from fmu_didim.components.fmu.library import Function, Library, Messages
from fmu_didim.errors import FmuError, SimulationError
from fmu_didim.signals import Array

STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
Call = tuple[Function, tuple[Any, ...]]
_DOUBLES = ctypes.POINTER(ctypes.c_double)


def references(numbers: Sequence[int]) -> ctypes.Array[ctypes.c_uint]:
    """Value references as a C array."""
    return (ctypes.c_uint * len(numbers))(*numbers)


def pointer(values: Array) -> Any:
    """The address of an array for C; the array must live as long."""
    return values.ctypes.data_as(_DOUBLES)


def address(function: Any) -> int:
    """Address of a C function or of what a ``c_void_p`` points to."""
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)


@dataclass(frozen=True)
class EventResult:
    """What an event iteration left: whether to stop, and the next time event (s) or None."""

    terminate: bool
    next_time: float | None


class Binding(ABC):
    """One instance of an FMU and the functions of its library.

    Raises (all methods):
        SimulationError: a function returned a status worse than a warning; the FMU's own messages are included.
    """

    major: int

    def __init__(self, description: FmuDescription, interface: Interface, library: Library) -> None:
        self.description, self.library = description, library
        self.co_simulation = interface.kind == CO_SIMULATION
        self.interface = interface
        self.messages = Messages()
        address = self._instantiate()
        if not address:
            raise FmuError(
                "The FMU cannot be instantiated.",
                where=str(description.path),
                got=self.messages.said(),
                next_step=self._advice(),
            )
        self.c: Any = ctypes.c_void_p(address)
        self._states: list[ctypes.c_void_p] = []

    def _advice(self) -> str:
        if self.interface.needs_execution_tool:
            return "It needs its tool to run (needsExecutionTool): install it, or export a self-contained FMU."
        if self.interface.once_per_process:
            return "It allows one instance in a process: close the other one, or load it with isolated=True."
        return ""

    def check(self, call: str, status: int) -> None:
        """Raise SimulationError if a status is worse than a warning."""
        if status > 1:
            name = STATUS[status] if status < len(STATUS) else f"status {status}"
            said = self.messages.said()
            advice = "The FMU refuses this step: choose another control rate." if name == "Discard" else ""
            raise SimulationError(
                f"{call} of the FMU returned {name}.", where=self.description.path.name, got=said, next_step=advice
            )

    def call(self, name: str, *arguments: Any) -> None:
        """Call ``fmiN<name>`` with the instance and these arguments; one that is missing is an error too."""
        full = f"fmi{self.major}{name}"
        function = self.library.get(full)
        if function is None:
            raise SimulationError(f"The FMU has no function {full}.", where=self.description.path.name)
        self.check(full, function(self.c, *arguments))

    def reset(self) -> None:
        """Back to the state after the instantiation, as far as the FMU does what it should."""
        self.call("Reset")

    def exit_initialisation(self) -> None:
        """End the initialisation mode."""
        self.call("ExitInitializationMode")

    def close(self) -> None:
        """Free the saved states and the instance; may be called twice."""
        if self.c is not None:
            for state in self._states:
                self.library[self._state_function("Free")](self.c, ctypes.byref(state))
            self._states.clear()
            self.library[f"fmi{self.major}FreeInstance"](self.c)
            self.c = None

    def save_state(self) -> ctypes.c_void_p:
        """A copy of the complete state, freed with the instance."""
        if not self.interface.has_state:
            raise SimulationError(
                "This FMU cannot save its state.",
                where=self.description.path.name,
                got="canGetAndSetFMUstate is false",
                next_step="Run it from the start instead.",
            )
        state = ctypes.c_void_p()
        name = self._state_function("Get")
        self.check(name, self.library[name](self.c, ctypes.byref(state)))
        self._states.append(state)
        return state

    def restore_state(self, state: ctypes.c_void_p) -> None:
        """Go back to a saved state."""
        name = self._state_function("Set")
        self.check(name, self.library[name](self.c, state))

    def _state_function(self, verb: str) -> str:
        return f"fmi{self.major}{verb}FMU{'state' if self.major == 2 else 'State'}"

    def set_option(self, kind: str, reference: int, value: int | float | str | bool) -> None:
        """Set an Integer, Enumeration, Boolean or String variable."""
        name, element, converted = self._option(kind, value)
        count = (1,) if self.major == 3 else ()
        self.call(f"Set{name}", references([reference]), 1, (element * 1)(converted), *count)

    @abstractmethod
    def _instantiate(self) -> int | None: ...

    @abstractmethod
    def _option(self, kind: str, value: Any) -> tuple[str, Any, Any]: ...

    @abstractmethod
    def real_call(self, verb: str, numbers: Sequence[int], values: Array) -> Call:
        """The call that sets (``Set``) or gets (``Get``) these real variables from or into the array."""

    @abstractmethod
    def step_call(self) -> tuple[Function, tuple[Any, ...]]:
        """The function that steps, and its arguments after (instance, time, size)."""

    @abstractmethod
    def stopped_early(self) -> bool:
        """Whether the last step ended the simulation or came back early."""

    @abstractmethod
    def enter_initialisation(self, time: float) -> None:
        """Begin the initialisation at ``time`` (s)."""

    @abstractmethod
    def update_discrete_states(self) -> EventResult:
        """Event iteration until nothing changes any more, in event mode."""

    @abstractmethod
    def derivatives_call(self, values: Array) -> Call:
        """The call that fills ``values`` with the derivatives of the continuous states."""

    def exchange_call(self, name: str, values: Array) -> Call:
        """A call (instance, array, size) of model exchange, such as ``SetContinuousStates``."""
        return self.library[f"fmi{self.major}{name}"], (self.c, pointer(values), values.size)

    @abstractmethod
    def directional_derivative(self, unknowns: Sequence[int], known: int, result: Array) -> None:
        """d unknowns / d known into ``result``, scalars only."""


class Binding2(Binding):
    """FMI 2.0."""

    major = 2

    def _instantiate(self) -> int | None:
        d = self.description
        name = self.interface.identifier.encode()
        where = (d.folder / "resources").resolve().as_uri().encode()
        kind = 1 if self.co_simulation else 0
        callbacks = ctypes.byref(self.messages.callbacks)
        address: int | None = self.library["fmi2Instantiate"](name, kind, d.token.encode(), where, callbacks, 0, 0)
        return address

    def _option(self, kind: str, value: Any) -> tuple[str, Any, Any]:
        if kind == "String":
            return "String", ctypes.c_char_p, str(value).encode()
        return ("Boolean" if kind == "Boolean" else "Integer"), ctypes.c_int, int(value)

    def real_call(self, verb: str, numbers: Sequence[int], values: Array) -> Call:
        return self.library[f"fmi2{verb}Real"], (self.c, references(numbers), len(numbers), pointer(values))

    def step_call(self) -> tuple[Function, tuple[Any, ...]]:
        return self.library["fmi2DoStep"], (1,)

    def stopped_early(self) -> bool:
        return False

    def enter_initialisation(self, time: float) -> None:
        self.call("SetupExperiment", 0, 0.0, time, 0, 0.0)
        self.call("EnterInitializationMode")

    def update_discrete_states(self) -> EventResult:
        from fmpy.fmi2 import fmi2EventInfo

        info = fmi2EventInfo()
        for _ in range(_MAXIMUM_ITERATIONS):
            self.call("NewDiscreteStates", ctypes.byref(info))
            if not info.newDiscreteStatesNeeded or info.terminateSimulation:
                break
        else:
            raise _endless(self)
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

    def _instantiate(self) -> int | None:
        d = self.description
        self._flags = (ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool())
        self._last_time = ctypes.c_double()
        name, token = self.interface.identifier.encode(), d.token.encode()
        folder = d.folder / "resources"
        where = f"{folder.resolve()}/".encode() if folder.is_dir() else None
        address: int | None
        if self.co_simulation:
            from fmpy.fmi3 import fmi3IntermediateUpdateCallback

            self._update = fmi3IntermediateUpdateCallback()
            options = (False, False, False, False, references([]), 0, None, self.messages.callback_3, self._update)
            address = self.library["fmi3InstantiateCoSimulation"](name, token, where, *options)
        else:
            more = (False, False, None, self.messages.callback_3)
            address = self.library["fmi3InstantiateModelExchange"](name, token, where, *more)
        return address

    def _option(self, kind: str, value: Any) -> tuple[str, Any, Any]:
        if kind == "String":
            return kind, ctypes.c_char_p, str(value).encode()
        if kind == "Boolean":
            return kind, ctypes.c_bool, bool(value)
        name = "Int64" if kind == "Enumeration" else kind
        return name, getattr(ctypes, f"c_{name.lower()}"), int(value)

    def real_call(self, verb: str, numbers: Sequence[int], values: Array) -> Call:
        arguments = (self.c, references(numbers), len(numbers), pointer(values), values.size)
        return self.library[f"fmi3{verb}Float64"], arguments

    def step_call(self) -> tuple[Function, tuple[Any, ...]]:
        return self.library["fmi3DoStep"], (True, *(ctypes.byref(x) for x in (*self._flags, self._last_time)))

    def stopped_early(self) -> bool:
        _, terminate, early = self._flags
        return bool(terminate.value or early.value)

    def enter_initialisation(self, time: float) -> None:
        self.call("EnterInitializationMode", False, 0.0, time, False, 0.0)

    def update_discrete_states(self) -> EventResult:
        need, terminate, nominals, values, defined = (ctypes.c_bool() for _ in range(5))
        following = ctypes.c_double()
        arguments = [ctypes.byref(x) for x in (need, terminate, nominals, values, defined, following)]
        for _ in range(_MAXIMUM_ITERATIONS):
            self.call("UpdateDiscreteStates", *arguments)
            if not need.value or terminate.value:
                break
        else:
            raise _endless(self)
        return EventResult(terminate.value, following.value if defined.value else None)

    def derivatives_call(self, values: Array) -> Call:
        return self.exchange_call("GetContinuousStateDerivatives", values)

    def directional_derivative(self, unknowns: Sequence[int], known: int, result: Array) -> None:
        seed = np.ones(1)
        head = (references(unknowns), len(unknowns), references([known]), 1)
        self.call("GetDirectionalDerivative", *head, pointer(seed), 1, pointer(result), result.size)


_MAXIMUM_ITERATIONS = 1000


def _endless(binding: Binding) -> SimulationError:
    return SimulationError(
        "The event iteration of the FMU does not end.",
        where=binding.description.path.name,
        got=f"{_MAXIMUM_ITERATIONS} iterations at one instant",
    )


def is_option(kind: str) -> bool:
    """Whether values of this type are set as options."""
    return kind in INTEGER_TYPES or kind in ("Boolean", "String")
