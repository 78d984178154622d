"""The loop of a case: from its components or from an SSP archive, with its timing and what is spliced into it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from fmu_didim.case.document import CaseDocument
from fmu_didim.case.free import DRIVE, beside_the_plant
from fmu_didim.components import Component, FmuComponent, rename
from fmu_didim.components.parameter_names import name_parameters
from fmu_didim.effects import EFFECTS
from fmu_didim.effects.drive_gain import DriveGain
from fmu_didim.errors import InputError, UnknownNameError
from fmu_didim.master import System, closed_loop, splice_effect
from fmu_didim.master.system import REFERENCE
from fmu_didim.robot import RobotDescription
from fmu_didim.ssp import read_ssp

TOLERANCE = 1e-6
"""Relative distance of two rates from a whole ratio that still counts as rounding of the numbers in the file."""


def communication_step(document: CaseDocument, controller: Component) -> float:
    """Step h of the loop in s: ``loop.rate_hz``, else ``controller.rate_hz``, else the controller's sample time."""
    own = None if document.controller is None else document.controller.rate_hz
    for rate in (document.loop.rate_hz, own):
        if rate is not None:
            return 1.0 / rate
    if controller.sample_time is None:
        raise InputError(
            "The control rate is unknown.", where="loop", next_step=_rate_to_give(controller),
        )  # fmt: skip
    return controller.sample_time


def _rate_to_give(controller: Component) -> str:
    suggested = controller.fmu.experiment.step if isinstance(controller, FmuComponent) else None
    if not suggested:
        return "Give loop: {rate_hz: ...}; this controller states none."
    return (
        f"If it is the {1 / suggested:.6g} Hz that the FMU suggests for its default experiment, "
        f"give loop: {{rate_hz: {1 / suggested:.6g}}}."
    )


def delay_in_samples(document: CaseDocument, step: float) -> float:
    """Delay of the command in samples of the loop."""
    if document.loop.delay_s is not None:
        return document.loop.delay_s / step
    return document.loop.delay_samples


def loop_of_components(
    document: CaseDocument, plant: Component, controller: Component, reference_names: tuple[str, ...], joint_count: int
) -> System:
    """The loop of plant and controller along a reference with these columns.

    Raises:
        InputError: a rate is no whole multiple or divisor of the rate of the loop.
    """
    step = communication_step(document, controller)
    system = closed_loop(
        plant,
        controller,
        joint_count=joint_count,
        step_size=step,
        drive_gains=document.loop.drive_gains,
        delay_samples=delay_in_samples(document, step),
        jacobi=document.loop.algorithm == "jacobi",
        # Not every experiment has the test signal; that one of them does is checked when the case is loaded.
        injections={c: name for c, name in document.loop.injections.items() if name in reference_names},
        reference_names=reference_names,
    )
    return _with_timing(system, document)


def _with_timing(system: System, document: CaseDocument) -> System:
    """The loop with the rates of its components and the treatment of algebraic loops that the case asks for."""
    every: dict[str, int] = {}
    substeps: dict[str, int] = {}
    assert document.controller is not None  # else the loop is that of an archive, with its own timing
    sources = {"controller": document.controller, "plant": document.plant}
    for name, source in sources.items():
        if source.rate_hz is None:
            continue
        ratio = 1.0 / (system.step_size * source.rate_hz)
        if _is_whole(ratio):
            every[name] = round(ratio)
        elif _is_whole(1.0 / ratio):
            substeps[name] = round(1.0 / ratio)
        else:
            raise InputError(
                "The rate of a component must be a whole multiple or divisor of the rate of the loop.",
                where=f"{name}.rate_hz", got=f"{source.rate_hz:g} Hz in a loop of {1.0 / system.step_size:g} Hz",
                next_step="Choose loop: {rate_hz: ...} as a common multiple.",
            )  # fmt: skip
    return replace(
        system,
        every=every,
        substeps=substeps,
        after_step=frozenset(name for name, source in sources.items() if source.outputs_after_step),
        algebraic_loops=document.loop.algebraic_loops,
    )


def _is_whole(ratio: float) -> bool:
    return ratio >= 1 - TOLERANCE and abs(ratio - round(ratio)) <= TOLERANCE * ratio


