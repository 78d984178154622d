"""What discovery adds to a model, as files: signals, robot description, FMUs, case and SSP archive."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fmu_didim.base.errors import InputError, SimulationError
from fmu_didim.base.imports import is_reference, located
from fmu_didim.case import Case
from fmu_didim.case.document import CONTROLLER
from fmu_didim.components import load_fmu
from fmu_didim.data.signals import Array, trajectory, write_csv
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.augmentation.gains import found_gains
from fmu_didim.discovery.augmentation.places import InWiring
from fmu_didim.discovery.form.curve import FoundCurve
from fmu_didim.discovery.run import Found
from fmu_didim.discovery.signals.run import FoundOnSignals
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, write_robot
from fmu_didim.export import build_fmu
from fmu_didim.fit.fit import Fit
from fmu_didim.model.free_parameter import BASE, LOG, PLANT
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.simulated_table import motion_at_samples, simulated_table
from fmu_didim.model.workers import side_by_side
from fmu_didim.ssp import read_ssp, write_ssp

ROBOT_FILE = "robot_augmented.yaml"
CASE_FILE = "case_augmented.yaml"
SYSTEM_FILE = "loop_augmented.ssp"
VIRTUAL_RERUN = (
    "The loop that was fitted, run with the FMU as its plant, gives the fitted torque to {0:.1e} of its peak. The "
    "augmented case follows the positions by a virtual controller of its own, planned by what was found, whose torque "
    "holds the noise of the positions otherwise."
)
_PATH_KEYS = ("robot", "source", "file", "system", "towards")


def write_augmented(
    case: Case, found: Found, description: RobotDescription | None, out: Path, home: Path
) -> tuple[dict[str, str], str]:
    """The augmented model in a folder: what each file is, and how well it gives the fitted torque when it is run anew.

    Args:
        description: the robot, None for a plant that is a black box: it is left as it is, the parts stand in the loop.
        out: where the files are written; home: where they will lie, from which the case sees what it reads.
    """
    final = found.discovery.final
    files = _write_parts(found.builder, final, out)
    if description is not None:
        described, content = _write_robot(found.builder, final, case, out, home)
        note = _rerun(case.with_content(content, out), final)
        if left := [name for name in case.memory.objects if name != case.document.robot]:
            note += f" {CASE_FILE} names what was in memory, {', '.join(left)}: give it again where that case is used."
        return files | described, note
    system, note = _write_system(case.name, final, files, out)
    return files | system, note


def write_curve(builder: LoopModelBuilder, curve: FoundCurve, out: Path) -> dict[str, str]:
    """The curve of what has no name as CSV: variable, torque and half of its 95 % interval; where the equations of the
    robot are known, its description and FMU with the curve as an effect."""
    joint, (at, torque, half_width) = curve.tried.effect_at.joint, curve.drawn()
    name = f"curve_joint{joint}"
    table = np.column_stack([at, torque, half_width])
    np.savetxt(out / f"{name}.csv", table, delimiter=",", header="x,torque,half_width", comments="", fmt="%.9g")
    files = {f"curve_{joint}": f"{name}.csv"}
    if builder.description is None:
        return files
    robot = augmented_robot(builder, curve.fit)
    robot = robot.model_copy(update={"name": f"{robot.name}_curve_joint{joint}"})
    write_robot(robot, out / f"{name}_robot.yaml")
    built = build_fmu(RobotModel(robot).block(), directory=out)
    return files | {f"curve_robot_{joint}": f"{name}_robot.yaml", f"curve_fmu_{joint}": built.name}


def write_signals(found: Found | FoundOnSignals, out: Path) -> dict[str, str]:
    """As CSV, of each experiment: measured torque, that of the base and of the final model, and the motion at the
    samples; and the torque of both models at every control period. Of a model alone its outputs, and its inputs."""
    files: dict[str, str] = {}
    base, final = found.discovery.base, found.discovery.final
    for label, experiment in final.model.experiments.items():
        joints, measured = range(1, final.model.joint_count + 1), final.model.experiments.measured_in(label)
        columns = {f"measured{j}": measured[:, j - 1] for j in joints}
        every: dict[str, Array] = {}
        for name, fit in (("base", base), ("final", final)):
            run = fit.simulation(label)
            torque = run.torque()
            columns |= {f"{name}{j}": torque[:, j - 1] for j in joints}
            table = simulated_table(run)
            every |= {f"{name}{j}": table.values[:, j - 1] for j in joints}
        columns |= motion_at_samples(run, table)
        files |= _written(out, f"signals_{label}", experiment.time, columns)
        files |= _written(out, f"simulated_{label}", table.time, every)
    return files


def _written(out: Path, name: str, time: Array, columns: dict[str, Array]) -> dict[str, str]:
    write_csv(trajectory(time, columns), out / f"{name}.csv")
    return {name: f"{name}.csv"}


def augmented_robot(builder: LoopModelBuilder, fit: Fit) -> RobotDescription:
    """The robot description with all effects found and the fitted values, wherever they act."""
    described = builder.described(fit.model.added_effects)
    parameters = fit.model.parameters
    assert described is not None
    values = _described_values(parameters.described(fit.values[: parameters.count]))
    for parameter, value in zip(fit.model.free_parameters, fit.values, strict=True):
        if parameter.owner == PLANT:
            values[parameter.key] = float(value)
        elif parameter.owner not in (BASE, LOG, *fit.model.loop.factors) and parameter.effect is not None:
            values[f"{parameter.key}_{fit.model.added_effects[parameter.effect].joint}"] = float(value)
    return described.with_values(values)


def _described_values(robot: RobotDescription | None) -> dict[str, float]:
    assert robot is not None
    return {v.name: v.start for v in (*robot.standard_parameters(), *robot.shape_parameters())}


def _write_robot(
    builder: LoopModelBuilder, fit: Fit, case: Case, out: Path, home: Path
) -> tuple[dict[str, str], dict[str, Any]]:
    """Robot, FMU and case; and the case as it is while it lies in ``out``."""
    robot = augmented_robot(builder, fit)
    write_robot(robot, out / ROBOT_FILE)
    fmu = build_fmu(RobotModel(robot).block(), directory=out)
    given = _write_given(case, out)
    _write_case(_augmented_case(fit, _relocated(case.content, case.folder, home, given)), out)
    files = {"robot": ROBOT_FILE, "plant_fmu": fmu.name, "case": CASE_FILE}
    return files, _augmented_case(fit, _relocated(case.content, case.folder, out, given))


def _augmented_case(fit: Fit, document: dict[str, Any]) -> dict[str, Any]:
    """The case with the augmented robot, and the shift of the logs and the gains of controllers that were found."""
    document["robot"] = ROBOT_FILE
    chosen = {key: value for key, value in document.get("plant", {}).items() if key == "substeps"}
    document["plant"] = {"kind": "fmu", **chosen}
    shift = fit.simulation(fit.model.first).log_shift_s
    runs = [document[key] for key in ("train", "validation") if key in document]
    logs = [run.get("torque") for run in (*runs, *document.get("experiments", {}).values())]
    for log in (log for log in logs if log and shift):
        log["log_shift_s"] = log.get("log_shift_s", 0.0) + shift
    named = {"estimation": document.get("train"), "validation": document.get("validation")}
    for label, run in {**named, **document.get("experiments", {})}.items():
        known = label if label in fit.model.loop.systems else fit.model.first
        if run and (own := _stated(found_gains(fit, known))):
            run["gains"] = {**run.get("gains", {}), **own}
    return document


def _stated(gains: Mapping[str, tuple[float, float]]) -> dict[str, float]:
    """Gains that were found as a run of a case states them, those of its one controller without its name."""
    return {name.removeprefix(f"{CONTROLLER}."): value for name, (_, value) in gains.items()}


def _write_given(case: Case, out: Path) -> dict[str, str]:
    """Signals that were given in memory, as files: name in the case -> name in the folder."""
    written = {}
    for number, (name, signals) in enumerate(case.signals.items(), start=1):
        written[name] = f"data_{number}.csv"
        write_csv(signals, out / written[name])
    return written


def move_case(old: Path, new: Path, home: Path, copied: Iterable[str]) -> None:
    """Write the case of the folder ``old`` to ``new`` as it must be in ``home``, beside the files that were copied."""
    content = yaml.safe_load((old / CASE_FILE).read_text(encoding="utf-8"))
    _write_case(_relocated(content, old, home, {name: name for name in copied}), new)


def _write_case(content: dict[str, Any], out: Path) -> None:
    (out / CASE_FILE).write_text(yaml.safe_dump(content, sort_keys=False, allow_unicode=True), encoding="utf-8")


def _relocated(content: Any, old: Path, new: Path, written: Mapping[str, str]) -> Any:
    """A case document whose relative paths are seen from another folder, in which some files were written anew."""
    if isinstance(content, list):
        return [_relocated(item, old, new, written) for item in content]
    if not isinstance(content, dict):
        return content
    result = {}
    for key, value in content.items():
        if key == "time" and content.get("file") in written:
            continue  # the new file has its own name for it
        named = key in _PATH_KEYS and isinstance(value, str)
        result[key] = _seen_from(value, old, new, written) if named else _relocated(value, old, new, written)
    return result


def _seen_from(name: str, old: Path, new: Path, written: Mapping[str, str]) -> str:
    """A path, or ``module:name``, seen from another folder; whatever is no file there stays as it is."""
    if name in written:
        return written[name]
    if is_reference(name):
        file, _, member = located(name, old).rpartition(":")
        return f"{os.path.relpath(file, new)}:{member}" if file.endswith(".py") else name
    return os.path.relpath(old / name, new) if (old / name).is_file() else name


def _write_parts(builder: LoopModelBuilder, fit: Fit, out: Path) -> dict[str, str]:
    """The FMUs of the effects that stand in the wiring, with their values."""
    files = {}
    step = fit.model.loop.systems[fit.model.first].step_size
    for index, effect_at in enumerate(fit.model.added_effects):
        placed = builder.at(effect_at)
        if not isinstance(placed, InWiring):
            continue
        block = placed.part.block(placed.joint_type, step)
        values = {
            k.key: float(v) for k, v in zip(fit.model.free_parameters, fit.values, strict=True) if k.effect == index
        }
        name = placed.owner
        path = build_fmu(replace(block, name=name).with_parameters(values), directory=out)
        files[f"part_{name}"] = path.name
    return files


def _write_system(name: str, fit: Fit, files: Mapping[str, str], out: Path) -> tuple[dict[str, str], str]:
    """The loop with the parts in its wiring as an SSP archive, and how well it gives the fitted torque."""
    run = without_external_torques(fit.model).simulation(fit.values)
    system = run.system
    try:
        for component in system.components:
            if f"part_{component}" in files:
                part = system.components[component]
                values = {v.name: v.start for v in part.parameters}
                alone = load_fmu(out / files[f"part_{component}"]).with_parameters(values)
                system = system.replace(component, alone)
        path = write_ssp(system, out / SYSTEM_FILE, name=name)
        recording = run.record(system=read_ssp(path))
    except (InputError, SimulationError) as error:
        return {}, f"The augmented loop could not be written as an SSP archive: {error}"
    torque = run.sampled_torque(recording)
    wanted = run.torque()
    worst = float(np.abs(torque - wanted).max() / np.abs(wanted).max())
    note = f"The augmented loop, read back and run, gives the fitted torque to {worst:.1e} of its peak."
    shift = fit.simulation(fit.model.first).log_shift_s
    stated = f" A case with it states of the torque log: log_shift_s: {shift:.6g}." if shift else ""
    return {"system": path.name}, note + stated


def _rerun(case: Case, final: Fit) -> str:
    """The augmented case run anew from its files, with the plant as an FMU, against the model that was fitted.

    A virtual controller is planned by the robot that it is to move, and so is another one in that case: there the loop
    that was fitted is run with the FMU as its plant.
    """
    model = case.model.with_low_pass(None)  # as discovery fits it
    # Torques from outside belong to the experiment, not to the augmented model.
    alone = without_external_torques(final.model)

    def difference(label: str) -> float:
        own = alone.simulation(final.values, label)
        if alone.loop.is_virtual:
            plant = model.simulation(model.start, label).system.components[model.loop.plant_name]
            torque = own.sampled_torque(own.record(system=own.system.replace(alone.loop.plant_name, plant)))
        else:
            torque = model.torque(model.start, label)
        wanted = own.torque()
        compared = torque[-wanted.shape[0] :]  # discovery leaves out the beginning
        return float(np.abs(compared - wanted).max() / np.abs(wanted).max())

    tasks = [partial(difference, label) for label in model.experiments]
    try:
        worst = max(side_by_side(tasks, model.allowed_workers(model.start)))
    except SimulationError as error:
        return f"The augmented FMU could not be run: {error}"
    if alone.loop.is_virtual:
        return VIRTUAL_RERUN.format(worst)
    return f"The augmented case, run with its plant as an FMU, gives the fitted torque to {worst:.1e} of its peak."


def without_external_torques(model: LoopModel) -> LoopModel:
    """The model without torques from outside: they belong to an experiment, not to the machine."""
    for label in model.experiments:
        model = model.pushed(label, ())
    return model
