"""Components and identified parameters of a case document."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.base.imports import import_object, run_code
from fmu_didim.case.document import CaseDocument, make_estimator
from fmu_didim.case.in_memory import check_at_hand
from fmu_didim.case.sources import ComponentSource
from fmu_didim.components import (
    Component,
    FmuComponent,
    ModelComponent,
    block_as_control,
    is_control,
    law_arguments,
    load_fmu,
    rename,
    wrap_control,
    wrap_law,
)
from fmu_didim.components.compiled_model import with_compiled_twin
from fmu_didim.components.fmu.description import MODEL_EXCHANGE
from fmu_didim.components.parameter_names import name_parameters
from fmu_didim.components.variable_names import unknown_parameter
from fmu_didim.controllers import read_controller
from fmu_didim.dynamics.base_parameters import base_parameters
from fmu_didim.dynamics.block import Block
from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.export import build_fmu, build_modelica
from fmu_didim.model.free_parameter import PLANT
from fmu_didim.model.parameters import NamedParameters, Parameters, RobotParameters

NO_OBJECTS: Mapping[str, Any] = MappingProxyType({})


def identified(
    document: CaseDocument, model: RobotModel | None, plant: Component, units: tuple[str, ...] | None = None
) -> Parameters:
    """The base parameters of the robot, or the parameters of the plant that the case names.

    Args:
        units: of the outputs that the log shows, where it is no torque.
    """
    own = (PLANT, document.plant_name)
    chosen = {name: entry for name, entry in (document.identify or {}).items() if entry.of in own}
    if not chosen and model is not None:
        return RobotParameters(model, base_parameters(model))
    offered = {v.name: v for v in plant.parameters}
    joints = [v for v in plant.inputs if re.fullmatch(r"tau\d+", v.name)]
    if units is None and not joints:
        raise InputError(
            "The plant has no torque input.", where="plant", got=", ".join(v.name for v in plant.inputs),
            next_step="Map it: plant: {inputs: {tau1: name in the plant}}.",
        )  # fmt: skip
    plant_names, ranges = [], []
    for name, entry in chosen.items():
        plant_names.append(entry.parameter or name)
        if plant_names[-1] not in offered and document.model is not None:
            raise unknown_parameter(plant, plant_names[-1], where=f"identify.{name}")
        if plant_names[-1] not in offered:
            raise UnknownNameError("parameter of the plant", plant_names[-1], offered, where=f"identify.{name}")
        ranges.append(entry.start_and_limits(name, offered[plant_names[-1]].start))
    return NamedParameters(
        names=tuple(chosen),
        units=tuple(offered[name].unit for name in plant_names),
        plant_names=tuple(plant_names),
        torque_units=tuple(v.unit or "N.m" for v in joints) if units is None else units,
        start=tuple(start for start, _, _ in ranges),
        lowest=tuple(low for _, low, _ in ranges),
        highest=tuple(high for _, _, high in ranges),
        probed=make_estimator(document.estimator_options).probes,
    )


def plant_block(model: RobotModel | None, path: Path | None) -> Block:
    """The block of the robot of a case, or of the description of another one."""
    if path is not None:
        return RobotModel(read_robot(path)).block()
    assert model is not None  # the document says so
    return model.block()


def controller_block(path: Path | None) -> Block:
    """The block of a controller description; raises InputError without a path."""
    if path is None:
        raise InputError(
            "The controller needs a source.", where="controller", valid=".yaml, .fmu, package.module:name",
            next_step="Add source: with the file of the controller, relative to the case.",
        )  # fmt: skip
    return read_controller(path)


def component_of(
    source: ComponentSource,
    folder: Path,
    make_block: Callable[[Path | None], Block],
    *,
    objects: Mapping[str, Any] = NO_OBJECTS,
    joint_count: int = 0,
    si_units: bool = True,
) -> Component:
    """The component of a source.

    Args:
        make_block: from the path of a description, or None, to its block.
        objects: what sources in memory are; joint_count: n, for a control law among them.
        si_units: whether an FMU shows SI units; else its own.

    Raises:
        InputError, FmuError, BuildError: the source does not fit its kind, or cannot be read.
    """
    named = source.source
    if named is not None and named in objects:
        component: Component = _of_object(objects[named], named, source, joint_count)
    elif named is not None and named.endswith(".fmu"):
        if source.kind != "fmu":
            raise InputError(
                "An .fmu file is of the kind fmu.", got=source.kind, where=named,
                next_step="Leave kind: out, or give kind: fmu.",
            )  # fmt: skip
        component = _fmu(folder / named, source, si_units=si_units)
    elif named is not None and named.endswith(".mo"):
        if source.kind != "fmu":
            raise InputError(
                "A Modelica file becomes an FMU.", got=source.kind, where=named, valid="kind: fmu",
                next_step="Leave kind: out, or give kind: fmu.",
            )  # fmt: skip
        in_exchange = source.model_copy(update={"interface": source.interface or MODEL_EXCHANGE})
        component = _fmu(build_modelica(folder / named, model=source.model), in_exchange, si_units=si_units)
    elif named is not None and ":" in named:
        if source.kind != "control":
            raise InputError(
                "A Python object is of the kind control.", got=source.kind, where=named,
                next_step="Leave kind: out, or give kind: control.",
            )  # fmt: skip
        component = _of_object(import_object(named, folder=folder, where="case"), named, source, joint_count)
    else:
        check_at_hand(named or "")
        block = make_block(folder / named if named is not None else None)
        component = _from_block(block, source)
    if source.parameters:
        component = component.with_parameters(source.parameters)
    if source.substeps is not None:
        component = component.with_substeps(source.substeps) or component
    component = name_parameters(component, source.parameter_names)
    return rename(component, inputs=source.inputs, outputs=source.outputs)


def _of_object(found: Any, named: str, source: ComponentSource, joint_count: int) -> Component:
    """The component of a Python object: itself, that of a block, a system or a law, or what a function returns."""
    if callable(found) and not isinstance(found, Component) and not is_control(found):
        if law_arguments(found, origin=named):
            return wrap_law(found, joint_count, origin=named)
        found = run_code(found, what="function", where="case", got=named)
    if isinstance(found, Block):
        return with_compiled_twin(ModelComponent(found))
    if isinstance(found, Component):
        return found
    return wrap_control(found, origin=named, initial_state=source.initial_state, substeps=source.substeps)


def _fmu(path: Path, source: ComponentSource, *, si_units: bool = True) -> FmuComponent:
    return load_fmu(
        path, interface=source.interface, solver=source.solver, substeps=source.substeps, isolated=source.isolated,
        time_limit_s=source.time_limit_s, rerun=source.rerun, event_mode=source.event_mode,
        tolerance=source.tolerance, si_units=si_units, directional_derivatives=source.directional_derivatives,
    )  # fmt: skip


def _from_block(block: Block, source: ComponentSource) -> Component:
    if source.kind == "fmu":
        # An FMU does not tell its sample time; the description does.
        return _fmu(build_fmu(block, fmi_version=source.fmi), source).built_from(block)
    if source.kind == "control":
        return block_as_control(block)
    return with_compiled_twin(ModelComponent(block))
