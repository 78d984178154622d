"""The closed loop as an immutable description: components, connections, order, delay, step."""

from __future__ import annotations

import re
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.components import Component
from fmu_didim.data.signals import Array, altered

REFERENCE = "reference"
OF_INPUTS = (
    "Keep the parameters where the model can be simulated (identify: {name: {minimum: ..., maximum: ..., start: ...}}),"
    " and check the units of its inputs."
)
"""What to do about a simulation that diverges where nothing is fed back."""
LoopTreatment = Literal["refuse", "iterate", "previous"]


def split_delay(samples: float) -> tuple[int, float]:
    """Whole periods and the fraction of a delay; a fraction within rounding of a whole one counts as whole."""
    whole, part = int(samples), samples - int(samples)
    if part > 1 - 1e-9:  # a rest of the period would be a step of no length
        return whole + 1, 0.0
    return whole, 0.0 if part < 1e-9 else part


@dataclass(frozen=True)
class Connection:
    """target += gain * source.

    Attributes:
        source: ``component.output``, or ``reference.column`` for a column of the reference trajectory.
        target: ``component.input``. Several connections to one input add up.
        gain: factor, such as the drive gain g_t of tau = g_t v (eq. 21 of the DIDIM paper).
    """

    source: str
    target: str
    gain: float = 1.0


_WIRE = np.dtype([("input", np.int64), ("signal", np.int64), ("gain", np.float64)])
"""As in loop.c."""


class Wiring:
    """Inputs of one component from the signals: only those that are connected, so that 0 * inf spoils no other.

    Attributes:
        table: (wires,) of the compiled loop: places of input and signal among all values, and the gain.
    """

    def __init__(self, entries: list[tuple[int, int, float]], first: int) -> None:
        self.table = np.array([(first + target, source, gain) for target, source, gain in entries], dtype=_WIRE)
        self.targets = np.array([e[0] for e in entries], dtype=np.int64)
        self.sources = np.array([e[1] for e in entries], dtype=np.int64)
        self.gains = np.array([e[2] for e in entries], dtype=float)
        self.single = len({e[0] for e in entries}) == len(entries)

    def gather(self, signals: Array, inputs: Array) -> None:
        """Fill the connected inputs."""
        values = self.gains * signals[self.sources]
        if self.single:
            inputs[self.targets] = values
        else:
            inputs[self.targets] = 0.0
            np.add.at(inputs, self.targets, values)


@dataclass(frozen=True)
class Place:
    """Where the values of one component lie.

    Attributes:
        outputs, inputs: places among all values; starts: (nu,) start values of the inputs.
        wiring: where its inputs come from.
        ramps: (input, column of the reference, gain) of inputs that go straight from tick to tick.
        readers: how many of its first outputs others read between its inputs and its step, and between its step and its
            next inputs.
    """

    outputs: slice
    inputs: slice
    starts: Array
    wiring: Wiring
    ramps: tuple[tuple[int, int, float], ...]
    readers: tuple[int, int]


@dataclass(frozen=True)
class Layout:
    """Where the values of a system lie in the memory of a run: the signals, then the inputs of all components.

    Attributes:
        signals: names of the signals, the columns of the reference first; values: of all values.
        places: of each component, by name.
        signal_places, input_places: name of a signal or an input -> its place among the values.
    """

    signals: tuple[str, ...]
    values: tuple[str, ...]
    places: Mapping[str, Place]
    signal_places: Mapping[str, int]
    input_places: Mapping[str, int]


