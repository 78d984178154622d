"""All versions of FMI behind one set of calls; each binding works on one instance of an FMU.

Where the loop spends its time (real values, steps, derivatives) a binding hands out the C function and its
arguments, made once, so that nothing of this module is in the way.
"""

from __future__ import annotations

import ctypes
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import repeat
from typing import Any

import numpy as np

from fmu_didim.base.errors import FmuError, SimulationError
from fmu_didim.components.fmu.description import CO_SIMULATION, FmuDescription, Interface
from fmu_didim.data.signals import Array

STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
MAXIMUM_ITERATIONS = 1000
"""Event iterations at one instant, and pieces of one step, after which an FMU is reported to make no progress."""
Function = Callable[..., Any]
Library = Mapping[str, Function]
"""The functions of a loaded library by name; those it does not have are missing."""
Call = tuple[Function, tuple[Any, ...]]
_DOUBLES = ctypes.POINTER(ctypes.c_double)


def references(numbers: Sequence[int]) -> ctypes.Array[ctypes.c_uint]:
    """Value references as a C array, which FMUs only read: the same one for the same numbers."""
    return _references(tuple(numbers))


@lru_cache(maxsize=256)
def _references(numbers: tuple[int, ...]) -> ctypes.Array[ctypes.c_uint]:
    return (ctypes.c_uint * len(numbers))(*numbers)


def _in_c(values: Any, pointer_type: Any) -> Any:
    """An array as the argument of a C function that takes this type of pointer; it keeps the array alive."""
    if not values.size:
        return pointer_type()
    return (pointer_type._type_ * values.size).from_buffer(values)


def pointer(values: Array) -> Any:
    """The address of an array for C; the array must live as long."""
    return values.ctypes.data_as(_DOUBLES)


def address(function: Any) -> int:
    """Address of a C function."""
    return ctypes.c_void_p.from_buffer(function).value or 0


