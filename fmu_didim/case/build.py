"""From a case document to components, the loop and its model."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.base_parameters import base_parameters
from fmu_didim.block import Block
from fmu_didim.case.archive import loop_of_archive
from fmu_didim.case.data import read_experiment, read_reference
from fmu_didim.case.document import CaseDocument, ComponentSource, make_estimator, read_case
from fmu_didim.case.free import free_parameters, with_drive_gains
from fmu_didim.case.spliced import with_spliced_effects
from fmu_didim.case.timing import communication_step, delay_in_samples, with_timing
from fmu_didim.components import (
    Component,
    FmuComponent,
    ModelComponent,
    block_as_control,
    load_fmu,
    rename,
    wrap_control,
)
from fmu_didim.components.compiled_model import with_compiled_twin
from fmu_didim.components.parameter_names import name_parameters
from fmu_didim.controllers import read_controller
from fmu_didim.documents import validate
from fmu_didim.errors import InputError, UnknownNameError
from fmu_didim.estimators import Estimator
from fmu_didim.export import build_fmu
from fmu_didim.imports import import_object
from fmu_didim.master import System, closed_loop
from fmu_didim.prediction.experiment import Experiment
from fmu_didim.prediction.free_parameter import PLANT
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.prediction.low_pass import LowPass
from fmu_didim.prediction.parameters import NamedParameters, Parameters, RobotParameters
from fmu_didim.robot import RobotModel, read_robot
from fmu_didim.signals import Trajectory


@dataclass(frozen=True)
class Case:
    """A case that is ready to run; made by :func:`load_case`.

    Attributes:
        document: what the file says; path: the file; folder: where it lies.
        parameters: what is identified of the plant; plant, controller: the components; no controller where an archive
            gives the whole loop.
        base: that loop; step_size: communication step of the loop in s.
        model: the loop with all experiments that have a torque log, None if the logs were not read.
        estimator: with its options.
    """

    document: CaseDocument
    folder: Path
    parameters: Parameters
    plant: Component
    controller: Component | None
    base: System | None
    step_size: float
    model: LoopModel | None
    estimator: Estimator
    path: Path = Path()

    @property
    def name(self) -> str:
        """Name of the case."""
        return self.document.name

    def with_(self, **changes: Any) -> Case:
        """The case with other entries, loaded anew: ``case.with_(torque_std=[0.1], loop={"delay_samples": 1})``.

        Args:
            changes: keys of the case file; mappings are merged with what is there, all else replaces it.

        Raises:
            InputError, FmuError, BuildError: as of :func:`load_case`.
        """
        content = self.document.model_dump(mode="json", by_alias=True, exclude_unset=True)
        return load_case(_merged(content, changes), folder=self.folder, require_torque=self.model is not None)

    def reference(self, label: str) -> Trajectory:
        """The reference of an experiment."""
        runs = self.document.runs
        if label not in runs:
            raise UnknownNameError("experiment", label, runs, where=self.name)
        source = runs[label].reference
        return read_reference(source, self.folder, step=self.step_size, joint_count=self.parameters.joint_count)

    def system(self, reference: Trajectory) -> System:
        """The loop of the case along a reference."""
        system = self.base
        if system is None:
            assert self.controller is not None  # the document says so
            system = _system(self.document, self.parameters, self.plant, self.controller, reference)
        robot = None if self.document.robot is None else read_robot(self.folder / self.document.robot)
        if robot is not None:
            system = with_spliced_effects(system, robot, plant=self.plant_name)
        return with_drive_gains(system, self.document, robot, plant=self.plant_name)

    @property
    def plant_name(self) -> str:
        """Name of the plant in the loop."""
        return self.document.plant.component if self.base is not None else "plant"

    def model_on(self, experiments: Mapping[str, Experiment]) -> LoopModel:
        """The loop of the case with data, those for the estimation first."""
        document = self.document
        systems = {label: self.system(experiment.reference) for label, experiment in experiments.items()}
        first = next(iter(systems.values()))
        low_pass = document.low_pass
        return LoopModel(
            systems=systems,
            experiments=experiments,
            parameters=self.parameters,
            plant=first.components[self.plant_name],
            plant_name=self.plant_name,
            free_parameters=free_parameters(document, self.parameters, first),
            torque_deviation=None if document.torque_std is None else np.array(document.torque_std),
            joint_weights=document.joint_weights,
            low_pass=None if low_pass is None else LowPass(low_pass.cutoff_hz, low_pass.order),
        )


def load_case(source: Path | str | Mapping[str, Any], *, folder: Path | str = ".", require_torque: bool = True) -> Case:
    """Read a case, build its FMUs and load its data; all that can be wrong is found here.

    Args:
        source: the case file, or its content.
        folder: to which the paths of a content are relative; those of a file are relative to its own folder.
        require_torque: whether the torque logs are read; a mere simulation needs none.

    Raises:
        InputError, FmuError, BuildError: with what, where, got, valid and next step.
    """
    if isinstance(source, Mapping):
        document, folder, path = validate(CaseDocument, dict(source), where="case"), Path(folder), Path()
    else:
        document, path = read_case(source), Path(source)
        folder = path.parent
    model = RobotModel(read_robot(folder / document.robot)) if document.robot is not None else None
    controller, base = None, None
    if document.controller is not None:
        controller = _component(document.controller, folder, _controller_block)
        plant = _component(document.plant, folder, lambda path: _plant_block(model, path))
        step = communication_step(document, controller)
    else:
        base = loop_of_archive(document, folder)
        plant, step = base.components[document.plant.component], base.step_size
    parameters = _parameters(document, model, plant)
    case = Case(
        document, folder, parameters, plant, controller, base, step, model=None,
        estimator=make_estimator(document.estimator), path=path,
    )  # fmt: skip
    return replace(case, model=_with_data(case)) if require_torque else case


def _with_data(case: Case) -> LoopModel:
    document = case.document
    experiments = {
        label: read_experiment(
            run,
            case.folder,
            step=case.step_size,
            drive_gains=document.loop.drive_gains,
            joint_count=case.parameters.joint_count,
            label=label,
        )
        for label, run in document.runs.items()
        if run.role == "estimation" or run.torque is not None
    }
    for name in document.loop.injections.values():
        if not any(name in e.reference.names for e in experiments.values()):
            known = next(iter(experiments.values())).reference.names
            raise UnknownNameError("column", name, known, where="loop.injections: no reference has it")
    model = case.model_on(experiments)
    _check(document, model, case.estimator)
    return model


def _merged(content: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    result = dict(content)
    for key, value in changes.items():
        both = isinstance(value, Mapping) and isinstance(result.get(key), Mapping)
        result[key] = _merged(dict(result[key]), value) if both else value
    return result


def _system(
    document: CaseDocument, parameters: Parameters, plant: Component, controller: Component, reference: Trajectory
) -> System:
    step = communication_step(document, controller)
    system = closed_loop(
        plant,
        controller,
        joint_count=parameters.joint_count,
        step_size=step,
        drive_gains=document.loop.drive_gains,
        delay_samples=delay_in_samples(document, step),
        jacobi=document.loop.algorithm == "jacobi",
        # Not every experiment has the test signal; that one of them does is checked when the case is loaded.
        injections={c: name for c, name in document.loop.injections.items() if name in reference.names},
        reference_names=reference.names,
    )
    return with_timing(system, document)


def _check(document: CaseDocument, model: LoopModel, estimator: Estimator) -> None:
    n = model.joint_count
    if model.torque_deviation is not None and model.torque_deviation.size != n:
        raise InputError("torque_std needs one value for each joint.", got=model.torque_deviation.size, valid=str(n))
    if estimator.needs_positions:
        for label in model.estimation_labels:
            estimator.positions(model, label)
    if model.parameters.has_regressor:
        _check_motion(model.plant, n, ("q", "dq"))  # accelerations can be had by differences
    elif model.parameters.is_probed:
        _check_motion(model.plant, n, ("ddq",))
    offered = {v.name for v in model.plant.parameters}
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


def _parameters(document: CaseDocument, model: RobotModel | None, plant: Component) -> Parameters:
    """The base parameters of the robot, or the parameters of the plant that the case names."""
    chosen = {name: entry for name, entry in (document.identify or {}).items() if entry.of == PLANT}
    if not chosen and model is not None:
        return RobotParameters(model, base_parameters(model))
    offered = {v.name: v for v in plant.parameters}
    joints = [v for v in plant.inputs if re.fullmatch(r"tau\d+", v.name)]
    if not joints:
        raise InputError(
            "The plant has no torque input.", where="plant", got=", ".join(v.name for v in plant.inputs),
            next_step="Map it: plant: {inputs: {tau1: name in the plant}}.",
        )  # fmt: skip
    plant_names = []
    for name, entry in chosen.items():
        plant_names.append(entry.parameter or name)
        if plant_names[-1] not in offered:
            raise UnknownNameError("parameter of the plant", plant_names[-1], offered, where=f"identify.{name}")
    return NamedParameters(
        names=tuple(chosen),
        units=tuple(offered[name].unit for name in plant_names),
        plant_names=tuple(plant_names),
        torque_units=tuple(v.unit or "N.m" for v in joints),
        start=tuple(
            entry.start if entry.start is not None else offered[name].start
            for name, entry in zip(plant_names, chosen.values(), strict=True)
        ),
        lowest=tuple(-np.inf if e.minimum is None else e.minimum for e in chosen.values()),
        highest=tuple(np.inf if e.maximum is None else e.maximum for e in chosen.values()),
        probed=document.estimator.get("kind") == "didim",
    )


def _plant_block(model: RobotModel | None, path: Path | None) -> Block:
    if path is not None:
        return RobotModel(read_robot(path)).block()
    assert model is not None  # the document says so
    return model.block()


def _controller_block(path: Path | None) -> Block:
    if path is None:
        raise InputError("The controller needs a source.", where="controller", valid=".yaml, .fmu, package.module:name")
    return read_controller(path)


def _component(source: ComponentSource, folder: Path, make_block: Any) -> Component:
    named = source.source
    if named is not None and named.endswith(".fmu"):
        if source.kind != "fmu":
            raise InputError("An .fmu file is of the kind fmu.", got=source.kind, where=named)
        component: Component = _fmu(folder / named, source)
    elif named is not None and ":" in named:
        if source.kind != "control":
            raise InputError("A Python object is of the kind control.", got=source.kind, where=named)
        found = import_object(named, folder=folder, where="case")
        system = found() if callable(found) and not hasattr(found, "nstates") else found
        component = wrap_control(system, origin=named, initial_state=source.initial_state, substeps=source.substeps)
    else:
        block = make_block(folder / named if named is not None else None)
        component = _from_block(block, source)
    if source.parameters:
        component = component.with_parameters(source.parameters)
    if source.substeps is not None:
        component = component.with_substeps(source.substeps) or component
    component = name_parameters(component, source.parameter_names)
    return rename(component, inputs=source.inputs, outputs=source.outputs)


def _fmu(path: Path, source: ComponentSource) -> FmuComponent:
    return load_fmu(
        path, interface=source.interface, solver=source.solver, substeps=source.substeps, isolated=source.isolated,
        time_limit_s=source.time_limit_s, rerun=source.rerun, event_mode=source.event_mode,
    )  # fmt: skip


def _from_block(block: Block, source: ComponentSource) -> Component:
    if source.kind == "fmu":
        # An FMU does not tell its sample time; the description does.
        return _fmu(build_fmu(block, fmi_version=source.fmi), source).built_from(block)
    if source.kind == "control":
        return block_as_control(block)
    return with_compiled_twin(ModelComponent(block))
