"""The page of a robot description: a picture that turns with the mouse, its joints with sliders, and its tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from fmu_didim.report.drawing.charts import in_script
from fmu_didim.report.page import environment
from fmu_didim.report.sections import Table


@dataclass(frozen=True)
class RobotPage:
    """What the page shows.

    Attributes:
        name: of the robot; lines: below it.
        gravity: (3,) m/s2 in the frame of the base, against which is upwards.
        joints: of each joint ``name``, ``type``, ``alpha``, ``a``, ``theta``, ``d``, ``beta`` (modified Denavit-
            Hartenberg, rad and m), ``low`` and ``high`` of its slider, whether these are its ``limits``, and the
            ``ellipsoid`` of its link: ``centre``, ``axes`` and ``radii`` in m in its frame, or None.
        tables: heading -> table; remarks: sentences.
    """

    name: str
    lines: Sequence[str]
    gravity: Sequence[float]
    joints: Sequence[Mapping[str, Any]]
    tables: Mapping[str, Table]
    remarks: Sequence[str]

    @property
    def json(self) -> Markup:
        """The picture as JSON that is safe inside a script element."""
        content = {"name": self.name, "gravity": list(self.gravity), "joints": list(self.joints)}
        return in_script(content)


def write_robot_page(page: RobotPage, path: Path) -> Path:
    """Write it, self-contained, and return its path; all texts are escaped."""
    path.write_text(environment().get_template("robot.html.j2").render(page=page), encoding="utf-8")
    return path
