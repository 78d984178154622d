"""Buffers of recordings, used again as soon as nothing refers to them.

Fresh pages from the operating system cost more than what a loop of cheap components writes into them.
"""

from __future__ import annotations

import weakref
from collections import deque

import numpy as np

from fmu_didim.data.signals import Array

SMALLEST, LARGEST = 1 << 14, 1 << 21
"""[1] Numbers in a buffer that is used again: the allocator is quick with smaller ones, and larger ones would fill
the memory."""
_free: deque[Array] = deque(maxlen=4)
_lent: dict[int, tuple[weakref.ref[Array], Array]] = {}
"""What watches each array that is in use, by its identity, and the buffer of that array."""


def recording_buffer(rows: int, columns: int) -> Array:
    """(rows, columns) without defined content.

    Its buffer serves another recording once this array and all views of it are gone.
    """
    count = rows * columns
    if not SMALLEST <= count <= LARGEST:
        return np.empty((rows, columns))
    buffer = _fitting(count)
    # Views of an array over a foreign buffer refer to that array, so it lives as long as they do.
    array: Array = np.frombuffer(buffer.data, count=count)
    watch = weakref.ref(array, _take_back)  # weakref.finalize takes several times as long
    _lent[id(watch)] = watch, buffer
    return array.reshape(rows, columns)


def _take_back(
    watch: weakref.ref[Array], lent: dict[int, tuple[weakref.ref[Array], Array]] = _lent, free: deque[Array] = _free
) -> None:
    """The buffer of an array that is gone serves another one; what it needs is bound here, for the end of Python."""
    free.append(lent.pop(id(watch))[1])


def _fitting(count: int) -> Array:
    """A free buffer, or a new one. Without a lock, as the end of an array may come at any moment."""
    for _ in range(len(_free)):
        try:
            buffer = _free.popleft()
        except IndexError:  # another thread took the last one
            break
        if count <= buffer.size <= 2 * count:
            return buffer
        _free.append(buffer)
    return np.empty(count)
