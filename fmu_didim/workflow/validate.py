"""The verb ``validate``: every mistake in a case and the files that it names, at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fmu_didim.base.documents import TO_FILL_IN, load_yaml
from fmu_didim.base.errors import FmuDidimError
from fmu_didim.case import load_case, read_case
from fmu_didim.case.files import read_signals, read_stamps
from fmu_didim.case.sources import ExperimentSource, SignalFile
from fmu_didim.controllers import read_law
from fmu_didim.dynamics.effects import UNITS
from fmu_didim.dynamics.robot import RobotDescription, read_robot
from fmu_didim.workflow.acknowledged import acknowledged
from fmu_didim.workflow.validate_model import mistakes_of_a_model, runs_of

NOT_YAML = (".fmu", ".ssp", ".mo")


@dataclass(frozen=True)
class Mistake:
    """Something that keeps a case from being run: where, what, and what to do about it."""

    where: str
    text: str

    @classmethod
    def of(cls, error: FmuDidimError, where: str) -> Mistake:
        return cls(error.where or where, str(error))


def mistakes(path: Path | str) -> list[Mistake]:
    """All mistakes in a case file, in its robot and controller or its model, in the columns of its data files.

    A case without any of these is loaded as a whole, which may tell one more: nothing is simulated.

    Raises:
        InputError: the case file is missing or no YAML.
    """
    path = Path(path)
    content, found, robot = load_yaml(path), list[Mistake](), None
    try:
        read_case(path)
    except FmuDidimError as error:
        found.append(Mistake.of(error, str(path)))
    if isinstance(content.get("robot"), str):
        robot = _tried(found, path.parent / content["robot"], read_robot)
    source = content["controller"].get("source") if isinstance(content.get("controller"), dict) else None
    if isinstance(source, str) and ":" not in source and not source.endswith(NOT_YAML):
        _tried(found, path.parent / source, read_law)
    units = () if robot is None else tuple(UNITS[joint.type].torque for joint in robot.joints)
    runs = dict(runs_of(content))
    if content.get("model") is not None:
        of_model = mistakes_of_a_model(content, runs, path.parent)
        found += [Mistake.of(error, where) for error, where in of_model if error.got != TO_FILL_IN]
    for label, run in ({} if content.get("model") is not None else runs).items():
        found += _of_run(label, run, path.parent, units)
    if not found:
        _tried(found, path, lambda path: load_case(path).model)
        _tried(found, path, lambda path: acknowledged(load_case(path, require_torque=False)))
    return list({mistake.text: mistake for mistake in found}.values())


def _tried(found: list[Mistake], path: Path, read: Any) -> RobotDescription | None:
    try:
        made = read(path)
    except FmuDidimError as error:
        found.append(Mistake.of(error, str(path)))
        return None
    return made if isinstance(made, RobotDescription) else None


def _of_run(label: str, run: ExperimentSource, folder: Path, units: tuple[str, ...]) -> Iterator[Mistake]:
    if run.instants is not None:
        try:
            read_stamps(run.instants, folder)
        except FmuDidimError as error:
            yield Mistake.of(error, f"{label}.instants")
    for name, part in (("reference", run.reference), ("torque", run.torque), ("positions", run.positions)):
        if not isinstance(part, SignalFile):
            continue
        stem = "tau" if name == "torque" else "q"
        try:
            signals = read_signals(part, folder, torque_units=units).signals
            signals.select([f"{stem}{j}" for j in range(1, len(units) + 1)])
        except FmuDidimError as error:
            if error.got != TO_FILL_IN:  # which is reported with its line
                yield Mistake.of(error, f"{label}.{name}")
