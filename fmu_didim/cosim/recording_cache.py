"""Recordings kept for runs that are asked for again.

A fit, its checks, its report and the next round of discovery run the loop with the same values.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Hashable

from fmu_didim.cosim.recording import Recording
from fmu_didim.cosim.system import System

MOST_NUMBERS = 1 << 23
"""[1] Numbers kept at most (64 MiB): some 40 runs of six joints at the samples of a log, or three at all ticks."""


class KeptRecordings:
    """The recordings asked for last, by everything that a run depends on; several threads may use them.

    Args:
        most: numbers kept at most; those asked for longest ago leave first.
    """

    def __init__(self, *, most: int = MOST_NUMBERS) -> None:
        self._most, self._count = most, 0
        self._kept: OrderedDict[Hashable, Recording] = OrderedDict()
        self._lock = threading.Lock()

    def find(self, key: Hashable) -> Recording | None:
        """The recording of this key, None if it is not kept."""
        with self._lock:
            found = self._kept.get(key)
            if found is not None:
                self._kept.move_to_end(key)
            return found

    def keep(self, key: Hashable, recording: Recording) -> None:
        """Keep a recording, which must not be changed from now on."""
        for columns in (recording.applied, recording.inputs, recording.sampled):
            columns.table.flags.writeable = False
        with self._lock:
            if key not in self._kept:
                self._kept[key] = recording
                self._count += _size(recording)
            while self._count > self._most:
                self._count -= _size(self._kept.popitem(last=False)[1])

    def __len__(self) -> int:
        return len(self._kept)

    def __getstate__(self) -> dict[str, int]:
        return {"most": self._most}

    def __setstate__(self, state: dict[str, int]) -> None:
        self.__init__(most=state["most"])  # type: ignore[misc]


def _size(recording: Recording) -> int:
    """Numbers in a recording."""
    columns = len(recording.applied) + len(recording.inputs) + len(recording.sampled)
    return int(recording.ticks.size) * (columns + 1)


def response_key(system: System) -> Hashable | None:
    """Everything that the response of a system to its reference depends on; None if a component does not know that."""
    answers = {name: component.compiled().response_key() for name, component in system.components.items()}
    if None in answers.values():
        return None
    return (
        tuple(answers.items()), system.connections, system.order, system.step_size, tuple(system.delays.items()),
        system.jacobi, tuple(system.every.items()), tuple(system.substeps.items()), system.after_step,
        system.algebraic_loops, system.at_instants, system.ramps,
    )  # fmt: skip
