"""The loop of a case: from its components or from an SSP archive, with its timing and what is inserted into it."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.case.document import CONTROLLER, DRIVE, CaseDocument
from fmu_didim.case.free import beside_the_plant
from fmu_didim.components import Component, FmuComponent, rename
from fmu_didim.components.inserted import InsertedComponent
from fmu_didim.components.parameter_names import name_parameters
from fmu_didim.cosim import Connection, System, check_period, closed_loop, insert_effect
from fmu_didim.cosim.readings import readings
from fmu_didim.cosim.system import REFERENCE
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.dynamics.effects.drive_gain import DriveGain
from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.ssp import read_ssp

_log = logging.getLogger(__name__)
TOLERANCE = 1e-6
"""Relative distance of two rates from a whole ratio that still counts as rounding of the numbers in the file."""


def communication_step(document: CaseDocument, controller: Component) -> float:
    """Step h of the loop in s: ``loop.rate_hz``, else ``controller.rate_hz``, else the controller's sample time."""
    own = None if document.controller is None else document.controller.rate_hz
    for rate in (document.loop.rate_hz, own):
        if rate is not None:
            return 1.0 / rate
    if controller.sample_time is None:
        advice = "Give loop: {rate_hz: ...}; this controller states none."
        if isinstance(controller, FmuComponent) and controller.fmu.experiment.step:
            hz = f"{1 / controller.fmu.experiment.step:.6g}"
            advice = f"If it is the {hz} Hz that the FMU suggests for its default experiment, "
            advice += f"give loop: {{rate_hz: {hz}}}."
        raise InputError("The control rate is unknown.", where="loop", next_step=advice)
    return controller.sample_time


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
        plant, controller, joint_count=joint_count, step_size=step, drive_gains=document.loop.drive_gains,
        delay_samples=delay_in_samples(document, step), jacobi=document.loop.algorithm == "jacobi",
        # Not every experiment has the test signal; that one of them does is checked when the case is loaded.
        injections={c: name for c, name in document.loop.injections.items() if name in reference_names},
        reference_names=reference_names,
    )  # fmt: skip
    return _with_timing(system, document)


def _with_timing(system: System, document: CaseDocument) -> System:
    """The loop with the rates of its components and the treatment of algebraic loops that the case asks for."""
    every: dict[str, int] = {}
    substeps: dict[str, int] = {}
    sources = document.parts
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
    system = _with_plant(system, document, f"plant.component: {path}")
    given = [c.source.removeprefix(f"{REFERENCE}.") for c in system.connections if c.source.startswith(f"{REFERENCE}.")]
    for name in document.system.inputs.values():
        if name not in given:
            raise UnknownNameError("input of the system", name, dict.fromkeys(given), where=f"system.inputs: {path}")
    columns = {f"{REFERENCE}.{own}": f"{REFERENCE}.{column}" for column, own in document.system.inputs.items()}
    system = replace(
        system, connections=tuple(replace(c, source=columns.get(c.source, c.source)) for c in system.connections)
    )  # fmt: skip
    if loop.model_fields_set & {"delay_samples", "delay_s"}:
        system = system.with_delay(plant.component, delay_in_samples(document, system.step_size))
    if "algorithm" in loop.model_fields_set:
        system = replace(system, jacobi=loop.algorithm == "jacobi")
    if "algebraic_loops" in loop.model_fields_set:
        system = replace(system, algebraic_loops=loop.algebraic_loops)
    return system


def _with_plant(system: System, document: CaseDocument, where: str) -> System:
    """The system with the plant's variables under the names of the case."""
    plant = document.plant
    if plant.component not in system.components:
        raise UnknownNameError("component", plant.component, system.components, where=where)
    component = system.components[plant.component]
    if plant.parameters:
        component = component.with_parameters(plant.parameters)
    component = name_parameters(component, plant.parameter_names)
    component = rename(component, inputs=plant.inputs, outputs=plant.outputs)
    new = {f"{plant.component}.{own}": f"{plant.component}.{role}" for role, own in plant.outputs.items()}
    fed = {f"{plant.component}.{own}": f"{plant.component}.{role}" for role, own in plant.inputs.items()}
    return replace(
        system,
        components={**system.components, plant.component: component},
        connections=tuple(
            replace(c, source=new.get(c.source, c.source), target=fed.get(c.target, c.target))
            for c in system.connections
        ),
    )


def loop_of_parts(document: CaseDocument, parts: Mapping[str, Component]) -> System:
    """The system of the components and connections of a case.

    Raises:
        InputError: a connection cannot be read, the rate is unknown, or nothing gives the plant its torque.
        UnknownNameError: a connection names what does not exist.
    """
    loop, plant = document.loop, document.plant_name
    periods = [part.sample_time for part in parts.values() if part.sample_time is not None]
    if loop.rate_hz is None and not periods:
        raise InputError(
            "The control rate is unknown.", where="loop",
            next_step="Give loop: {rate_hz: ...}; none of the components states one.",
        )  # fmt: skip
    step = 1.0 / loop.rate_hz if loop.rate_hz is not None else min(periods)
    links = [
        Connection(source, target, gain)
        for target, text in document.connections.items()
        for gain, source in _terms(text, f"connections.{target}")
    ]
    delay = delay_in_samples(document, step)
    system = System(
        components=parts, connections=tuple(links), order=tuple(parts), step_size=step,
        delays={plant: delay} if delay else {}, jacobi=loop.algorithm == "jacobi",
    )  # fmt: skip
    system = _with_plant(_with_timing(system, document), document, "plant.component")
    _check_fed(system, plant)
    return system


