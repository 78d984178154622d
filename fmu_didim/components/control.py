"""python-control systems in the loop."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fmu_didim.base.errors import FmuDidimError, SimulationError
from fmu_didim.base.imports import raised
from fmu_didim.components.base import Component, Instance, SameObject, SampleClock, block_feedthrough, check_names
from fmu_didim.components.block_control import state_space, to_control
from fmu_didim.components.native import Native, NativeLinear
from fmu_didim.data.signals import Array, Variable
from fmu_didim.dynamics.block import MAXIMUM_SUBSTEPS, Block, Steps, choose_steps, runge_kutta_step

DEFAULT_SUBSTEPS = 10


@dataclass(frozen=True)
class Matrices:
    """A linear system by its matrices alone, named as in python-control, whose import takes longer than most loops:

    dx/dt = A x + B u, or x[k+1] = A x + B u if it is sampled; y = C x + D u.
    """

    A: Array
    B: Array
    C: Array
    D: Array


@dataclass(frozen=True)
class ControlComponent(Component):
    """A ``StateSpace``, ``TransferFunction``, ``NonlinearIOSystem`` or :class:`Matrices` as a component.

    A discrete system is sampled at its ``dt``; a continuous one advances by equal substeps with inputs held, of RK4
    unless it is a block whose stiff part is known.

    Attributes:
        system: the python-control system, or the matrices of a linear one.
        inputs, outputs, parameters: its variables, in the order of the system's signals.
        initial_state: (nx,) start value of the state; that of a block follows from the first inputs.
        state_parameters: names of the parameters that are ``initial_state``, of a system that offers it.
        substeps: in a communication step; None: 10, or chosen, with the method, from the rates of the block.
        origin: where the system comes from, for the provenance.
        block: the equations, if the system was made from a block; its matrices follow the parameters.
    """

    system: Any
    inputs: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    parameters: tuple[Variable, ...] = ()
    initial_state: tuple[float, ...] = ()
    substeps: int | None = None
    origin: str = ""
    sample_time: float | None = field(default=None)
    block: Block | None = None
    state_parameters: tuple[str, ...] = ()

    def with_parameters(self, values: Mapping[str, float]) -> ControlComponent:
        check_names("parameter", values, self.parameters, where=f"python-control system {self.origin}")
        if self.block is not None:  # the matrices of a linear block depend on its parameters
            block = self.block.with_parameters(dict(values))
            return replace(self, block=block, system=to_control(block), parameters=block.parameters)
        changed = tuple(v.starting_at(float(values.get(v.name, v.start))) for v in self.parameters)
        present = {v.name: float(v.start or 0.0) for v in changed}
        state = tuple(present[name] for name in self.state_parameters) or self.initial_state
        return replace(self, parameters=changed, initial_state=state)

    @property
    def start_parameters(self) -> tuple[str, ...]:
        return self.state_parameters if self.block is None else super().start_parameters

    def __getstate__(self) -> dict[str, Any]:
        state = dict(self.__dict__)
        if _is_linear(self.system) and not isinstance(self.system, Matrices):  # python-control's cannot be pickled
            s = self.system
            names = {"inputs": s.input_labels, "outputs": s.output_labels, "states": s.state_labels, "name": s.name}
            state["system"] = (s.A, s.B, s.C, s.D), {**names, "dt": s.dt}
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        if isinstance(state["system"], tuple):
            matrices, names = state["system"]
            state = {**state, "system": state_space(*matrices, **names)}
        self.__dict__.update(state)

    def with_names(self, inputs: tuple[Variable, ...], outputs: tuple[Variable, ...]) -> ControlComponent:
        return replace(self, inputs=inputs, outputs=outputs)

    def with_substeps(self, count: int) -> ControlComponent:
        return replace(self, substeps=count)

    @property
    def stated_substeps(self) -> int | None:
        return self.substeps

    def instantiate(self) -> Instance:
        return _ControlInstance(self)

    def equations(self) -> tuple[Block, int | None] | None:
        if self.block is None:
            return None
        return self.block.with_variables(self.inputs, self.outputs, self.block.parameters), self.substeps

    def response_key(self) -> Hashable | None:
        return SameObject(self) if self.block is not None or _is_linear(self.system) else None

    def feedthrough(self) -> frozenset[tuple[str, str]] | None:
        if self.block is not None:
            return block_feedthrough(self.block)
        if not _is_linear(self.system):
            return None
        direct = np.asarray(self.system.D)
        return frozenset((self.outputs[i].name, self.inputs[j].name) for i, j in np.argwhere(direct != 0.0))

    def describe(self) -> dict[str, Any]:
        return {
            "kind": "control",
            "origin": self.origin,
            "class": type(self.system).__name__,
            "sample_time": self.sample_time,
            "substeps": self.substeps or "automatic",
        }


def _is_linear(system: Any) -> bool:
    """Whether a system has matrices; of python-control's it is a ``StateSpace``, which need not be imported to tell."""
    return hasattr(system, "A")


