"""Running a system: the loop over the ticks."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fmu_didim.components import Instance
from fmu_didim.errors import DivergedError, InputError, SimulationError, UnknownNameError
from fmu_didim.master.system import REFERENCE, System
from fmu_didim.signals import Array, Trajectory

Observer = Callable[[int, Mapping[str, Instance]], None]
CHECK_INTERVAL = 32
"""Ticks between two looks for divergence: often enough to stop early, seldom enough to cost nothing."""


@dataclass(frozen=True)
class Recording:
    """Signals recorded at some ticks.

    Attributes:
        ticks: (K,) tick numbers; time: (K,) their instants in s.
        applied: name -> (K,) values; those of a component whose inputs are delayed are taken when the
            input computed at the tick acts, so that torque and motion of a row belong together.
        inputs: name -> (K,) values of the inputs of the components, when they begin to act.
        sampled: the same as ``applied`` at the instant of the tick itself, just before anything that is due then acts.
    """

    ticks: NDArray[np.int64]
    time: Array
    applied: Mapping[str, Array]
    inputs: Mapping[str, Array]
    sampled: Mapping[str, Array]

    def table(self, names: list[str], *, sampled: bool = False) -> Array:
        """(K, len(names)) of the named signals ``component.variable``."""
        source = self.sampled if sampled else self.applied
        for name in names:
            if name not in source:
                raise UnknownNameError("recorded signal", name, source)
        return np.column_stack([source[name] for name in names])


class _Wiring:
    """Inputs of one component from the signals: only those that are connected, so that 0 * inf spoils no other."""

    def __init__(self, entries: list[tuple[int, int, float]]) -> None:
        self.targets = np.array([e[0] for e in entries], dtype=np.intp)
        self.sources = np.array([e[1] for e in entries], dtype=np.intp)
        self.gains = np.array([e[2] for e in entries], dtype=float)
        self.single = np.unique(self.targets).size == self.targets.size

    def gather(self, signals: Array, inputs: Array) -> None:
        values = self.gains * signals[self.sources]
        if self.single:
            inputs[self.targets] = values
        else:
            inputs[self.targets] = 0.0
            np.add.at(inputs, self.targets, values)


class _Running:
    """One component inside the loop: its instance, its rows of the wiring, its delay line."""

    def __init__(self, instance: Instance, wiring: _Wiring, inputs: Array, place: slice, delay: float) -> None:
        self.instance, self.wiring, self.inputs, self.place = instance, wiring, inputs, place
        self.whole, self.part = int(delay), delay - int(delay)
        # A fraction within rounding of a whole sample would be a step of no length.
        if self.part > 1 - 1e-9:
            self.whole, self.part = self.whole + 1, 0.0
        elif self.part < 1e-9:
            self.part = 0.0
        self.line: list[Array] = []

    @property
    def delayed(self) -> bool:
        return self.whole > 0 or self.part > 0

    def gather(self, signals: Array) -> None:
        """Inputs from the signals."""
        self.wiring.gather(signals, self.inputs)

    def apply(self, time: float, step: float) -> None:
        """Inputs into the component, its outputs into the signals; a fraction of delay is stepped through."""
        if self.delayed:
            self._through_the_line(time, step)
        self.instance.set()
        self.instance.get()

    def _through_the_line(self, time: float, step: float) -> None:
        line = self.line
        line.append(self.inputs.copy())
        if len(line) > self.whole + 2:
            del line[0]
        if self.part > 0:
            self.inputs[:] = line[max(len(line) - self.whole - 2, 0)]
            self.instance.set()
            self.instance.step(time, self.part * step)
        self.inputs[:] = line[max(len(line) - self.whole - 1, 0)]

    def advance(self, time: float, step: float) -> None:
        """To the next tick, then the outputs there."""
        self.instance.step(time + self.part * step, (1 - self.part) * step if self.part else step)
        self.instance.get()


def simulate(
    system: System,
    reference: Trajectory,
    *,
    ticks: NDArray[np.int64] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    observe: Observer | None = None,
) -> Recording:
    """Run the closed loop along a reference.

    Args:
        system: the loop.
        reference: columns that the connections name, one row a tick: its time must be t0 + k h.
        ticks: increasing tick numbers to record; all by default. The run ends with the last one.
        bounds: signal -> (lowest, highest) sensible value, looked at every 32 ticks and at the end; a signal
            found outside stops the run.
        observe: called with the number of each recorded row and the running instances by name when the row's
            command has just begun to act; it must leave their state and inputs as they were.

    Raises:
        InputError: the reference does not fit the step or lacks a column.
        DivergedError: a signal left its bounds or is not finite.
        SimulationError: a component refused a step.
    """
    if ticks is None:
        ticks = np.arange(reference.time.size, dtype=np.int64)
    _check_reference(system, reference, ticks)
    names, running, signals = _assemble(system, reference)
    try:
        return _run(system, reference, ticks, bounds or {}, names, running, signals, observe)
    finally:
        for part in running.values():
            part.instance.close()


def _check_reference(system: System, reference: Trajectory, ticks: NDArray[np.int64]) -> None:
    time, h = reference.time, system.step_size
    ideal = time[0] + np.arange(time.size) * h
    worst = float(np.abs(time - ideal).max())
    if worst > 0.01 * h:
        raise InputError(
            "The reference is not sampled at the control rate.",
            where=reference.source or "reference",
            got=f"instants up to {worst:.3g} s away from t0 + k * {h:g} s",
            next_step="Resample it to the control rate, or correct the rate of the loop.",
        )
    if ticks.size == 0 or ticks[0] < 0 or ticks[-1] >= time.size or (np.diff(ticks) <= 0).any():
        raise InputError(
            "The ticks to record lie outside the reference.",
            where=reference.source or "reference",
            got="no ticks" if ticks.size == 0 else f"ticks {ticks[0]} to {ticks[-1]}",
            valid=f"0 to {time.size - 1}",
            next_step="Shorten the measurement, or give a reference that covers it.",
        )


def _assemble(system: System, reference: Trajectory) -> tuple[list[str], dict[str, _Running], Array]:
    """Signal names (references first), the running components and the vector that holds all signals."""
    names = [f"{REFERENCE}.{name}" for name in reference.names]
    places: dict[str, slice] = {}
    for name in system.order:
        first = len(names)
        names += [f"{name}.{v.name}" for v in system.components[name].outputs]
        places[name] = slice(first, len(names))
    index = {name: i for i, name in enumerate(names)}
    for connection in system.connections:
        if connection.source not in index:
            raise UnknownNameError("signal", connection.source, names, where=f"source of {connection.target}")
    signals = np.zeros(len(names))
    running: dict[str, _Running] = {}
    for name in system.order:
        component = system.components[name]
        rows = {f"{name}.{v.name}": i for i, v in enumerate(component.inputs)}
        wiring = _Wiring([(rows[c.target], index[c.source], c.gain) for c in system.connections if c.target in rows])
        # An input that nothing is connected to keeps its start value.
        inputs = np.array([v.start for v in component.inputs], dtype=float)
        try:
            instance = component.instantiate()
        except BaseException:
            for part in running.values():
                part.instance.close()
            raise
        instance.bind(inputs, signals[places[name]])
        running[name] = _Running(instance, wiring, inputs, places[name], system.delays.get(name, 0.0))
    return names, running, signals


def _initialise(running: dict[str, _Running], signals: Array, time: float) -> None:
    """Initialisation mode: values pass around the loop until every component has seen all others."""
    for part in running.values():
        part.instance.begin_initialisation(time)
    for _ in range(len(running) + 1):
        for part in running.values():
            part.wiring.gather(signals, part.inputs)
            part.instance.set()
            part.instance.get()
    for part in running.values():
        part.instance.end_initialisation()
        part.instance.get()


def _run(
    system: System,
    reference: Trajectory,
    ticks: NDArray[np.int64],
    bounds: Mapping[str, tuple[float, float]],
    names: list[str],
    running: dict[str, _Running],
    signals: Array,
    observe: Observer | None,
) -> Recording:
    h, t0, table = system.step_size, float(reference.time[0]), reference.values
    count = table.shape[1]
    lowest, highest = _bounds(names, bounds)
    parts = list(running.values())
    lag = max(part.whole for part in parts)
    delayed = any(part.delayed for part in parts)
    instances = {name: part.instance for name, part in running.items()}
    rows = np.full(table.shape[0] + lag, -1, dtype=np.int64)
    rows[ticks] = np.arange(ticks.size)
    applied = np.zeros((ticks.size, len(names)))
    sampled = np.zeros_like(applied) if delayed else applied
    given = {name: np.zeros((ticks.size, part.inputs.size)) for name, part in running.items()}
    signals[:count] = table[0]
    with np.errstate(all="ignore"):
        _initialise(running, signals, t0)
        # A whole delay of m samples: the motion that belongs to the last command comes m ticks later.
        for k in range(int(ticks[-1]) + lag + 1):
            time = t0 + k * h
            signals[:count] = table[min(k, table.shape[0] - 1)]
            row = rows[k]
            if delayed and row >= 0:
                sampled[row] = signals
            if system.jacobi:
                for part in parts:
                    part.gather(signals)
                for part in parts:
                    part.apply(time, h)
            else:
                for part in parts:
                    part.gather(signals)
                    part.apply(time, h)
            if delayed:
                _record_delayed(parts, signals, rows, k, count, applied, sampled)
                _record_inputs(parts, rows, k, given)
            elif row >= 0:
                applied[row] = signals
                _record_inputs(parts, rows, k, given)
            if observe is not None and k >= lag and rows[k - lag] >= 0:
                observe(int(rows[k - lag]), instances)
            if k % CHECK_INTERVAL == 0:
                _check_bounds(signals, names, lowest, highest, time)
            for part in parts:
                part.advance(time, h)
        _check_bounds(signals, names, lowest, highest, time)
    if not np.isfinite(applied).all():
        bad = int(np.flatnonzero(~np.isfinite(applied).all(axis=1))[0])
        raise DivergedError("The closed loop gave values that are not finite.", time=t0 + float(ticks[bad]) * h)
    return Recording(
        ticks=ticks,
        time=np.asarray(t0 + ticks * h, dtype=float),
        applied={name: applied[:, i] for i, name in enumerate(names)},
        inputs={
            f"{name}.{variable.name}": values[:, i]
            for name, values in given.items()
            for i, variable in enumerate(system.components[name].inputs)
        },
        sampled={name: sampled[:, i] for i, name in enumerate(names)},
    )


def _record_delayed(
    parts: list[_Running],
    signals: Array,
    rows: NDArray[np.int64],
    k: int,
    count: int,
    applied: Array,
    sampled: Array,
) -> None:
    row = rows[k]
    if row >= 0:
        applied[row, :count] = signals[:count]
    for part in parts:
        late = rows[k - part.whole] if k >= part.whole else -1
        if late >= 0:
            applied[late, part.place] = signals[part.place]
        if row >= 0 and not part.delayed:
            sampled[row, part.place] = signals[part.place]


def _record_inputs(parts: list[_Running], rows: NDArray[np.int64], k: int, given: Mapping[str, Array]) -> None:
    for part, values in zip(parts, given.values(), strict=True):
        row = rows[k - part.whole] if k >= part.whole else -1
        if row >= 0:
            values[row] = part.inputs


def _bounds(names: list[str], bounds: Mapping[str, tuple[float, float]]) -> tuple[Array, Array]:
    lowest, highest = np.full(len(names), -1e100), np.full(len(names), 1e100)
    for name, (low, high) in bounds.items():
        if name not in names:
            raise UnknownNameError("signal", name, names, where="bounds")
        lowest[names.index(name)], highest[names.index(name)] = low, high
    return lowest, highest


def _check_bounds(signals: Array, names: list[str], lowest: Array, highest: Array, time: float) -> None:
    # Written so that NaN counts as outside.
    inside = (signals >= lowest) & (signals <= highest)
    if not inside.all():
        i = int(np.flatnonzero(~inside)[0])
        value = signals[i]
        what = f"The closed loop diverged: {names[i]} = {value:.3g}"
        if math.isfinite(value):
            what += f", outside {lowest[i]:.3g} to {highest[i]:.3g}"
        raise DivergedError(
            what + ".",
            time=time,
            next_step="Start from the reference trajectory (start: reference), or lower the gains.",
        )


__all__ = ["Recording", "SimulationError", "simulate"]
