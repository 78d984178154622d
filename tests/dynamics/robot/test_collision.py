"""Collision geometry of a URDF file: capsules that enclose it, on the right link, and what is not read is told."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from fmu_didim.dynamics.robot import read_robot
from fmu_didim.dynamics.robot.formats.collision import capsule_about, read_collision
from fmu_didim.dynamics.robot.formats.stl import read_stl
from fmu_didim.dynamics.robot.formats.urdf import serial_robot
from fmu_didim.dynamics.space.space import Capsule, Space, all_checks

MESH = np.random.default_rng(2).normal(size=(30, 3)) * [0.3, 0.1, 0.05] + [0.1, 0.0, 0.2]
SOLID = '<collision><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{shape}</geometry></collision>'
AXES = {"one": (0.0, 0.0, 1.0), "two": (0.0, 1.0, 0.0)}


def binary(path: Path, points: np.ndarray) -> None:
    rows = [struct.pack("<12fH", 0, 0, 0, *points[i : i + 3].ravel(), 0) for i in range(0, len(points), 3)]
    path.write_bytes(b"solid, and yet binary".ljust(80) + struct.pack("<I", len(rows)) + b"".join(rows))


def ascii_(path: Path, points: np.ndarray) -> None:
    lines = [f"  vertex {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    path.write_text("solid mesh\n" + "\n".join(lines) + "\nendsolid mesh\n", encoding="ascii")


def robot(folder: Path, mesh: str = "package://arm_description/meshes/two.stl") -> Path:
    """Two joints with poses askew, and a tool behind a fixed joint."""
    post = SOLID.format(xyz="0 0 0.1", rpy="0 0 0", shape='<cylinder radius="0.05" length="0.2"/>')
    bar = SOLID.format(xyz="0.2 0 0", rpy="0 1.2 0.3", shape='<box size="0.4 0.06 0.08"/>')
    tool = SOLID.format(xyz="0 0.1 0.05", rpy="0.4 0 0", shape='<sphere radius="0.03"/>')
    solid = SOLID.format(xyz="0 0 0.1", rpy="0.2 0.1 0", shape=f'<mesh filename="{mesh}" scale="0.5 0.5 0.5"/>')
    links = [("root", post), ("a", bar), ("b", solid), ("tool", tool)]
    joints = [
        ("one", "revolute", "root", "a", "0.1 0 0.3", "0 0.3 0"),
        ("two", "revolute", "a", "b", "0.4 0.05 0", "0.5 0 0.2"), ("held", "fixed", "b", "tool", "0 0 0.2", "0 0.7 0"),
    ]  # fmt: skip
    text = '<robot name="arm">' + "".join(f'<link name="{name}">{shape}</link>' for name, shape in links)
    for name, kind, parent, child, xyz, rpy in joints:
        axis = " ".join(map(str, AXES.get(name, (0, 0, 1))))
        text += (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/></joint>'
        )
    path = folder / "urdf" / "arm.urdf"
    path.parent.mkdir(exist_ok=True)
    path.write_text(text + "</robot>", encoding="utf-8")
    return path


def turned(axis: tuple[float, float, float], angle: float) -> np.ndarray:
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    pose = np.eye(4)
    pose[:3, :3] = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    return pose


@pytest.mark.parametrize("write", [binary, ascii_])
def test_shapes_are_where_the_links_of_the_file_are(write: object, tmp_path: Path) -> None:
    path = robot(tmp_path)
    (tmp_path / "meshes").mkdir()
    write(tmp_path / "meshes" / "two.stl", MESH)  # type: ignore[operator]
    found = read_collision(path)
    assert found.unread == () and [shape.link for shape in found.shapes] == [0, 1, 2, 2]
    capsules = [Capsule(s.link, tuple(s.start), tuple(s.end), s.radius) for s in found.shapes]  # type: ignore[arg-type]
    space = Space(read_robot(path), all_checks(capsules, []), base=found.base)
    serial, q = serial_robot(path), np.array([0.7, -1.1])
    one, two, held = (joint.pose for joint in serial.joints)
    link = one @ turned(AXES["one"], q[0])
    last = link @ two @ turned(AXES["two"], q[1])
    ends = space._places(q).full().reshape(3, -1, 2)
    where = {capsule: ends[:, i].T for i, capsule in enumerate(space._capsules)}
    corners = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.03, 0.03) for z in (-0.04, 0.04)])
    points = [
        (capsules[1], link, corners, "0.2 0 0", "0 1.2 0.3"),
        (capsules[2], last, 0.5 * MESH, "0 0 0.1", "0.2 0.1 0"),
    ]
    for capsule, pose, own, xyz, rpy in points:
        roll, pitch, yaw = map(float, rpy.split())
        at = np.eye(4)
        at[:3, 3] = [float(x) for x in xyz.split()]
        at = at @ turned((0, 0, 1), yaw) @ turned((0, 1, 0), pitch) @ turned((1, 0, 0), roll)
        x = (pose @ at @ np.vstack([own.T, np.ones(len(own))]))[:3].T
        start, end = where[capsule]
        part = np.clip((x - start) @ (end - start) / ((end - start) @ (end - start)), 0, 1)
        beyond = np.linalg.norm(x - start - part[:, None] * (end - start), axis=1) - capsule.radius
        assert beyond.max() == pytest.approx(0.0, abs=1e-6)  # all inside, some on the surface
    centre = (last @ held @ np.array([0, 0.1, 0.05, 1.0]))[:3]
    np.testing.assert_allclose(where[capsules[3]], [centre, centre], atol=1e-9)
    np.testing.assert_allclose(where[capsules[0]], [[0, 0, 0], [0, 0, 0.2]], atol=1e-12)  # in the root of the file


@pytest.mark.parametrize(
    ("mesh", "words"),
    [("package://arm_description/meshes/two.stl", "not found"), ("two.dae", "no STL"), ("text.stl", "no STL file")],
)
def test_a_mesh_that_is_not_read_is_named(mesh: str, words: str, tmp_path: Path) -> None:
    path = robot(tmp_path, mesh)
    (path.parent / "text.stl").write_text("no mesh at all", encoding="utf-8")
    found = read_collision(path)
    assert len(found.shapes) == 3 and len(found.unread) == 1
    assert "link 2 (b)" in found.unread[0] and words in found.unread[0]


def test_a_capsule_encloses_any_points_and_flat_ones() -> None:
    rng = np.random.default_rng(1)
    for size in ([1, 0.2, 0.1], [1, 1, 1], [1, 1, 0], [1, 0, 0]):
        points = rng.uniform(-1, 1, size=(50, 3)) * size + 3
        start, end, radius = capsule_about(points)
        way = end - start
        part = np.clip((points - start) @ way / max(way @ way, 1e-30), 0, 1)
        assert (np.linalg.norm(points - start - part[:, None] * way, axis=1) <= radius + 1e-9).all()


def test_vertices_of_both_forms(tmp_path: Path) -> None:
    binary(tmp_path / "b.stl", MESH)
    ascii_(tmp_path / "a.stl", MESH)
    np.testing.assert_allclose(read_stl(tmp_path / "b.stl"), MESH, atol=1e-6)
    np.testing.assert_allclose(read_stl(tmp_path / "a.stl"), MESH)
