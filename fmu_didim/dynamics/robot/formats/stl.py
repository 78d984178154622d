"""Vertices of STL meshes, binary and ASCII."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array

MAXIMUM_BYTES = 256 * 2**20
"""[bytes] Of a mesh that is read: five million triangles."""
HEAD = 84
"""[bytes] Of a binary file: 80 of text, and the number of triangles."""
TRIANGLE = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("attribute", "<u2")])
"""Of a binary file, 50 bytes."""


def read_stl(path: Path) -> Array:
    """(N, 3) vertices of a mesh, in the unit of the file.

    Raises:
        InputError: the file is too large, or no STL.
    """
    if path.stat().st_size > MAXIMUM_BYTES:
        raise InputError(f"the mesh {path.name} is too large", next_step="Take a coarser one for collisions.")
    content = path.read_bytes()
    count = int.from_bytes(content[80:HEAD], "little") if len(content) >= HEAD else -1
    if len(content) == HEAD + count * TRIANGLE.itemsize:
        found = np.frombuffer(content, TRIANGLE, offset=HEAD)["vertices"].reshape(-1, 3).astype(float)
    else:
        lines = (line.split() for line in content.decode("ascii", errors="replace").splitlines())
        try:
            found = np.array([[float(x) for x in words[1:4]] for words in lines if words[:1] == ["vertex"]])
        except ValueError:
            found = np.zeros((0, 3))
    if found.ndim != 2 or found.shape[0] < 3 or found.shape[1] != 3 or not np.isfinite(found).all():
        raise InputError(f"the mesh {path.name} is no STL file", next_step="Export it as STL.")
    return np.asarray(found)
