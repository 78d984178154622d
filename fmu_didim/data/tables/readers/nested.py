"""Named arrays inside one another, as MAT and HDF5 files hold them, as flat columns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from fmu_didim.data.signals import Array

MOST_COLUMNS = 20_000
"""Of a file: matrices that are no tables of signals have more."""


def leaves(content: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Path and value of all that is not a mapping: ``log.q``; elements of a list are ``signals(1).values``."""
    for name, value in content.items():
        if isinstance(value, Mapping):
            yield from ((f"{name}.{rest}", inner) for rest, inner in leaves(value))
        elif _is_list_of_structs(value):
            for i, element in enumerate(np.asarray(value, dtype=object).ravel(), start=1):
                yield from ((f"{name}({i}).{rest}", inner) for rest, inner in leaves(element))
        else:
            yield name, value


def _is_list_of_structs(value: Any) -> bool:
    if not isinstance(value, (list, np.ndarray)) or len(value) == 0:
        return False
    array = np.asarray(value, dtype=object) if isinstance(value, list) else value
    return array.dtype == object and all(isinstance(element, Mapping) for element in array.ravel())


def as_columns(named: Iterable[tuple[str, Any]]) -> dict[str, Array]:
    """Columns of the numeric arrays among these; scalars and texts are left out.

    A matrix gives one column ``name(i)`` for each signal in it. Which of its sides is time follows from the lengths of
    the plain vectors of the file, else it is the longer side.
    """
    arrays = {name: np.squeeze(np.asarray(value)) for name, value in named if _is_numeric(value)}
    usual = Counter(a.size for a in arrays.values() if a.ndim == 1)
    columns: dict[str, Array] = {}
    for name, array in arrays.items():
        if array.ndim == 1:
            columns[name] = array.astype(float)
        elif array.ndim == 2:
            rows, count = array.shape
            along_rows = usual[rows] > usual[count] or (usual[rows] == usual[count] and rows >= count)
            table = array if along_rows else array.T
            if len(columns) + table.shape[1] <= MOST_COLUMNS:
                columns |= {f"{name}({i + 1})": table[:, i].astype(float) for i in range(table.shape[1])}
    return columns


def _is_numeric(value: Any) -> bool:
    try:
        array = np.asarray(value)
    except ValueError:  # lists of unlike lengths
        return False
    real = np.issubdtype(array.dtype, np.number) and not np.issubdtype(array.dtype, np.complexfloating)
    return bool((real or array.dtype == bool) and array.size > 1)
