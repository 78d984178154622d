"""Numbers in a MATLAB file of level 5, the usual one; SciPy's reader crashes on some of those that are damaged.

Source: "MAT-File Format" of The MathWorks, chapter 1.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Type of an element -> that of its numbers."""
_MATRIX, _COMPRESSED = 14, 15
_FLAGS, _SIZES, _NAME = 6, 5, 1
_NUMERIC = range(6, 16)
"""Classes of matrices that hold numbers: double, single and integers."""
_IS_COMPLEX = 0x0800
_HEADER = 128
MAXIMUM_BYTES = 256 * 2**20
"""Of one compressed variable: 33 million numbers."""


def is_level_5(content: bytes) -> bool:
    """Whether the header of a file says so."""
    return content[126:_HEADER] in (b"IM", b"MI")


def numbers(content: bytes) -> dict[str, NDArray[np.float64]]:
    """Name -> values of all real numeric matrices of a file, in the order of rows; others are left out.

    Raises:
        ValueError: the file is damaged.
    """
    order = "<" if content[126:_HEADER] == b"IM" else ">"
    found: dict[str, NDArray[np.float64]] = {}
    for kind, inner in _elements(memoryview(content)[_HEADER:], order):
        if kind == _COMPRESSED:
            ((kind, inner),) = _elements(_decompressed(inner), order)
        if kind == _MATRIX and len(inner):
            found |= _matrix(inner, order)
    return found


def _elements(content: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Type and content of the elements that follow one another."""
    place = 0
    while place < len(content):
        if len(content) - place < 8:
            raise ValueError("an element is cut off")
        kind, size = struct.unpack_from(f"{order}II", content, place)
        begin, short = place + 8, kind >> 16
        if short:  # its values stand in the tag
            kind, size, begin = kind & 0xFFFF, short, place + 4
        if size > (4 if short else len(content) - begin):
            raise ValueError("an element reaches beyond its end")
        yield kind, content[begin : begin + size]
        place = place + 8 if short else begin + size + (0 if kind == _COMPRESSED else -size % 8)


def _matrix(content: memoryview, order: str) -> dict[str, NDArray[np.float64]]:
    parts = _elements(content, order)
    kind, flags = next(parts)
    if (kind, len(flags)) != (_FLAGS, 8):
        raise ValueError("a matrix does not begin with its flags")
    (word,) = struct.unpack_from(f"{order}I", flags)
    if word & 0xFF not in _NUMERIC or word & _IS_COMPLEX:
        return {}
    try:
        (of_sizes, sizes), (of_name, name), (of_values, values) = parts
    except ValueError as error:
        raise ValueError(f"a matrix has not sizes, name and values: {error}") from error
    if (of_sizes, of_name) != (_SIZES, _NAME) or of_values not in _TYPES:
        raise ValueError(f"sizes, name and values of a matrix are of the types {of_sizes}, {of_name} and {of_values}")
    table = np.frombuffer(values, f"{order}{_TYPES[of_values]}").astype(np.float64)
    shape = np.frombuffer(sizes, f"{order}i4").tolist()
    if min(shape, default=-1) < 0 or math.prod(shape) != table.size:
        raise ValueError(f"a matrix of {shape} holds {table.size} numbers")
    return {bytes(name).decode("ascii"): table.reshape(shape, order="F").ravel()}


def _decompressed(content: memoryview) -> memoryview:
    stream = zlib.decompressobj()
    found = stream.decompress(content, MAXIMUM_BYTES)
    if not stream.eof:
        raise ValueError("a compressed variable is cut off, or too large")
    return memoryview(found)
