"""The closed loop as a function from free parameters to the torque at the samples of every experiment.

    values (p,) -> FreeParameters -> base parameters (b,), values by owner
                -> Loop           -> system of an experiment with these values
                -> Simulation     -> closed-loop simulation -> torque at the samples (N, n)
                -> Experiments    -> measured minus simulated torque (N, n)

A :class:`LoopModel` has these parts. Free are base parameters of the robot first, then parameters of the controller, of
drives and sensors, the delay, the clock of the log, and amplitudes and shapes of effects that discovery has added. A
:class:`Simulation` is one experiment of it with certain values.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmu_didim.base.errors import DivergedError, FmuError, SimulationError
from fmu_didim.components import Component, SameObject
from fmu_didim.cosim import (
    InstancePool,
    Instants,
    KeptRecordings,
    Observer,
    Recording,
    SampleOperator,
    System,
    measured_output,
    response_key,
    simulate,
)  # fmt: skip
from fmu_didim.cosim.system import OF_INPUTS
from fmu_didim.data.filters import LowPass
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.load import Load
from fmu_didim.dynamics.prior import Prior
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.experiments import Experiments
from fmu_didim.model.external_torque import EXTERNAL_TORQUE, ExternalTorque, held, with_external_torques
from fmu_didim.model.free_parameter import LOG, FreeParameter, FreeParameters
from fmu_didim.model.integration import Integration, divided, integration
from fmu_didim.model.loop import Loop
from fmu_didim.model.parameters import Parameters, RobotParameters
from fmu_didim.model.signals.channel import Channel
from fmu_didim.model.signals.path import INPUT, OUTPUT, STRAIGHT, changed_inputs, changed_outputs
from fmu_didim.model.workers import default_workers, may_run_side_by_side

LONG_RUN = 5000
"""[ticks] Of the longest run of two joints, from which threads gain: identified with two instead of one, a batch of 100
ticks takes 30 % longer and a SCARA of 2000 up to 40 %, a double pendulum of 14 000 5 % less. Below, Python's part of a
run, which takes turns, is most of it. A tick of more joints counts as the square of their number: a TX40 takes seven
times as long for one as a SCARA, and its matrices are the larger."""


@dataclass(frozen=True)
class EffectAtJoint:
    """An effect at a joint: its name in the catalogue, and the number of the joint, counted from 1."""

    effect: str
    joint: int

    @property
    def text(self) -> str:
        """In words."""
        return f"{self.effect.replace('_', ' ')}, joint {self.joint}"


@dataclass(frozen=True)
class LoopModel:
    """Torque and residual of a closed loop as functions of the values (p,) of what is free.

    Attributes:
        loop: plant, controller, wiring and integration; experiments: what was measured.
        free_parameters: what is free anywhere in the loop, with start values and limits.
        added_effects: in the order in which they were added.
        torque_deviation: (n,) known standard deviation of the torque noise; estimated when None.
        joint_weights: ``estimated`` divides each joint by its noise, ``equal`` treats them alike.
        prior: what is known of the shared base parameters before, if that is to count.
        loads: label of an experiment -> what its last link carries, of which the free part is among the parameters.
        pool: instances that run again; recordings: of the last runs, for those who ask for the same again. Both are
            shared with all models made from this one.
        workers: simulations side by side, where compiled code runs the loop.
    """

    loop: Loop
    experiments: Experiments
    free_parameters: FreeParameters
    added_effects: tuple[EffectAtJoint, ...] = ()
    torque_deviation: Array | None = None
    joint_weights: str = "estimated"
    prior: Prior | None = None
    loads: Mapping[str, Load] = field(default_factory=dict)
    pool: InstancePool = field(default_factory=InstancePool, compare=False, repr=False)
    recordings: KeptRecordings = field(default_factory=KeptRecordings, compare=False, repr=False)
    workers: int = field(default_factory=default_workers, compare=False)

    # ---- the parts, as most ask for them

    @property
    def parameters(self) -> Parameters:
        """The base parameters, with their regressor where there is one."""
        return self.loop.parameters

    @property
    def joint_count(self) -> int:
        """Number of joints n."""
        return self.loop.joint_count

    @property
    def names(self) -> tuple[str, ...]:
        """(p,) names of the free parameters."""
        return self.free_parameters.names

    @property
    def start(self) -> Array:
        """(p,) start values of the free parameters."""
        return self.free_parameters.start

    @property
    def linear_count(self) -> int:
        """Number of free base parameters: the first of all."""
        return self.free_parameters.linear_count

    @property
    def first(self) -> str:
        """Label of the first experiment."""
        return self.experiments.first

    @property
    def estimation_labels(self) -> tuple[str, ...]:
        """Labels of the experiments that are fitted."""
        return self.experiments.estimation_labels

    @property
    def measured(self) -> Array:
        """(N, n) measured torque of all experiments that are fitted."""
        return self.experiments.measured

    @property
    def measured_outputs(self) -> Array:
        """(M, m) all that was measured in the experiments that are fitted, the torque first; see ``experiments``."""
        return self.experiments.measured_outputs if self.experiments.channels else self.measured

    @property
    def stated_deviations(self) -> Array:
        """(m,) known standard deviations of the noise of all outputs; NaN where it is estimated."""
        torque = np.full(self.joint_count, np.nan) if self.torque_deviation is None else self.torque_deviation
        return np.concatenate([torque, self.experiments.stated_deviations])

    @property
    def output_counts(self) -> Array:
        """(m,) samples of each output in the experiments that are fitted."""
        if not self.experiments.channels:
            return np.full(self.joint_count, float(self.measured.shape[0]))
        return self.experiments.output_counts

    def torque_of(self, outputs: Array) -> Array:
        """(N, n, ...) torque in a table (M, m, ...) over all outputs of the experiments that are fitted."""
        return self.experiments.torque_of(outputs)

    def beside_prior(self, table: Array) -> Array:
        """A whitened table (m, p) over the first p free parameters with the rows of the prior below it; the table
        itself where there is none."""
        return table if self.prior is None else np.vstack([table, self.prior.padded(table.shape[1])])

    # ---- other models

    @property
    def torque_alone(self) -> LoopModel:
        """The same model without what is fitted beside the torque."""
        return replace(self, experiments=self.experiments.torque_alone)

    def with_values(self, values: Array) -> LoopModel:
        """The same model starting from other values."""
        return replace(self, free_parameters=self.free_parameters.with_values(values))

    def with_free(self, free_parameters: Iterable[FreeParameter]) -> LoopModel:
        """The same model with these free parameters."""
        return replace(self, free_parameters=FreeParameters(free_parameters))

    def without(self, names: Collection[str]) -> LoopModel:
        """The reduced model of a robot, in which the base parameters of these names are zero."""
        assert isinstance(self.parameters, RobotParameters)
        kept = [i for i, name in enumerate(self.parameters.names) if name not in names]
        reduced = replace(
            self, free_parameters=self.free_parameters.without(names),
            loads={label: load.on(kept) for label, load in self.loads.items()},
        )  # fmt: skip
        return reduced.with_loop(parameters=self.parameters.without(names))

    def with_loop(self, **changes: Any) -> LoopModel:
        """The same model with other attributes of its :class:`Loop`."""
        return replace(self, loop=replace(self.loop, **changes))

    def with_delay(self, samples: float) -> LoopModel:
        """The same model with a known delay of the command, in control periods, in all experiments."""
        name, systems = self.loop.plant_name, self.loop.systems
        return self.with_loop(systems={label: s.with_delay(name, samples) for label, s in systems.items()})

    def with_experiment(self, label: str, experiment: Experiment) -> LoopModel:
        """The same model with other data under a label."""
        return replace(self, experiments=self.experiments.with_experiment(label, experiment))

    def pushed(self, label: str, external_torques: Sequence[ExternalTorque]) -> LoopModel:
        """The same model with these torques from outside in an experiment, instead of those that it has."""
        experiment = replace(self.experiments[label], external_torques=tuple(external_torques))
        return self.with_experiment(label, experiment)

    def with_low_pass(self, low_pass: LowPass | None) -> LoopModel:
        """The same model with another filter of torque and regressor, or none."""
        return replace(self, experiments=replace(self.experiments, low_pass=low_pass))

    def on(self, *labels: str) -> LoopModel:
        """The same model with some of its experiments alone, all of them for the estimation."""
        model = self.with_loop(systems={label: self.loop.systems[label] for label in labels})
        return replace(model, experiments=self.experiments.fitted(labels))

    def integrated_as(self, values: Array) -> LoopModel:
        """The same model with the integration steps that it has at these values, wherever its parameters move."""
        if self.loop.substeps is None:
            return self
        stated = self._plant(values).stated_substeps
        plant = self.loop.plant.with_substeps(stated) if stated is not None else None
        return self if plant is None else self.with_loop(plant=plant)

    # ---- values in it

    def theta(self, values: Array, label: str | None = None) -> Array:
        """(b,) base parameters that act in an experiment; by default those of the first one without its load, as in
        ``parameters``."""
        if label is None:
            return np.asarray(values[self.free_parameters.places(self.first)])
        theta = self.free_parameters.theta(values, label)
        return theta + self.loads[label].shift if label in self.loads else theta

    def system(self, values: Array, label: str | None = None) -> System:
        """The loop of an experiment, by default the first one, with these values; all else stays untouched."""
        label = label or self.first
        others = self.free_parameters.others(values, label)
        return self.loop.system(label, self.experiments[label], self.theta(values, label), others)

    def simulation(self, values: Array, label: str | None = None) -> Simulation:
        """An experiment, by default the first one, with these values; it runs when something is asked of it."""
        return Simulation(self, values, label or self.first)

    def torque(self, values: Array, label: str | None = None) -> Array:
        """(N, n) simulated torque at the samples of an experiment, by default of all that are fitted; raises
        DivergedError, SimulationError."""
        labels = self.estimation_labels if label is None else (label,)
        return np.concatenate([self.simulation(values, each).torque() for each in labels])

    def outputs(self, values: Array) -> Array:
        """(M, m) all simulated outputs of the experiments that are fitted, the torque first; raises DivergedError,
        SimulationError."""
        if not self.experiments.channels:
            return self.torque(values)
        return np.concatenate([self.simulation(values, each).outputs() for each in self.estimation_labels])

    def residual(self, values: Array, label: str | None = None) -> Array:
        """(N, n) measured minus simulated torque of an experiment, by default of all that are fitted."""
        measured = self.measured if label is None else self.experiments.measured_in(label)
        return measured - self.torque(values, label)

    def output_residual(self, values: Array) -> Array:
        """(M, m) measured minus simulated outputs of the experiments that are fitted; raises SimulationError."""
        return self.measured_outputs - self.outputs(values)

    @property
    def threads(self) -> int:
        """How many are worth their cost for simulations, and for what is computed at their samples: ``workers``, or one
        where all runs are short."""
        longest = max(experiment.reference.time.size for experiment in self.experiments.values())
        counted = max(self.joint_count / 2, 1) ** 2
        return self.workers if longest * self.loop.subdivision * counted >= LONG_RUN else 1

    def allowed_workers(self, values: Array) -> int:
        """How many simulations may run at once: ``threads``, or one where Python runs the loop or an FMU of another
        tool takes part."""
        if self.threads == 1 or not may_run_side_by_side(self.loop.systems[self.first]):
            return 1
        return self.threads if self.simulation(values).record(ticks=np.zeros(1, dtype=np.int64)).compiled else 1

    @property
    def workers_from_start(self) -> int:
        """How many simulations may run at once from the start values on; one where these cannot be simulated, with
        which each of them deals by itself."""
        try:
            return self.allowed_workers(self.start)
        except (SimulationError, FmuError):
            return 1

    # ---- how finely its plant is integrated

    @property
    def can_refine(self) -> bool:
        """Whether the substeps of the plant can be chosen, so that halving them can be tried."""
        loop, label = self.loop, self.first
        start = loop.start_values(self.experiments[label])
        known = loop.parameters.substeps(loop.parameters.nominal(), start, loop.systems[label].step_size)
        return known is not None and loop.plant.with_substeps(2) is not None

    @property
    def divides_steps(self) -> bool:
        """Whether the length of its steps counts: the plant holds linear inputs over them, or follows them from one to
        the next while something bends them in between."""
        bent = [p.key.rpartition(":") for p in self.free_parameters if p.owner == INPUT]
        return self.loop.holds_ramps or any(s in self.loop.ramps and own not in STRAIGHT for s, _, own in bent)

    def twice_as_fine(self) -> LoopModel | None:
        """The same model with steps half as long: of the integration of the plant, or those between which linear inputs
        are held or go on straight; None where they cannot be chosen."""
        loop = self.loop
        if self.divides_steps:
            finer = [count for count in loop.subdivisions if count >= 2 * loop.subdivision]
            return self.with_loop(subdivision=finer[0]) if finer else None
        return self.with_loop(substep_factor=2 * loop.substep_factor) if self.can_refine else None

    def fewest_substeps(self, values: Array) -> int:
        """The fewest substeps of the plant that are stable in all fitted experiments."""
        fewest = self.with_loop(substeps=1, substep_factor=1)
        return max(fewest._plant(values, label).stated_substeps or 1 for label in self.estimation_labels)

    def automatic_substeps(self, values: Array) -> int:
        """The substeps of the plant by the rule for its fastest rate."""
        fewest, counts = self.with_loop(substeps=1, substep_factor=1), []
        for label in self.estimation_labels:
            known = fewest._plant(values, label).equations()
            assert known is not None
            counts.append(known[0].automatic_substeps(self._tick_s(label)))
        return max(counts)

    def integration_steps(self, values: Array) -> int:
        """Steps of the integration of the plant in all fitted experiments, where they can be chosen."""
        return sum(self.simulation(values, label).integration_steps for label in self.estimation_labels)

    def integration(self, values: Array) -> Integration | None:
        """How the plant is integrated; None where its equations are not known."""
        return integration(self._plant(values), self._tick_s(self.first))

    def _plant(self, values: Array, label: str | None = None) -> Component:
        """The plant as it is run with these values."""
        return self.system(values, label).components[self.loop.plant_name]

    def _tick_s(self, label: str) -> float:
        """Communication step of the plant in an experiment, s."""
        return self.loop.systems[label].step_size / self.loop.subdivision


@dataclass(frozen=True, eq=False)
class Simulation:
    """One experiment of a loop with certain values of what is free.

    Attributes:
        model: the loop; values: (p,); label: of the experiment.
    """

    model: LoopModel
    values: Array
    label: str

    def moved(self, i: int, value: float) -> Simulation:
        """The same with another value of a free parameter."""
        values = self.values.copy()
        values[i] = value
        return replace(self, values=values)

    def on(self, experiment: Experiment) -> Simulation:
        """The same with other data."""
        return replace(self, model=self.model.with_experiment(self.label, experiment))

    @property
    def experiment(self) -> Experiment:
        """The reference and the measurement."""
        return self.model.experiments[self.label]

    @property
    def step_size(self) -> float:
        """Control period, s; the nominal one where it changes."""
        return self.model.loop.systems[self.label].step_size

    @property
    def instants(self) -> Instants | None:
        """The instants of the ticks, where the control period changes; else None."""
        changes = self.model.loop.systems[self.label].at_instants
        return Instants(self.experiment.reference.time, self.step_size) if changes else None

    @property
    def theta(self) -> Array:
        """(b,) base parameters that act here."""
        return self.model.theta(self.values, self.label)

    @cached_property
    def external_torques(self) -> tuple[ExternalTorque, ...]:
        """The torques from outside; their times and sizes may be free parameters."""
        found = list(self.experiment.external_torques)
        for key, value in self._free(EXTERNAL_TORQUE).items():
            index, _, name = key.partition(".")
            found[int(index)] = found[int(index)].moved(name, value)
        return tuple(found)

    @property
    def log_shift_s(self) -> float:
        """Lag of the stamps of the log, in s, in addition to that of its operator."""
        return sum(self._free(LOG).values())

    def _free(self, owner: str) -> dict[str, float]:
        """Values of the free parameters of an owner, by their names there."""
        return self.model.free_parameters.others(self.values, self.label).get(owner, {})

    @cached_property
    def operator(self) -> SampleOperator:
        """Maps the held command to the samples of the log."""
        is_free = any(parameter.owner == LOG for parameter in self.model.free_parameters)
        count, shift = self.experiment.reference.time.size, self.log_shift_s / self.step_size
        between = is_free or not self.model.loop.shows_torque  # outputs do not jump at the ticks as commands do
        return self.experiment.operator.stamped_later(shift, count, between=between)

    @cached_property
    def system(self) -> System:
        """The system as it is run, with the ticks that its components need."""
        loop, system = self.model.loop, self.model.system(self.values, self.label)
        if loop.subdivision == 1:
            return system
        return divided(system, loop.plant_name, set(loop.added_components), loop.subdivision)

    def record(
        self,
        *,
        ticks: NDArray[np.int64] | None = None,
        all_ticks: bool = False,
        system: System | None = None,
        observe: Observer | None = None,
        signals: Sequence[str] | None = None,
    ) -> Recording:
        """Run it; raises DivergedError, SimulationError.

        Args:
            ticks: to record; by default those that the samples need, with ``all_ticks`` all.
            system: another one like the own; observe, signals: as of :func:`fmu_didim.cosim.simulate`.
        """
        if ticks is None:
            ticks = np.arange(self.experiment.reference.time.size) if all_ticks else self.operator.ticks
        if not self.shown_as:
            return self._recorded(ticks, system or self.system, observe, signals)
        whole = self._recorded(np.arange(self.experiment.reference.time.size), system or self.system, observe)
        return changed_outputs(whole, ticks, self.shown_as, self.model.loop.plant_name)

    @property
    def shown_as(self) -> dict[str, float]:
        """What sensors do to the outputs of a model, by free parameters."""
        return self._free(OUTPUT)

    def _recorded(
        self,
        ticks: NDArray[np.int64],
        system: System,
        observe: Observer | None,
        signals: Sequence[str] | None = None,
    ) -> Recording:
        """These ticks of a run, the outputs as the model has them."""
        model, reference, external = self.model, self.experiment.reference, self.external_torques
        subdivision, driven = model.loop.subdivision, self._free(INPUT)
        bounds = model.loop.position_bounds(reference, self.experiment.initial_state.values)
        response, key = response_key(system) if observe is None else None, None
        if response is not None:
            run = (response, SameObject(reference), external, subdivision, tuple(bounds.items()), tuple(driven.items()))
            key = (run, ticks.tobytes(), None if signals is None else tuple(signals))
            if known := self._known(run, ticks, key[-1]):
                return known
        reference = with_external_torques(reference, external)
        if subdivision > 1:
            reference = held(reference, subdivision, at_instants=system.at_instants, ramps=system.ramps)
            ticks = ticks * subdivision
        reference = changed_inputs(reference, system.ramps, driven) if driven else reference
        recording = simulate(
            system, reference, ticks=ticks, bounds=bounds, observe=observe, pool=model.pool, signals=signals
        )  # fmt: skip
        if key is not None:
            model.recordings.keep(key, recording)
        return recording

    def _known(self, run: Hashable, ticks: NDArray[np.int64], signals: tuple[str, ...] | None) -> Recording | None:
        """What is kept of a run, at these ticks or all, of these signals or all."""
        kept = self.model.recordings
        if not len(kept):
            return None
        everywhere = np.arange(self.experiment.reference.time.size)
        for at, asked in product((ticks, everywhere), dict.fromkeys((signals, None))):
            if known := kept.find((run, at.tobytes(), asked)):
                return known if at.size == ticks.size else known.at(ticks)
        return None

    def torque(self) -> Array:
        """(N, n) simulated torque at the samples; raises DivergedError, SimulationError."""
        return self.sampled_torque(self.record())

    def outputs(self) -> Array:
        """(M, m) all simulated outputs, the torque first; raises DivergedError, SimulationError."""
        if not self.model.experiments.channels:
            return self.torque()
        recording = self.record(ticks=self.output_ticks)
        return self.sampled_outputs(
            recording, self.logged_torque(recording), lambda name: recording.table([name], sampled=True)[:, 0]
        )

    def channels(self) -> dict[str, Array]:
        """Name of each signal that was measured beside the torque -> (N,) as simulated at its own samples; raises
        DivergedError, SimulationError."""
        recording, found = self.record(ticks=self.output_ticks), dict[str, Array]()
        for channel in self.experiment.channels:
            signal = recording.table([self.signal_of(channel)], sampled=True)[:, 0]
            found[channel.name] = self._sampled_by(channel.operator, signal, recording)
        return found

    def signal_of(self, channel: Channel) -> str:
        """The ``component.output`` that a channel shows, behind the effects of an encoder that were added."""
        return measured_output(self.model.loop.systems[self.label], channel.signal)

    def _sampled_by(self, operator: SampleOperator, values: Array, recording: Recording) -> Array:
        """(N, ...) samples by an operator of values (K, ...) at ``output_ticks``; raises DivergedError."""
        found = operator.apply(values[np.searchsorted(self.output_ticks, operator.ticks)])
        if not np.isfinite(found).all():
            raise DivergedError(
                "A simulated output is not finite.", time=float(recording.time[-1]), next_step=self.when_diverged
            )  # fmt: skip
        return found

    @property
    def when_diverged(self) -> str:
        """What to do about a simulation that is no number."""
        if self.model.loop.shows_torque:
            return "Check the start values and the gains, signs and units of the loop."
        return OF_INPUTS

    @cached_property
    def output_ticks(self) -> NDArray[np.int64]:
        """Ticks that the samples of all outputs need."""
        if not self.experiment.channels:
            return self.operator.ticks
        return np.unique(np.concatenate([self.operator.ticks, *(c.operator.ticks for c in self.experiment.channels)]))

    @property
    def integration_steps(self) -> int:
        """Steps of the integration of its plant up to the last sample, where they can be chosen."""
        model, values = self.model, self.values
        stated = model.loop.substeps or model.automatic_substeps(values)
        return int(np.max(self.output_ticks, initial=0)) * max(stated, model.fewest_substeps(values))

    def sampled_outputs(self, recording: Recording, torque: Array, signal: Callable[[str], Array]) -> Array:
        """(M, m, ...) samples of a recording at ``output_ticks``; raises DivergedError.

        Args:
            torque: (K, n, ...) at the recorded ticks; signal: gives (K, ...) of a signal of the loop by its name.
        """
        experiments = self.model.experiments
        if not experiments.channels:
            return self.sampled(torque)
        further = [self._sampled_by(c.operator, signal(self.signal_of(c)), recording) for c in self.experiment.channels]
        return experiments.outputs_of(
            self.label, experiments.compared(self._sampled_by(self.operator, torque, recording), self.label), further
        )

    def sampled_torque(self, recording: Recording) -> Array:
        """(N, n) what the log shows of a recording at its ticks; raises DivergedError."""
        return self._sampled_torque(self.logged_torque(recording), float(recording.time[-1]))

    def torque_at(self, every: Array) -> Array:
        """(N, n) samples of the torque that a log would show at every tick, (T, n), of which one simulation gives the
        motion, too; raises DivergedError."""
        return self._sampled_torque(every[self.operator.ticks], float(self.experiment.reference.time[-1]))

    def _sampled_torque(self, ticks: Array, end_s: float) -> Array:
        torque = self.operator.apply(ticks)
        if not np.isfinite(torque).all():
            raise DivergedError(
                f"The simulated {self.model.loop.quantity} is not finite.", time=end_s, next_step=self.when_diverged,
            )  # fmt: skip
        return self.model.experiments.compared(torque, self.label)

    def logged_torque(self, recording: Recording) -> Array:
        """(K, n) what a log would show at the recorded ticks: the inputs without the torques from outside, or outputs
        at the instants themselves."""
        loop, logged, reference = self.model.loop, self.model.loop.logged, self.experiment.reference.time
        if not loop.shows_torque:
            return recording.table(list(logged), sampled=True)
        torque = np.column_stack([recording.inputs[name] for name in logged])
        for external in self.external_torques:
            reaches_log = logged[external.joint - 1] == f"{loop.plant_name}.tau{external.joint}"
            if reaches_log != external.is_logged:
                sign = -1.0 if reaches_log else 1.0
                torque[:, external.joint - 1] += sign * np.interp(recording.time, reference, external.along(reference))
        return torque

    def sampled(self, table: Array) -> Array:
        """(N, ...) samples of values (K, ...) at the ticks of the log, filtered as it is."""
        return self.model.experiments.compared(self.operator.apply(table), self.label)
