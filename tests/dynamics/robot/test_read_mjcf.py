"""MJCF is read as MuJoCo computes it, and what no serial robot has is refused by name."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from fmu_didim import InputError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot import RobotModel, read_robot
from fmu_didim.dynamics.robot.formats.write_mjcf import mjcf_of
from tests.helpers import ROOT

mujoco = pytest.importorskip("mujoco")

ARM = """
<mujoco model="an arm">
  <compiler angle="radian" autolimits="true"/>
  <option gravity="0.3 -1 -9.6"/>
  <default><joint damping="0.4"/><default class="wrist"><joint armature="0.03" frictionloss="0.2"/></default></default>
  <worldbody>
    <body name="base" pos="0.1 0.2 0.3" euler="0.2 -0.4 0.7">
      <geom type="box" size=".1 .1 .1" mass="5"/>
      <body name="upper" pos="0 0.1 0.4" quat="0.8 0.1 -0.3 0.4">
        <joint name="shoulder" pos="0.05 -0.02 0.1" axis="0.2 0.3 1" range="-2 2"/>
        <inertial pos="0.1 0.02 -0.03" mass="3" fullinertia="0.05 0.06 0.04 0.004 -0.003 0.002"/>
        <body name="fore" pos="0.4 0 0.1" euler="0.5 0 0.1">
          <joint name="elbow" axis="0 1 0" pos="0 0.01 0" class="wrist"/>
          <joint name="slide" type="slide" axis="1 0.1 0" armature="0.7"/>
          <geom type="capsule" fromto="0 0 0 0.3 0 0.05" size="0.04" mass="1.5"/>
          <body name="tool" pos="0.3 0 0.05" euler="0 0.3 0">
            <geom type="sphere" size="0.05" mass="0.4" pos="0.02 0 0.01"/>
            <body name="hand" pos="0.1 0 0">
              <joint name="roll" axis="1 0 0.5" class="wrist"/>
              <inertial pos="0.01 0 0.02" mass="0.6" diaginertia="0.002 0.003 0.0025"/>
            </body>
          </body>
        </body>
      </body>
    </body>
    {beside}
  </worldbody>
  {below}
</mujoco>
"""


def file_of(folder: Path, *, beside: str = "", below: str = "", text: str = ARM) -> Path:
    path = folder / "arm.xml"
    path.write_text(text.replace("{beside}", beside).replace("{below}", below), encoding="utf-8")
    return path


def torques(path: Path, q: Array, dq: Array, ddq: Array) -> Array:
    """(n,) by MuJoCo: without damping and friction loss, which its inverse dynamics take as passive and as
    constraints."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.dof_damping[:], model.dof_frictionloss[:] = 0.0, 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
    mujoco.mj_inverse(model, data)
    return np.array(data.qfrc_inverse)


def largest_difference(path: Path) -> float:
    """Of the torques at random motions, over the largest one."""
    robot, rng = read_robot(path), np.random.default_rng(3)
    model = RobotModel(robot)
    values = {v.name: v.start for v in model.parameters}
    frictionless = [0.0 if name[:2] in ("Fv", "Fc") else value for name, value in values.items()]
    worst = largest = 0.0
    for _ in range(20):
        q, dq, ddq = rng.normal(size=(3, len(robot.joints)))
        ours = np.array(model.inverse(q, dq, ddq, frictionless, [])).ravel()
        worst = max(worst, float(np.abs(ours - torques(path, q, dq, ddq)).max()))
        largest = max(largest, float(np.abs(ours).max()))
    return worst / largest


def test_the_torque_is_that_of_mujoco(tmp_path: Path) -> None:
    path = file_of(tmp_path)
    assert largest_difference(path) < 1e-12
    robot = read_robot(path)
    assert (robot.name, [joint.name for joint in robot.joints]) == ("an_arm", ["shoulder", "elbow", "slide", "roll"])
    assert [joint.type for joint in robot.joints] == ["revolute", "revolute", "prismatic", "revolute"]
    assert robot.joints[0].limits == (-2, 2) and robot.joints[1].limits is None
    values = [{name: joint.parameters.get(name) for name in ("Ia", "Fv", "Fc")} for joint in robot.joints]
    assert values[1] == {"Ia": 0.03, "Fv": 0.4, "Fc": 0.2} and values[2] == {"Ia": 0.7, "Fv": 0.4, "Fc": None}


def test_what_is_written_is_read_as_the_same_robot(tmp_path: Path) -> None:
    heavy = ARM.replace('<joint name="slide" type="slide" axis="1 0.1 0" armature="0.7"/>', "")  # each link has a mass
    robot = read_robot(file_of(tmp_path, text=heavy))
    mjcf_of(robot).write(tmp_path / "written.xml")
    assert largest_difference(tmp_path / "written.xml") < 1e-12
    there, back = RobotModel(robot), RobotModel(read_robot(tmp_path / "written.xml"))
    rng = np.random.default_rng(1)
    for _ in range(5):
        q, dq, ddq = rng.normal(size=(3, len(robot.joints)))
        same = [np.array(m.inverse(q, dq, ddq, _inertial(m), [])).ravel() for m in (there, back)]
        np.testing.assert_allclose(same[0], same[1], rtol=1e-11, atol=1e-11 * np.abs(same[0]).max())


def _inertial(model: RobotModel) -> list[float]:
    kept = ("X", "Y", "Z", "M", "Ia")
    return [v.start if v.name.startswith(kept) else 0.0 for v in model.parameters]


BRANCH = '<body name="camera" pos="1 0 0"><joint name="pan" axis="0 0 1"/><geom type="sphere" size=".1"/></body>'


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"beside": BRANCH}, r"has branches[\s\S]*hand"),
        ({"below": '<equality><joint joint1="elbow" joint2="roll"/></equality>'}, "couples joints"),
        ({"below": '<equality><weld body1="hand" body2="base"/></equality>'}, "welds two bodies"),
        ({"text": ARM.replace('name="roll"', 'name="roll" stiffness="3"')}, "has a spring"),
        ({"text": ARM.replace('name="roll"', 'name="roll" ref="0.3"')}, r"begins at 0\.3"),
        ({"text": ARM.replace('<joint name="roll" axis="1 0 0.5" class="wrist"/>', '<joint type="ball"/>')}, "ball"),
        ({"text": ARM.replace('<geom type="box"', '<freejoint/><geom type="box"')}, "floating"),
        ({"text": ARM.replace("<inertial", "<inertia", 1)}, "MuJoCo does not take the file"),
    ],
)
def test_what_no_serial_robot_has_is_refused(changes: dict[str, str], says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=says):
        read_robot(file_of(tmp_path, **changes))


def test_a_robot_with_branches_ends_at_its_tip(tmp_path: Path) -> None:
    path = file_of(tmp_path, beside=BRANCH)
    assert [joint.name for joint in read_robot(path, tip="hand").joints] == ["shoulder", "elbow", "slide", "roll"]
    with pytest.raises(InputError, match="no link of the name of the tip"):
        read_robot(path, tip="foot")


def test_a_description_has_no_tip() -> None:
    with pytest.raises(InputError, match="Leave the tip out"):
        read_robot(ROOT / "fmus/scara/robot.yaml", tip="hand")


def test_without_mujoco_it_is_said_how_to_get_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match=r"fmu_didim\[mjcf\]"):
        read_robot(file_of(tmp_path))