class _ControlInstance(Instance):
    def __init__(self, component: ControlComponent) -> None:
        self._component = component
        starts = component.state_parameters
        self._parameters = {n: value for n, value in component.parameter_values().items() if n not in starts}
        self._p = np.array(list(self._parameters.values()))
        self._clock: SampleClock | None = None
        self._live, self._initialising, self._time = True, False, 0.0
        self._count = component.substeps or 0
        self._chosen: dict[float, Steps] = {}
        self._update, self._output = _functions(component.system, self._parameters)
        implicit = component.block.implicit if component.block is not None else None
        self._implicit = implicit.step() if implicit is not None else None
        self._memory = np.zeros(implicit.memory if implicit is not None else 0)
        self._x = np.array(component.initial_state, dtype=float)
        self.take_variables(component.inputs, component.outputs)

    def bind(self, inputs: Array, outputs: Array) -> None:
        super().bind(inputs, outputs)
        self._held = inputs.copy()

    def begin_initialisation(self, time: float) -> None:
        self._initialising, self._time = True, time
        if self._component.sample_time is not None:
            self._clock = SampleClock(time, self._component.sample_time)

    def end_initialisation(self) -> None:
        self._start()
        self._initialising = False

    def _start(self) -> None:
        block = self._component.block
        if block is not None and block.states:
            self._x = block.start(self._held, self._p).full().ravel()

    def set(self) -> None:
        self._held[:] = self.inputs

    def get(self) -> None:
        if self._initialising:
            self._start()
        if self._live:
            try:
                self.outputs[:] = self._output(self._time, self._x, self._held)
            except (Exception, SystemExit) as error:
                raise self._failed("output", error) from error

    def step(self, time: float, size: float) -> None:
        try:
            if self._clock is None:
                self._integrate(time, size)
            else:
                self._sample(time, size)
        except FmuDidimError:
            raise
        except (Exception, SystemExit) as error:
            raise self._failed("update", error) from error
        self._time = time + size

    def _failed(self, what: str, error: BaseException) -> SimulationError:
        """The error of a function of the user."""
        return SimulationError(
            f"its {what} function cannot be run: {raised(error)}.", where=self._component.origin,
            next_step="Fix the python-control system.",
        )  # fmt: skip

    def _integrate(self, time: float, size: float) -> None:
        steps = Steps(self._count, self._implicit is None) if self._count else self._choose(size)
        if steps.count > MAXIMUM_SUBSTEPS:
            raise SimulationError(
                "The equations of the python-control system are too stiff to integrate.", where=self._component.origin,
                got=f"t = {time:.6g} s",
                next_step="Check the units of its parameters and its gains, or give it as a discrete system.",
            )  # fmt: skip
        h, x, u, update = size / steps.count, self._x, self._held, self._update
        if steps.explicit:
            self._memory = np.zeros(self._memory.size)
        for i in range(steps.count):
            if self._implicit is not None and not steps.explicit:
                x, self._memory = (v.full().ravel() for v in self._implicit(x, self._memory, u, self._p, h))
            else:
                x = runge_kutta_step(lambda t, stage: update(t, stage, u), time + i * h, x, h)
        self._x = x

    def _chosen_count(self, size: float) -> int:
        return self._choose(size).count

    def _choose(self, size: float) -> Steps:
        block = self._component.block
        if block is None or block.rates is None:
            return Steps(DEFAULT_SUBSTEPS, True)
        if size not in self._chosen:
            # of the start: where the state is, hardly changes it
            rates = block.rates(block.start(np.zeros(len(block.inputs)), self._p), self._p)
            self._chosen[size] = choose_steps(rates.full().ravel(), size)
        return self._chosen[size]

    def _sample(self, time: float, size: float) -> None:
        clock = self._clock
        assert clock is not None
        while clock.is_due(time) or clock.is_before(time + size):
            instant = clock.start + clock.count * clock.period
            self.outputs[:] = self._output(instant, self._x, self._held)
            self._x = np.asarray(self._update(instant, self._x, self._held), dtype=float)
            clock.count += 1
        self._live = clock.is_due(time + size)

    def set_parameters(self, values: Mapping[str, float]) -> None:
        self._parameters.update({name: float(value) for name, value in values.items()})
        self._p = np.array(list(self._parameters.values()))
        self._chosen.clear()
        block = self._component.block
        if block is not None:  # matrices of a linear block follow its parameters
            system = to_control(block.with_parameters(self._parameters))
            self._update, self._output = _functions(system, self._parameters)

    def native(self) -> Native | None:
        system, period = self._component.system, self._component.sample_time
        if self._component.block is not None and self._component.block.parameters:
            system = to_control(self._component.block.with_parameters(self._parameters))
        if not _is_linear(system):
            return None
        a, b, c, d = (np.ascontiguousarray(m, dtype=float) for m in (system.A, system.B, system.C, system.D))
        start = self._clock.start if self._clock else 0.0
        self._x, self._held = np.ascontiguousarray(self._x, dtype=float), np.ascontiguousarray(self._held)
        return NativeLinear((a, b, c, d), self._x, self._held, period or 0.0, start, self._count, self._chosen_count)

    def save_state(self) -> Any:
        count = self._clock.count if self._clock else 0
        x, memory = self._x.copy(), self._memory.copy()
        return x, memory, self._held.copy(), self.outputs.copy(), self._live, self._time, count

    def restore_state(self, state: Any) -> None:
        x, memory, held, outputs, self._live, self._time, count = state
        self._x, self._memory = x.copy(), memory.copy()
        self._held[:], self.outputs[:] = held, outputs
        if self._clock:
            self._clock.count = count


