"""From a case document to components, the loop and its model."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from fmu_didim.base.documents import validate
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.base.files import is_file
from fmu_didim.case.calibration.experiment import (
    CalibrationData,
    calibration_experiment,
    model_system,
    read_calibration,
)
from fmu_didim.case.calibration.model import model_component
from fmu_didim.case.changes import CaseChanges, CaseParts, changes_by, merged
from fmu_didim.case.document import MODEL, CaseDocument, make_estimator, read_case
from fmu_didim.case.files import path_of
from fmu_didim.case.free import carried_loads, free_parameters, prior
from fmu_didim.case.in_memory import Memory, check_at_hand, named
from fmu_didim.case.loop import (
    at_instants_of,
    communication_step,
    loop_of_archive,
    loop_of_components,
    loop_of_parts,
    with_drive_gains,
    with_gains,
    with_inserted_effects,
    with_reading,
)
from fmu_didim.case.parts import component_of, controller_block, identified, plant_block
from fmu_didim.case.runs.experiment import read_experiment
from fmu_didim.case.runs.instants import read_motion
from fmu_didim.case.runs.measured import read_channels
from fmu_didim.case.runs.temperatures import check_temperatures, read_temperatures
from fmu_didim.case.sources import ExperimentSource
from fmu_didim.case.tracking.followed import Tracking, planned_tracking, tracking_of
from fmu_didim.components import Component
from fmu_didim.cosim import System
from fmu_didim.cosim.system import REFERENCE
from fmu_didim.data.filters import LowPass
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, read_robot
from fmu_didim.estimators import Estimator
from fmu_didim.estimators.starts.signs import with_signs
from fmu_didim.model.experiment import Experiment
from fmu_didim.model.experiments import Experiments
from fmu_didim.model.loop import Loop
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.parameters import Parameters
from fmu_didim.model.workers import one_blas_thread


@dataclass(frozen=True, repr=False)
class Case:
    """A case that is ready to run; made by :func:`load_case`.

    Attributes:
        document: the content of its file; path, folder: of that file.
        parameters: the identified ones of the plant; plant, controller: the components; no controller where an archive
            or a list of components gives the whole loop.
        base: that loop; step_size: communication step of the loop in s.
        estimator: with its options.
        memory: the objects that its document names: signals in place of files, robot, components.
        robot: the robot description, where the case names one.
        data: of the experiments of a ``model:``, which has no robot and no controller.
        tracking: the virtual controller, and what it follows, of a case whose controller nobody knows.
    """

    document: CaseDocument
    folder: Path
    parameters: Parameters
    plant: Component
    controller: Component | None
    base: System | None
    step_size: float
    estimator: Estimator
    path: Path = Path()
    memory: Memory = field(default_factory=Memory)
    robot: RobotDescription | None = None
    data: CalibrationData | None = None
    tracking: Tracking | None = None

    def __repr__(self) -> str:
        runs = ", ".join(f"{label}: {run.role}" for label, run in self.document.runs.items())
        return f"Case({self.name!r}, {self.estimator.name}, {{{runs}}})"

    @property
    def name(self) -> str:
        """Name of the case."""
        return self.document.name

    @property
    def content(self) -> dict[str, Any]:
        """The content of the case file, as a mapping that :func:`load_case` takes."""
        return contents_of(self.document)

    @property
    def signals(self) -> Mapping[str, Trajectory]:
        """Name of a file in the document -> the signals that are taken instead of reading it."""
        return self.memory.signals

    @cached_property
    def model(self) -> LoopModel:
        """The loop with all experiments that have a torque log, with the values of the description.

        Raises:
            InputError: a log is missing or does not fit; found by :func:`load_case`, unless it was to read no logs.
        """
        return _with_data(self)

    @property
    def low_pass(self) -> LowPass | None:
        """The filter of both torques: that of the case, or the one that a virtual controller needs."""
        given, needed = self.document.low_pass, None if self.tracking is None else self.tracking.compared_hz
        if given is not None:
            return LowPass(given.cutoff_hz, given.order)
        return None if needed is None else LowPass(needed)

    @property
    def other_choices(self) -> dict[str, Case]:
        """Another choice of a virtual controller, in words -> the case with it; none where the controller is known."""
        if self.tracking is None:
            return {}
        return {
            words: replace(self, tracking=other, controller=other.controller, step_size=other.step)
            for words, other in self.tracking.others().items()
        }

    def with_(self, **changes: Unpack[CaseChanges]) -> Case:
        """The case with other entries, loaded anew: ``case.with_(torque_std=[0.1], loop={"delay_samples": 1})``.

        Args:
            changes: keys of the case file. Mappings are merged with what is there, all else replaces it, None takes
                an entry out: ``case.with_(train={"torque": {"rate_hz": 20}}, validation=None)``. Start values, and a
                reference or an estimator of another kind, replace the former ones as a whole. Objects may stand where
                a case file names other files: ``case.with_(controller=law, train={"torque": Log(t, tau)})``.

        Raises:
            InputError, FmuError, BuildError: as of :func:`load_case`.
        """
        return _changed(
            self.document, self.folder, changes, self.memory, require_torque="model" in self.__dict__,
            require_positions=self.tracking is None or not self.tracking.is_planned,
        )  # fmt: skip

    def with_content(self, content: dict[str, Any], folder: Path) -> Case:
        """Another case that knows the objects of this one; ``folder``: to which its paths are relative."""
        return _of_content(content, folder, self.memory, require_torque=True)

    def with_signals(self, signals: Mapping[str, Trajectory]) -> Case:
        """The case with signals in memory instead of files: ``case.with_signals({"train_10hz.csv": log})``.

        Args:
            signals: name of a file as the case has it -> its content, with the columns that the file would have.

        Raises:
            UnknownNameError: the case names no such file; InputError: the signals do not fit.
        """
        for name in signals:
            if name not in self.document.files:
                raise UnknownNameError("file in the case", name, self.document.files, where=self.name)
        memory = self.memory | Memory(signals)
        changed = replace(self, memory=memory)
        if self.data is not None:
            changed = replace(changed, data=read_calibration(self.document, self.folder, self.plant, memory.signals))
        if "model" in self.__dict__:
            _ = changed.model  # errors are found now
        return changed

    @property
    def needed(self) -> frozenset[str]:
        """Columns of the reference that the loop takes: ``q1``, ``dq1``."""
        if self.base is not None:
            sources = (c.source.partition(".") for c in self.base.connections)
            return frozenset(column for owner, _, column in sources if owner == REFERENCE)
        assert self.controller is not None
        return frozenset(
            match[1] + match[2] for v in self.controller.inputs for match in re.finditer(r"(d{0,2}q)_ref(\d+)", v.name)
        )

    def reference(self, label: str) -> Trajectory:
        """The reference of an experiment."""
        runs = self.document.runs
        if label not in runs:
            raise UnknownNameError("experiment", label, runs, where=self.name)
        if self.data is not None:
            return self.data.reference(label)
        if self.tracking is not None:
            return self.tracking.motion(label).signals
        return read_motion(
            runs[label], self.folder, step=self.step_size, torque_units=self.parameters.torque_units,
            needed=self.needed, signals=self.signals,
        ).signals  # fmt: skip

    def measured_starts(self, label: str, reference: Trajectory) -> Mapping[str, float]:
        """Parameters of the plant for states that were measured in an experiment, such as temperatures of its gears."""
        run, joints = self.document.runs[label], self.parameters.joint_count
        return read_temperatures(run, self.folder, reference.time, joints, label, self.signals).starts

    def inside(self, label: str) -> ExperimentSource:
        """The entry of an experiment; that of followed positions without their borders, which an estimator that takes
        positions as they are leaves out itself."""
        run = self.document.runs[label]
        if self.tracking is None:
            return run
        return self.tracking.inside(run, label, borders=not self.estimator.needs_positions)

    def system(self, label: str, reference: Trajectory) -> System:
        """The loop of an experiment along its reference, whose rows are the instants of the controller or a period
        apart."""
        if self.data is not None:
            return with_reading(model_system(self.plant, self.data, label), self.document)
        system = self.base
        if self.tracking is not None:
            system = self.tracking.loop(self.plant, reference)
        elif system is None:
            assert self.controller is not None  # the document says so
            n = self.parameters.joint_count
            system = loop_of_components(self.document, self.plant, self.controller, reference.names, n)
        if self.robot is not None:
            system = with_inserted_effects(system, self.robot, plant=self.plant_name)
        system = with_drive_gains(system, self.document, self.robot, plant=self.plant_name)
        system = with_gains(system, self.document, label)
        system = with_reading(system, self.document)
        return system if self.document.runs[label].instants is None else at_instants_of(system)

    def with_channels(self, label: str, experiment: Experiment) -> Experiment:
        """An experiment of a robot with what else was measured of its run.

        Raises:
            InputError: a file is missing or does not fit.
        """
        source = self.document.runs[label]
        if not source.measured_files:
            return experiment
        channels, told = read_channels(
            source, self.folder, experiment.reference, self.system(label, experiment.reference), plant=self.plant_name,
            torque_units=self.parameters.torque_units, label=label, signals=self.signals,
        )  # fmt: skip
        return replace(experiment, channels=channels, told=tuple(dict.fromkeys((*experiment.told, *told))))

    @property
    def plant_name(self) -> str:
        """Name of the plant in the loop."""
        return self.document.plant_name

    def model_on(self, experiments: Mapping[str, Experiment]) -> LoopModel:
        """The loop of the case with data, those for the estimation first."""
        document = self.document
        shown = () if self.data is None else tuple(f"{MODEL}.{name}" for name in self.data.together)
        systems = {label: self.system(label, experiment.reference) for label, experiment in experiments.items()}
        first = next(iter(systems.values()))
        low_pass, plant = self.low_pass, first.components[self.plant_name]
        follows = None if self.tracking is None else self.tracking.bandwidth_hz
        loop = Loop(systems, self.parameters, plant, self.plant_name, output_signals=shown, follows_hz=follows)
        for label, experiment in experiments.items():
            for name in experiment.initial_state.values:
                loop.start_named(name, where=f"{label}.initial_state")
        return LoopModel(
            loop,
            Experiments(experiments, low_pass),
            free_parameters(document, self.parameters, first),
            torque_deviation=self._stated_deviation(experiments),
            joint_weights=document.joint_weights,
            prior=prior(document, self.parameters, self.folder),
            loads=carried_loads(document, self.parameters),
        )

    def _stated_deviation(self, experiments: Mapping[str, Experiment]) -> Array | None:
        """(n,) known standard deviations of the noise of the log; None where they are not stated for all of it."""
        if self.data is None:
            return None if self.document.torque_std is None else np.array(self.document.torque_std)
        outputs = self.data.runs[next(iter(experiments))].outputs
        stated = [outputs[name].errors.stated for name in self.data.together]
        return None if None in stated else np.array(stated)


@one_blas_thread
def load_case(
    source: Path | str | Mapping[str, Any],
    *,
    folder: Path | str = ".",
    signals: Mapping[str, Trajectory] | None = None,
    require_torque: bool = True,
    require_positions: bool = True,
) -> Case:
    """Read a case, build its FMUs and load its data; all its errors are found here.

    Args:
        source: the case file, or its content, in which objects may stand where a file names other files: a
            :class:`Log`, a :class:`Reference`, a robot description, a component, a python-control system or a function.
        folder: to which the paths of a content are relative; those of a file are relative to its own folder.
        signals: name of a data file as the case has it -> signals in memory that are taken instead.
        require_torque: whether the torque logs are read at once, if the case names them; without them it can only be
            simulated.
        require_positions: whether the logs of a case whose controller nobody knows must be there; without them its
            motion can only be planned.

    Raises:
        InputError, FmuError, BuildError: with what, where, got, valid and next step.
    """
    required = {"require_torque": require_torque, "require_positions": require_positions}
    memory = Memory(dict(signals or {}))
    if isinstance(source, Mapping):
        content, found = named(source, Path(folder))
        return _of_content(content, Path(folder), memory | found, **required)
    document, path = read_case(source), Path(source)
    return _loaded(document, path.parent, path, memory, **required)


def case_of(
    case: Case | Path | str | Mapping[str, Any] | None,
    objects: CaseParts,
    *,
    require_torque: bool = True,
    require_positions: bool = True,
) -> Case:
    """The case of a verb: as it is, or with the objects that the verb was given in the place of its entries.

    Raises:
        InputError, FmuError, BuildError: as of :func:`load_case`; or the case does not tell which entry is meant.
    """
    required = {"require_torque": require_torque, "require_positions": require_positions}
    if case is None or any(value is not None for value in objects.values()):
        folder, memory, document = Path(), Memory(), None
        if isinstance(case, Case):
            folder, memory, document = case.folder, case.memory, case.document
        elif isinstance(case, Mapping):
            content, memory = named(case, folder)
            document = validate(CaseDocument, content, where="case")
        elif case is not None:
            folder, document = Path(case).parent, read_case(case)
        changes = changes_by(objects, document)
        if document is None:
            content, memory = named(changes, folder)
            return _of_content(content, folder, memory, **required)
        return _changed(document, folder, changes, memory, **required)
    if isinstance(case, Case):
        return case
    return load_case(case, require_torque=require_torque, require_positions=require_positions)


def _changed(
    document: CaseDocument, folder: Path, changes: Mapping[str, Any], memory: Memory, **required: bool
) -> Case:
    """The case of a document with other entries."""
    plain, found = named(changes, folder)
    content = merged(contents_of(document), plain)
    return _of_content(content, folder, memory | found, **required)


def contents_of(document: CaseDocument) -> dict[str, Any]:
    """The content of a case file, as a mapping."""
    return document.model_dump(mode="json", by_alias=True, exclude_unset=True)


def _of_content(content: dict[str, Any], folder: Path, memory: Memory, **required: bool) -> Case:
    document = validate(CaseDocument, content, where="case")
    _check_folder(document, folder, memory)
    return _loaded(document, folder, Path(), memory, **required)


def _loaded(
    document: CaseDocument, folder: Path, path: Path, memory: Memory, *, require_torque: bool,
    require_positions: bool = True,
) -> Case:  # fmt: skip
    memory = memory.of(document.named_objects)
    robot = _robot(document, folder, memory)
    model = RobotModel(robot) if robot is not None else None
    controller, base, data, tracking = None, None, None, None
    if document.model is not None:
        plant = model_component(document, folder, memory)
        data = read_calibration(document, folder, plant, memory.signals)
        step = data.step
    elif document.tracks:
        plant = component_of(document.plant, folder, lambda path: plant_block(model, path), objects=memory.objects)
        is_measured = require_positions or _is_logged(document, folder, memory)
        tracking = (
            tracking_of(document, folder, model, memory.signals) if is_measured else planned_tracking(document, model)
        )
        controller, step = tracking.controller, tracking.step
    elif document.controller is not None:
        plant = component_of(document.plant, folder, lambda path: plant_block(model, path), objects=memory.objects)
        count = len(robot.joints) if robot is not None else sum(v.name.startswith("tau") for v in plant.inputs)
        controller = component_of(
            document.controller, folder, controller_block, objects=memory.objects, joint_count=count
        )
        step = communication_step(document, controller)
    else:
        if document.components is not None:
            base = loop_of_parts(document, _parts(document, folder, model, memory))
        else:
            base = loop_of_archive(document, folder)
        plant, step = base.components[document.plant_name], base.step_size
    parameters = identified(document, model, plant, None if data is None else data.units)
    memory.check_joints(len(parameters.torque_units))
    estimator = make_estimator(document.estimator_options)
    case = Case(
        document, folder, parameters, plant, controller, base, step, estimator, path, memory, robot, data, tracking
    )  # fmt: skip
    fitted = [run for run in document.runs.values() if run.role == "estimation"]
    if data is not None or (require_torque and all(run.torque is not None for run in fitted)):
        _ = case.model  # errors in the data are found now
    return case


def _is_logged(document: CaseDocument, folder: Path, memory: Memory) -> bool:
    """Whether the files of all runs are there."""
    return all(name in memory.signals or is_file(path_of(name, folder)) for name in document.files)


def _robot(document: CaseDocument, folder: Path, memory: Memory) -> RobotDescription | None:
    if document.robot is None:
        return None
    if document.robot in memory.objects:
        found: RobotDescription = memory.objects[document.robot]
        return found
    check_at_hand(document.robot)
    return read_robot(folder / document.robot)


def _parts(document: CaseDocument, folder: Path, model: RobotModel | None, memory: Memory) -> dict[str, Component]:
    """The components that a case lists; one without source is the robot if it is the plant."""
    found = {}
    joints = 0 if model is None else len(model.description.joints)
    for name, source in document.parts.items():
        make = partial(plant_block, model) if name == document.plant_name else controller_block
        found[name] = component_of(source, folder, make, objects=memory.objects, joint_count=joints)
    return found


def _check_folder(document: CaseDocument, folder: Path, memory: Memory) -> None:
    """Refuse a case in memory whose files are looked for in the wrong folder."""
    sources = [part.source for part in document.parts.values()]
    sources += [document.robot, document.system.source if document.system is not None else None]
    sources.append(None if document.prior is None else document.prior.file)
    files = [name for name in sources if name is not None and ":" not in name and name not in memory.objects]
    for name in files:
        check_at_hand(name)
    absent = [name for name in files if not is_file(folder / name)]
    if absent:
        raise InputError(
            "The case names files that do not exist.", where=str(folder.resolve()), got=", ".join(absent),
            next_step="Paths are relative to that folder; of a case in memory it is load_case(content, folder=...).",
        )  # fmt: skip


def _with_data(case: Case) -> LoopModel:
    document = case.document
    if case.data is not None:
        return _of_a_model(case, case.data)
    tracking = case.tracking
    experiments = {
        label: read_experiment(
            case.inside(label), case.folder, step=case.step_size,
            drive_gains=document.loop.drive_gains, torque_units=case.parameters.torque_units, label=label,
            needed=case.needed, signals=case.signals, motion=None if tracking is None else tracking.motion(label),
        )
        for label, run in document.runs.items() if run.role == "estimation" or run.torque is not None
    }  # fmt: skip
    experiments = {label: case.with_channels(label, experiment) for label, experiment in experiments.items()}
    check_temperatures(experiments, case.plant)
    for name in document.loop.injections.values():
        if not any(name in e.reference.names for e in experiments.values()):
            known = next(iter(experiments.values())).reference.names
            raise UnknownNameError("column", name, known, where="loop.injections: no reference has it")
    model = with_signs(case.model_on(experiments))
    _check(document, model, case.estimator)
    return model


def _of_a_model(case: Case, data: CalibrationData) -> LoopModel:
    """The model of a case without robot, with its data."""
    experiments = {}
    for label in data.runs:
        reference = case.reference(label)
        experiments[label] = calibration_experiment(data, label, case.system(label, reference), reference)
    model = case.model_on(experiments)
    samples, values = int(model.output_counts.sum()), model.start.size
    if samples <= values:
        raise InputError(
            "There are no more samples than values to be identified.", where="measured",
            got=f"{samples} samples in all fitted experiments, {values} values", valid=f"{values + 1} samples or more",
            next_step="Give further samples or outputs, or take parameters out of identify:.",
        )  # fmt: skip
    return model


def _check(document: CaseDocument, model: LoopModel, estimator: Estimator) -> None:
    """Raise InputError where a case of a robot does not fit together."""
    n = model.joint_count
    if model.torque_deviation is not None and model.torque_deviation.size != n:
        raise InputError(
            "torque_std needs one value for each joint.", got=model.torque_deviation.size, valid=str(n),
            next_step="Give one number for all joints, or a list of that length.",
        )  # fmt: skip
    if (
        model.loop.torque_is_given
        and not estimator.needs_positions
        and (estimator.name != "clie" or not model.experiments.channels)
    ):
        raise InputError(
            "The loop is open: the torque is an input, and only the motion depends on what is to be identified.",
            where="connections", got=f"estimator {estimator.name}, "
            f"{'measured: ' + ', '.join(model.experiments.channels) if model.experiments.channels else 'no measured:'}",
            next_step="Give measured: with the positions, and estimator: {kind: clie}.",
        )  # fmt: skip
    if model.prior is not None and not estimator.takes_prior:
        raise InputError(
            f"The estimator {estimator.name} takes no prior.", where="prior", got=dict(estimator.describe()),
            valid="didim with its finish, clie", next_step="Use one of these, or take prior: out of the case.",
        )  # fmt: skip
    if model.experiments.channels and not estimator.fits_channels:
        raise InputError(
            f"The estimator {estimator.name} does not fit what was measured beside the torque.",
            where="measured", got=", ".join(model.experiments.channels),
            next_step=("Write positions: in the place of measured:, with its file: and columns: alone, or use didim "
                       "(with its finish) or clie, which fit them with the torque." if estimator.needs_positions else
                       "Use didim (with its finish) or clie, which fit them with the torque."),
        )  # fmt: skip
    if estimator.needs_positions:
        for label in model.estimation_labels:
            estimator.positions(model, label)
    if model.parameters.has_regressor:
        _check_motion(model.loop.plant, n, ("q", "dq"))  # accelerations can be had by differences
    elif model.parameters.is_probed:
        _check_motion(model.loop.plant, n, ("ddq",))
    offered = {v.name for v in model.loop.plant.parameters}
    absent = [name for name in model.parameters.plant_names if name not in offered]
    if absent:
        raise InputError(
            "The plant lacks parameters that are to be identified.", where="plant",
            got=", ".join(absent), valid=sorted(offered),
            next_step="Say what they are called there: plant: {parameter_names: {Fv1: name in the plant, ...}}.",
        )  # fmt: skip


def _check_motion(plant: Component, n: int, signals: tuple[str, ...]) -> None:
    given = {v.name for v in plant.outputs}
    missing = [f"{signal}{j}" for signal in signals for j in range(1, n + 1) if f"{signal}{j}" not in given]
    if missing:
        raise InputError(
            "The plant lacks outputs that the regressor needs.", where="plant", got=", ".join(missing),
            valid=sorted(given), next_step="Map them: plant: {outputs: {q1: name in the plant, ...}}.",
        )  # fmt: skip