@dataclass(frozen=True)
class System:
    """Components wired to a loop; time is counted in ticks, t = t0 + k * step_size, or t_k of the reference.

    At tick k each component in ``order`` gets its inputs and gives its outputs (so the controller sees
    reference and position of tick k); then all advance by one step with the inputs held.

    Attributes:
        components: by name.
        connections: the wiring.
        order: the names in the order of evaluation; controller first.
        step_size: communication step h in s.
        jacobi: all components get the outputs that the others had at the end of the last step, as masters that
            step in parallel do: one sample of delay on every connection with feed-through.
        delays: name -> delay of all its inputs in samples, a fraction allowed: the inputs computed at
            t_k act from t_k + delay * h. Before the first ones act, they are held at their first value.
        every: name -> number n of ticks between its communication points, 1 by default; its outputs are held in
            between.
        substeps: name -> number of equal communication steps that it does in one of its own periods, inputs held.
        after_step: names of components whose outputs at t_k are those after the step that begins at t_k, such as a
            controller FMU that computes its command in ``doStep``.
        algebraic_loops: ``refuse`` an algebraic loop, ``iterate`` until its outputs are consistent at each tick, or
            take the ``previous`` values (those at the end of the last step) where the order does not help.
        at_instants: the control period changes: tick k lies at the time t_k of row k of the reference, and
            ``step_size`` is the nominal period. Components with a sample time run once in so many ticks by their own
            clock, which counts nominal periods, as a law does whose loop runs late; all others step from t_k to
            t_(k+1). A whole delay is a number of ticks, the fraction a time: that part of the nominal period.
        ramps: columns of the reference that go straight from tick to tick. A component that does not follow them
            (:attr:`~fmu_didim.components.Component.follows_ramps`) holds the mean over the step.
        varied: systems with derivatives that were made of this one, or of one with other values; see
            :func:`~fmu_didim.cosim.derivatives.with_derivatives`.
    """

    components: Mapping[str, Component]
    connections: tuple[Connection, ...]
    order: tuple[str, ...]
    step_size: float
    delays: Mapping[str, float] = field(default_factory=dict)
    jacobi: bool = False
    every: Mapping[str, int] = field(default_factory=dict)
    substeps: Mapping[str, int] = field(default_factory=dict)
    after_step: frozenset[str] = frozenset()
    algebraic_loops: LoopTreatment = "refuse"
    at_instants: bool = False
    ramps: frozenset[str] = frozenset()
    _layouts: dict[tuple[str, ...], Layout] = field(default_factory=dict, init=False, repr=False, compare=False)
    varied: dict[Hashable, System] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.step_size > 0:
            raise InputError(
                "The communication step must be positive.", got=self.step_size,
                next_step="Give the step of the loop in s, such as 0.001.",
            )  # fmt: skip
        if sorted(self.order) != sorted(self.components):
            raise InputError(
                "The order must name each component once.", got=self.order, valid=self.components,
                next_step="List all components, each one time.",
            )  # fmt: skip
        named = {"delays": self.delays, "every": self.every, "substeps": self.substeps, "after_step": self.after_step}
        for what, owners in named.items():
            for name in owners:
                self._check_name(name, what)
        for name, delay in self.delays.items():
            if not 0 <= delay <= 1000:
                raise InputError(
                    "A delay must be between 0 and 1000 samples.", where=name, got=delay,
                    next_step="Give the delay in samples of the loop.",
                )  # fmt: skip
        for what, counts in (("every", self.every), ("substeps", self.substeps)):
            for name, count in counts.items():
                if not (isinstance(count, int) and 1 <= count <= 100_000):
                    raise InputError(
                        f"'{what}' must be a whole number of steps.", where=name, got=count, valid="1 to 100000",
                        next_step="Choose steps whose ratio is a whole number.",
                    )  # fmt: skip
        names = {
            name: (dict.fromkeys(v.name for v in c.inputs), dict.fromkeys(v.name for v in c.outputs))
            for name, c in self.components.items()
        }
        for connection in self.connections:
            self._check(connection, names)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "varied": {}}

    def layout(self, columns: tuple[str, ...]) -> Layout:
        """Where its values lie in a run along a reference with these columns.

        Raises:
            UnknownNameError: the reference lacks a column that is connected.
        """
        if columns not in self._layouts:  # which systems of other values share
            self._layouts[columns] = _layout(self, columns)
        return self._layouts[columns]

    def _check(self, connection: Connection, names: Mapping[str, tuple[dict[str, None], dict[str, None]]]) -> None:
        both = f"{connection.source} -> {connection.target}"
        name, _, variable = connection.target.partition(".")
        self._check_name(name, both)
        if variable not in names[name][0]:
            raise UnknownNameError("input", variable, names[name][0], where=both)
        name, _, variable = connection.source.partition(".")
        if name == REFERENCE:
            return
        if name not in self.components:
            raise UnknownNameError("component", name, (*self.components, REFERENCE), where=both)
        if variable not in names[name][1]:
            raise UnknownNameError("output", variable, names[name][1], where=both)

    def _check_name(self, name: str, where: str) -> None:
        if name not in self.components:
            raise UnknownNameError("component", name, self.components, where=where)

    @property
    def closes(self) -> bool:
        """Whether outputs are fed back to inputs, or components drive each other; else all comes from outside."""
        return any(not c.source.startswith(f"{REFERENCE}.") for c in self.connections)

    def replace(self, name: str, component: Component) -> System:
        """The same system with another component of that name; all else untouched."""
        self._check_name(name, "System.replace")
        components, present = {**self.components, name: component}, self.components[name]
        same = component.inputs is present.inputs and component.outputs is present.outputs
        if not same and (component.inputs, component.outputs) != (present.inputs, present.outputs):
            return replace(self, components=components)
        return altered(self, components=components)  # wired as the system that was checked

    def with_delay(self, name: str, samples: float) -> System:
        """The same system with another delay of the inputs of one component, in samples."""
        return replace(self, delays={**self.delays, name: samples})

    def describe(self) -> dict[str, Any]:
        """Order, delay, step and components, for the provenance of a result."""
        return {
            "order": list(self.order),
            "algorithm": "Jacobi" if self.jacobi else "Gauss-Seidel in this order",
            "step_size_s": self.step_size,
            **({"ticks": "at the instants of the reference; step_size_s is nominal"} if self.at_instants else {}),
            "delay_samples": {name: self.delays.get(name, 0.0) for name in self.order},
            "ticks_per_step": {name: self.every.get(name, 1) for name in self.order},
            "steps_per_period": {name: self.substeps.get(name, 1) for name in self.order},
            "outputs_after_step": sorted(self.after_step),
            "algebraic_loops": self.algebraic_loops,
            "hold": "zero-order hold; acceleration taken after the new torque is applied",
            "components": {name: c.describe() for name, c in self.components.items()},
            "connections": [f"{c.target} <- {c.gain:g} * {c.source}" for c in self.connections],
        }


