"""The robot of a case with identified values, as URDF, MJCF or a description: for whoever simulates or controls it.

result.json -> base parameters b and their covariance
            -> standard parameters of links that exist, nearest to those of the description
            -> the URDF that the case is made of, or a URDF, MJCF or YAML by itself
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from fmu_didim.base.errors import InputError, listed
from fmu_didim.base.version import __version__
from fmu_didim.case import Case, load_case
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot import RobotDescription, RobotModel, write_robot
from fmu_didim.dynamics.robot.formats.read_mjcf import SUFFIX as MJCF
from fmu_didim.dynamics.robot.formats.urdf import SUFFIX as URDF
from fmu_didim.dynamics.robot.formats.write_mjcf import mjcf_of, not_in_mjcf
from fmu_didim.dynamics.robot.formats.write_urdf import not_in_urdf, urdf_like, urdf_of
from fmu_didim.dynamics.standard_parameters import (
    KEPT,
    StandardParameters,
    links_that_cannot_exist,
    standard_parameters,
)
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.parameters import RobotParameters
from fmu_didim.results.result import ResultDocument, read_result
from fmu_didim.workflow.output.result import Result
from fmu_didim.workflow.output.result_folder import check_writable
from fmu_didim.workflow.simulate import model_without_data, named_values

YAML = (".yaml", ".yml")
NAMED = 8
"""[parameters] That have no place in a format, named at most."""


@dataclass(frozen=True)
class ExportedRobot:
    """What was written.

    Attributes:
        path: of the robot with the identified values; draws: of those with values drawn from their covariance.
        robot: with the values that were written; base: name -> base parameter of it.
        away: standard deviations between these and the identified ones, together: 0 where links have them.
        remarks: what whoever uses the file must know.
    """

    path: Path
    draws: tuple[Path, ...]
    robot: RobotDescription
    base: Mapping[str, float]
    away: float
    remarks: tuple[str, ...] = ()


def export_robot(
    case: Case | Path | str | Mapping[str, Any],
    path: Path | str,
    *,
    result: Result | Path | str | None = None,
    draws: int = 0,
    seed: int = 0,
) -> ExportedRobot:
    """Write the robot of a case with identified values, as links that exist.

    Base parameters are kept; what the data do not determine, such as the mass of the first link, is as near to the
    description as links with them allow.

    Args:
        case: a loaded case, the path of its file, or its content; torque logs are not needed.
        path: ``.urdf``, ``.xml`` (MJCF) or ``.yaml``. Where the case names a URDF, its visuals, limits and other links
            stay.
        result: what :func:`~fmu_didim.identify` returned, ``result.json`` or its folder; without it the values of the
            robot description are written.
        draws: further robots, with values drawn from the covariance of the result, at random by ``seed``: their files
            have a number behind the name.

    Returns:
        What was written, with remarks: what the format has no place for, and how far links that exist are from what
        was identified.

    Raises:
        InputError: the plant of the case has no description, the result is of another case or holds no values, or the
            file is there already.
        IdentificationError: no links nearly have these values.
    """
    case = case if isinstance(case, Case) else load_case(case, require_torque=False)
    task = _Task.of(case, Path(path), result)
    paths = [task.path, *(_numbered(task.path, k + 1, draws) for k in range(draws))]
    if draws and not task.covariance.any():
        raise InputError(
            "There is no covariance to draw from.", where="draws", got=draws,
            next_step="Give a result (--result result.json), or leave the draws out.",
        )  # fmt: skip
    check_writable(task.path.parent)
    for one in paths:
        if one.exists():
            raise InputError("The file is there already.", where=str(one), next_step="Give another name, or remove it.")
    robot, found = task.robot(task.values)
    files = [task.file(robot)]
    rng, drawn = np.random.default_rng(seed), list[StandardParameters]()
    for _ in range(draws):
        other, own = task.robot(rng.multivariate_normal(task.values, task.covariance, method="eigh"))
        files.append(task.file(other))
        drawn.append(own)
    for one, content in zip(paths, files, strict=True):
        _write(content, one)
    base = dict(zip(task.parameters.base.names, found.base.tolist(), strict=True))
    return ExportedRobot(
        task.path, tuple(paths[1:]), robot, base, found.away, tuple(task.remarks(robot, found, drawn, seed))
    )


@dataclass(frozen=True)
class _Task:
    """A case and a result, and where the robot goes.

    Attributes:
        values, covariance: (b,) base parameters and (b, b); others: other values of the plant, by name.
        template: the URDF of the case, its visuals to be kept; None without.
    """

    path: Path
    parameters: RobotParameters
    values: Array
    covariance: Array
    others: Mapping[str, float]
    template: Path | None
    document: ResultDocument | None
    origin: str
    outside: tuple[str, ...] = field(default_factory=tuple)

    @classmethod
    def of(cls, case: Case, path: Path, result: Result | Path | str | None) -> _Task:
        suffix = path.suffix.lower()
        if suffix not in (URDF, MJCF, *YAML):
            raise InputError(
                "A robot is written as URDF, MJCF or YAML.", where=str(path), got=suffix or "no suffix",
                valid=f"{URDF}, {MJCF}, {YAML[0]}", next_step="Give one of these suffixes.",
            )  # fmt: skip
        model = model_without_data(case, None)
        parameters = model.parameters
        if not isinstance(parameters, RobotParameters):
            raise InputError(
                "The plant of this case has no description of links.", where=case.name, got="a black box",
                next_step="Name the robot (robot: robot.yaml), or export the loop (--ssp).",
            )  # fmt: skip
        document = result.document if isinstance(result, Result) else None if result is None else read_result(result)
        given = {} if document is None else {name: p.value for name, p in document.parameters.items()}
        if document is not None and not given:
            raise InputError(
                "The result holds no values.", where=str(result), got=document.status,
                next_step="Take the result of a run that ended with values.",
            )  # fmt: skip
        own = {name: value for name, value in given.items() if name in model.names}
        outside = tuple(f"{name} = {given[name]:.6g}" for name in given if name not in own)
        unknown = [] if document is None else [
            name for name, p in document.parameters.items() if name not in own and p.of == "plant"
        ]  # fmt: skip
        if unknown:
            raise InputError(
                "The result is of another robot.", where=str(result), got=", ".join(unknown),
                valid=", ".join(model.names), next_step="Give the case that the result was made with.",
            )  # fmt: skip
        values = named_values(model, own)
        robot = case.document.robot
        template = None if robot is None else case.folder / str(robot)
        return cls(
            path, parameters, model.theta(values)[: parameters.base.count],
            _covariance(model, parameters, document), _others(model, values),
            template if template is not None and suffix == URDF and template.suffix.lower() == URDF else None,
            document, case.name, outside,
        )  # fmt: skip

    def robot(self, values: Array) -> tuple[RobotDescription, StandardParameters]:
        """The robot with base parameters (b,); without a result that of the description as it is, if it has masses."""
        model = self.parameters.model
        if self.document is None and all(joint.parameters.get("M", 0.0) > 0 for joint in model.description.joints):
            return model.description, StandardParameters({}, self.parameters.base.reduce(model.parameter_values), 0.0)
        found = standard_parameters(
            self.parameters.model, self.parameters.base, values, self.covariance,
            in_links=self.path.suffix.lower() == URDF,
        )  # fmt: skip
        return self.parameters.model.description.with_values({**self.others, **found.values}), found

    def file(self, robot: RobotDescription) -> RobotDescription | ET.ElementTree[ET.Element]:
        """What is written."""
        suffix = self.path.suffix.lower()
        if suffix in YAML:
            source = f"{robot.source}; " if robot.source else ""
            return robot.model_copy(update={"source": f"{source}{self._note}"})
        tree = mjcf_of(robot) if suffix == MJCF else (
            urdf_of(robot) if self.template is None else urdf_like(self.template, robot)
        )  # fmt: skip
        tree.getroot().insert(0, ET.Comment(f" {self._note} ".replace("--", "- -")))
        return tree

    @property
    def _note(self) -> str:
        if self.document is None:
            return f"values of the description, by fmu_didim {__version__}"
        return f"values identified in {self.origin} ({self.document.verdict}), by fmu_didim {__version__}"

    def remarks(
        self, robot: RobotDescription, found: StandardParameters, drawn: list[StandardParameters], seed: int
    ) -> list[str]:
        """What must be known of the file."""
        told = list[str]()
        if self.document is not None and self.document.verdict != "valid":
            told.append(f"The result is {self.document.verdict}: read its reasons before you use these values.")
        if found.away > KEPT:
            told.append(
                f"No links have these base parameters: the nearest that exist are written, {found.away:.3g} standard "
                "deviations away, all together. Beyond 3, the model lacks something, or a value of the description "
                "that is not identified is wrong."
            )
        if wrong := links_that_cannot_exist(RobotModel(robot)):
            told.append(
                "No distribution of mass has the inertia that the description gives link "
                f"{', '.join(map(str, wrong))}: simulators may refuse it. Correct it, or write the values of a result, "
                "as links that exist."
            )
        if found.moved:
            told.append(f"Friction cannot be negative, and is written as zero: {', '.join(found.moved)}.")
        suffix = self.path.suffix.lower()
        beside = [] if suffix in YAML else not_in_mjcf(robot) if suffix == MJCF else not_in_urdf(robot)
        beside += self.outside
        if beside:
            told.append(
                f"The file has no place for {listed(beside, NAMED, separator='; ')}: whoever reads it simulates "
                "without, or adds it by hand."
            )
        described = self.parameters.model.description.joints
        bare = [str(j) for j, joint in enumerate(described, start=1) if not joint.parameters.get("M")]
        if bare:
            told.append(
                f"The description states no mass of link {', '.join(bare)}: a usual one for a robot of this size is "
                "taken."
            )
        if self.document is not None:
            told.append(
                "Data determine base parameters alone. What else the file states, such as single masses, is as near to "
                "the description as these allow."
            )
        if drawn:
            far = sum(one.away > KEPT for one in drawn)
            told.append(
                f"{len(drawn)} draws from the covariance, seed {seed}"
                + (f"; {far} of them are the nearest links that exist to what was drawn." if far else ".")
            )
        return told


def _covariance(model: LoopModel, parameters: RobotParameters, document: ResultDocument | None) -> Array:
    """(b, b) of the base parameters; zero for those that were not identified."""
    count = parameters.base.count
    found = np.zeros((count, count))
    if document is None or not document.covariance:
        return found
    numbers = model.free_parameters.places(model.first)[:count]
    order = list(document.parameters)
    rows = [(i, order.index(model.names[k])) for i, k in enumerate(numbers) if model.names[k] in order]
    ours, theirs = [i for i, _ in rows], [k for _, k in rows]
    found[np.ix_(ours, ours)] = np.array(document.covariance)[np.ix_(theirs, theirs)]
    return found


def _others(model: LoopModel, values: Array) -> dict[str, float]:
    """Values of the plant that are no base parameters, such as shapes of friction, by name."""
    robot = model.system(values).components[model.loop.plant_name]
    known = {v.name for v in model.loop.plant.parameters}
    assert isinstance(model.parameters, RobotParameters)
    shapes = {v.name for v in model.parameters.model.shapes}
    return {v.name: v.start for v in robot.parameters if v.name in known & shapes}


def _numbered(path: Path, number: int, count: int) -> Path:
    return path.with_stem(f"{path.stem}_{number:0{len(str(count))}d}")


def _write(content: RobotDescription | ET.ElementTree[ET.Element], path: Path) -> None:
    if isinstance(content, RobotDescription):
        write_robot(content, path)
    else:
        content.write(path, encoding="utf-8", xml_declaration=True)
