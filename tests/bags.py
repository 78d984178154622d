"""Recordings of ROS for tests: joint states with stamps, and commands without."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

BEGIN_NS = 1_700_000_000_000_000_000
"""[ns] Instant of the first message."""
ARRIVAL_NS = 2_000_000
"""[ns] By which messages arrive later than their stamps."""


def written(
    path: Path,
    time: np.ndarray,
    positions: Mapping[str, np.ndarray],
    *,
    efforts: Mapping[str, np.ndarray] | None = None,
    commands: Sequence[np.ndarray] = (),
    is_stamped: bool = True,
    stamp_offset_s: float = 0.0,
    turned_every: int = 0,
    picture_of: int = 0,
) -> None:
    """A recording at instants ``time`` (N,) in s, in the format of the suffix.

    Args:
        positions, efforts: by joint, in the order of the message; commands: of ``/command``, a list without names.
        is_stamped, stamp_offset_s: whether headers are filled in, and how far they are off the clock of arrival.
        turned_every: each such message has the joints in the opposite order.
        picture_of: numbers of a list on ``/picture``, one message.
    """
    is_first = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if is_first else Stores.ROS2_HUMBLE)
    types = store.types
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name, "run")
        writer: Any
        if is_first:
            writer = stack.enter_context(Writer1(folder.with_suffix(".bag")))
        else:
            plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
            writer = stack.enter_context(Writer(folder, version=9, storage_plugin=plugin))

        def topic(title: str, kind: str) -> Any:
            connection = writer.add_connection(title, kind, typestore=store)

            def write(instant: int, message: Any) -> None:
                raw = (store.serialize_ros1 if is_first else store.serialize_cdr)(message, kind)
                writer.write(connection, instant, bytes(raw))

            return write

        states = topic("/joint_states", "sensor_msgs/msg/JointState")
        command = topic("/command", "std_msgs/msg/Float64MultiArray") if len(commands) else None
        for k, t in enumerate(time):
            instant = BEGIN_NS + round(1e9 * t)
            stamp = instant + round(1e9 * stamp_offset_s) if is_stamped else 0
            at = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
            header = types["std_msgs/msg/Header"](**({"seq": k} if is_first else {}), stamp=at, frame_id="")
            names = list(positions)[:: -1 if turned_every and k % turned_every == 0 else 1]
            states(
                instant + ARRIVAL_NS,
                types["sensor_msgs/msg/JointState"](
                    header=header, name=names, position=np.array([positions[n][k] for n in names]),
                    velocity=np.zeros(0), effort=np.array([efforts[n][k] for n in names] if efforts else []),
                ),
            )  # fmt: skip
            if command is not None:
                command(instant, _list(types, np.array([c[k] for c in commands])))
        if picture_of:
            topic("/picture", "std_msgs/msg/Float64MultiArray")(BEGIN_NS, _list(types, np.zeros(picture_of)))
        stack.close()
        found = folder.with_suffix(".bag") if is_first else next(folder.glob(f"*{path.suffix}"))
        shutil.copy(found, path)


def _list(types: Mapping[str, Any], values: np.ndarray) -> Any:
    layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return types["std_msgs/msg/Float64MultiArray"](layout=layout, data=values)
