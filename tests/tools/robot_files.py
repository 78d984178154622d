"""URDF files of public robots, read and written in three ways: whether the torque stays that of Pinocchio.

    python -m tests.tools.robot_files panda.urdf:panda_link8 ur10_robot.urdf

Each file is read (behind a colon stands the link where the robot ends), written into itself where it has no branches,
written by itself, and as MJCF; Pinocchio reads the first two, and MuJoCo, where it is there, the third. Printed is the
largest difference of the torques, over the largest torque, at random positions, velocities and accelerations.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from fmu_didim.base.errors import FmuDidimError, InputError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.dynamics.robot.formats.urdf import read_urdf
from fmu_didim.dynamics.robot.formats.write_mjcf import mjcf_of
from fmu_didim.dynamics.robot.formats.write_urdf import urdf_like, urdf_of
from fmu_didim.dynamics.standard_parameters import links_that_cannot_exist

ALIKE = 1e-9
"""[1] Of the largest torque, up to which torques are the same."""
POINTS = 20
"""[points] At which they are compared."""


def links(robot: RobotDescription) -> RobotModel:
    """The robot with nothing but its links."""
    joints = (j.model_copy(update={"effects": ()}) for j in robot.joints)
    return RobotModel(robot.model_copy(update={"joints": tuple(joints)}))


def points(robot: RobotModel, count: int = POINTS) -> list[tuple[Array, Array, Array, Array]]:
    """Positions, velocities, accelerations and torques (n,) at random."""
    rng, found = np.random.default_rng(1), []
    for _ in range(count):
        q, dq, ddq = rng.normal(size=(3, robot.joint_count))
        found.append((q, dq, ddq, np.array(robot.inverse(q, dq, ddq, robot.parameter_values, [])).ravel()))
    return found


def by_pinocchio(path: Path, q: Array, dq: Array, ddq: Array) -> Array:
    """The torque (n,) of a URDF."""
    import pinocchio

    model = pinocchio.buildModelFromUrdf(str(path))
    there = pinocchio.neutral(model)
    for one in list(model.joints)[1:]:
        angle = q[one.idx_v]
        there[one.idx_q : one.idx_q + one.nq] = [angle] if one.nq == 1 else [np.cos(angle), np.sin(angle)]
    return np.asarray(pinocchio.rnea(model, model.createData(), there, dq, ddq))


def by_mujoco(path: Path, q: Array, dq: Array, ddq: Array) -> Array:
    """The torque (n,) of the links of an MJCF file."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(path))
    model.dof_damping[:] = model.dof_frictionloss[:] = model.dof_armature[:] = 0.0
    model.jnt_limited[:] = 0  # a limit that is passed pushes back
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
    mujoco.mj_inverse(model, data)
    return np.array(data.qfrc_inverse)


def differences(path: Path, tip: str = "") -> Iterator[tuple[str, float]]:
    """In which way a file was written -> difference of the torques, over the largest one."""
    robot = read_urdf(path, tip=tip)
    wanted = points(links(robot))
    largest = max(float(np.abs(torque).max()) for *_, torque in wanted)
    links_exist = not links_that_cannot_exist(links(robot))  # others are refused by MuJoCo
    with tempfile.TemporaryDirectory() as folder:
        for way, made, torque_of in (
            *([] if tip else [("in its file", urdf_like(path, robot), by_pinocchio)]),
            ("by itself", urdf_of(robot), by_pinocchio),
            *([("MJCF", mjcf_of(robot), by_mujoco)] if find_spec("mujoco") and links_exist else []),
        ):  # fmt: skip
            file = Path(folder) / f"robot{'.xml' if way == 'MJCF' else '.urdf'}"
            made.write(file, encoding="utf-8")
            assert ET.parse(file)
            off = [np.abs(torque_of(file, q, dq, ddq) - torque).max() for q, dq, ddq, torque in wanted]
            yield way, float(max(off)) / largest


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.tools.robot_files", description=__doc__.split("\n")[0])
    parser.add_argument("files", nargs="+", metavar="FILE.urdf[:TIP]")
    worst = 0.0
    for one in parser.parse_args(arguments).files:
        file, _, tip = one.partition(":")
        try:
            found = dict(differences(Path(file), tip))
        except FmuDidimError as error:
            kind = "refused" if isinstance(error, InputError) else "failed"
            print(f"{Path(file).name}: {kind}: {str(error).splitlines()[0]}")
            continue
        worst = max(worst, *found.values())
        print(f"{Path(file).name}: {', '.join(f'{way} {off:.1e}' for way, off in found.items())}", flush=True)
    return 0 if worst <= ALIKE else 1


if __name__ == "__main__":
    sys.exit(main())
