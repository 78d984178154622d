"""Model exchange: FMUs whose equations are integrated here.

Between two communication points the inputs are held. At each of them the FMU is in event mode, because a held input
jumps there: so discrete inputs may be set, and samples that fall on the point see the new inputs. The event iteration
is done when the step begins.

Time events split a step where they are. State events are detected by a change of sign of an event indicator: RK4
handles them at the end of the substep in which they occur (an error of the order of the substep), CVode where it finds
them.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from fmu_didim.base.errors import SimulationError
from fmu_didim.components.fmu.binding import address, no_end_of_events
from fmu_didim.components.fmu.cvode import CVODE_TOLERANCE, MOST_STEPS, cvode, silence
from fmu_didim.components.fmu.instance import TIME_TOLERANCE, FmuInstance, ended
from fmu_didim.components.fmu.settings import DEFAULT_SUBSTEPS, FmuSettings
from fmu_didim.components.native import EXCHANGE, FMI2, ExchangeEquations, Native, NativeSolver

ENDED, NO_END_OF_EVENTS = -1, -2
"""What ``exchange.h`` returns where an FMU ends the simulation, and where its event iteration does not end."""
NEEDED = ("set_time", "set_states", "get_states", "derive", "enter_event", "enter_continuous", "update")
"""Functions, by their names in ``exchange.h``, without which Python runs the FMU."""


class ModelExchangeInstance(FmuInstance):
    """An FMU in model exchange; ``solver`` of the component chooses how it is integrated."""

    def __init__(self, component: FmuSettings, *, keep_new_state: bool = False) -> None:
        super().__init__(component, keep_new_state=keep_new_state)
        fmu, binding = component.fmu, self._binding
        self._nx, self._nz = fmu.state_count, fmu.indicator_count
        self._x, self._dx, self._stage, self._sum = (np.zeros(self._nx) for _ in range(4))
        self._z, self._z_before = np.zeros(self._nz), np.zeros(self._nz)
        self._c = binding.c
        self._set_time = binding.library[f"{binding.prefix}SetTime"]
        self._set_stage, self._stage_arguments = binding.exchange_call("SetContinuousStates", self._stage)
        self._get_states, self._states_arguments = binding.exchange_call("GetContinuousStates", self._x)
        self._derive, self._derive_arguments = binding.exchange_call(binding.derivatives_function, self._dx)
        self._get_indicators, self._indicator_arguments = binding.exchange_call("GetEventIndicators", self._z)
        self._enter_event, self._terminate = binding.truth_type(), binding.truth_type()
        self._completed = binding.library[f"{binding.prefix}CompletedIntegratorStep"]
        self._completed_arguments = (self._c, 1, ctypes.byref(self._enter_event), ctypes.byref(self._terminate))
        self._next_event: float | None = None
        self._substeps = component.substeps or DEFAULT_SUBSTEPS
        self._cvode: Any = None
        self._worst = 0

    def begin_initialisation(self, time: float) -> None:
        super().begin_initialisation(time)
        self._next_event, self._cvode = None, None

    def step(self, time: float, size: float) -> None:
        """From event mode at ``time`` to event mode at ``time + size``."""
        self._begin, self._held = time, self.inputs.copy()
        self._leave_event_mode(time)
        end, tolerance, now = time + size, TIME_TOLERANCE * size, time
        while end - now > tolerance:
            following = self._next_event
            target = end if following is None or following <= now + tolerance else min(following, end)
            if end - target <= tolerance:
                target = end
            now = self._integrate(now, target, size)
            if now < end - tolerance:
                self._binding.call("EnterEventMode")
                self._leave_event_mode(now)
        if self._next_event is not None and abs(self._next_event - end) <= tolerance:
            self._check(self._set_time(self._c, self._next_event), end)  # t0 + k h is not exactly the event's instant
        self._binding.call("EnterEventMode")

    def _inputs_at(self, time: float) -> None:
        """The inputs at an instant of the step, on straight lines from where it began."""
        if self.slopes is not None:
            np.multiply(self.slopes, time - self._begin, out=self.inputs)
            np.add(self._held, self.inputs, out=self.inputs)
            self.set()

    def _leave_event_mode(self, time: float) -> None:
        """Event iteration, then continuous-time mode with the states and indicators of this instant."""
        result = self._binding.update_discrete_states()
        if result.terminate:
            raise ended(self._component, time)
        self._next_event = result.next_time
        self._binding.call("EnterContinuousTimeMode")
        if self._nx:
            self._check(self._get_states(*self._states_arguments), time)
        if self._nz:
            self._check(self._get_indicators(*self._indicator_arguments), time)

    def _integrate(self, start: float, target: float, size: float) -> float:
        """Advance to ``target`` or to the first event before it; returns the instant reached."""
        if self._component.solver == "cvode" and self._nx:
            return self._integrate_cvode(start, target)
        count = max(1, math.ceil(self._substeps * (target - start) / size - TIME_TOLERANCE))
        count = count if self._nx or self._nz else 1  # without states there is nothing to integrate
        h = (target - start) / count
        for i in range(count):
            now = target if i + 1 == count else start + (i + 1) * h
            self._runge_kutta(start + i * h, now)
            if self._is_event(now):
                return now
        return target

    def _runge_kutta(self, time: float, end: float) -> None:
        """One substep of the classical method; the FMU holds the state at ``time`` and ends with the one at ``end``."""
        c, set_time, h = self._c, self._set_time, end - time
        if not self._nx:
            self._check(set_time(c, end), time)
            self._inputs_at(end)
            return
        x, dx, stage, total = self._x, self._dx, self._stage, self._sum
        set_stage, stage_arguments = self._set_stage, self._stage_arguments
        derive, derive_arguments = self._derive, self._derive_arguments
        status = derive(*derive_arguments)
        total[:] = dx
        for part, weight in ((h / 2, 2.0), (h / 2, 2.0), (h, 1.0)):
            np.multiply(dx, part, out=stage)
            np.add(stage, x, out=stage)
            status |= set_time(c, time + part)
            self._inputs_at(time + part)
            status |= set_stage(*stage_arguments) | derive(*derive_arguments)
            np.multiply(dx, weight, out=stage)
            np.add(total, stage, out=total)
        np.multiply(total, h / 6, out=stage)
        np.add(x, stage, out=stage)
        x[:] = stage
        status |= set_time(c, end)
        self._inputs_at(end)
        self._check(status | set_stage(*stage_arguments), time)

    def _is_event(self, time: float) -> bool:
        """Tell the FMU that a substep is complete; whether it or an indicator asks for an event."""
        found = False
        if self._component.interface.needs_completed_step:
            self._check(self._completed(*self._completed_arguments), time)
            if self._terminate.value:
                raise ended(self._component, time)
            found = bool(self._enter_event.value)
        if self._nz:
            self._z_before[:] = self._z
            self._check(self._get_indicators(*self._indicator_arguments), time)
            found = found or bool(((self._z > 0) != (self._z_before > 0)).any())
        return found

    def _integrate_cvode(self, start: float, target: float) -> float:
        if self._cvode is None:
            self._cvode = _cvode(self, start)
        self._worst = 0
        self._cvode.reset(start)
        try:
            found, _, now = self._cvode.step(start, target)
        except (RuntimeError, TypeError) as error:  # FMPy's; TypeError where the solver gave it no reason
            raise _not_integrated(self._component, f"t = {start:.6g} s: {error}") from error
        now = float(min(now, target))
        self._check(self._worst | self._set_time(self._c, now), start)
        self._inputs_at(now)
        self._check(self._get_states(*self._states_arguments), start)
        event = self._is_event(now)
        return now if found or event else target

    def _check(self, status: int, time: float) -> None:
        if status > 1:
            self._binding.check(f"Model exchange at t = {time:.6g} s: a function", status)

    def get_nominals(self, values: Any, count: int) -> None:
        """Fill an array in C with the nominal values of the states, 1 where the FMU has none."""
        nominals = self._binding.library.get(f"{self._binding.prefix}GetNominalsOfContinuousStates")
        if nominals is None or nominals(self._c, values, count) > 1:
            values[:count] = [1.0] * count
        for i in range(count):  # CVode divides by its error weights, which must not be zero
            value = abs(values[i])
            values[i] = value if 0 < value < math.inf else 1.0

    def native(self) -> Native | None:
        kind = self._binding.native_kind
        if kind is None or kind not in EXCHANGE or not self._has_plain_ports:
            return None
        library, prefix = self._binding.library, self._binding.prefix
        functions = {key: library.get(f"{prefix}{name}") for key, name in self._functions().items()}
        if any(functions[key] is None for key in NEEDED):
            return None
        equations = ExchangeEquations(
            functions={key: 0 if function is None else address(function) for key, function in functions.items()},
            states=self._nx, indicators=self._nz, completes=self._component.interface.needs_completed_step,
            substeps=self._substeps, solver=self._native_cvode if self._component.solver == "cvode" else None,
            explain=self._explained,
        )  # fmt: skip
        return self._native(EXCHANGE[kind], f"A function of {prefix} model exchange", step=None, exchange=equations)

    def _functions(self) -> dict[str, str]:
        """Name in ``exchange.h`` -> name of the FMU's function, without the prefix."""
        update = "NewDiscreteStates" if self._binding.native_kind == FMI2 else "UpdateDiscreteStates"
        return {
            "set_time": "SetTime", "set_states": "SetContinuousStates", "get_states": "GetContinuousStates",
            "derive": self._binding.derivatives_function, "indicators": "GetEventIndicators",
            "completed": "CompletedIntegratorStep", "enter_event": "EnterEventMode",
            "enter_continuous": "EnterContinuousTimeMode", "update": update,
        }  # fmt: skip

    def _native_cvode(self, rhs: int, roots: int, data: int) -> NativeSolver:
        def get_states(values: Any, count: int) -> None:
            self._binding.library[f"{self._binding.prefix}GetContinuousStates"](self._c, values, count)

        return cvode(self._nx, self._nz, get_states, self.get_nominals, rhs, roots, data)

    def _explained(self, status: int, time: float) -> SimulationError:
        """The error for what ``exchange.h`` returns below zero."""
        if status == ENDED:
            return ended(self._component, time)
        if status == NO_END_OF_EVENTS:
            return no_end_of_events(self._binding)
        return _not_integrated(self._component, f"t = {time:.6g} s")

    def save_state(self) -> Any:
        return super().save_state(), self._next_event

    def restore_state(self, state: Any) -> None:
        saved, self._next_event = state
        super().restore_state(saved)

    def close(self) -> None:
        self._cvode = None
        super().close()