def product(matrix: Array, vector: Array) -> Array:
    """A v, summed column by column: the order of operations of the compiled loop, bit for bit."""
    result = np.zeros(matrix.shape[0])
    for column, value in zip(matrix.T, vector, strict=True):
        result += column * value
    return result


def _functions(system: Any, parameters: dict[str, float]) -> tuple[Callable[..., Array], Callable[..., Array]]:
    """(t, x, u) -> next state or derivative, and (t, x, u) -> outputs, of a python-control system."""
    if _is_linear(system):
        a, b, c, d = (np.asarray(m, dtype=float) for m in (system.A, system.B, system.C, system.D))
        return lambda t, x, u: product(a, x) + product(b, u), lambda t, x, u: product(c, x) + product(d, u)
    return (
        lambda t, x, u: np.atleast_1d(system.dynamics(t, x, u, params=parameters)),
        lambda t, x, u: np.atleast_1d(system.output(t, x, u, params=parameters)),
    )


def block_as_control(block: Block, *, substeps: int | None = None) -> ControlComponent:
    """A block run as a python-control system, with the start, the substeps and the integration method of the block."""
    return ControlComponent(
        system=to_control(block),
        inputs=block.inputs,
        outputs=block.outputs,
        parameters=block.parameters,
        initial_state=(0.0,) * len(block.states),
        substeps=substeps,
        origin=f"block '{block.name}'",
        block=block,
        sample_time=block.sample_time,
    )