def loop_of_archive(document: CaseDocument, folder: Path) -> System:
    """The system of the archive, its plant and its inputs under the names of the case.

    Step, order and delay are those of the archive, where the case does not give its own in ``loop``.

    Raises:
        InputError, UnknownNameError, FmuError: the archive cannot be read, or lacks something that the case names.
    """
    assert document.system is not None
    loop, plant = document.loop, document.plant
    path = folder / document.system.source
    system = read_ssp(path, step_size=None if loop.rate_hz is None else 1.0 / loop.rate_hz)
    if plant.component not in system.components:
        raise UnknownNameError("component", plant.component, system.components, where=f"plant.component: {path}")
    component = system.components[plant.component]
    if plant.parameters:
        component = component.with_parameters(plant.parameters)
    component = name_parameters(component, plant.parameter_names)
    component = rename(component, inputs=plant.inputs, outputs=plant.outputs)
    new = {f"{plant.component}.{own}": f"{plant.component}.{role}" for role, own in plant.outputs.items()}
    fed = {f"{plant.component}.{own}": f"{plant.component}.{role}" for role, own in plant.inputs.items()}
    columns = _columns(system, document.system.inputs, path)
    system = replace(
        system,
        components={**system.components, plant.component: component},
        connections=tuple(
            replace(c, source=columns.get(c.source, new.get(c.source, c.source)), target=fed.get(c.target, c.target))
            for c in system.connections
        ),
    )
    if loop.model_fields_set & {"delay_samples", "delay_s"}:
        system = system.with_delay(plant.component, delay_in_samples(document, system.step_size))
    if "algorithm" in loop.model_fields_set:
        system = replace(system, jacobi=loop.algorithm == "jacobi")
    if "algebraic_loops" in loop.model_fields_set:
        system = replace(system, algebraic_loops=loop.algebraic_loops)
    return system


def _columns(system: System, inputs: Mapping[str, str], path: Path) -> dict[str, str]:
    """Input of the system -> column of the reference, both as sources of connections."""
    given = [c.source.removeprefix(f"{REFERENCE}.") for c in system.connections if c.source.startswith(f"{REFERENCE}.")]
    for name in inputs.values():
        if name not in given:
            raise UnknownNameError("input of the system", name, dict.fromkeys(given), where=f"system.inputs: {path}")
    return {f"{REFERENCE}.{own}": f"{REFERENCE}.{column}" for column, own in inputs.items()}


def with_spliced_effects(system: System, robot: RobotDescription, *, plant: str = "plant") -> System:
    """The loop with the drive and sensor effects of each joint, with the parameters given there.

    Args:
        system: the loop; plant: name of its plant, which may be any FMU.

    Raises:
        InputError: the loop runs in parallel (Jacobi), or nothing takes the signal that an effect changes.
    """
    for j, joint in enumerate(robot.joints, start=1):
        for effect in joint.outside_effects():
            names = [v.name for v in (*effect.parameters(joint.type), *effect.shapes(joint.type))]
            values = {name: joint.parameters[name] for name in names if name in joint.parameters}
            system = splice_effect(system, effect, j, joint.type, values=values, plant=plant)
    return system


def with_drive_gains(system: System, document: CaseDocument, robot: RobotDescription | None, *, plant: str) -> System:
    """The loop with a gain in each drive whose gain is free, behind the torque log.

    Raises:
        InputError: a drive is named without its joint, or with one that the robot lacks.
    """
    for name, entry in beside_the_plant(document).items():
        if entry.of != DRIVE:
            continue
        if entry.joint is None:
            raise InputError(
                "The gain of a drive needs the joint.", where=f"identify.{name}", next_step="Add joint: 1."
            )
        if robot is not None and entry.joint > len(robot.joints):
            raise InputError(
                "The robot has no such joint.", where=f"identify.{name}.joint", got=entry.joint,
                valid=f"1 to {len(robot.joints)}",
            )  # fmt: skip
        kind = robot.joints[entry.joint - 1].type if robot is not None else "revolute"
        effect = EFFECTS[DriveGain.name]
        assert isinstance(effect, DriveGain)
        if f"{effect.name}{entry.joint}" not in system.components:
            system = splice_effect(system, effect, entry.joint, kind, plant=plant)
    return system
