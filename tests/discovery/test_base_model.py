"""The base fit begins where the loop can be simulated."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fmu_didim import load_case, read_robot, write_robot
from fmu_didim.discovery.base_model import prepare
from tests.cases import SCARA
from tests.conftest import ROOT


def test_a_robot_of_which_nothing_is_known_starts_as_in_identification(tmp_path: Path) -> None:
    """Without a value of any inertia M(q) is singular; ``init`` writes such robots."""
    source = ROOT / "fmus/scara/robot.yaml"
    robot = read_robot(source)
    joints = tuple(joint.model_copy(update={"parameters": {}}) for joint in robot.joints)
    write_robot(robot.model_copy(update={"joints": joints}), tmp_path / "robot.yaml")
    content = load_case(SCARA).content | {"plant": {"kind": "model"}}
    known, unknown = (
        prepare(load_case(content | {"robot": str(path)}, folder=SCARA.parent).model)
        for path in (source, tmp_path / "robot.yaml")
    )
    assert unknown.notes[0].startswith("The search starts from the motion that the measured torque implies")
    assert not any("starts from" in note for note in known.notes)
    sigma = np.sqrt(np.diag(known.fit.covariance))
    assert np.abs((known.fit.values - unknown.fit.values) / sigma).max() < 0.05
