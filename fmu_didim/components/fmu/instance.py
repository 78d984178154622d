"""Running instances of FMUs: the common part of co-simulation and model exchange, and co-simulation."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import FixedParameterError, FmuError, SimulationError
from fmu_didim.components.base import DIFFERENCE_STEP, Component
from fmu_didim.components.fmu.binding import MAXIMUM_ITERATIONS, Call, EndedError, address, references
from fmu_didim.components.fmu.description import FLOAT_TYPES, REAL_TYPES, FmuVariable
from fmu_didim.components.fmu.library import load_library
from fmu_didim.components.fmu.ports import MixedCall
from fmu_didim.components.fmu.settings import RESET, STATE, FmuSettings, Ports, RestartableInstance
from fmu_didim.components.fmu.units import Conversion
from fmu_didim.components.native import ExchangeEquations, Native, NativeFmu
from fmu_didim.data.signals import Array

READ_BACK = 1e-6
"""[1] Relative difference between a value that was set and what is read back, above which the FMU has not taken it:
ten times what is lost where it is kept in single precision."""
DERIVATIVES_AGREE = 1e-2
"""[1] Part of the larger one by which a directional derivative and a difference may differ: tables and friction that
bend within a step of the difference change it by less, a derivative that is left out by all of it."""
ROUNDED = 1e-9
"""[1] Part of an output to which an FMU computes it where it iterates inside: its noise in a difference."""


class _Port:
    """Inputs or outputs in the FMU's own units: shown = factor * own + offset.

    Attributes:
        own: the buffer itself where all units agree; scaling: (factor, offset), None there.
    """

    def __init__(self, conversions: Sequence[Conversion], shown: Array, *, converts: bool) -> None:
        self.own, self.scaling = shown, None
        if converts:
            self.own = np.zeros(len(conversions))
            self.scaling = np.array([c.factor for c in conversions]), np.array([c.offset for c in conversions])

    def from_shown(self, shown: Array) -> None:
        if self.scaling is not None:
            np.subtract(shown, self.scaling[1], out=self.own)
            np.divide(self.own, self.scaling[0], out=self.own)

    def to_shown(self, shown: Array) -> None:
        if self.scaling is not None:
            np.multiply(self.own, self.scaling[0], out=shown)
            np.add(shown, self.scaling[1], out=shown)


def _nothing() -> int:
    return 0


TIME_TOLERANCE = 1e-9
"""[1] Two instants closer than this fraction of a step count as one."""


class FmuInstance(RestartableInstance):
    """An FMU in the loop; values pass by C calls whose arguments are made once.

    ``get`` after ``set`` gives the outputs that the FMU computes without a step; whether they follow the inputs at
    once depends on the FMU, see :func:`fmu_didim.components.fmu.probe_fmu`.
    """

    def __init__(self, component: FmuSettings, *, keep_new_state: bool = False) -> None:
        fmu, interface = component.fmu, component.interface
        library = load_library(component.fmi, fmu, interface)
        self._binding = component.fmi.binding(
            fmu, interface, library, event_mode=component.event_mode, tolerance=component.tolerance
        )
        self._new_state = self._binding.save_state() if keep_new_state else None
        self._trusts_derivatives = True
        self._called: dict[str, Any] | None = None
        self._as_native: NativeFmu | None = None
        self._connected: tuple[object, ...] = ()
        self._setting: tuple[Ports, tuple[str, ...], list[int], Array, Call] | None = None
        self._take(component)
        self._bind_anew()

    def _take(self, component: FmuSettings) -> None:
        """Take the variables of a component."""
        self._component = component
        self._derivatives_asked = 0
        self._input_types = component.input_types
        self._output_types = component.fmu.output_types
        self.input_names, self.output_names = component.ports.inputs, component.ports.outputs

    def _bind_anew(self) -> None:
        """Take buffers of its own, with the inputs at their start values."""
        ports = self._component.ports
        self.bind(ports.starts.copy(), np.zeros(len(ports.outputs)))

    def _connect(self) -> None:
        """Make the calls that pass values from and to the buffers, unless they are those of its last run."""
        component = self._component
        fmu, ports = component.fmu, component.ports
        joined = (self.inputs, self.outputs, ports)
        if self._connected and all(a is b for a, b in zip(joined, self._connected, strict=True)):
            return
        self._connected, self._as_native = joined, None
        self._in = _Port(component.input_conversions, self.inputs, converts=ports.converts_inputs)
        self._out = _Port(component.output_conversions, self.outputs, converts=ports.converts_outputs)
        self._set, self._set_arguments = self._port_call(
            "Set", fmu.of_causality("input"), self._in.own, plain=fmu.has_plain_inputs
        )
        self._get, self._get_arguments = self._port_call(
            "Get", fmu.of_causality("output"), self._out.own, plain=fmu.has_plain_outputs
        )

    def _port_call(self, verb: str, variables: Sequence[FmuVariable], values: Array, *, plain: bool) -> Call:
        if not variables:
            return _nothing, ()
        if plain:
            return self._binding.real_call(verb, [v.reference for v in variables], values)
        return MixedCall(self._binding, verb, variables, values, self._ticks), ()

    def _ticks(self, clock: int) -> bool:
        """Whether a clock ticks now."""
        return False

    def restart(self, component: Component) -> bool:
        if not isinstance(component, FmuSettings):
            return False
        rerun = component.find_rerun()
        if rerun.isolated or not self._go_back(rerun.strategy):
            return False
        self._take(component)
        return True

    def restart_by(self, strategy: str, component: FmuSettings) -> bool:
        if not self._go_back(strategy):
            return False
        self._take(component)
        self._bind_anew()
        return True

    def _go_back(self, strategy: str) -> bool:
        """To the state of a new instance; whether that is possible in this way."""
        if strategy == RESET:
            self._binding.forget_states(self._new_state)
            self._binding.reset()
        elif strategy == STATE and self._new_state is not None:
            self._binding.forget_states(self._new_state)
            self._binding.restore_state(self._new_state)
        else:
            return False
        return True

    def begin_initialisation(self, time: float) -> None:
        if not self._binding.gives_initial_outputs:
            self._connected = ()  # nothing of its last run is shown until they are given
        self._connect()
        component = self._component
        self._binding.set_up_experiment(time)
        if component.changed:
            self._set_own(self._given({**component.start_values, **component.parameter_values()}))
        for name, value in component.options.items():
            self._binding.set_option(component.option_types[name], component.references[name], value)
        self._binding.enter_initialisation(time)
        if not self._binding.gives_initial_outputs:
            self._get, self._get_arguments, self._connected = _nothing, (), ()

    def end_initialisation(self) -> None:
        """Raises FmuError if another value is read back than was set: the run would use that one."""
        component = self._component
        if component.changed & component.start_values.keys():  # a state moves on later
            self._check_taken(component.start_values)
        self._binding.exit_initialisation()
        if not self._binding.gives_initial_outputs:
            self._connect()
        if not component.is_own:  # what is exported here refuses what it does not take
            self._check_taken(component.parameter_values())
        self._put_states()
        for name, value in component.options.items():
            kind = component.option_types[name]
            found = None if kind == "String" else self._binding.read_back(kind, [component.references[name]], 1)
            if found is not None and found[0] != value:
                raise _not_taken(component, name, value, found[0])

    def _put_states(self) -> None:
        """Let continuous states start elsewhere than the initialisation says, from event mode to event mode."""
        component, binding = self._component, self._binding
        places = {name: i for name, i in component.state_starts.items() if name in component.changed}
        if not places:
            return
        binding.update_discrete_states()
        binding.call("EnterContinuousTimeMode")
        states, values = np.zeros(component.fmu.state_count), component.parameter_values()
        for verb in ("Get", "Set"):
            function, arguments = binding.exchange_call(f"{verb}ContinuousStates", states)
            binding.check(f"{binding.prefix}{verb}ContinuousStates", function(*arguments))
            for name, i in places.items():
                states[i] = component.parameter_conversion(name).to_own(values[name])
        binding.call("EnterEventMode")

    def _check_taken(self, values: Mapping[str, float]) -> None:
        component, given = self._component, self._given(values)
        if not given:
            return
        wanted, numbers = self._last_set[1:] if given == self._last_set[0] else self._own_values(given)
        found = self._binding.read_back(self._binding.real_type, wanted, numbers.size)
        if found is None or (found == numbers).all():
            return
        for place in np.flatnonzero(~np.isclose(found, numbers, rtol=READ_BACK, atol=0.0, equal_nan=True)):
            first = [next(n for n in values if component.reference(n) == reference) for reference in wanted]
            names = [sibling for name in first for sibling in component.arrays.get(name, (name,))]
            raise _not_taken(component, names[place], numbers[place], found[place])

    def set(self) -> None:
        self._in.from_shown(self.inputs)
        status = self._set(*self._set_arguments)
        if status > 1:
            self._binding.check(self._real_function("Set"), status)

    def get(self) -> None:
        status = self._get(*self._get_arguments)
        if status > 1:
            self._binding.check(self._real_function("Get"), status)
        self._out.to_shown(self.outputs)

    def _real_function(self, verb: str) -> str:
        return f"{self._binding.prefix}{verb}{self._binding.real_type}"

    def _given(self, values: Mapping[str, float]) -> dict[str, float]:
        """Those of some values that were set before the run, without where continuous states start."""
        component = self._component
        at_first = component.changed - component.state_starts.keys() if component.state_starts else component.changed
        return {name: value for name, value in values.items() if name in at_first}

    def _own_values(self, values: Mapping[str, float]) -> tuple[list[int], Array]:
        """Value references, and the FMU's own values of parameters given in the units shown; an array as a whole."""
        component = self._component
        if not (component.arrays or component.parameter_conversions):
            known = component.ports.references
            plain = {known[name]: value for name, value in values.items()}
            return list(plain), np.array(list(plain.values()))
        wanted: dict[int, list[float]] = {}
        for name, value in values.items():
            reference, own = component.reference(name), component.parameter_conversion(name).to_own(value)
            siblings = component.arrays.get(name, (name,))
            if len(siblings) == 1:
                wanted[reference] = [own]
                continue
            if reference not in wanted:
                now = {**component.start_values, **component.parameter_values()}
                wanted[reference] = [component.parameter_conversion(s).to_own(now.get(s, value)) for s in siblings]
            wanted[reference][siblings.index(name)] = own
        return list(wanted), np.array([x for group in wanted.values() for x in group])

    def _set_own(self, values: Mapping[str, float]) -> None:
        component, names = self._component, tuple(values)
        if self._setting is not None and self._setting[0] is component.ports and self._setting[1] == names:
            _, _, wanted, numbers, (function, arguments) = self._setting
            numbers[:] = list(values.values())
            self._last_set = values, wanted, numbers
        else:
            wanted, numbers = self._own_values(values)
            self._last_set, self._setting = (values, wanted, numbers), None
            if not wanted:
                return
            function, arguments = call = self._binding.real_call("Set", wanted, numbers)
            if not (component.arrays or component.parameter_conversions):
                self._setting = component.ports, names, wanted, numbers, call
        status = function(*arguments)
        if status > 1:
            self._binding.check(f"{self._real_function('Set')} of parameters", status)

    def set_parameters(self, values: Mapping[str, float]) -> None:
        component = self._component
        fixed = [name for name in values if name in component.fixed or name in component.start_values]
        if fixed:
            raise FixedParameterError(
                "A fixed parameter or a start value of the FMU cannot be changed while it runs.",
                where=self._component.path.name,
                got=", ".join(fixed),
                next_step="Set it before the run (with_parameters).",
            )
        self._set_own(values)

    def derivatives(
        self, outputs: Sequence[int], inputs: Sequence[int], parameters: Mapping[str, float]
    ) -> tuple[Array, Array]:
        """The FMU's directional derivatives where it gives them and differences show the same, else differences."""
        component, types = self._component, self._input_types
        smooth = [k for k, i in enumerate(inputs) if types[i] in FLOAT_TYPES]
        if len(smooth) < len(inputs):  # nothing follows a small change of an integer
            some, by_parameter = self.derivatives(outputs, [inputs[k] for k in smooth], parameters)
            by_input = np.zeros((len(outputs), len(inputs)))
            by_input[:, smooth] = some
            return by_input, by_parameter
        plain = all(types[i] in REAL_TYPES for i in inputs)
        plain = plain and all(self._output_types[i] in REAL_TYPES for i in outputs)
        if not (component.has_derivatives and self._trusts_derivatives and plain):
            return super().derivatives(outputs, inputs, parameters)
        asked = self._derivatives_asked
        self._derivatives_asked += 1
        try:
            found = self._directional(outputs, inputs, list(parameters))
        except SimulationError:  # the standard lets an FMU refuse those by parameters
            if asked:
                raise
            self._trusts_derivatives = False
            return super().derivatives(outputs, inputs, parameters)
        if asked & (asked - 1):  # looked at in calls 0, 1, 2, 4, 8, ...
            return found
        changed = {name: value for name, value in parameters.items() if name not in component.fixed}
        places = [k for k, name in enumerate(parameters) if name in changed]
        other = super().derivatives(outputs, inputs, changed)
        rounding = ROUNDED * float(np.abs(self.outputs[list(outputs)]).max(initial=0.0)) / DIFFERENCE_STEP
        scales = [1.0] * len(inputs) + [1 / (abs(value) or 1.0) for value in changed.values()]
        apart = _apart(np.hstack([found[0], found[1][:, places]]), np.hstack(other), rounding * np.array(scales))
        if not apart.size:
            return found
        if asked == 0 and len(changed) == len(parameters):
            self._trusts_derivatives = False
            return other
        names = [*(self._component.inputs[i].name for i in inputs), *changed]
        raise SimulationError(
            "The directional derivatives of this FMU are not what differences of its outputs show.",
            where=component.path.name, got=f"by {', '.join(names[k] for k in apart)}",
            next_step="Write directional_derivatives: false beside its source: differences are taken then.",
        )  # fmt: skip

    def _directional(self, outputs: Sequence[int], inputs: Sequence[int], parameters: list[str]) -> tuple[Array, Array]:
        component = self._component
        unknown = [component.output_references[i] for i in outputs]
        known = [component.input_references[i] for i in inputs] + [component.references[p] for p in parameters]
        factors = [component.input_conversions[i].factor for i in inputs]
        factors += [component.parameter_conversion(p).factor for p in parameters]
        result = np.zeros((len(known), len(outputs)))
        for row, reference in zip(result, known, strict=True):
            self._binding.directional_derivative(unknown, reference, row)
        result *= np.array([component.output_conversions[i].factor for i in outputs])
        result /= np.array(factors)[:, None]
        return result[: len(inputs)].T, result[len(inputs) :].T

    def save_state(self) -> Any:
        return self._binding.save_state()

    def restore_state(self, state: Any) -> None:
        self._binding.restore_state(state)

    def close(self) -> None:
        self._binding.close()

    @abstractmethod
    def step(self, time: float, size: float) -> None: ...

    @property
    def _has_plain_ports(self) -> bool:
        """Whether one C call passes all inputs, and one all outputs."""
        fmu = self._component.fmu
        return fmu.has_plain_inputs and fmu.has_plain_outputs

    def _native(
        self, kind: int, steps_by: str, *, step: Any, exchange: ExchangeEquations | None = None
    ) -> NativeFmu:  # fmt: skip
        """The instance for the compiled loop; ``steps_by``: what a step is called in messages."""
        if self._called is None:  # the same in all its runs
            component, fmu = self._component, self._component.fmu
            self._called = {
                "self_address": self._binding.c.value, "check": self._binding.check,
                "set_address": address(self._set) if component.input_references else 0,
                "get_address": address(self._get) if component.output_references else 0,
                "step_address": 0 if step is None else address(step),
                "calls": (self._real_function("Set"), self._real_function("Get"), steps_by),
                "input_references": references(fmu.input_references),
                "output_references": references(fmu.output_references),
            }  # fmt: skip
        if self._as_native is None or exchange is not None:
            self._as_native = NativeFmu(
                kind, own_inputs=self._in.own, own_outputs=self._out.own, input_scaling=self._in.scaling,
                output_scaling=self._out.scaling, exchange=exchange, **self._called,
            )  # fmt: skip
        return self._as_native