_SUM = re.compile(r"\s+([+-])\s+")
_TERM = re.compile(r"(?P<sign>-?)\s*(?:(?P<gain>\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)\s*\*\s*)?(?P<name>[A-Za-z_]\w*\..+)")


def _terms(text: str, where: str) -> list[tuple[float, str]]:
    """Gains and sources of a sum such as ``reference.q1 - 0.5 * load.q``."""
    pieces = _SUM.split(text.strip())
    found = []
    for sign, piece in zip(["+", *pieces[1::2]], pieces[::2], strict=True):
        match = _TERM.fullmatch(piece.strip())
        if match is None:
            raise InputError(
                "This connection cannot be read.", where=where, got=text,
                valid="component.output, reference.column, and sums of them with gains: reference.q1 - 0.5 * load.q",
                next_step="Write both ends with their component; fmu-didim fmu info lists the variables of an FMU.",
            )  # fmt: skip
        negative = (sign == "-") != (match["sign"] == "-")
        found.append(((-1.0 if negative else 1.0) * float(match["gain"] or 1.0), match["name"].strip()))
    return found


def _check_fed(system: System, plant: str) -> None:
    """Warn of inputs that nothing is connected to; refuse a torque of the plant among them."""
    fed = {c.target for c in system.connections}
    loose = [
        f"{n}.{v.name}" for n, part in system.components.items() for v in part.inputs if f"{n}.{v.name}" not in fed
    ]
    torques = [name for name in loose if re.fullmatch(rf"{plant}\.tau\d+", name)]
    if torques:
        raise InputError(
            "Nothing is connected to a torque of the plant.", where="connections", got=", ".join(torques),
            next_step="Connect it by its own name in the component, as: motor.tau: pd.u.",
        )  # fmt: skip
    if loose:
        _log.warning("Nothing is connected to %s: they keep their start values.", ", ".join(loose))


def with_inserted_effects(system: System, robot: RobotDescription, *, plant: str = "plant") -> System:
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
            system = insert_effect(system, effect, j, joint.type, values=values, plant=plant)
    return system


def with_gains(system: System, document: CaseDocument, label: str) -> System:
    """The loop of an experiment with the values that its controller had there.

    Raises:
        InputError: a value is identified, too, so that it is one for all experiments; UnknownNameError: there is no
            such part or parameter.
    """
    where = f"experiments.{label}.gains"
    for name, value in document.runs[label].gains.items():
        owner, _, key = name.rpartition(".")
        owner = owner or CONTROLLER
        if owner == document.plant_name or owner not in system.components:
            valid = [f"{part}.{key}" for part in system.components if part != document.plant_name]
            raise UnknownNameError("parameter of the controller", name, valid, where=where)
        offered = [v.name for v in system.components[owner].parameters]
        if key not in offered:
            raise UnknownNameError(f"parameter of the {owner}", key, offered, where=where)
        if (owner, key) in {(one.of, one.parameter or name) for name, one in (document.identify or {}).items()}:
            raise InputError(
                "This value is identified, so that it is one for all experiments.", where=where, got=name,
                next_step="Take it out of identify:, or out of gains:.",
            )  # fmt: skip
        system = system.replace(owner, system.components[owner].with_parameters({key: value}))
    return system


def with_reading(system: System, document: CaseDocument) -> System:
    """The loop in which the outputs of FMUs that reading would disturb are read after each step only, unless the case
    says when they are read, or one that is used follows the inputs at once."""
    files = [file for run in document.runs.values() for file in run.measured_files]
    measured = {name for file in files for name in (*file.signals, *file.columns)}
    for name, found in readings(system).items():
        source = document.parts.get(name)
        if source is not None and source.outputs_after_step is not None:
            continue
        component, used = system.components[name], found.used | measured
        if found.reading.acts and not used & found.at_once and isinstance(component, FmuComponent):
            system = system.replace(name, replace(component, reads_between=False))
    return system


def at_instants_of(system: System) -> System:
    """The loop, stepped from instant to instant of its reference.

    Raises:
        InputError: an effect is computed for periods of one length, or an FMU takes steps of one size only.
    """
    for name, component in system.components.items():
        if isinstance(component, InsertedComponent) and component.effect is not None:
            check_period(component.effect, "revolute", name)
        form = component.compiled()
        if isinstance(form, FmuComponent) and form.sample_time is None and not form.takes_any_step:
            raise InputError(
                "This FMU takes communication steps of one size only (canHandleVariableCommunicationStepSize is "
                "false), and those from instant to instant differ.", where=name, got=form.path.name,
                next_step="Export it for variable steps, or for model exchange (interface: model-exchange).",
            )  # fmt: skip
    return replace(system, at_instants=True)


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
                valid=f"1 to {len(robot.joints)}", next_step="Take the number of a joint, from the base to the tip.",
            )  # fmt: skip
        kind = robot.joints[entry.joint - 1].type if robot is not None else "revolute"
        effect = EFFECTS[DriveGain.name]
        assert isinstance(effect, DriveGain)
        if f"{effect.name}{entry.joint}" not in system.components:
            system = insert_effect(system, effect, entry.joint, kind, plant=plant)
    return system
