"""Arrays in the place of data files: a torque log and a reference trajectory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Array, Trajectory, Variable


@dataclass(frozen=True, eq=False)
class Log:
    """A torque log in memory.

    Attributes:
        time: (N,) instants in s, on the clock of the reference.
        torque: (N, n), one column a joint, or (N,) of one joint.
        unit: of the numbers, for all joints or one for each; N.m and N by default.

    Raises:
        InputError: the shapes do not belong together, or the time does not increase.
    """

    time: Any
    torque: Any
    unit: str | Sequence[str] = ""

    def __post_init__(self) -> None:
        _ = self.signals

    @property
    def signals(self) -> Trajectory:
        """Columns ``tau<j>``, as they were given."""
        return _signals("Log", self.time, {"tau": ("torque", self.torque)})

    @property
    def columns(self) -> dict[str, Any]:
        """The columns that have another unit than SI, as a case file writes them."""
        return _with_units(self.signals, self.unit, {"tau": ""})


@dataclass(frozen=True, eq=False)
class Reference:
    """A reference trajectory in memory, one row a control period.

    Attributes:
        time: (N,) instants in s.
        position: (N, n), one column a joint, or (N,) of one joint.
        velocity, acceleration: likewise; where they are left out and the controller needs them, they are computed from
            the position by a cubic spline.
        unit: of the position, for all joints or one for each, rad and m by default; the derivatives are in this unit
            per s and per s2.

    Raises:
        InputError: the shapes do not belong together, or the time does not increase.
    """

    time: Any
    position: Any
    velocity: Any = None
    acceleration: Any = None
    unit: str | Sequence[str] = ""

    def __post_init__(self) -> None:
        _ = self.signals

    @property
    def signals(self) -> Trajectory:
        """Columns ``q<j>``, ``dq<j>``, ``ddq<j>``, as they were given."""
        parts = {
            "q": ("position", self.position), "dq": ("velocity", self.velocity),
            "ddq": ("acceleration", self.acceleration),
        }  # fmt: skip
        return _signals("Reference", self.time, {stem: part for stem, part in parts.items() if part[1] is not None})

    @property
    def columns(self) -> dict[str, Any]:
        """The columns that have another unit than SI, as a case file writes them."""
        return _with_units(self.signals, self.unit, {"q": "", "dq": "/s", "ddq": "/s2"})


def _signals(kind: str, time: Any, parts: Mapping[str, tuple[str, Any]]) -> Trajectory:
    stamps = _numbers(time, f"{kind}: time")
    if stamps.ndim != 1:
        raise InputError(
            "The time is one column.", where=f"{kind}: time", got=stamps.shape, valid="(N,) in s",
            next_step="Give time.ravel(), or one column of it.",
        )  # fmt: skip
    columns: dict[str, Array] = {}
    widths = {}
    for stem, (name, values) in parts.items():
        found = _numbers(values, f"{kind}: {name}")
        found = found[:, None] if found.ndim == 1 else found
        if found.ndim != 2 or found.shape[0] != stamps.size:
            turned = found.ndim == 2 and found.shape[1] == stamps.size
            raise InputError(
                "An array does not have a row for each instant.", where=f"{kind}: {name}",
                got=f"{np.shape(values)}, and {stamps.size} instants", valid="(N, n), or (N,) of one joint",
                next_step=f"Transpose it: {name}.T." if turned else "Give as many rows as the time has.",
            )  # fmt: skip
        widths[name] = found.shape[1]
        columns |= {f"{stem}{j}": found[:, j - 1] for j in range(1, found.shape[1] + 1)}
    if len(set(widths.values())) > 1:
        raise InputError(
            "The arrays have different numbers of joints.", where=kind,
            got=", ".join(f"{name}: {count}" for name, count in widths.items()),
            next_step="Give each array one column a joint, from the base to the tip.",
        )  # fmt: skip
    return Trajectory(stamps, np.column_stack(list(columns.values())), tuple(map(Variable, columns)), source=kind)


def _numbers(values: Any, where: str) -> Array:
    found = np.asarray(values)
    if found.dtype.kind in "mM":
        raise InputError(
            "These are dates, not seconds.", where=where, got=found.dtype,
            next_step="Give seconds on the clock of the reference: (t - t[0]) / np.timedelta64(1, 's').",
        )  # fmt: skip
    if found.dtype.kind not in "iuf":
        raise InputError(
            "This is no array of real numbers.", where=where, got=f"dtype {found.dtype}", valid="float",
            next_step="Convert it first, such as with numpy.asarray(values, dtype=float).",
        )  # fmt: skip
    return np.asarray(found, dtype=float)


def _with_units(signals: Trajectory, unit: str | Sequence[str], per: Mapping[str, str]) -> dict[str, Any]:
    count = sum(name.startswith(next(iter(per))) for name in signals.names)
    units = [unit] * count if isinstance(unit, str) else list(unit)
    if len(units) != count:
        raise InputError(
            "One unit is needed for all joints, or one for each.", where=f"{signals.source}: unit", got=units,
            valid=f"{count} units", next_step="Give a single unit such as 'N m', or a list with one for each column.",
        )  # fmt: skip
    found = {}
    for name in signals.names:
        stem, joint = name.rstrip("0123456789"), int(name.lstrip("dqtau"))
        if units[joint - 1]:
            found[name] = {"name": name, "unit": units[joint - 1] + per[stem]}
    return found