def _apart(found: Array, other: Array, rounding: Array) -> NDArray[np.intp]:
    """Columns (no, k) of derivatives that differ by more than their differences are uncertain, ``rounding`` (k,)."""
    size = np.maximum(np.abs(found), np.abs(other)).max(axis=0, initial=0.0)
    alike = np.abs(found - other).max(axis=0, initial=0.0) <= DERIVATIVES_AGREE * size + rounding
    return np.flatnonzero(~alike)  # NaN is not


class CoSimulationInstance(FmuInstance):
    """An FMU in co-simulation."""

    def __init__(self, component: FmuSettings, *, keep_new_state: bool = False) -> None:
        super().__init__(component, keep_new_state=keep_new_state)
        self._do_step, self._tail = self._binding.step_call()
        self._c = self._binding.c

    def native(self) -> Native | None:
        kind = self._binding.native_kind
        if kind is None or self._component.interface.may_return_early or not self._has_plain_ports:
            return None
        return self._native(kind, f"{self._binding.prefix}DoStep", step=self._do_step)

    def step(self, time: float, size: float) -> None:
        now, end, pieces = time, time + size, 1
        reached = self._advance(time, size)
        while reached is not None and end - reached > TIME_TOLERANCE * size:  # the FMU came back early
            if not reached > now or pieces == MAXIMUM_ITERATIONS:
                raise no_progress(self._component, now)
            now, pieces = reached, pieces + 1
            reached = self._advance(now, end - now)

    def _advance(self, time: float, size: float) -> float | None:
        """One call of DoStep; returns the time reached if the FMU came back early."""
        status = self._do_step(self._c, time, size, *self._tail)
        if status > 1:
            self._binding.check(f"{self._binding.prefix}DoStep at t = {time:.6g} s", status)
        result = self._binding.step_result()
        if result is None:
            return None
        if result.terminate:
            raise ended(self._component, time)
        return result.time if result.early else None


class NotTakenError(FmuError, SimulationError):
    """An FMU does not take a value: a run with it cannot be made, others can."""


def _not_taken(component: FmuSettings, name: str, wanted: float, found: float) -> NotTakenError:
    return NotTakenError(
        f"The FMU did not take the value of '{name}': another value is read back.",
        where=component.path.name,
        got=f"{found:.9g} after {wanted:.9g} was set, in the FMU's own units",
        next_step="Choose a value that the FMU allows, or leave the parameter as the FMU has it.",
    )


def ended(component: FmuSettings, time: float) -> EndedError:
    """The error of an FMU that wants the simulation to end."""
    return EndedError(
        "The FMU ended the simulation.", where=component.path.name, got=f"t = {time:.6g} s",
        next_step="Check its parameters and its stop time; fmu-didim fmu check FILE tries it alone.",
    )  # fmt: skip


def no_progress(component: FmuSettings, time: float) -> SimulationError:
    """The error of an FMU whose steps make no progress."""
    return SimulationError(
        "The FMU comes back early from its steps again and again.", where=component.path.name, got=f"t = {time:.6g} s",
        next_step="Give a longer communication step, or report it to the maker of the FMU.",
    )  # fmt: skip
