"""Arrays in the place of data files: a torque log and a reference; inputs of a model and what was measured of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.data.signals import Array, Trajectory, Variable

NO_UNITS: Mapping[str, str] = MappingProxyType({})


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


class _Named:
    """Signals in memory by the names of variables of a model: arrays, or a table that has columns (pandas)."""

    kind = ""

    def __init__(self, time: Any, table: Any, units: Mapping[str, str] | str, signals: Mapping[str, Any]) -> None:
        if table is None and hasattr(time, "columns") and not signals:
            time, table = _clock_of(time)
        given = {} if table is None else {str(name): table[name] for name in _names_of(table)}
        self._time = _numbers(time, f"{self.kind}: time")
        self._columns = {name: _one_column(v, name, self._time, self.kind) for name, v in {**given, **signals}.items()}
        if not self._columns:
            raise InputError(
                "No signal was given.", where=self.kind, valid=f"{self.kind}(t, NAME=values), {self.kind}(t, {{...}})",
                next_step="Give the arrays by the names of the variables of the model.",
            )  # fmt: skip
        self._units = dict.fromkeys(self._columns, units) if isinstance(units, str) else dict(units)
        if unknown := [name for name in self._units if name not in self._columns]:
            raise UnknownNameError("signal", unknown[0], self._columns, where=f"{self.kind}: units")

    def __repr__(self) -> str:
        return f"{self.kind}({self._time.size} rows, {', '.join(self._columns)})"

    @property
    def parts(self) -> list[Trajectory]:
        """The signals, those together that have numbers at the same instants."""
        groups: dict[bytes, list[str]] = {}
        for name, values in self._columns.items():
            groups.setdefault(np.isfinite(values).tobytes(), []).append(name)
        made = []
        for names in groups.values():
            kept = np.isfinite(self._columns[names[0]]) & np.isfinite(self._time)
            values = np.column_stack([self._columns[name][kept] for name in names])
            made.append(Trajectory(self._time[kept], values, tuple(map(Variable, names)), source=self.kind))
        return made

    def entry(self, part: Trajectory) -> dict[str, Any]:
        """What a case file says of such a file beside its name."""
        units = {name: {"name": name, "unit": self._units[name]} for name in part.names if self._units.get(name)}
        return {"columns": {name: units.get(name, {"name": name}) for name in part.names}}


class Inputs(_Named):
    """Recorded inputs of a model in memory: ``Inputs(t, T_out=..., T_beside=...)``.

    Args:
        time: (N,) instants in s; or a pandas DataFrame with a column ``t`` or ``time``, or with them as its index.
        table: mapping or DataFrame of columns (N,) by the names of the inputs, for names that are none in Python.
        interpolation: ``linear`` between the rows, or ``held`` from each row to the next.
        outside: what acts before the first row and after the last one: ``refuse``, or ``hold`` that row.
        units: of the numbers, for all signals or by name; by default those of the model.
        signals: (N,) by the name of the input.

    Raises:
        InputError: the shapes do not belong together, a number is missing, or the time does not increase.
    """

    kind = "Inputs"

    def __init__(
        self, time: Any, table: Any = None, *, interpolation: str = "linear", outside: str = "refuse",
        units: Mapping[str, str] | str = NO_UNITS, **signals: Any,
    ) -> None:  # fmt: skip
        super().__init__(time, table, units, signals)
        self._entries = {"interpolation": interpolation, "outside": outside}
        lacking = [name for name, values in self._columns.items() if not np.isfinite(values).all()]
        if lacking:
            raise InputError(
                "An input has no number in some rows.", where=self.kind, got=", ".join(lacking),
                next_step="Fill the rows in or take them out: nothing is invented for an input.",
            )  # fmt: skip
        _ = self.parts

    def entry(self, part: Trajectory) -> dict[str, Any]:
        """What a case file says of such a file beside its name."""
        return {**super().entry(part), **self._entries}


class Measured(_Named):
    """Measured outputs of a model in memory: ``Measured(t, T=...)``.

    Args:
        time: (N,) instants in s, on the clock of the inputs; or a DataFrame, as of :class:`Inputs`.
        table: mapping or DataFrame of columns (N,) by the names of the outputs; not a number (NaN) is no sample.
        std: known standard deviation of the noise, for all signals or by name; estimated by default.
        units: of the numbers, for all signals or by name; by default those of the model.
        signals: (N,) by the name of the output.

    Raises:
        InputError: the shapes do not belong together, or the time does not increase.
    """

    kind = "Measured"

    def __init__(
        self, time: Any, table: Any = None, *, std: Mapping[str, float] | float | None = None,
        units: Mapping[str, str] | str = NO_UNITS, **signals: Any,
    ) -> None:  # fmt: skip
        super().__init__(time, table, units, signals)
        self._std = dict(std) if isinstance(std, Mapping) else {} if std is None else dict.fromkeys(self._columns, std)
        _ = self.parts

    def entry(self, part: Trajectory) -> dict[str, Any]:
        """What a case file says of such a file beside its name."""
        own = {name: float(self._std[name]) for name in part.names if name in self._std}
        return {**super().entry(part), **({"std": own} if own else {})}


def _clock_of(frame: Any) -> tuple[Any, Any]:
    """The instants of a table of columns, and the table without them."""
    for name in frame.columns:
        if str(name) == "t" or str(name).lower() == "time":
            return frame[name], frame.drop(columns=name)
    return frame.index, frame


def _names_of(table: Any) -> list[Any]:
    return list(table.columns) if hasattr(table, "columns") else list(table)


def _one_column(values: Any, name: str, time: Array, kind: str) -> Array:
    found = _numbers(values, f"{kind}: {name}")
    if found.shape != time.shape or time.ndim != 1:
        raise InputError(
            "A signal does not have one number for each instant.", where=f"{kind}: {name}",
            got=f"{found.shape}, and {time.shape} instants", valid="(N,) and (N,)",
            next_step="Give as many numbers as the time has, one signal an array.",
        )  # fmt: skip
    return found


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
