"""What the links of a URDF file fill, as capsules that enclose it: cylinders, spheres, boxes, capsules, and STL meshes.

A mesh is looked for beside the file, ``package://name/path`` as ``name/path`` and ``path`` in its folder and in those
above. Its capsule lies along the principal axis of its vertices.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array
from fmu_didim.dynamics.robot.body import inverse
from fmu_didim.dynamics.robot.formats.stl import read_stl
from fmu_didim.dynamics.robot.formats.urdf import SerialRobot, numbers_of, pose_of, serial_robot

PACKAGE = "package://"


@dataclass(frozen=True)
class Shape:
    """A capsule about a piece of a link.

    Attributes:
        link: of the description, 0 for what does not move; start, end: (3,) m in its frame, of link 0 in that of the
            root of the file; radius: m.
    """

    link: int
    start: Array
    end: Array
    radius: float


@dataclass(frozen=True)
class Collision:
    """The shapes of a file; ``base``: (4, 4) pose of the description's base in the root of the file; ``unread``: what
    could not be read, in words."""

    shapes: tuple[Shape, ...]
    unread: tuple[str, ...]
    base: Array


def read_collision(path: Path | str) -> Collision:
    """The capsules about the ``<collision>`` elements of the serial robot of a URDF file; raises InputError as
    :func:`~fmu_didim.dynamics.robot.formats.urdf.read_urdf`."""
    path, shapes, unread = Path(path), list[Shape](), list[str]()
    serial = serial_robot(path)
    elements = {link.get("name"): link for link in serial.root.iter("link")}
    for name, number, pose in _links(serial):
        for collision in elements[name].findall("collision"):
            where = f"{path}: link {name}"
            own, geometry = pose @ pose_of(collision.find("origin"), where), collision.find("geometry")
            try:
                found = _enclosing(geometry, path.parent, where)
            except (InputError, OSError, ValueError) as error:
                unread.append(f"link {number} ({name}): {str(error).splitlines()[0]}")
                continue
            start, end = ((own @ np.array([*end, 1.0]))[:3] for end in found[:2])
            shapes.append(Shape(number, start, end, found[2]))
    return Collision(tuple(shapes), tuple(unread), serial.frames[0])


def _links(serial: SerialRobot) -> Iterator[tuple[str, int, Array]]:
    """Name of each link of the file, number of that which carries it, and its pose (4, 4) in the frame of that."""
    moving = {joint.name: k for k, (joint, _) in enumerate(serial.chain)}
    children = {joint.child for joint in serial.joints}
    root = next(link.get("name", "") for link in serial.root.iter("link") if link.get("name") not in children)
    new = [(root, 0, np.eye(4))]
    while new:
        name, number, pose = new.pop()
        yield name, number, pose
        for joint in serial.joints:
            if joint.parent != name:
                continue
            k = moving.get(joint.name)
            carried = (number, pose @ joint.pose) if k is None else (k + 1, inverse(serial.inside(k)))
            new.append((joint.child, *carried))


def _enclosing(geometry: ET.Element | None, folder: Path, where: str) -> tuple[Array, Array, float]:
    """Ends (3,) and radius of a capsule about a geometry, in its frame; raises InputError or OSError."""
    shape = None if geometry is None else next((part for part in geometry if isinstance(part.tag, str)), None)
    kind = "nothing" if shape is None else str(shape.tag)
    if kind in ("cylinder", "capsule"):
        half = numbers_of(shape, "length", [0.0], where)[0] / 2
        return np.array([0, 0, -half]), np.array([0, 0, half]), numbers_of(shape, "radius", [0.0], where)[0]
    if kind == "sphere":
        return np.zeros(3), np.zeros(3), numbers_of(shape, "radius", [0.0], where)[0]
    if kind == "box":
        size = np.array(numbers_of(shape, "size", [0.0] * 3, where))
        return capsule_about(np.array(np.meshgrid(*(np.array([-0.5, 0.5]) * s for s in size))).reshape(3, -1).T)
    if kind == "mesh":
        assert shape is not None
        name = shape.get("filename", "")
        found = _file(name, folder)
        return capsule_about(read_stl(found) * np.array(numbers_of(shape, "scale", [1.0] * 3, where)))
    raise InputError(f"its geometry is {kind}", next_step="Give capsules.")


def _file(name: str, folder: Path) -> Path:
    """The file of a mesh."""
    if Path(name).suffix.lower() != ".stl":
        raise InputError(f"the mesh {name} is no STL file", next_step="Give capsules.")
    if name.startswith(PACKAGE):
        package, _, inside = name.removeprefix(PACKAGE).partition("/")
        places = [
            above / part for above in (folder, *folder.resolve().parents) for part in (f"{package}/{inside}", inside)
        ]
    else:
        places = [folder / name.removeprefix("file://")]
    for place in places:
        if place.is_file():
            return place
    raise InputError(f"the mesh {name} is not found beside the file", next_step="Put it there, or give capsules.")


def capsule_about(points: Array) -> tuple[Array, Array, float]:
    """Ends (3,) and radius of a capsule about points (N, 3), along their principal axis."""
    middle = (points.max(axis=0) + points.min(axis=0)) / 2
    axis = np.linalg.svd(points - middle, full_matrices=False)[2][0]
    along = (points - middle) @ axis
    across = np.linalg.norm(points - middle - np.outer(along, axis), axis=1)
    radius = float(across.max())
    # A half sphere about each end: a point at t and r from the axis is inside if the end is within sqrt(R^2 - r^2).
    reach = np.sqrt(np.maximum(radius**2 - across**2, 0.0))
    low, high = float((along + reach).min()), float((along - reach).max())
    if low > high:
        low = high = (low + high) / 2
    return middle + low * axis, middle + high * axis, radius
