"""Free parameters of a case beside the base parameters: gains of controller or drives, the delay, the log's clock; and
what is known of the base parameters before.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from fmu_didim.base.cache import file_digest
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.case.document import DRIVE, CaseDocument
from fmu_didim.case.files import resolve
from fmu_didim.case.sources import IdentifiedParameter, RelativeStd
from fmu_didim.cosim import System
from fmu_didim.dynamics.effects.drive_gain import DriveGain
from fmu_didim.dynamics.load import Load, load_of
from fmu_didim.dynamics.physical_set import COUPLED, FRICTION, MOTOR_INERTIA
from fmu_didim.dynamics.prior import Prior, prior_of, prior_of_values, with_known
from fmu_didim.dynamics.robot import RobotDescription, read_robot
from fmu_didim.model.free_parameter import (
    DELAY,
    LOG,
    PLANT,
    FreeParameter,
    FreeParameters,
    base_free_parameters,
    delay_parameter,
    load_parameters,
    log_shift_parameter,
    of_experiment,
)
from fmu_didim.model.parameters import Parameters, RobotParameters

SAME_GEOMETRY = ("type", "alpha", "a", "theta", "d", "beta")
"""What two descriptions of one robot have in common at each joint, so that their values mean the same."""


def beside_the_plant(document: CaseDocument) -> Mapping[str, IdentifiedParameter]:
    """The entries of ``identify`` that do not belong to the plant."""
    return {name: e for name, e in (document.identify or {}).items() if e.of not in (PLANT, document.plant_name)}


def free_parameters(document: CaseDocument, parameters: Parameters, system: System) -> FreeParameters:
    """The free parameters: base parameters, own ones of experiments, and those that ``identify`` lists beside them.

    Raises:
        InputError, UnknownNameError: an entry names no part of the loop, or an experiment something that is not free.
    """
    further = {name: _entry(name, entry, system, document) for name, entry in beside_the_plant(document).items()}
    _check_each_once(further, parameters)
    own = {label: run.own for label, run in document.runs.items() if run.own}
    for label, names in own.items():
        for name in names:
            if name not in further and name not in parameters.names:
                valid = (*parameters.names, *further)
                raise UnknownNameError("free parameter", name, valid, where=f"experiments.{label}.own")
    base = {label: [name for name in names if name in parameters.names] for label, names in own.items()}
    others = [of_experiment(further[name], label) for label, names in own.items() for name in names if name in further]
    carried = _loads(document, parameters)
    return FreeParameters((*base_free_parameters(parameters, base), *carried, *further.values(), *others))


def _loads(document: CaseDocument, parameters: Parameters) -> list[FreeParameter]:
    """The parameters of the loads that runs carry."""
    return [
        free for label, load in loads_of(document, parameters).items()
        for free in load_parameters(load, label, _alike(document, label))
    ]  # fmt: skip


def loads_of(document: CaseDocument, parameters: Parameters) -> dict[str, Load]:
    """Label of each experiment that describes a load -> that load.

    Raises:
        InputError: the plant has no robot description, or no base parameter moves with a load.
    """
    found = {}
    for label, run in document.runs.items():
        if run.load is None or run.load.same_as is not None:
            continue
        if not isinstance(parameters, RobotParameters):
            raise InputError(
                "A load hangs on the last link of a robot description.", where=f"{label}: load", got="no robot:",
                next_step="Give robot: in the case.",
            )  # fmt: skip
        found[label] = load_of(parameters.model, parameters.base, run.load.known)
    return found


def carried_loads(document: CaseDocument, parameters: Parameters) -> dict[str, Load]:
    """Label of each experiment that carries a load -> that load."""
    found = loads_of(document, parameters)
    return found | {other: load for label, load in found.items() for other in _alike(document, label)}


def _alike(document: CaseDocument, label: str) -> list[str]:
    """Labels of the other experiments that carry the same load."""
    return [other for other, run in document.runs.items() if run.load is not None and run.load.same_as == label]


def _check_each_once(further: Mapping[str, FreeParameter], parameters: Parameters) -> None:
    """Raises InputError: two parameters with one name, or one parameter under two names."""
    if taken := [name for name in further if name in parameters.names]:
        raise InputError(
            "A base parameter has this name already.", where="identify", got=", ".join(taken),
            next_step="List it under another name; parameter: says what it is called in its component.",
        )  # fmt: skip
    meant: dict[tuple[str, str], str] = {}
    for name, parameter in further.items():
        before = meant.setdefault((parameter.owner, parameter.key), name)
        if before != name:
            raise InputError(
                "One parameter is listed twice.", where="identify", got=f"{before} and {name}",
                next_step="Take one of them out.",
            )  # fmt: skip


def _entry(name: str, entry: IdentifiedParameter, system: System, document: CaseDocument) -> FreeParameter:
    if entry.of == DELAY:
        found = replace(delay_parameter(float(system.delays.get(document.plant_name, 0.0))), name=name)
    elif entry.of == LOG:
        found = replace(log_shift_parameter(), name=name)
    else:
        owner, key = entry.of, entry.parameter or name
        if owner == DRIVE:
            owner, key = f"{DriveGain.name}{entry.joint}", DriveGain.name
        if owner not in system.components:
            valid = (*system.components, DRIVE, DELAY, LOG)
            raise UnknownNameError("part of the loop", entry.of, valid, where=f"identify.{name}.of")
        offered = {v.name: v for v in system.components[owner].parameters}
        if key not in offered:
            raise UnknownNameError(f"parameter of the {entry.of}", key, offered, where=f"identify.{name}")
        start = offered[key].start
        found = FreeParameter(name, offered[key].unit, owner, key, start, abs(start) or 1.0)
    value, low, high = entry.start_and_limits(name, found.value, (found.lowest, found.highest))
    return replace(found, value=value, lowest=low, highest=high)


def prior(document: CaseDocument, parameters: Parameters, folder: Path) -> Prior | None:
    """What a case says of the base parameters before they are identified; None where it says nothing.

    Args:
        folder: of the case, from which another description is read.

    Raises:
        InputError: the plant has no robot description, the other one is of another robot, or its values cannot be
            those of a robot.
    """
    known = _known_masses(document, parameters)
    own = _stated_prior(document, parameters, folder)
    if not known:
        return own
    free = [k.name for k in (*base_free_parameters(parameters), *_loads(document, parameters))]
    words = "what is said of the load" + ("s" if len(known) > 1 else "")
    return with_known(own, len(free), {free.index(name): value for name, value in known.items()}, words)


def _known_masses(document: CaseDocument, parameters: Parameters) -> dict[str, tuple[float, float]]:
    """Free parameter -> stated mass of a load and its standard deviation.

    Raises:
        InputError: torques of the robot do not show the mass by itself.
    """
    found = {}
    for label, load in loads_of(document, parameters).items():
        source = document.runs[label].load
        if source is None or source.mass is None or source.mass_std is None:
            continue
        if "M" not in load.alone:
            raise InputError(
                "The torques of this robot do not show the mass of a load by itself.", where=f"{label}: load.mass_std",
                next_step="Leave mass_std: out, and give centre: and inertia: if they are known.",
            )  # fmt: skip
        name = load_parameters(load, label)[load.stems.index("M")].name
        found[name] = (source.mass, source.mass_std)
    return found


def _stated_prior(document: CaseDocument, parameters: Parameters, folder: Path) -> Prior | None:
    """What prior: of a case says."""
    source = document.prior
    if source is None:
        return None
    if not isinstance(parameters, RobotParameters):
        raise InputError(
            "A prior is about the base parameters of a robot description.", where="prior", got="no robot:",
            next_step="Give robot: in the case, or limits of the parameters under identify:.",
        )  # fmt: skip
    model, base = parameters.model, parameters.base
    if source.result is not None:
        return _of_earlier(folder / str(source.file), document, folder, parameters)
    other = model.description if source.file is None else read_robot(folder / source.file)
    _check_same_joints(model.description, other, source.towards)
    nominal = {v.name: v.start for v in other.standard_parameters()}
    count = len(model.description.joints)
    links = _by_joint(source.relative_std, count, "relative_std")
    single: dict[str, float] = {}
    for key, stems in (("motor_inertia", (MOTOR_INERTIA, COUPLED)), ("friction", FRICTION)):
        for joint, relative in _by_joint(getattr(source, key), count, key).items():
            found = {f"{stem}{joint}": abs(nominal.get(f"{stem}{joint}", 0.0)) for stem in stems}
            single |= {name: relative * v for name, v in found.items() if v > 0 and name in base.standard_names}
    where = "the robot description" if source.file is None else source.file
    return prior_of(model, base, nominal, links=links, single=single, source=where)


def _of_earlier(path: Path, document: CaseDocument, folder: Path, parameters: RobotParameters) -> Prior:
    """The base parameters of an earlier result with their covariance.

    Raises:
        InputError: it is missing or damaged, has no values, is of another robot, or is from a log that is fitted again.
    """
    base, names = parameters.base, parameters.base.names
    where = f"prior: {path.name}"
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        values, covariance = found["parameters"], np.array(found["covariance"], dtype=float)
        order, verdict = list(values), str(found["verdict"])
        links, digests = found["geometry"]["links"], set(found["provenance"]["files"].values())
        reasons = [str(reason["code"]) for reason in found["reasons"]]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            "This is no result of an identification of a robot.", where=where, got=str(error),
            next_step="Give result.json of fmu-didim identify, or its folder.",
        ) from error  # fmt: skip
    own = [{key: getattr(joint, key) for key in SAME_GEOMETRY} for joint in parameters.model.description.joints]
    theirs = [{key: {"beta": 0.0, **link}[key] for key in SAME_GEOMETRY} for link in links]
    absent = [name for name in names if name not in values]
    if not values or own != theirs or absent or covariance.shape != (len(order), len(order)):
        raise InputError(
            "The result that prior: names is of another robot." if values else "The result holds no values.",
            where=where, got=f"without {', '.join(absent)}" if absent and values else verdict,
            next_step="Identify the robot of this case, with the same description, from runs without the load.",
        )  # fmt: skip
    fitted = [run.torque for run in document.runs.values() if run.role == "estimation" and run.torque is not None]
    again = list[str]()
    for file in fitted:
        with suppress(InputError):  # signals in memory
            again += [file.file] if file_digest(resolve(file, folder)) in digests else []
    if again:
        raise InputError(
            "A log that is fitted is that of the result, too: it would count twice.", where=where,
            got=", ".join(again), next_step="Fit other runs, or take prior: out.",
        )  # fmt: skip
    places = [order.index(name) for name in names]
    mean = np.array([float(values[name]["value"]) for name in names])
    doubted = "" if verdict == "valid" else (
        f"The result of the prior is {verdict.replace('_', ' ')}: {', '.join(reasons) or 'no reason saved'}."
    )  # fmt: skip
    assert base.count == mean.size
    return prior_of_values(mean, covariance[np.ix_(places, places)], f"the earlier result {path.name}", doubted)


def _by_joint(given: RelativeStd | None, count: int, key: str) -> dict[int, float]:
    """Joint, from 1 -> relative standard deviation."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        return dict.fromkeys(range(1, count + 1), given)
    found = {int(name.removeprefix("joint")): value for name, value in given.items()}
    for joint in found:
        if joint > count:
            valid = [f"joint{j}" for j in range(1, count + 1)]
            raise UnknownNameError("joint", f"joint{joint}", valid, where=f"prior.{key}")
    return found


def _check_same_joints(own: RobotDescription, other: RobotDescription, source: str) -> None:
    """Raise InputError where a description has other joints, so that its values are about other frames."""
    problems = [
        f"joint {j}: {name}: {getattr(b, name)} instead of {getattr(a, name)}"
        for j, (a, b) in enumerate(zip(own.joints, other.joints, strict=False), start=1)
        for name in SAME_GEOMETRY
        if getattr(a, name) != getattr(b, name)
    ]
    if len(own.joints) != len(other.joints):
        problems.insert(0, f"{len(other.joints)} joints instead of {len(own.joints)}")
    if problems:
        raise InputError(
            "The prior comes from a robot with other joints: its values are about other frames.",
            where=f"prior.towards: {source}", got="; ".join(problems),
            next_step="Describe the links in the frames of the robot description of the case.",
        )  # fmt: skip