def _layout(system: System, columns: tuple[str, ...]) -> Layout:
    names = [f"{REFERENCE}.{column}" for column in columns]
    outputs: dict[str, slice] = {}
    for name in system.order:
        first = len(names)
        names += [f"{name}.{v.name}" for v in system.components[name].outputs]
        outputs[name] = slice(first, len(names))
    index = {name: i for i, name in enumerate(names)}
    for connection in system.connections:
        if connection.source not in index:
            raise UnknownNameError("signal", connection.source, names, where=f"source of {connection.target}")
    straight = {f"{REFERENCE}.{column}" for column in columns if column in system.ramps}
    values, places = list(names), {}
    read = {name: _readers(system, name, outputs[name], index) for name in system.order}
    for name in system.order:
        variables, first = system.components[name].inputs, len(values)
        rows = {f"{name}.{v.name}": i for i, v in enumerate(variables)}
        wires = [c for c in system.connections if c.target in rows]
        entries = [(rows[c.target], index[c.source], c.gain) for c in wires]
        ramps = tuple((rows[c.target], index[c.source], c.gain) for c in wires if c.source in straight)
        values += rows
        starts = np.array([v.start for v in variables], dtype=float)
        wiring = Wiring(entries, first)
        places[name] = Place(outputs[name], slice(first, len(values)), starts, wiring, ramps, read[name])
    inputs = {name: i for i, name in enumerate(values) if i >= len(names)}
    return Layout(tuple(names), tuple(values), places, index, inputs)


def _readers(system: System, name: str, outputs: slice, index: Mapping[str, int]) -> tuple[int, int]:
    """How many of the first outputs of a component, at these places, others read before its step and after it."""
    before, after = 0, 0
    for connection in system.connections:
        read = index[connection.source] - outputs.start + 1
        if not 0 < read <= outputs.stop - outputs.start:
            continue
        reader = connection.target.partition(".")[0]
        if system.order.index(reader) > system.order.index(name) and not system.jacobi:
            before = max(before, read)
        else:
            after = max(after, read)
    return before, after


_TERM = re.compile(
    r"\s*(?P<sign>[+-]?)\s*(?:(?P<gain>\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)\s*\*\s*)?(?P<name>[A-Za-z_]\w*)\s*"
)
_INDEXED = re.compile(r"^(?P<stem>[A-Za-z_]+?)(?P<joint>\d+)$")


