"""Memory of recordings, used again as soon as nothing refers to it any more.

Fresh pages from the operating system cost more than what a loop of cheap components writes into them.
"""

from __future__ import annotations

import weakref
from collections import deque

import numpy as np

from fmu_didim.data.signals import Array

SMALLEST, LARGEST = 1 << 14, 1 << 21
"""Numbers in a block that is kept: the allocator is quick with smaller ones, and larger ones would fill the memory."""
_kept: deque[Array] = deque(maxlen=4)


def recording_memory(rows: int, columns: int) -> Array:
    """(rows, columns) without defined content.

    Its memory serves another recording once this array and all views of it are gone.
    """
    count = rows * columns
    if not SMALLEST <= count <= LARGEST:
        return np.empty((rows, columns))
    memory = _fitting(count)
    # Views of an array over a foreign buffer refer to that array, so it lives as long as they do.
    array: Array = np.frombuffer(memory.data, count=count)
    weakref.finalize(array, _kept.append, memory).atexit = False
    return array.reshape(rows, columns)


def _fitting(count: int) -> Array:
    """A block that is free, or a new one. Without a lock, as the end of an array may come at any moment."""
    for _ in range(len(_kept)):
        try:
            memory = _kept.popleft()
        except IndexError:  # another thread took the last one
            break
        if count <= memory.size <= 2 * count:
            return memory
        _kept.append(memory)
    return np.empty(count)