def _not_integrated(component: FmuSettings, got: str) -> SimulationError:
    return SimulationError(
        "CVode could not integrate the FMU.", where=component.path.name, got=got,
        next_step="Check the values of the parameters, or give another solver: rk4 with more substeps.",
    )  # fmt: skip


def _cvode(instance: ModelExchangeInstance, start: float) -> Any:
    """FMPy's CVode solver on the functions of an instance; their worst status is kept, since C cannot raise."""
    from fmpy.sundials import CVodeSolver

    binding, c = instance._binding, instance._c
    library, prefix = binding.library, binding.prefix

    def keep_alive(function: Callable[..., int]) -> Callable[[Any, int], None]:
        def call(values: Any, count: int) -> None:
            instance._worst |= function(c, values, count)

        return call

    def set_time(time: float) -> None:
        instance._worst |= instance._set_time(c, time)
        instance._inputs_at(time)

    solver = CVodeSolver(
        nx=instance._nx,
        nz=instance._nz,
        get_x=keep_alive(library[f"{prefix}GetContinuousStates"]),
        set_x=keep_alive(library[f"{prefix}SetContinuousStates"]),
        get_dx=keep_alive(library[f"{prefix}{binding.derivatives_function}"]),
        get_z=keep_alive(library[f"{prefix}GetEventIndicators"]),
        get_nominals=instance.get_nominals,
        set_time=set_time,
        input=SimpleNamespace(apply=lambda time: None),  # it is applied while roots are looked for; here it is held
        startTime=start,
        relativeTolerance=CVODE_TOLERANCE,
        maxNumSteps=MOST_STEPS,
    )
    silence(solver)
    return solver