class Messages:
    """The last lines that an FMU wrote to its logger, for error messages."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def log(self, *arguments: Any) -> None:
        """The logger: in every version of FMI the message is the last argument."""
        if arguments[-1]:
            self.lines.append(arguments[-1].decode("utf-8", "replace"))
            del self.lines[:-20]

    def last_lines(self) -> str | None:
        """The last lines; None if there are no lines."""
        return "; ".join(self.lines[-3:]) or None


class EndedError(SimulationError):
    """An FMU wants the simulation to end, as it may."""


@dataclass(frozen=True)
class EventResult:
    """Result of an event iteration: whether to stop, and the next time event (s) or None."""

    terminate: bool
    next_time: float | None


@dataclass(frozen=True)
class StepResult:
    """Result of a step: whether events wait, whether to stop, whether it returned early, and the time reached (s)."""

    event: bool
    terminate: bool
    early: bool
    time: float


class Binding(ABC):
    """One instance of an FMU and the functions of its library.

    Raises (all methods):
        SimulationError: a function returned a status worse than a warning; the FMU's own messages are included.

    Attributes:
        prefix: how the names of its functions begin.
        array_types: type of a variable -> numpy type of its values in C.
        real_type, enumeration_type: the types whose functions pass real values and enumerations.
        truth_type: of flags, in C; state_word: what the functions for states end in.
        passes_sizes: whether the functions that pass values take their number.
        derivatives_function: of the continuous states, without the prefix.
        native_kind: how the compiled loop calls it (:mod:`fmu_didim.components.native`), None if it cannot.
        gives_initial_outputs: whether outputs can be asked for while it is being initialised.
        tolerance: whether one is given when a run is set up, and which.
    """

    prefix: str
    array_types: Mapping[str, Any]
    real_type: str
    enumeration_type: str
    truth_type: Any = ctypes.c_bool
    state_word: str = "FMUState"
    passes_sizes: bool = False
    derivatives_function: str = ""
    native_kind: int | None = None
    gives_initial_outputs: bool = True

    def __init__(
        self, description: FmuDescription, interface: Interface, library: Library, *, event_mode: bool = False,
        tolerance: float | None = None,
    ) -> None:  # fmt: skip
        self.description, self.library, self.event_mode = description, library, event_mode
        self.tolerance = (0, 0.0) if tolerance is None else (1, tolerance)
        self.co_simulation = interface.kind == CO_SIMULATION
        self.interface = interface
        self.messages = Messages()
        address = self._instantiate()
        if not address:
            advice = ""
            if interface.needs_execution_tool:
                advice = "It needs its tool to run (needsExecutionTool): install it, or export a self-contained FMU."
            elif interface.once_per_process:
                advice = "It allows one instance in a process: close the other one, or load it with isolated=True."
            where, got = str(description.path), self.messages.last_lines()
            raise FmuError("The FMU cannot be instantiated.", where=where, got=got, next_step=advice)
        self.c: Any = ctypes.c_void_p(address)
        self._states: list[ctypes.c_void_p] = []

    def check(self, call: str, status: int) -> None:
        """Raise SimulationError if a status is worse than a warning."""
        if status > 1:
            name = STATUS[status] if status < len(STATUS) else f"status {status}"
            lines = self.messages.last_lines()
            advice = "The FMU refuses this step: choose another control rate." if name == "Discard" else ""
            raise SimulationError(
                f"{call} of the FMU returned {name}.", where=self.description.path.name, got=lines, next_step=advice
            )

    def call(self, name: str, *arguments: Any) -> None:
        """Call ``<prefix><name>`` with the instance and these arguments; one that is missing is an error too."""
        full = f"{self.prefix}{name}"
        function = self.library.get(full)
        if function is None:
            raise SimulationError(
                f"The FMU has no function {full}.", where=self.description.path.name,
                next_step="Export the FMU again with a complete interface; fmu-didim fmu check FILE tries it.",
            )  # fmt: skip
        self.check(full, function(self.c, *arguments))

    def reset(self) -> None:
        """Return to the state after the instantiation, if the FMU resets correctly."""
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
        self.library[f"{self.prefix}FreeInstance"](self.c)

    def forget_states(self, keep: ctypes.c_void_p | None = None) -> None:
        """Free the saved states, but for one."""
        for state in self._states:
            if state is not keep:
                self.library[f"{self.prefix}Free{self.state_word}"](self.c, ctypes.byref(state))
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
        self.call(f"Get{self.state_word}", ctypes.byref(state))
        self._states.append(state)
        return state

    def restore_state(self, state: ctypes.c_void_p) -> None:
        """Go back to a saved state."""
        self.call(f"Set{self.state_word}", state)

    def set_option(self, kind: str, reference: int, value: int | float | str | bool) -> None:
        """Set an Integer, Enumeration, Boolean or String variable."""
        if kind == "String":
            text = (ctypes.c_char_p * 1)(str(value).encode())
            count = (1,) if self.passes_sizes else ()
            self.call("SetString", references([reference]), 1, text, *count)
        else:
            function, arguments = self.typed_call("Set", kind, [reference], np.array([value], self.array_types[kind]))
            self.check(self._value_function("Set", kind), function(*arguments))

    def _value_function(self, verb: str, kind: str) -> str:
        return f"{self.prefix}{verb}{self.enumeration_type if kind == 'Enumeration' else kind}"

    def typed_call(self, verb: str, kind: str, numbers: Sequence[int], values: Any) -> Call:
        """The call that sets (``Set``) or gets (``Get``) variables of a type; ``values`` is of its array type."""
        name = self._value_function(verb, kind)
        function: Any = self.library.get(name)
        if function is None:
            raise FmuError(
                f"The FMU has no function {name}.", where=self.description.path.name,
                next_step="Export the FMU again with a complete interface; fmu-didim fmu check FILE tries it.",
            )  # fmt: skip
        count = (values.size,) if self.passes_sizes else ()
        return function, (self.c, references(numbers), len(numbers), _in_c(values, function.argtypes[3]), *count)

    def real_call(self, verb: str, numbers: Sequence[int], values: Array) -> Call:
        """The call that sets (``Set``) or gets (``Get``) these real variables from or into the array."""
        return self.typed_call(verb, self.real_type, numbers, values)

    def read_back(self, kind: str, numbers: Sequence[int], count: int) -> Array | None:
        """Present values (count,) of variables that were set; None where the FMU does not let them be read."""
        if self._value_function("Get", kind) not in self.library:
            return None
        values = np.zeros(count, self.array_types[kind])
        function, arguments = self.typed_call("Get", kind, numbers, values)
        return None if function(*arguments) > 1 else values

    @abstractmethod
    def _instantiate(self) -> int | None: ...

    @abstractmethod
    def step_call(self) -> tuple[Function, tuple[Any, ...]]:
        """The function that steps, and its arguments after (instance, time, size)."""

    def step_result(self) -> StepResult | None:
        """The event or early return of the last step; None if it was an ordinary step."""
        return None

    def set_up_experiment(self, time: float) -> None:  # noqa: B027 - most versions have no such call
        """Set the start time (s), before any value is set: some FMUs then take their start values again."""

    @abstractmethod
    def enter_initialisation(self, time: float) -> None:
        """Begin the initialisation at ``time`` (s)."""

    def set_clock(self, reference: int) -> None:
        """Let a clock tick, in event mode."""
        raise self._without("clocks")

    def update_discrete_states(self) -> EventResult:
        """Event iteration until no value changes, in event mode."""
        raise self._without("events")

    def exchange_call(self, name: str, values: Array) -> Call:
        """A call (instance, array, size) of model exchange, such as ``SetContinuousStates``."""
        return self.library[f"{self.prefix}{name}"], (self.c, pointer(values), values.size)

    def directional_derivative(self, unknowns: Sequence[int], known: int, result: Array) -> None:
        """d unknowns / d known into ``result``, scalars only."""
        raise self._without("derivatives")

    def _without(self, what: str) -> SimulationError:
        return SimulationError(
            f"FMUs of FMI {self.description.version} have no {what}.", where=self.description.path.name,
            next_step="Export the FMU as FMI 3.0.",
        )  # fmt: skip


def event_iterations(binding: Binding) -> Iterator[None]:
    """As many event iterations as there may be at one instant; raises SimulationError after them."""
    yield from repeat(None, MAXIMUM_ITERATIONS)
    raise no_end_of_events(binding)


def no_end_of_events(binding: Binding) -> SimulationError:
    """The error of an FMU whose event iteration goes on and on."""
    return SimulationError(
        "The event iteration of the FMU does not end.", where=binding.description.path.name,
        got=f"{MAXIMUM_ITERATIONS} iterations at one instant",
        next_step="Report it to the maker of the FMU, or take its co-simulation interface.",
    )  # fmt: skip
