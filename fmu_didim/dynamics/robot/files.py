"""Robot descriptions in files: YAML, written and read, and URDF and MJCF."""

from __future__ import annotations

from pathlib import Path

import yaml

from fmu_didim.base.documents import read_document
from fmu_didim.base.errors import InputError
from fmu_didim.dynamics.robot.description import RobotDescription
from fmu_didim.dynamics.robot.formats.read_mjcf import SUFFIX as MJCF
from fmu_didim.dynamics.robot.formats.read_mjcf import read_mjcf
from fmu_didim.dynamics.robot.formats.urdf import SUFFIX, read_urdf


def write_robot(robot: RobotDescription, path: Path | str) -> None:
    """Write a robot description as YAML, in modified frames; :func:`read_robot` gives it back."""
    content = robot.model_dump(mode="json", by_alias=True, exclude_defaults=True)
    # Of what was read in another convention the file says in which its numbers are.
    frames = {"frames": robot.frames} if "original_frames" in content else {}
    content = {"schema": robot.schema_version, **frames, **content}
    Path(path).write_text(yaml.safe_dump(content, sort_keys=False, allow_unicode=True), encoding="utf-8")


def read_robot(path: Path | str, *, tip: str = "") -> RobotDescription:
    """Read and validate a robot description, YAML, URDF (``.urdf``) or MJCF (``.xml``); raises InputError with all its
    problems.

    Args:
        tip: the link at which the robot ends, for a URDF or an MJCF file with branches.
    """
    reader = {SUFFIX: read_urdf, MJCF: read_mjcf}.get(Path(path).suffix.lower())
    if reader is not None:
        return reader(path, tip=tip)
    if tip:
        raise InputError(
            "Only a URDF or an MJCF file has links where a robot may end.", where=str(path), got=f"tip {tip}",
            next_step="Leave the tip out.",
        )  # fmt: skip
    return read_document(RobotDescription, path)
