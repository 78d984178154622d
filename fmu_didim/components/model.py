"""A block evaluated by CasADi's virtual machine: the reference for the FMU of the block."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.components.base import Component, Instance, SampleClock, block_feedthrough
from fmu_didim.components.evaluator import Evaluator
from fmu_didim.data.signals import Array, Variable
from fmu_didim.dynamics.block import MAXIMUM_SUBSTEPS, Block, Steps, choose_steps, runge_kutta_step


@dataclass(frozen=True)
class ModelComponent(Component):
    """A :class:`Block` as a component; continuous blocks advance by equal substeps, linearly implicit where they know
    their stiff part, else of RK4.

    Attributes:
        block: the equations.
        substeps: in a communication step; None chooses them, and the method that needs less, from the block's rates.
        twin: the same block as C code, which a compiled loop runs instead (see :func:`with_compiled_twin`).
    """

    block: Block
    substeps: int | None = None
    twin: Component | None = None

    @property
    def inputs(self) -> tuple[Variable, ...]:  # type: ignore[override]
        return self.block.inputs

    @property
    def outputs(self) -> tuple[Variable, ...]:  # type: ignore[override]
        return self.block.outputs

    @property
    def parameters(self) -> tuple[Variable, ...]:  # type: ignore[override]
        return self.block.parameters

    @property
    def sample_time(self) -> float | None:  # type: ignore[override]
        return self.block.sample_time

    def with_parameters(self, values: Mapping[str, float]) -> ModelComponent:
        twin = self.twin.with_parameters(values) if self.twin is not None else None
        return ModelComponent(self.block.with_parameters(dict(values)), self.substeps, twin)

    def with_names(self, inputs: tuple[Variable, ...], outputs: tuple[Variable, ...]) -> ModelComponent:
        twin = self.twin.with_names(inputs, outputs) if self.twin is not None else None
        return replace(self, block=replace(self.block, inputs=inputs, outputs=outputs), twin=twin)

    def with_substeps(self, count: int) -> ModelComponent:
        twin = self.twin.with_substeps(count) if self.twin is not None else None
        return ModelComponent(self.block, count, twin)

    @property
    def stated_substeps(self) -> int | None:
        return self.substeps

    def compiled(self) -> Component:
        return self if self.twin is None else self.twin

    def equations(self) -> tuple[Block, int | None]:
        return self.block, self.substeps

    def feedthrough(self) -> frozenset[tuple[str, str]]:
        return block_feedthrough(self.block)

    def instantiate(self) -> Instance:
        return _ModelInstance(self)

    def describe(self) -> dict[str, Any]:
        return {
            "kind": "model",
            "name": self.block.name,
            "substeps": self.substeps or "automatic",
            "compiled": self.twin is not None,
        }


class _ModelInstance(Instance):
    def __init__(self, component: ModelComponent) -> None:
        block = component.block
        self._block, self._substeps = block, component.substeps
        self._p = block.parameter_values
        self._x = np.zeros(len(block.states))
        self._next = np.zeros(len(block.states))
        self._memory = np.zeros(block.implicit.memory if block.implicit is not None else 0)
        self._remembered = np.zeros(self._memory.size)
        self._size = np.zeros(1)
        self._rates: Array | None = None
        self._live = True
        self._initialising = False
        self._clock: SampleClock | None = None
        self.take_variables(block.inputs, block.outputs)

    def bind(self, inputs: Array, outputs: Array) -> None:
        super().bind(inputs, outputs)
        self._held = np.zeros(inputs.size)
        self._output = Evaluator(self._block.output, [self._x, self._held, self._p], outputs)
        if self._block.sample_time is not None:
            self._update = Evaluator(self._block.update, [self._x, self._held, self._p], self._next)

    @cached_property
    def _explicit(self) -> Evaluator:
        return Evaluator(_substep(self._block), [self._x, self._held, self._p, self._size], self._next)

    @cached_property
    def _implicit(self) -> Evaluator:
        assert self._block.implicit is not None
        arguments = [self._x, self._memory, self._held, self._p, self._size]
        return Evaluator(self._block.implicit.step(), arguments, self._next, self._remembered)

    def begin_initialisation(self, time: float) -> None:
        self._initialising = True
        if self._block.sample_time is not None:
            self._clock = SampleClock(time, self._block.sample_time)

    def end_initialisation(self) -> None:
        self._start()
        self._initialising = False
        self._rates = None

    def _start(self) -> None:
        if self._x.size:
            self._x[:] = self._block.start(self._held, self._p).full().ravel()

    def set(self) -> None:
        self._held[:] = self.inputs

    def get(self) -> None:
        if self._initialising:
            self._start()
        if self._live:
            self._output()

    def step(self, time: float, size: float) -> None:
        if self._clock is None:
            self._integrate(time, size)
        else:
            self._sample(time, size)

    def _integrate(self, time: float, size: float) -> None:
        stated = self._substeps
        steps = self._choose(size) if stated is None else Steps(stated, self._block.implicit is None)
        if steps.count > MAXIMUM_SUBSTEPS:
            raise SimulationError(
                f"The equations of '{self._block.name}' are too stiff to integrate.",
                got=f"{steps.count} substeps or more at t = {time:.6g} s",
                valid=f"at most {MAXIMUM_SUBSTEPS}",
                next_step="Check the inertias and the smoothing velocities.",
            )
        self._size[0] = size / steps.count
        update = self._explicit if steps.explicit else self._implicit
        if steps.explicit:
            self._remembered[:] = 0.0
        for _ in range(steps.count):
            update()
            self._x[:] = self._next
            self._memory[:] = self._remembered

    def _choose(self, size: float) -> Steps:
        if self._rates is None:
            known = self._block.rates
            self._rates = known(self._x, self._p).full().ravel() if known is not None else np.zeros(1)
        return choose_steps(self._rates, size)

    def _sample(self, time: float, size: float) -> None:
        clock = self._clock
        assert clock is not None
        while clock.is_due(time) or clock.is_before(time + size):
            self._output()
            self._update()
            self._x[:] = self._next
            clock.count += 1
        self._live = clock.is_due(time + size)

    def set_parameters(self, values: Mapping[str, float]) -> None:
        places = {v.name: i for i, v in enumerate(self._block.parameters)}
        for name, value in values.items():
            self._p[places[name]] = value
        self._rates = None

    def save_state(self) -> Any:
        count = self._clock.count if self._clock else 0
        memory = self._memory.copy()
        return self._x.copy(), memory, self._held.copy(), self.outputs.copy(), self._live, count, self._rates

    def restore_state(self, state: Any) -> None:
        self._x[:], self._memory[:], self._held[:], self.outputs[:], self._live, count, self._rates = state
        if self._clock:
            self._clock.count = count


def _substep(block: Block) -> ca.Function:
    """One substep of the classical Runge-Kutta method: (x, u, p, h) -> x(t + h), input held."""
    x = ca.SX.sym("x", len(block.states))
    u = ca.SX.sym("u", len(block.inputs))
    p = ca.SX.sym("p", len(block.parameters))
    h = ca.SX.sym("h")
    following = runge_kutta_step(lambda _, stage: block.update(stage, u, p), 0.0, x, h)
    return ca.Function("substep", [x, u, p, h], [ca.densify(following)])
