"""Measurements of the automotive kind, ASAM MDF (``.mf4``, ``.mdf``), by asammdf."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.base.errors import InputError, loading
from fmu_didim.data.signals import Array
from fmu_didim.data.tables.table import SignalTable


def read_mf4(path: Path) -> SignalTable:
    """Channels with their units, each with the instants of its own group: nothing is brought to a common time.

    A name that several groups have becomes ``<group>.<name>``, groups counted from 0; the instants of a group are the
    column ``time <group>``.
    """
    absent = InputError(
        "MF4 files need asammdf.", where=str(path),
        next_step="pip install fmu_didim[mf4], or export the channels as CSV.",
    )  # fmt: skip
    with loading("asammdf", absent=absent):
        from asammdf import MDF
    columns: dict[str, Array] = {}
    units: dict[str, str] = {}
    times: dict[str, str] = {}
    file: Any
    with MDF(str(path)) as file:
        channels = [
            (g, c, channel.name)
            for g, group in enumerate(file.groups)
            for c, channel in enumerate(group.channels)
            if file.masters_db.get(g) != c
        ]
        usual = Counter(name for _, _, name in channels)
        for g, c, own in channels:
            signal = file.get(group=g, index=c)
            samples = np.asarray(signal.samples)
            if samples.ndim != 1 or samples.dtype.kind not in "fiub" or samples.size < 2:
                continue
            name = own if usual[own] == 1 else f"{g}.{own}"
            clock = _clock(columns, g, np.asarray(signal.timestamps, dtype=float))
            columns[name], times[name] = samples.astype(float), clock
            units[name] = signal.unit or ""
    return SignalTable(columns, {n: u for n, u in units.items() if u}, times=times, source=str(path))


def _clock(columns: dict[str, Array], group: int, stamps: Array) -> str:
    """The column of these instants; one more where a channel lacks some samples of its group."""
    number, name = 0, f"time {group}"
    while name in columns and not np.array_equal(columns[name], stamps):
        number += 1
        name = f"time {group}.{number}"
    columns[name] = stamps
    return name
