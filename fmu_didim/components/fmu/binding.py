"""All versions of FMI behind one set of calls; each binding works on one instance of an FMU.

Where the loop spends its time (real values, steps, derivatives) a binding hands out the C function and its
arguments, made once, so that nothing of this module is in the way.
"""

from __future__ import annotations

import ctypes
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmu_didim.components.fmu.description import CO_SIMULATION, REAL_TYPES, FmuDescription, Interface
from fmu_didim.components.fmu.library import Function, Library, Messages
from fmu_didim.errors import FmuError, SimulationError
from fmu_didim.signals import Array

STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
MAXIMUM_ITERATIONS = 1000
"""Event iterations at one instant, and pieces of one step, before an FMU is said not to get on."""
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


@dataclass(frozen=True)
class StepResult:
    """What a step left: whether events wait, whether to stop, whether it came back early, and the time reached (s)."""

    event: bool
    terminate: bool
    early: bool
    time: float


class Binding(ABC):
    """One instance of an FMU and the functions of its library.

    Raises (all methods):
        SimulationError: a function returned a status worse than a warning; the FMU's own messages are included.
    """

    major: int
    array_types: Mapping[str, Any]
    """Type of a variable -> numpy type of its values in C."""

    def __init__(
        self, description: FmuDescription, interface: Interface, library: Library, *, event_mode: bool = False
    ) -> None:
        self.description, self.library, self.event_mode = description, library, event_mode
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
            self.forget_states()
            self._free()
            self.c = None

    def _free(self) -> None:
        self.library[f"fmi{self.major}FreeInstance"](self.c)

    def forget_states(self, keep: ctypes.c_void_p | None = None) -> None:
        """Free the saved states, but for one."""
        for state in self._states:
            if state is not keep:
                self.library[self._state_function("Free")](self.c, ctypes.byref(state))
        self._states = [state for state in self._states if state is keep]

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
        count = (1,) if self.major == 3 else ()
        if kind == "String":
            text = (ctypes.c_char_p * 1)(str(value).encode())
            self.call("SetString", references([reference]), 1, text, *count)
        else:
            function, arguments = self.typed_call("Set", kind, [reference], np.array([value], self.array_types[kind]))
            self.check(f"fmi{self.major}Set{self.type_name(kind)}", function(*arguments))

    def type_name(self, kind: str) -> str:
        """How the functions for variables of a type are called."""
        return kind

    def typed_call(self, verb: str, kind: str, numbers: Sequence[int], values: Any) -> Call:
        """The call that sets (``Set``) or gets (``Get``) variables of a type; ``values`` is of its array type."""
        name = f"fmi{self.major}{verb}{self.type_name(kind)}"
        function: Any = self.library.get(name)
        if function is None:
            raise FmuError(f"The FMU has no function {name}.", where=self.description.path.name)
        count = (values.size,) if self.major == 3 else ()
        place = values.ctypes.data_as(function.argtypes[3])
        return function, (self.c, references(numbers), len(numbers), place, *count)

    def real_call(self, verb: str, numbers: Sequence[int], values: Array) -> Call:
        """The call that sets (``Set``) or gets (``Get``) these real variables from or into the array."""
        return self.typed_call(verb, REAL_TYPES[0] if self.major < 3 else REAL_TYPES[1], numbers, values)

    @abstractmethod
    def _instantiate(self) -> int | None: ...

    @property
    def gives_initial_outputs(self) -> bool:
        """Whether outputs can be asked for while it is being initialised."""
        return True

    @abstractmethod
    def step_call(self) -> tuple[Function, tuple[Any, ...]]:
        """The function that steps, and its arguments after (instance, time, size)."""

    def step_result(self) -> StepResult | None:
        """What the last step left, of FMI 3.0; None if there was nothing special."""
        return None

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


def endless(binding: Binding) -> SimulationError:
    """The error of an event iteration without end."""
    return SimulationError(
        "The event iteration of the FMU does not end.",
        where=binding.description.path.name,
        got=f"{MAXIMUM_ITERATIONS} iterations at one instant",
    )
