"""Events in co-simulation of FMI 3.0: event mode at every communication point, and clocks that tick periodically.

At a communication point the FMU is in event mode, with the clocks active whose ticks fall on it: so inputs set there
count for the tick, and outputs asked for there show what it gives. The event iteration, which ends the tick, is done
when the step begins. Ticks are counted: t = t0 + shift + k interval.

Source: "Functional Mock-up Interface", version 3.0, sections 2.2.8 (clocks) and 4.2 (co-simulation).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fmu_didim.base.errors import FmuError, SimulationError
from fmu_didim.components.base import SampleClock
from fmu_didim.components.fmu.binding import MAXIMUM_ITERATIONS
from fmu_didim.components.fmu.description import CO_SIMULATION, ClockVariable, FmuDescription, Interface
from fmu_didim.components.fmu.instance import TIME_TOLERANCE, CoSimulationInstance, ended, no_progress
from fmu_didim.components.fmu.settings import FmuSettings
from fmu_didim.components.native import Native


def input_clocks(fmu: FmuDescription) -> tuple[ClockVariable, ...]:
    """The clocks that the master lets tick."""
    return tuple(c for c in fmu.clocks if c.causality == "input")


def clock_period(fmu: FmuDescription) -> float | None:
    """The interval of all input clocks in s, None if they have several."""
    periods = {c.interval for c in input_clocks(fmu)}
    return periods.pop() if len(periods) == 1 else None


def check_events(fmu: FmuDescription, interface: Interface, *, wanted: bool) -> bool:
    """Whether an FMU has clocks that must tick.

    Raises:
        FmuError: event mode is wanted or needed and the FMU has none, or a clock is of a kind that is not supported.
    """
    where = f"{fmu.path}, {interface.kind}"
    clocks = input_clocks(fmu)
    able = interface.kind == CO_SIMULATION and interface.has_event_mode
    for clock in clocks:
        if not clock.is_periodic:
            raise FmuError(
                f"The clock '{clock.name}' of the FMU is of a kind that is not supported.",
                where=where,
                got=f"{clock.variability or 'no variability'} interval, {clock.interval or 'not given'} s",
                valid="input clocks with a constant or fixed interval that the file gives",
                next_step="Export the FMU with a periodic clock, or without clocks.",
            )
        if not able:
            raise FmuError(
                f"The clock '{clock.name}' of the FMU needs co-simulation with event mode.",
                where=where,
                got=f"{interface.kind}, hasEventMode is {str(interface.has_event_mode).lower()}",
                next_step="Export the FMU for co-simulation with event mode, or without clocks.",
            )
    known = {c.reference for c in clocks}
    for variable in fmu.variables:
        if variable.causality in ("input", "output") and not set(variable.clocks) <= known:
            other = next(c for c in fmu.clocks if c.reference in variable.clocks and c.reference not in known)
            raise FmuError(
                f"The variable '{variable.name}' belongs to the clock '{other.name}', which the FMU itself lets tick.",
                where=where,
                got=f"{other.causality} clock, {other.variability} interval",
                valid="input clocks with a constant or fixed interval",
                next_step="Export the FMU without this clock.",
            )
    if wanted and not able:
        raise FmuError(
            "The FMU has no event mode.",
            where=where,
            got=f"FMI {fmu.version}, hasEventMode is {str(interface.has_event_mode).lower()}",
            next_step="Load it without event_mode.",
        )
    return bool(clocks)


@dataclass
class _Ticking:
    clock: ClockVariable
    instants: SampleClock
    is_active: bool = False


class EventInstance(CoSimulationInstance):
    """An FMU in co-simulation with event mode."""

    def __init__(self, component: FmuSettings, *, keep_new_state: bool = False) -> None:
        self._ticking: dict[int, _Ticking] = {}
        self._next_event: float | None = None
        super().__init__(component, keep_new_state=keep_new_state)

    def native(self) -> Native | None:
        return None

    def _ticks(self, clock: int) -> bool:
        return clock in self._ticking and self._ticking[clock].is_active

    def begin_initialisation(self, time: float) -> None:
        self._next_event = None
        self._start = time
        self._ticking = {
            clock.reference: _Ticking(clock, SampleClock(time + clock.shift, clock.interval or 0.0))
            for clock in input_clocks(self._component.fmu)
        }
        super().begin_initialisation(time)

    def end_initialisation(self) -> None:
        super().end_initialisation()  # it is in event mode now
        self._activate(self._start)

    def _activate(self, time: float) -> None:
        """Activate the clocks that tick now."""
        for reference, ticking in self._ticking.items():
            ticking.is_active = ticking.instants.is_due(time)
            if ticking.is_active:
                self._binding.set_clock(reference)

    def step(self, time: float, size: float) -> None:
        end = time + size
        for ticking in self._ticking.values():
            ticking.instants.count += ticking.is_active
            if ticking.instants.is_before(end):
                raise self._between(ticking.clock, time, size)
        self._leave_event_mode(time)
        now, tolerance = time, TIME_TOLERANCE * size
        for _ in range(MAXIMUM_ITERATIONS):
            target, following = end, self._next_event
            if following is not None and self._component.interface.has_variable_step:
                # the FMU may stop at its own next time event
                target = following if now + tolerance < following < end - tolerance else end
            early = self._advance(now, target - now)
            reached = target if early is None else early
            if end - reached <= tolerance:
                break
            result = self._binding.step_result()
            is_time_event = following is not None and abs(reached - following) <= tolerance
            if is_time_event or (result is not None and result.event):
                self._binding.call("EnterEventMode")
                self._leave_event_mode(reached)
            now = reached
        else:
            raise no_progress(self._component, now)
        self._binding.call("EnterEventMode")
        self._activate(end)

    def _leave_event_mode(self, time: float) -> None:
        """Event iteration, which ends the ticks too, then step mode."""
        result = self._binding.update_discrete_states()
        if result.terminate:
            raise ended(self._component, time)
        for ticking in self._ticking.values():
            ticking.is_active = False
        self._next_event = result.next_time
        self._binding.call("EnterStepMode")

    def _between(self, clock: ClockVariable, time: float, size: float) -> SimulationError:
        return SimulationError(
            f"The clock '{clock.name}' of the FMU ticks between two communication points.",
            where=self._component.path.name,
            got=f"interval {clock.interval:.9g} s, shift {clock.shift:.9g} s, step {size:.9g} s at t = {time:.6g} s",
            valid="intervals and shifts that are multiples of the communication step",
            next_step="Choose another control rate.",
        )

    def save_state(self) -> Any:
        ticks = {reference: (t.instants.count, t.is_active) for reference, t in self._ticking.items()}
        return super().save_state(), self._next_event, ticks

    def restore_state(self, state: Any) -> None:
        saved, self._next_event, ticks = state
        for reference, (count, active) in ticks.items():
            self._ticking[reference].instants.count = count
            self._ticking[reference].is_active = active
        super().restore_state(saved)
