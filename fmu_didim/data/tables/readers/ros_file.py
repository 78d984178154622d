"""Recordings of ROS 1 (``.bag``) and ROS 2 (``.mcap``, ``.db3``), by rosbags."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, is_dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.base.errors import InputError, loading
from fmu_didim.data.signals import Array
from fmu_didim.data.tables.readers.size import MOST_VALUES, check_size
from fmu_didim.data.tables.table import SignalTable

NAMES = ("name", "joint_names")
"""Fields of a message that name the elements of its other lists, as in ``sensor_msgs/JointState`` and those of
controllers."""
MOST_ELEMENTS = 256
"""[1] Numbers of a message: images, point clouds and maps, which are no signals, have more."""
NANO = 1e-9
"""[s] Unit of the stamps."""
LATE = 1.0
"""[s] Between stamp and arrival of a message, from which two clocks, or a queue, are told."""


def read_ros(path: Path) -> SignalTable:
    """The numbers in all messages of all topics, each with the instants of its own topic.

    The column ``/joint_states.effort.elbow`` is the field ``effort`` of that topic, at the joint that its list ``name``
    calls so, in whatever order a message has them; ``/command.data.2`` the second element of a list without names. The
    column ``time /joint_states`` has the instants: those of ``header.stamp`` where a topic has them, else those at
    which its messages arrived; all in s after the first message of the file. A number that one message of a topic
    lacks is NaN.
    """
    absent = InputError(
        "Recordings of ROS need rosbags.", where=str(path),
        next_step="pip install fmu_didim[ros], or export the topics as CSV.",
    )  # fmt: skip
    with loading("rosbags", absent=absent):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    topics: dict[str, _Topic] = {}
    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as bag:
        known = [c for c in bag.connections if c.msgtype in bag.typestore.fielddefs]
        left_out, begin, values = {c.topic for c in bag.connections} - {c.topic for c in known}, bag.start_time, 0
        for connection, instant, raw in bag.messages(known) if known else ():
            if connection.topic in left_out:
                continue
            message = bag.deserialize(raw, connection.msgtype)
            numbers = dict(islice(_numbers(message), MOST_ELEMENTS + 1))
            if len(numbers) > MOST_ELEMENTS:
                left_out.add(connection.topic)
                continue
            values += len(numbers)
            if values > MOST_VALUES:
                check_size(values, path)
            topics.setdefault(connection.topic, _Topic()).add(_stamp(message), instant, numbers)
    kept = {name: topic for name, topic in topics.items() if name not in left_out and topic.is_signal}
    columns, times = dict[str, Array](), dict[str, str]()
    for name, topic in kept.items():
        columns[f"time {name}"] = (np.array(topic.instants) - begin) * NANO
        columns |= {f"{name}.{field}": np.array(column) for field, column in topic.columns.items()}
        times |= {f"{name}.{field}": f"time {name}" for field in topic.columns}
    notes = [
        f"the stamps of {name} are up to {topic.late * NANO:.3g} s off the arrival of its messages: another clock"
        for name, topic in kept.items() if topic.late * NANO > LATE
    ]  # fmt: skip
    arrived = [name for name, topic in kept.items() if not topic.is_stamped]
    if arrived:
        notes.append(f"instants of {', '.join(arrived)}: those of arrival, for its messages have no stamps")
    if left_out:
        notes.append(f"not read: {', '.join(sorted(left_out))}, no signals or of an unknown type")
    return SignalTable(columns, times=times, notes=tuple(notes), source=str(path))


@dataclass
class _Topic:
    """What its messages hold.

    Attributes:
        columns: path of a number -> its value in each message; instants: ns of each.
        is_stamped: whether these are the stamps of their headers, as the first message decides; late: ns by which
            messages arrived later, or earlier, at most.
    """

    columns: dict[str, array[float]] = field(default_factory=dict)
    instants: list[int] = field(default_factory=list)
    is_stamped: bool = False
    late: int = 0

    @property
    def is_signal(self) -> bool:
        """Whether there is more than one number of something."""
        return len(self.instants) > 1 and bool(self.columns)

    def add(self, stamp: int | None, arrived: int, numbers: Mapping[str, float]) -> None:
        """One message."""
        count = len(self.instants)
        if not count:
            self.is_stamped = stamp is not None
        self.instants.append(stamp if self.is_stamped and stamp is not None else arrived)
        self.late = max(self.late, abs(arrived - self.instants[-1]))
        for name in numbers:
            if name not in self.columns:
                self.columns[name] = array("d", [np.nan]) * count
        for name, column in self.columns.items():
            column.append(numbers.get(name, np.nan))


def _stamp(message: Any) -> int | None:
    """Nanoseconds of the header of a message; None where it has none, or one that nobody filled in."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is None:
        return None
    found = 10**9 * int(stamp.sec) + int(stamp.nanosec)
    return found or None


def _numbers(message: Any, names: tuple[str, ...] = ()) -> Iterator[tuple[str, float]]:
    """Path and value of the numbers in a message, its header and what is not plain left out."""
    values: Mapping[str, Any] = vars(message)
    own = next((tuple(values[n]) for n in NAMES if isinstance(values.get(n), list)), names)
    for name, value in values.items():
        if name in ("header", "__msgtype__") or isinstance(value, str):
            continue
        if isinstance(value, bool | int | float | np.number):
            yield name, float(value)
        elif isinstance(value, list | np.ndarray):
            yield from _elements(name, value, own)
        elif is_dataclass(value):
            yield from ((f"{name}.{rest}", number) for rest, number in _numbers(value, own))


def _elements(name: str, value: Any, names: tuple[str, ...]) -> Iterator[tuple[str, float]]:
    titles = names if len(names) == len(value) and len(set(names)) == len(names) else range(1, len(value) + 1)
    for title, element in zip(titles, value, strict=True):
        if isinstance(element, bool | int | float | np.number):
            yield f"{name}.{title}", float(element)
        elif is_dataclass(element):
            yield from ((f"{name}.{title}.{rest}", number) for rest, number in _numbers(element, names))
