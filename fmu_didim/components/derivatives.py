"""Components that carry derivatives: each signal with its derivatives by some parameters of the loop.

An input ``tau1`` is followed by ``tau1@0``, ``tau1@1``, ...: its derivatives by parameter 0, 1, ... The loop wires them
as it wires the signals, so that delays, rates and the order of evaluation hold for them too.
"""

from __future__ import annotations

import ctypes
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.components.base import Component, Instance
from fmu_didim.components.native import FMI2, Native, NativeFmu
from fmu_didim.data.signals import Array, Variable
from fmu_didim.dynamics.block import Block
from fmu_didim.export.variational import lane_count, variational_library

_void, _double = ctypes.c_void_p, ctypes.c_double


_EQUATIONS = ("update", "output", "start", "rate_bound", "balance", "implicit")
"""The attributes of a block that hold them: the same objects in all that differ in values alone."""


def derivative_name(signal: str, parameter: int) -> str:
    """Name of the derivative of a signal by the parameter of this number."""
    return f"{signal}@{parameter}"


@dataclass(frozen=True)
class VariationalComponent(Component):
    """A block with its derivatives, run by compiled code.

    Attributes:
        block: the equations; substeps: of its integration, None chooses them from the block's rate.
        differentiated: its own parameters among those that the loop is differentiated by: (place among these, place
            among the parameters of the block).
        lanes: number of parameters that the loop is differentiated by.
        followed: places of the outputs whose derivatives are wanted.
    """

    block: Block
    substeps: int | None
    differentiated: tuple[tuple[int, int], ...]
    lanes: int
    followed: tuple[int, ...]

    @cached_property
    def inputs(self) -> tuple[Variable, ...]:  # type: ignore[override]
        return (*self.block.inputs, *self._derivatives(self.block.inputs))

    @cached_property
    def outputs(self) -> tuple[Variable, ...]:  # type: ignore[override]
        return (*self.block.outputs, *self._derivatives([self.block.outputs[i] for i in self.followed]))

    def _derivatives(self, variables: Sequence[Variable]) -> list[Variable]:
        lanes = range(lane_count(self.lanes))
        return [Variable(derivative_name(v.name, i), "", v.causality) for v in variables for i in lanes]

    @property
    def parameters(self) -> tuple[Variable, ...]:  # type: ignore[override]
        return self.block.parameters

    @property
    def sample_time(self) -> float | None:  # type: ignore[override]
        return self.block.sample_time

    def with_parameters(self, values: Mapping[str, float]) -> VariationalComponent:
        return replace(self, block=self.block.with_parameters(dict(values)))

    def with_names(self, inputs: tuple[Variable, ...], outputs: tuple[Variable, ...]) -> VariationalComponent:
        raise NotImplementedError("the names of derivatives follow from those of the block")

    def with_substeps(self, count: int) -> VariationalComponent:
        return replace(self, substeps=count)

    @property
    def stated_substeps(self) -> int | None:
        return self.substeps

    def instantiate(self) -> Instance:
        return _VariationalInstance(self)

    def pool_key(self) -> Hashable:
        return self.library(), self.substeps

    def has_equations_of(self, other: VariationalComponent) -> bool:
        """Whether another one differs in values alone, and in its substeps."""
        own, its = self.block, other.block
        same = all(getattr(own, part) is getattr(its, part) for part in _EQUATIONS)
        named = (own.inputs, own.outputs, own.sample_time) == (its.inputs, its.outputs, its.sample_time)
        how = (self.differentiated, self.lanes, self.followed) == (other.differentiated, other.lanes, other.followed)
        return same and named and how

    def library(self) -> Path:
        """The compiled code; raises BuildError."""
        return variational_library(self.block, self.differentiated, self.lanes, self.followed)

    def describe(self) -> dict[str, Any]:
        return {"kind": "model with derivatives", "name": self.block.name, "parameters": len(self.differentiated)}


@cache
def _loaded(path: Path) -> ctypes.CDLL:
    library = ctypes.CDLL(str(path))
    library.instance_size.restype = ctypes.c_ulonglong
    library.begin.argtypes, library.begin.restype = (_void, _void, ctypes.c_int), None
    library.finish_initialization.argtypes, library.finish_initialization.restype = (_void,), None
    for function in (library.set_values, library.get_values):
        function.argtypes = (_void, _void, ctypes.c_size_t, _void)
    library.do_step.argtypes = (_void, _double, _double, ctypes.c_int)
    return library


class _VariationalInstance(Instance):
    def __init__(self, component: VariationalComponent) -> None:
        self._component = component
        self._library = library = _loaded(component.library())
        self._memory = np.zeros(-(-int(library.instance_size()) // 8))
        self._self = self._memory.ctypes.data
        self._as_native: NativeFmu | None = None
        self.take_variables(component.inputs, component.outputs)

    def bind(self, inputs: Array, outputs: Array) -> None:
        super().bind(inputs, outputs)
        self._as_native = None

    def begin_initialisation(self, time: float) -> None:
        values = self._component.block.parameter_values
        self._library.begin(self._self, values.ctypes.data, self._component.substeps or 0)

    def end_initialisation(self) -> None:
        self._library.finish_initialization(self._self)

    def set(self) -> None:
        self._library.set_values(self._self, None, 0, self.inputs.ctypes.data)

    def get(self) -> None:
        self._library.get_values(self._self, None, 0, self.outputs.ctypes.data)

    def step(self, time: float, size: float) -> None:
        self._check("step", self._library.do_step(self._self, time, size, 0))

    def _check(self, call: str, status: int) -> None:
        if status > 1:
            raise SimulationError(
                "A state is not finite, or its equations are too stiff.", where=self._component.block.name, got=call,
                next_step="Check the values of the parameters, or shorten the step of the loop.",
            )  # fmt: skip

    def native(self) -> Native:
        if self._as_native is None:
            self._as_native = self._for_compiled_code()
        return self._as_native

    def _for_compiled_code(self) -> NativeFmu:
        none = (ctypes.c_uint32 * 1)()
        set_address, get_address, step_address = (
            ctypes.cast(function, _void).value or 0
            for function in (self._library.set_values, self._library.get_values, self._library.do_step)
        )
        return NativeFmu(
            FMI2, self._self, ("set", "get", "step"), set_address, get_address, step_address, none, none,
            self.inputs, self.outputs, input_scaling=None, output_scaling=None, check=self._check,
        )  # fmt: skip

    def restart(self, component: Component) -> bool:
        assert isinstance(component, VariationalComponent)
        self._component = component
        return True

    def save_state(self) -> Any:
        return self._memory.copy()

    def restore_state(self, state: Any) -> None:
        self._memory[:] = state
