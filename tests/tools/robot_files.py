"""URDF files of public robots, read and written in three ways: whether the torque stays that of Pinocchio.

    python -m tests.tools.robot_files panda.urdf:panda_link8 ur10_robot.urdf --figures docs/figures/robot_files.json

Each file is read (behind a colon stands the link where the robot ends), written into itself where it has no branches,
written by itself, and as MJCF; Pinocchio reads the first two, and MuJoCo, where it is there, the third. Printed is the
largest difference of the torques, over the largest torque, at random positions, velocities and accelerations. ROS's
``check_urdf``, where it is there, is asked of what was written.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from fmu_didim.base.errors import FmuDidimError, InputError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.dynamics.robot.body import body_of
from fmu_didim.dynamics.robot.formats.urdf import read_urdf
from fmu_didim.dynamics.robot.formats.write_mjcf import mjcf_of
from fmu_didim.dynamics.robot.formats.write_urdf import urdf_like, urdf_of
from fmu_didim.dynamics.standard_parameters import links_that_cannot_exist
from tests.figures import command_of, write_figures

WAYS = ("in its file", "by itself", "MJCF")
"""In which a robot is written."""
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


def is_solid(robot: RobotDescription) -> bool:
    """Whether MuJoCo takes its links: some mass has their inertia, and none is a point."""
    bodies = [body_of(joint.parameters) for joint in robot.joints]
    solid = all(body.mass > 0 and np.linalg.eigvalsh(body.at_centre).min() > 0 for body in bodies)
    return solid and not links_that_cannot_exist(links(robot))


def complaint(path: Path) -> str | None:
    """What ``check_urdf`` says against a file, empty if nothing; None where that program is not there. It comes with
    the package that Pinocchio reads URDF by."""
    prefix = Path(sysconfig.get_path("purelib")) / "cmeel.prefix"
    program = shutil.which("check_urdf", path=f"{os.environ.get('PATH', '')}{os.pathsep}{prefix / 'bin'}")
    if program is None:
        return None
    where = {**os.environ, "LD_LIBRARY_PATH": str(prefix / "lib")}
    done = subprocess.run([program, str(path)], env=where, capture_output=True, text=True, check=False)
    return "" if done.returncode == 0 else (done.stderr or done.stdout).strip() or f"exit code {done.returncode}"


def differences(path: Path, tip: str = "") -> Iterator[tuple[str, float, str | None]]:
    """In which way a file was written, difference of the torques over the largest one, what ROS says against it."""
    robot = read_urdf(path, tip=tip)
    wanted = points(links(robot))
    largest = max(float(np.abs(torque).max()) for *_, torque in wanted)
    with tempfile.TemporaryDirectory() as folder:
        for way, made, torque_of in (
            *([] if tip else [(WAYS[0], urdf_like(path, robot), by_pinocchio)]),
            (WAYS[1], urdf_of(robot), by_pinocchio),
            *([(WAYS[2], mjcf_of(robot), by_mujoco)] if find_spec("mujoco") and is_solid(robot) else []),
        ):  # fmt: skip
            file = Path(folder) / f"robot{'.xml' if way == WAYS[2] else '.urdf'}"
            made.write(file, encoding="utf-8")
            assert ET.parse(file)
            off = [np.abs(torque_of(file, q, dq, ddq) - torque).max() for q, dq, ddq, torque in wanted]
            yield way, float(max(off)) / largest, complaint(file) if way != WAYS[2] else None


def texts(rows: Mapping[str, Sequence[tuple[str, float, str | None]]]) -> dict[str, str]:
    """What the page shows of robots: their names, and the worst of each kind of file."""
    found = {"robots": ", ".join(rows), "count": str(len(rows))}
    of_urdf = [off for one in rows.values() for way, off, _ in one if way != WAYS[2]]
    of_mjcf = [off for one in rows.values() for way, off, _ in one if way == WAYS[2]]
    asked = [said for one in rows.values() for *_, said in one if said is not None]
    found |= {"urdf": f"{max(of_urdf):.0e}", "mjcf": f"{max(of_mjcf):.0e}" if of_mjcf else "–"}
    return found | {"mjcf_count": str(len(of_mjcf)), "checked": f"{sum(not said for said in asked)} of {len(asked)}"}


def main(arguments: Sequence[str] | None = None) -> int:
    """The command: 1 where torques differ or ROS complains."""
    parser = argparse.ArgumentParser(prog="python -m tests.tools.robot_files", description=__doc__.split("\n")[0])
    parser.add_argument("files", nargs="+", metavar="FILE.urdf[:TIP]")
    parser.add_argument("--figures", type=Path, help="file of figures for docs/include.py")
    given = list(sys.argv[1:] if arguments is None else arguments)
    options, rows = parser.parse_args(given), dict[str, Sequence[tuple[str, float, str | None]]]()
    for one in options.files:
        file, _, tip = one.partition(":")
        try:
            found = list(differences(Path(file), tip))
        except FmuDidimError as error:
            kind = "refused" if isinstance(error, InputError) else "failed"
            print(f"{Path(file).name}: {kind}: {str(error).splitlines()[0]}")
            continue
        rows[Path(file).stem] = found
        told = (f"{way} {off:.1e}" + (f" ({said})" if said else "") for way, off, said in found)
        print(f"{Path(file).name}: {', '.join(told)}", flush=True)
    if options.figures and rows:
        named = [Path(part).name if ".urdf" in part else part for part in given]
        write_figures(options.figures, command_of("tests.tools.robot_files", named), texts(rows), data=rows)
    return int(any(off > ALIKE or said for one in rows.values() for _, off, said in one))


if __name__ == "__main__":
    sys.exit(main())
