"""Numbers and structs in a MATLAB file of level 5, the usual one; SciPy's reader crashes on some that are damaged.

Source: "MAT-File Format" of The MathWorks, chapter 1.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Type of an element -> that of its numbers."""
Content: TypeAlias = "NDArray[np.float64] | dict[str, Content] | list[dict[str, Content]]"
"""A matrix of numbers, a struct by the names of its fields, or an array of structs."""
_MATRIX, _COMPRESSED, _STRUCT = 14, 15, 2
_FLAGS, _SIZES, _NAME = 6, 5, 1
_NUMERIC = range(6, 16)
"""Classes of matrices that hold numbers: double, single and integers."""
_IS_COMPLEX = 0x0800
_HEADER = 128
MAXIMUM_DEPTH = 20
"""[1] Levels of nested structs at most."""
MAXIMUM_BYTES = 256 * 2**20
"""[byte] Size of one compressed variable at most: 33 million numbers."""


def is_level_5(content: bytes) -> bool:
    """Whether the header of a file says so."""
    return content[126:_HEADER] in (b"IM", b"MI")


def contents(content: bytes) -> dict[str, Content]:
    """Name -> content of the variables of a file; texts, complex numbers, cells and objects are left out.

    Raises:
        ValueError: the file is damaged.
    """
    order = "<" if content[126:_HEADER] == b"IM" else ">"
    found: dict[str, Content] = {}
    for kind, inner in _elements(memoryview(content)[_HEADER:], order):
        if kind == _COMPRESSED:
            ((kind, inner),) = _elements(_decompressed(inner), order)
        if kind == _MATRIX and len(inner):
            name, value = _matrix(inner, order, 0)
            if value is not None:
                found[name] = value
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


def _matrix(content: memoryview, order: str, depth: int) -> tuple[str, Content | None]:
    """Name and content of a variable, or of a field of a struct, which has no name."""
    parts = _elements(content, order)
    kind, flags = next(parts, (0, memoryview(b"")))
    if (kind, len(flags)) != (_FLAGS, 8):
        raise ValueError("a matrix does not begin with its flags")
    (word,) = struct.unpack_from(f"{order}I", flags)
    if word & 0xFF not in (*_NUMERIC, _STRUCT) or word & _IS_COMPLEX:
        return "", None
    (of_sizes, sizes), (of_name, name) = _two(parts)
    if (of_sizes, of_name) != (_SIZES, _NAME):
        raise ValueError(f"sizes and name of a matrix are of the types {of_sizes} and {of_name}")
    shape = np.frombuffer(sizes, f"{order}i4").tolist()
    if min(shape, default=-1) < 0:
        raise ValueError(f"a matrix is of the size {shape}")
    own = bytes(name).decode("ascii")
    if word & 0xFF == _STRUCT:
        return own, _structs(parts, math.prod(shape), order, depth + 1)
    ((of_values, values),) = parts
    if of_values not in _TYPES:
        raise ValueError(f"the values of a matrix are of the type {of_values}")
    table = np.frombuffer(values, f"{order}{_TYPES[of_values]}").astype(np.float64)
    if math.prod(shape) != table.size:
        raise ValueError(f"a matrix of {shape} holds {table.size} numbers")
    return own, table.reshape(shape, order="F")


def _structs(
    parts: Iterator[tuple[int, memoryview]], count: int, order: str, depth: int
) -> dict[str, Content] | list[dict[str, Content]]:
    """A struct, or the list of those of an array of them."""
    if depth > MAXIMUM_DEPTH:
        raise ValueError(f"structs are nested more than {MAXIMUM_DEPTH} deep")
    (_, length), (_, names) = _two(parts)
    (size,) = struct.unpack_from(f"{order}i", length) if len(length) >= 4 else (0,)
    if size <= 0 or len(names) % size:
        raise ValueError("the names of the fields of a struct are damaged")
    fields = [bytes(names[i : i + size]).split(b"\0")[0].decode("ascii") for i in range(0, len(names), size)]
    found: list[dict[str, Content]] = []
    for _ in range(count if fields else 0):
        element: dict[str, Content] = {}
        for field in fields:
            kind, inner = next(parts, (0, memoryview(b"")))
            if kind != _MATRIX:
                raise ValueError(f"the field {field} of a struct is missing")
            value = _matrix(inner, order, depth)[1] if len(inner) else None
            if value is not None:
                element[field] = value
        found.append(element)
    return found[0] if len(found) == 1 else found


def _two(parts: Iterator[tuple[int, memoryview]]) -> tuple[tuple[int, memoryview], tuple[int, memoryview]]:
    try:
        return next(parts), next(parts)
    except StopIteration as error:
        raise ValueError("a matrix ends before its content") from error


def _decompressed(content: memoryview) -> memoryview:
    stream = zlib.decompressobj()
    found = stream.decompress(content, MAXIMUM_BYTES)
    if not stream.eof:
        raise ValueError("a compressed variable is cut off, or too large")
    return memoryview(found)