def closed_loop(
    plant: Component,
    controller: Component,
    *,
    joint_count: int,
    step_size: float | None = None,
    drive_gains: Sequence[float] | None = None,
    delay_samples: float = 0.0,
    jacobi: bool = False,
    injections: Mapping[str, str] | None = None,
    reference_names: Sequence[str],
) -> System:
    """A plant and a controller wired by the names of their variables.

    An input of the controller may also be named by a sum, ``q_ref1 - q1``.

    The controller's ``q_ref<j>``, ``dq_ref<j>``, ``ddq_ref<j>`` come from the columns ``q<j>``, ``dq<j>``,
    ``ddq<j>`` of the reference, its ``q<j>``, ``dq<j>``, ``ddq<j>`` from the plant, and the plant's ``tau<j>``
    is the drive gain times ``command<j>``.

    Args:
        plant, controller: the components.
        joint_count: number of joints n.
        step_size: communication step in s; by default the controller's sample time.
        drive_gains: (n,) g_t of tau = g_t command; 1 by default.
        delay_samples: delay of the command in samples.
        jacobi: see :class:`System`.
        injections: ``command<j>`` -> reference column added to that command (a test signal).
        reference_names: columns of the reference.

    Raises:
        InputError: an input of the controller or the plant has no source; the step is unknown.
    """
    step = step_size if step_size is not None else controller.sample_time
    if step is None:
        raise InputError(
            "The sample time of the loop is unknown.",
            where="controller",
            next_step="Give the control rate (loop: {rate_hz: ...}).",
        )
    gains = list(drive_gains) if drive_gains is not None else [1.0] * joint_count
    if len(gains) != joint_count:
        raise InputError(
            "One drive gain is needed for each joint.", got=gains, valid=f"{joint_count} numbers",
            next_step="Give a list with a number for each joint.",
        )  # fmt: skip
    commands = [f"command{j}" for j in range(1, joint_count + 1)]
    for name in injections or {}:
        if name not in commands:
            raise UnknownNameError("command", name, commands, where="injections")
    connections = _to_controller(controller, {v.name for v in plant.outputs}, reference_names)
    for j in range(1, joint_count + 1):
        connections.append(Connection(f"controller.command{j}", f"plant.tau{j}", gains[j - 1]))
        column = (injections or {}).get(f"command{j}")
        if column is not None:
            connections.append(Connection(f"{REFERENCE}.{column}", f"plant.tau{j}", gains[j - 1]))
    return System(
        components={"controller": controller, "plant": plant},
        connections=tuple(connections),
        order=("controller", "plant"),
        step_size=step,
        delays={"plant": delay_samples} if delay_samples else {},
        jacobi=jacobi,
    )


def _to_controller(controller: Component, plant_outputs: set[str], reference_names: Sequence[str]) -> list[Connection]:
    """The connections to the inputs of the controller, by their names."""
    connections = []
    for variable in controller.inputs:
        for gain, name in _terms(variable.name):
            source = _source(name, plant_outputs, reference_names)
            if source is None:
                raise InputError(
                    f"Nothing gives '{name}', an input of the controller.",
                    where="closed loop",
                    valid=f"reference: {', '.join(reference_names)}; plant: {', '.join(sorted(plant_outputs))}",
                    next_step="Add the column to the reference, or map the input to another name.",
                )
            connections.append(Connection(source, f"controller.{variable.name}", gain))
    return connections


def _terms(name: str) -> list[tuple[float, str]]:
    """Gains and names of a sum such as ``q_ref1 - 0.5 * q1``; a single name is itself."""
    found = list(_TERM.finditer(name))
    if "".join(m.group(0) for m in found) != name or not found:
        return [(1.0, name)]
    return [((-1.0 if m["sign"] == "-" else 1.0) * float(m["gain"] or 1.0), m["name"]) for m in found]


def _source(name: str, plant_outputs: set[str], reference_names: Sequence[str]) -> str | None:
    match = _INDEXED.match(name)
    if match and match["stem"].endswith("_ref"):
        column = match["stem"].removesuffix("_ref") + match["joint"]
        return f"{REFERENCE}.{column}" if column in reference_names else None
    if name in plant_outputs:
        return f"plant.{name}"
    return f"{REFERENCE}.{name}" if name in reference_names else None
