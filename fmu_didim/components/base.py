"""The one interface of everything that runs in the loop, plant or controller.

A :class:`Component` is an immutable description; ``instantiate`` makes the running
:class:`Instance`, the only thing that changes. The order of calls is

    begin_initialisation, any number of (set, get), end_initialisation,
    then at each instant: set, get, step.

After ``set``, ``get`` returns the outputs at the present instant, direct feed-through included.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fmu_didim.base.errors import SimulationError, UnknownNameError
from fmu_didim.components.native import Native
from fmu_didim.data.signals import Array, Variable
from fmu_didim.dynamics.block import Block

DIFFERENCE_STEP = 1e-5
"""Relative step of central differences: truncation and rounding are both of the order 1e-10."""

START_NAME = re.compile(r"\w+_start\d+")
"""Of a parameter in which a state starts."""


class Instance(ABC):
    """A running component. ``inputs`` (nu,) and ``outputs`` (ny,) are its buffers, with their names.

    The master may replace them once, before initialisation, by views into its own memory (``bind``),
    so that no values are copied in the loop.
    """

    inputs: Array
    outputs: Array
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    slopes: Array | None = None
    """(nu,) By how much its inputs change a second within a step, of a component that follows ramps; None: held."""

    def take_variables(self, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> None:
        """Take the names of these variables, and new buffers: inputs at their start values, outputs 0."""
        self.input_names = tuple(v.name for v in inputs)
        self.output_names = tuple(v.name for v in outputs)
        self.bind(np.array([v.start for v in inputs], dtype=float), np.zeros(len(outputs)))

    def bind(self, inputs: Array, outputs: Array) -> None:
        """Use these contiguous buffers from now on."""
        self.inputs, self.outputs = inputs, outputs

    @abstractmethod
    def begin_initialisation(self, time: float) -> None:
        """Start the initialisation at ``time`` (s)."""

    @abstractmethod
    def end_initialisation(self) -> None:
        """Fix the initial state from the inputs set last."""

    @abstractmethod
    def set(self) -> None:
        """Hand the input buffer to the component."""

    @abstractmethod
    def get(self) -> None:
        """Fill the output buffer with the outputs at the present instant."""

    @abstractmethod
    def step(self, time: float, size: float) -> None:
        """Advance from ``time`` by ``size`` (s), inputs held; raises SimulationError."""

    def set_parameters(self, values: Mapping[str, float]) -> None:
        """Change tunable parameters now; raises SimulationError where that is not possible."""
        raise SimulationError(
            "The parameters of this component cannot be changed while it runs.",
            next_step="Set them before the simulation, in the component.",
        )  # fmt: skip

    def derivatives(
        self, outputs: Sequence[int], inputs: Sequence[int], parameters: Mapping[str, float]
    ) -> tuple[Array, Array]:
        """Partial derivatives of some outputs at the present instant, state and other inputs fixed.

        By central differences; an instance that knows its derivatives overrides this.

        Args:
            outputs, inputs: positions in the buffers; parameters: present values by name.

        Returns:
            d outputs / d inputs (no, ni) and d outputs / d parameters (no, np).
        """
        columns = []
        before = self.inputs.copy()
        for i in inputs:
            step = DIFFERENCE_STEP * max(abs(before[i]), 1.0)
            pair = []
            for sign in (1.0, -1.0):
                self.inputs[i] = before[i] + sign * step
                self.set()
                self.get()
                pair.append(self.outputs[list(outputs)].copy())
            self.inputs[i] = before[i]
            columns.append((pair[0] - pair[1]) / (2 * step))
        self.set()
        by_parameter = []
        for name, value in parameters.items():
            step = DIFFERENCE_STEP * (abs(value) or 1.0)
            pair = []
            for sign in (1.0, -1.0):
                self.set_parameters({name: value + sign * step})
                self.get()
                pair.append(self.outputs[list(outputs)].copy())
            self.set_parameters({name: value})
            by_parameter.append((pair[0] - pair[1]) / (2 * step))
        self.get()
        return (
            np.reshape(columns, (len(inputs), len(outputs))).T,
            np.reshape(by_parameter, (len(parameters), len(outputs))).T,
        )

    @abstractmethod
    def save_state(self) -> Any:
        """A copy of the complete state."""

    @abstractmethod
    def restore_state(self, state: Any) -> None:
        """Go back to a saved state."""

    def native(self) -> Native | None:
        """How compiled code runs this instance, asked after the initialisation; None if only Python can.

        The same object as in its last run means that nothing has changed in it.
        """
        return None

    def restart(self, component: Component) -> bool:
        """Become the instance that ``component.instantiate()`` would give, without loading it again.

        Its buffers may stay those that it was bound to, with what is in them.

        Args:
            component: the same as the one this instance was made from, parameter values aside.

        Returns:
            Whether that was possible; if not, the instance must be closed and a new one made.
        """
        return False

    def close(self) -> None:  # noqa: B027 - most components hold nothing that must be released
        """Release all resources; the instance must not be used afterwards."""


@dataclass(frozen=True, eq=False)
class SameObject:
    """An immutable object as a part of a key: only the very same object is equal, and it lives as long as the key."""

    value: object

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SameObject) and other.value is self.value

    def __hash__(self) -> int:
        return id(self.value)


class Component(ABC):
    """Immutable and picklable description of something that runs in the loop.

    Attributes:
        inputs, outputs, parameters: its variables; ``start`` of a parameter is its present value.
        sample_time: period in s of a sampled system, None for a continuous one or if unknown.
    """

    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    parameters: tuple[Variable, ...]
    sample_time: float | None

    @abstractmethod
    def with_parameters(self, values: Mapping[str, float]) -> Component:
        """The same component with other values of the named parameters; raises UnknownNameError."""

    @abstractmethod
    def with_names(self, inputs: tuple[Variable, ...], outputs: tuple[Variable, ...]) -> Component:
        """The same component with other names of its inputs and outputs, in the same order."""

    @abstractmethod
    def instantiate(self) -> Instance:
        """A new running instance."""

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """Kind, origin and options, for the provenance of a result."""

    @property
    def follows_ramps(self) -> bool:
        """Whether its inputs may go straight from one communication point to the next; else it holds them."""
        return False

    @property
    def takes_any_step(self) -> bool:
        """Whether its communication steps may differ in size."""
        return True

    def feedthrough(self) -> frozenset[tuple[str, str]] | None:
        """Pairs (output, input) where the output depends on the present input at once; None if unknown."""
        return None

    def pool_key(self) -> Hashable | None:
        """Equal for components whose instances can replace each other after a restart; None if there are no others."""
        return None

    def response_key(self) -> Hashable | None:
        """Key of the response to the inputs, parameter values included: equal keys, equal responses.

        None: it is not known, or two runs may differ, as of an FMU of another tool.
        """
        return None

    def compiled(self) -> Component:
        """A component that does the same and runs in compiled code, or this one if there is no such component."""
        return self

    def equations(self) -> tuple[Block, int | None] | None:
        """The block that it computes, with its present names and values, and the substeps of its integration (None:
        chosen from the block's rate); None if it computes something else, or what it computes is not known."""
        return None

    def with_substeps(self, count: int) -> Component | None:
        """The same component with ``count`` integration substeps a step; None if that cannot be chosen."""
        return None

    @property
    def stated_substeps(self) -> int | None:
        """Integration substeps a step if their number was stated; None if it is chosen, or nothing is integrated."""
        return None

    @property
    def start_parameters(self) -> tuple[str, ...]:
        """Names of those parameters that say where its states start, as far as that is known: fixed ones named
        ``<state>_start<j>``."""
        known = self.equations()
        return () if known is None else start_names(known[0].fixed)

    @property
    def start_candidates(self) -> tuple[str, ...]:
        """Names that may say where its states start: of an FMU of another tool all that can be set."""
        return self.start_parameters

    def parameter_values(self) -> dict[str, float]:
        """Present values by name."""
        return {v.name: v.start for v in self.parameters}


def start_names(names: Iterable[str]) -> tuple[str, ...]:
    """Those of the names that are ``<state>_start<j>``."""
    return tuple(sorted(name for name in names if START_NAME.fullmatch(name)))


def check_names(kind: str, names: Iterable[str], valid: Iterable[Variable], *, where: str) -> None:
    """Raise UnknownNameError for the first name that is not among the variables."""
    known = [v.name for v in valid]
    for name in names:
        if name not in known:
            raise UnknownNameError(kind, name, known, where=where)


def rename(component: Component, *, inputs: Mapping[str, str], outputs: Mapping[str, str]) -> Component:
    """Give inputs and outputs the names of their roles in the loop.

    Args:
        inputs, outputs: role -> own name. Others keep their names.

    Raises:
        UnknownNameError: the component has no variable of that own name.
    """
    if not inputs and not outputs:
        return component

    def renamed(kind: str, variables: tuple[Variable, ...], roles: Mapping[str, str]) -> tuple[Variable, ...]:
        check_names(kind, roles.values(), variables, where="mapping of names in the case")
        back = {name: role for role, name in roles.items()}
        return tuple(replace(v, name=back.get(v.name, v.name)) for v in variables)

    return component.with_names(
        renamed("input", component.inputs, inputs), renamed("output", component.outputs, outputs)
    )


def block_feedthrough(block: Block) -> frozenset[tuple[str, str]]:
    """Pairs (output, input) of a block where the output function depends on the input, by its sparsity."""
    rows, columns = block.output.jac_sparsity(0, 1).get_triplet()
    return frozenset((block.outputs[i].name, block.inputs[j].name) for i, j in zip(rows, columns, strict=True))


class SampleClock:
    """The sample instants t0 + n T of a system; n is counted, so that rounding does not add up."""

    def __init__(self, start: float, period: float) -> None:
        self.start, self.period, self.count = start, period, 0

    def is_due(self, time: float) -> bool:
        """Whether ``time`` is the next sample instant (to 1e-6 of a period)."""
        return abs(time - self._next()) <= 1e-6 * self.period

    def is_before(self, time: float) -> bool:
        """Whether the next sample instant lies clearly before ``time``."""
        return self._next() < time - 1e-6 * self.period

    def _next(self) -> float:
        return self.start + self.count * self.period
