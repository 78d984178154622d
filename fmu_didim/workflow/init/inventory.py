"""The kinds of the given files: tables of signals, FMUs, descriptions; and the tables that belong to one run."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from fmu_didim.base.documents import load_yaml
from fmu_didim.base.errors import InputError
from fmu_didim.components.fmu import read_description
from fmu_didim.data.tables import READER_OF, read_table
from fmu_didim.dynamics.robot import RobotDescription, read_robot
from fmu_didim.dynamics.robot.formats.read_mjcf import SUFFIX as MJCF
from fmu_didim.dynamics.robot.formats.urdf import SUFFIX as URDF
from fmu_didim.export import build_modelica
from fmu_didim.workflow.init.data_file import TORQUES, WORDS_OF_LOOPS, DataFile
from fmu_didim.workflow.init.fmu_roles import FmuPorts, FmuRole, assigned
from fmu_didim.workflow.init.model_columns import named_alike

_WORDS_OF_SIGNALS = r"reference|ref|soll|set|trajectory|motion|torque|tau|moment|strom|current|log|ist|act"


@dataclass
class Inventory:
    """The files by what they are.

    Attributes:
        taken: role in a loop -> the FMU that has it, and why; model: the FMU that is calibrated as it is, and why.
    """

    data: list[DataFile] = field(default_factory=list)
    fmus: list[FmuPorts] = field(default_factory=list)
    taken: dict[FmuRole, tuple[FmuPorts, str]] = field(default_factory=dict)
    robot: tuple[Path, RobotDescription] | None = None
    controller: Path | None = None
    system: Path | None = None
    model: tuple[FmuPorts, str] | None = None

    @property
    def loop_logs(self) -> list[DataFile]:
        """The files of instants of a controller."""
        return [d for d in self.data if d.is_loop_log]

    @property
    def plant_fmu(self) -> FmuPorts | None:
        """The FMU that is the plant."""
        return self.taken["plant"][0] if "plant" in self.taken else None

    @property
    def controller_fmu(self) -> FmuPorts | None:
        """The FMU that is the controller."""
        return self.taken["controller"][0] if "controller" in self.taken else None

    @property
    def has_no_controller(self) -> bool:
        """Whether none of the files is a controller, or holds one."""
        return self.controller is None and self.controller_fmu is None and self.system is None

    @property
    def torque_count(self) -> int:
        """Torques (currents, commands) of the log that has most of them, joints where no column is known as one."""
        counts = [sum(g.role == role for g in d.guesses) for d in self.data for role in TORQUES]
        return max([len(self.robot[1].joints)] if self.robot is not None else counts, default=0) or self.joint_count

    @property
    def joint_count(self) -> int:
        """Of the robot, else of the columns."""
        if self.robot is not None:
            return len(self.robot[1].joints)
        found = [g for d in self.data for g in d.guesses if g.role in ("q", *TORQUES)]
        lists = Counter(g.list_name for g in found if g.joint is None and g.list_name)
        return max([g.joint or 1 for g in found] + list(lists.values()), default=1)


def inventory(
    files: Sequence[Path], said: Mapping[Path, FmuRole], *, has_law: bool, model: Path | None = None
) -> Inventory:
    """The files by their kinds.

    Args:
        said: whole path of an FMU or a Modelica file -> its role, where the user states it.
        has_law: whether a controller will be written.
        model: whole path of the FMU or Modelica file that the user wants calibrated as it is.

    Raises:
        InputError: a file is missing, cannot be read, or is of an unknown kind; the role of an FMU is not clear; there
            is no data file. BuildError: a Modelica file cannot be compiled.
    """
    found = Inventory()
    for path in files:
        suffix = path.suffix.lower()
        if not path.is_file():
            raise InputError("The file does not exist.", where=str(path), next_step="Check the path.")
        if suffix in READER_OF:
            found.data.append(DataFile(path, read_table(path)))
        elif suffix == ".fmu":
            found.fmus.append(FmuPorts(path, read_description(path)))
        elif suffix == ".mo":
            found.fmus.append(FmuPorts(path, read_description(build_modelica(path))))
        elif suffix == ".ssp":
            found.system = path
        elif suffix in (URDF, MJCF):
            found.robot = path, read_robot(path)
        elif suffix in (".yaml", ".yml"):
            content = load_yaml(path)
            if "law" in content:
                found.controller = path
            elif "joints" in content:
                found.robot = path, read_robot(path)
            else:
                raise InputError(
                    "This YAML is neither a robot (joints:) nor a controller (law:).", where=str(path),
                    next_step="Leave it out: init writes a case, and needs data, a plant and a controller.",
                )  # fmt: skip
        else:
            raise InputError(
                "This file is of no kind that is known.", where=str(path),
                valid=(*READER_OF, ".fmu", ".mo", ".ssp", ".yaml", URDF, MJCF),
                next_step="Leave it out, or export it as one of these.",
            )  # fmt: skip
    if found.robot is not None:
        joints = tuple(joint.name for joint in found.robot[1].joints)
        found.data = [replace(d, joints=joints) for d in found.data]
    if not [d for d in found.data if not d.is_loop_log or found.fmus]:
        raise InputError(
            "No file with signals is among them.", valid=READER_OF, next_step="Give the log and the reference."
        )  # fmt: skip
    found.model = a_model(found, is_loop=bool(said) or has_law, model=model)
    if found.model is not None:
        return found
    has_controller = found.controller is not None or has_law
    found.taken = assigned(found.fmus, found.torque_count, said=said, has_controller=has_controller)
    return found


def a_model(found: Inventory, *, is_loop: bool, model: Path | None) -> tuple[FmuPorts, str] | None:
    """The FMU that is a model on its own and no part of the loop of a robot, and why; None where there is a robot.

    An FMU beside a robot, a controller or another FMU is part of a loop; so is one that takes or gives torques, or set
    points where the log shows a torque. Any other one is a model.

    Args:
        is_loop: whether the user says of a file that it is a plant or a controller, or names a control law.
        model: the file that the user says is one.
    """
    if model is not None:
        return next((ports, "as you say") for ports in found.fmus if ports.source.resolve() == model)
    others = (found.robot, found.controller, found.system)
    if is_loop or len(found.fmus) != 1 or any(other is not None for other in others):
        return None
    (ports,) = found.fmus
    own = [*ports.inputs, *ports.outputs]
    if any(g.role == "tau" for g in own):
        return None
    named = named_alike(ports.fmu, found.data)
    has_set_points = any(g.side == "reference" for g in ports.inputs)
    if any(d.has(*TORQUES) for d in found.data):
        told = "the files have columns with its names, and no set points are among them"
        return (ports, told) if named and not has_set_points else None
    if named:
        return ports, "the files have columns with its names, and none is a torque"
    has_motion = any(d.has("q") for d in found.data)
    return None if has_set_points or has_motion else (ports, "neither it nor the files have a torque")


def key_of(path: Path) -> str:
    """What names of files of one run have in common."""
    key = re.sub(rf"({_WORDS_OF_SIGNALS}|{WORDS_OF_LOOPS})", "", path.stem.lower())
    return re.sub(r"[_\-. ]+", "_", key).strip("_") or "run"
