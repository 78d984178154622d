"""A system made ready to run: the memory of its signals, its instances, their wiring and timing."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import DivergedError, FmuDidimError, UnknownNameError
from fmu_didim.components import Component, Instance
from fmu_didim.components.fmu.component import foreign_co_simulation
from fmu_didim.cosim.execution.buffers import recording_buffer
from fmu_didim.cosim.execution.instance_pool import InstancePool
from fmu_didim.cosim.system import OF_INPUTS, Layout, Place, System, split_delay
from fmu_didim.data.signals import Array, Trajectory

CHECK_INTERVAL = 32
"""[1] Ticks between two checks for divergence: few enough to stop early, enough to cost no time."""
LONGER = 0.01
"""[1] Of a nominal period, by which a period may be longer before integration steps are added: rounding of clocks."""
LATEST = 1 - 1e-6
"""[1] Of a period, after which a delayed input acts at the latest: the rest is a step that every FMU can take."""

Beat = Callable[[], None]
"""Called while a run goes on, at every tick or every few."""
Observer = Callable[[int, Mapping[str, Instance]], None]


@dataclass(frozen=True)
class Order:
    """The arguments of :func:`fmu_didim.cosim.simulate`."""

    system: System
    reference: Trajectory
    ticks: NDArray[np.int64] | None = None
    bounds: Mapping[str, tuple[float, float]] | None = None
    observe: Observer | None = None
    compiled: bool | None = None
    signals: tuple[str, ...] | None = None


def reads_between(component: Component) -> bool | None:
    """Whether the outputs of a component are read at each tick between its inputs and its step.

    Reading is not neutral in FMUs of other tools: some evaluate their model where their solver stands, and continue
    differently then (Dymola 2021: 0.4 % of the torque). So theirs are read always, where they follow the inputs at
    once, or never, where they do not: recording must not change a run. None: where they are used.
    """
    fmu = foreign_co_simulation(component)
    return None if fmu is None or fmu.event_mode else fmu.feedthrough() != frozenset()


def _has_substeps(component: Component) -> bool:
    """Whether a component is integrated by so many substeps a step, which must not get longer with the step."""
    return component.sample_time is None and component.with_substeps(1) is not None


class Part:
    """One component inside the loop.

    Attributes:
        instance, wiring: the running component and where its inputs come from.
        place: its outputs among the values of the run; given: its inputs there; inputs: these values.
        readers: how many of its first outputs others read before its step, and after it.
        every: ticks between its communication points; substeps: its steps in between.
        whole, part: the delay of its inputs in its own periods.
        after_step: its outputs at an instant are those after the step that begins there.
        between: whether outputs are read between inputs and step; None: where somebody looks at them.
        ramps: (input, column of the reference, gain) of inputs that go straight from tick to tick; follows_ramps:
            whether the component does; else it holds them halfway.
        start, instants: where its ticks lie, see :meth:`follow`; longest: step beyond which it does several equal ones.
    """

    start: float
    instants: Array | None
    longest: float

    def __init__(self, name: str, system: System, instance: Instance, place: Place, values: Array) -> None:
        self.name, self.instance, self.wiring = name, instance, place.wiring
        self.place, self.given, self.readers = place.outputs, place.inputs, place.readers
        self.inputs, self.outputs = values[self.given], values[self.place]
        self.every = system.every.get(name, 1)
        self.substeps = system.substeps.get(name, 1)
        self.after_step = name in system.after_step
        self.whole, self.part = split_delay(system.delays.get(name, 0.0) / self.every)
        self.step_size = system.step_size
        self._straight, self._starts = place.ramps, place.starts

    def begin(self, component: Component) -> None:
        """Be at the beginning of a run, with the values of this component."""
        self._component = component
        self.between = reads_between(component)
        self.line: list[Array] = []
        sees_all = component.sample_time is None and not self.delayed and self.every == 1
        self.ramps = self._straight if sees_all else ()
        self.follows_ramps = bool(self.ramps) and component.follows_ramps
        self.start, self.instants, self.longest = 0.0, None, np.inf
        self.inputs[:] = self._starts  # where nothing is connected, it stays
        self.instance.slopes = None
        if self.instance.inputs is not self.inputs or self.instance.outputs is not self.outputs:
            self.instance.bind(self.inputs, self.outputs)

    def follow(self, start: float, instants: Array | None) -> None:
        """Take the time of tick 0 (s), and the instants of all ticks where these are not equally spaced."""
        self.start, self.instants = start, instants
        if instants is not None and _has_substeps(self._component):
            self.longest = (1 + LONGER) * (1 - self.part) * self.step_size * self.every

    @property
    def delayed(self) -> bool:
        """Whether its inputs are delayed."""
        return self.whole > 0 or self.part > 0

    @property
    def lag(self) -> int:
        """Whole ticks from a command to when it acts."""
        return self.whole * self.every

    def step_sizes(self) -> list[float]:
        """Sizes in s of the steps that the component does: one, or two where a fraction of delay divides its period;
        of periods that change the shortest and the longest."""
        size = self.step_size * self.every
        pieces = [self.part * size, (1 - self.part) * size] if self.part else [size]
        if self.instants is not None:
            sizes = self.instants[self.every :] - self.instants[: -self.every]
            late = np.minimum(self.part * size, LATEST * sizes)
            rest = (sizes - late) / np.maximum(np.ceil((sizes - late) / self.longest), 1)
            pieces = [float(bound) for each in (late, rest) for bound in (each.min(), each.max()) if bound > 0]
        return [piece / self.substeps for piece in pieces]

    def gather(self, signals: Array) -> None:
        """Inputs from the signals."""
        self.wiring.gather(signals, self.inputs)

    def lead(self, table: Array, tick: int) -> None:
        """Let the inputs go straight to where they are at the next tick: by their slopes, or held halfway where the
        component holds them. Behind the last row they stay."""
        if not self.ramps:
            return
        changes = np.zeros(self.inputs.size)
        if tick + 1 < table.shape[0]:
            for place, column, gain in self.ramps:
                changes[place] += gain * (table[tick + 1, column] - table[tick, column])
        if self.follows_ramps:
            self.instance.slopes = changes / self._period(tick)[2]
        elif tick + 1 < table.shape[0]:
            self.inputs += changes / 2
            self.instance.set()

    def apply(self, tick: int) -> None:
        """Inputs into the component, its outputs into the signals; a fraction of delay is stepped through."""
        time, late, rest = self._period(tick)
        try:
            if self.delayed:
                self._through_the_line(time, late)
            self.instance.set()
            if self.after_step:
                self._step(time + late, rest)
            if self.after_step or self.between is not False:
                self.instance.get()
        except FmuDidimError as error:
            raise error.in_component(self.name, time) from error.__cause__

    def _period(self, tick: int) -> tuple[float, float, float]:
        """Where its period from a tick on begins, how much later its inputs act, and the rest of the period, s."""
        if self.instants is None:
            size = self.step_size * self.every
            time = self.start + tick * self.step_size
            return time, self.part * size, (1 - self.part) * size if self.part else size
        time, end = float(self.instants[tick]), float(self.instants[tick + self.every])
        late = min(self.part * (self.step_size * self.every), LATEST * (end - time)) if self.part else 0.0
        return time, late, end - time - late

    def _through_the_line(self, time: float, late: float) -> None:
        line = self.line
        line.append(self.inputs.copy())
        if len(line) > self.whole + 2:
            del line[0]
        if self.part > 0:
            self.inputs[:] = line[max(len(line) - self.whole - 2, 0)]
            self.instance.set()
            self._step(time, late)
            if self.between is False:
                self.instance.get()
        self.inputs[:] = line[max(len(line) - self.whole - 1, 0)]

    def advance(self, tick: int) -> None:
        """From its communication point at a tick to the next one, then the outputs there."""
        begin, late, rest = self._period(tick)
        try:
            self._step(begin + late, rest)
            self.instance.get()
        except FmuDidimError as error:
            raise error.in_component(self.name, begin) from error.__cause__

    def _step(self, time: float, size: float) -> None:
        count = self.substeps if size <= self.longest else self.substeps * math.ceil(size / self.longest)
        piece = size / count
        for i in range(count):
            self.instance.step(time + i * piece, piece)


@dataclass
class Assembly:
    """The parts of a system, wired over one memory. A pool keeps it, so that the next run of the same system with other
    values finds all of it ready.

    Attributes:
        layout: where the values lie; values: present values of the signals, then of the inputs of all parts.
        parts: in the order of evaluation.
        calls: how compiled code calls the parts, made in the first run that needs it.
    """

    layout: Layout
    values: Array
    parts: list[Part] = field(default_factory=list)
    calls: Any = None

    @cached_property
    def unbounded(self) -> tuple[Array, Array]:
        """Bounds of the signals that let all pass."""
        count = len(self.layout.signals)
        return np.full(count, -1e100), np.full(count, 1e100)


@dataclass
class LoopRun:
    """A system and the memory of one run of it.

    Attributes:
        assembly: its parts, and the memory on which they work.
        layout, values, parts: those of it; signals: the first of the values.
        start: time of tick 0, s.
        names, recorded: of the signals, and of all values.
        table: (T, c) reference; rows: tick -> row of the recording, -1 where nothing is recorded.
        record: (K, values), the signals and inputs when these begin to act; applied: its signals.
        sampled: (K, signals) at the instant of the tick; the same as ``applied`` where nothing is delayed.
        columns: of all values those that are recorded alone, in all three alike; None where all are.
        finite: whether all recorded signals are finite, None if that is not known; unsound: the first row of which some
            signal is not, where only some are recorded.
        lowest, highest: bounds of the signals.
        beat: see :data:`Beat`; None if nobody asks for it.
    """

    system: System
    reference: Trajectory
    assembly: Assembly
    ticks: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    finite: bool | None = None
    columns: list[int] | None = None
    unsound: int | None = None
    beat: Beat | None = None

    def __post_init__(self) -> None:
        self.layout, self.values, self.parts = self.assembly.layout, self.assembly.values, self.assembly.parts
        self.names, self.recorded = self.layout.signals, self.layout.values
        self.signals = self.values[: len(self.names)]
        self.start = float(self.reference.time[0])

    @property
    def table(self) -> Array:
        return self.reference.values

    def time_of(self, tick: int) -> float:
        """Time of a tick, s."""
        return self.start + tick * self.system.step_size if self.instants is None else float(self.instants[tick])

    @cached_property
    def instants(self) -> Array | None:
        """Time of each tick that any part needs, s; None where they are equally spaced.

        Behind the last row of the reference the last period goes on.
        """
        if not self.system.at_instants:
            return None
        time, more = self.reference.time, self.lag + max(part.every for part in self.parts)
        last = float(time[-1] - time[-2]) if time.size > 1 else self.system.step_size
        return np.concatenate([time, time[-1] + last * np.arange(1, more + 1)])

    def prepare(self, ticks: NDArray[np.int64], bounds: Mapping[str, tuple[float, float]] | None) -> None:
        """The buffer of the recording at these ticks, and the bounds by signal."""
        self.ticks = ticks
        self.lag = max(part.lag for part in self.parts)
        self.delayed = any(part.delayed for part in self.parts)
        for part in self.parts:
            counts = self.system.components[part.name].sample_time is not None
            part.follow(self.start, None if counts else self.instants)
        self.lowest, self.highest = self.assembly.unbounded
        if bounds:
            self.lowest, self.highest = self.lowest.copy(), self.highest.copy()
        for name, (low, high) in (bounds or {}).items():
            if name not in self.names:
                raise UnknownNameError("signal", name, self.names, where="bounds")
            i = self.names.index(name)
            self.lowest[i], self.highest[i] = low, high

    def allocate(self, signals: Sequence[str] | None = None) -> None:
        """The buffer of the recording: of these outputs and inputs alone where nothing is delayed, else of all."""
        for name in signals or ():
            if name not in self.recorded:
                raise UnknownNameError("signal", name, self.recorded, where="signals")
        if signals is not None and not self.delayed:
            columns = self.columns = [i for i, name in enumerate(self.recorded) if name in signals]
            self.record = self.applied = self.sampled = recording_buffer(self.ticks.size, len(columns))
            return
        self.record = recording_buffer(self.ticks.size, self.values.size)
        self.applied = self.record[:, : len(self.names)]
        self.sampled = recording_buffer(self.ticks.size, len(self.names)) if self.delayed else self.applied

    def take(self, rows: Array, first: int) -> None:
        """Take what is recorded of all values (K, v), at the rows of the recording from a first one on."""
        if self.unsound is None and not np.isfinite(rows.sum()):  # of one that is not, the sum is not either
            finite = np.isfinite(rows[:, : len(self.names)]).all(axis=1)
            self.unsound = None if finite.all() else first + int(np.argmin(finite))
        assert self.columns is not None
        np.take(rows, self.columns, axis=1, out=self.record[first : first + len(rows)], mode="clip")

    @cached_property
    def rows(self) -> NDArray[np.int64]:
        rows = np.full(self.table.shape[0] + self.lag, -1, dtype=np.int64)
        rows[self.ticks] = np.arange(self.ticks.size)
        return rows

    @property
    def end(self) -> int:
        """Number of ticks to run: a whole delay of m samples lets the last command act m ticks later."""
        return int(self.ticks[-1]) + self.lag + 1

    def initialise(self, passing: Callable[[LoopRun], bool] | None = None) -> None:
        """Initialisation mode: values pass around the loop until each component has received those of all others,
        or none changes any more.

        Args:
            passing: does that in compiled code, where it returns True.
        """
        self.signals[: self.table.shape[1]] = self.table[0]
        part = self.parts[0]
        try:
            for part in self.parts:
                part.instance.begin_initialisation(self.start)
                self._goes_on()
            done = passing is not None and passing(self)
            for _ in range(0 if done else len(self.parts) + 1):
                before = self.signals.copy()
                for part in self.parts:
                    part.gather(self.signals)
                    part.instance.set()
                    part.instance.get()
                if (self.signals == before).all():
                    break  # all have received what the others give
            for part in self.parts:
                part.instance.end_initialisation()
                part.instance.get()
                self._goes_on()
        except FmuDidimError as error:
            raise error.in_component(part.name, None) from error.__cause__

    def _goes_on(self) -> None:
        if self.beat is not None:
            self.beat()

    def diverged(self, i: int, time: float) -> DivergedError:
        """The error for signal ``i`` that left its bounds, or is not a number."""
        value = float(self.signals[i])
        is_loop = self.system.closes
        what = f"The {'closed loop' if is_loop else 'simulation'} diverged: {self.names[i]} = {value:.3g}"
        if np.isfinite(value):
            what += f", outside {self.lowest[i]:.3g} to {self.highest[i]:.3g}"
        advice = "Start from the reference trajectory (start: reference), or lower the gains." if is_loop else OF_INPUTS
        return DivergedError(what + ".", time=time, next_step=advice, is_finite=bool(np.isfinite(value)))

    def look(self, part: Part, time: float) -> None:
        """Raise DivergedError where outputs of a part are not finite though its inputs are.

        The error names the part, unless its equations are known here: then the loop has diverged.
        """
        bad = np.flatnonzero(~np.isfinite(self.values[part.place]))
        if not bad.size or not np.isfinite(part.inputs).all():
            return
        if self.system.components[part.name].equations() is not None:
            raise self.diverged(part.place.start + int(bad[0]), time)
        output = self.names[part.place.start + int(bad[0])]
        raise DivergedError(
            f"{output} = {self.values[part.place][bad[0]]}, while all its inputs are numbers.",
            time=time, next_step=f"Fix the {part.name}, or keep its parameters in their range.",
        ).in_component(part.name, time)  # fmt: skip

    def close(self, pool: InstancePool | None, *, reusable: bool) -> None:
        """Give the instances back to the pool, or close them."""
        for part in self.parts:
            if pool is not None and reusable:
                pool.give_back(self.system.components[part.name], part.instance)
            else:
                part.instance.close()
        if pool is not None and reusable:
            pool.keep_assembly(self.layout, self.assembly)


def assemble(system: System, reference: Trajectory, pool: InstancePool | None, beat: Beat | None = None) -> LoopRun:
    """Instances of all components, wired; raises UnknownNameError for a column that the reference lacks."""
    layout, instances = system.layout(reference.names), list[Instance]()
    known = None if pool is None else pool.find_assembly(layout)
    parts = [None] * len(system.order) if known is None else known.parts
    try:
        for name, part in zip(system.order, parts, strict=True):
            component = system.components[name]
            wanted = None if part is None else part.instance
            instances.append(component.instantiate() if pool is None else pool.take(component, wanted))
            if beat is not None:
                beat()
        if known is None or any(p.instance is not i for p, i in zip(known.parts, instances, strict=True)):
            known = Assembly(layout, np.zeros(len(layout.values)))
            for name, instance in zip(system.order, instances, strict=True):
                known.parts.append(Part(name, system, instance, layout.places[name], known.values))
        known.values[:] = 0.0
        for part in known.parts:
            part.begin(system.components[part.name])
    except BaseException:
        for instance in instances:
            instance.close()
        raise
    return LoopRun(system, reference, known, beat=beat)
