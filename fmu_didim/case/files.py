"""Where the files of a case lie, and the signals in them."""

from __future__ import annotations

import os
from collections.abc import Container, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.base.errors import InputError
from fmu_didim.base.files import is_file
from fmu_didim.case.in_memory import check_at_hand
from fmu_didim.case.sources import DataFile, SignalFile, TorqueFile
from fmu_didim.data.signals import Array, Trajectory
from fmu_didim.data.tables import (
    Column,
    Selected,
    SignalTable,
    TimeColumn,
    clock_column,
    instants,
    read_table,
    selected,
)
from fmu_didim.data.tables.columns import is_of_joint
from fmu_didim.data.tables.motors import on_joints
from fmu_didim.data.tables.select import NO_UNITS

DATA_VARIABLE = "FMU_DIDIM_DATA"
DATA_PREFIX = "data:"
NONE_GIVEN: Mapping[str, Trajectory] = MappingProxyType({})
TIME_IN_MEMORY = "time of signals in memory"


def data_folder(folder: Path) -> Path:
    """The folder of the environment variable ``FMU_DIDIM_DATA``, else ``../shared/data`` beside the project.

    Args:
        folder: that of the case file, from which the project's folder is looked for.
    """
    named = os.environ.get(DATA_VARIABLE)
    if named:
        return Path(named)
    for parent in (folder.resolve(), *folder.resolve().parents):
        if (parent / "pyproject.toml").is_file():
            return parent.parent / "shared" / "data"
    return Path("../shared/data")


def path_of(file: str, folder: Path) -> Path:
    """The path of a file that a case in a folder names, whether it is there or not."""
    is_data = file.startswith(DATA_PREFIX)
    return data_folder(folder) / file.removeprefix(DATA_PREFIX) if is_data else folder / file


def resolve(source: DataFile, folder: Path) -> Path:
    """The path of a file; raises InputError that says where to get it."""
    check_at_hand(source.file)
    path = path_of(source.file, folder)
    if not is_file(path):
        step = how_to_get(source.file, source.obtain)
        raise InputError("A data file is absent.", where=str(path), next_step=step)
    return path


def how_to_get(file: str, obtain: str = "") -> str:
    """The next step of a user whose data file is absent.

    Args:
        file: as the case names it; obtain: what the case says of where to get it.
    """
    step = "Check the path in the case file; it is relative to the folder of that file."
    if file.startswith(DATA_PREFIX):
        step = f"Set {DATA_VARIABLE} to the folder that holds {file.removeprefix(DATA_PREFIX)}."
    return f"{step} {obtain}".strip()


def read_signals(
    source: SignalFile,
    folder: Path,
    signals: Mapping[str, Trajectory] = NONE_GIVEN,
    *,
    torque_units: tuple[str, ...] = (),
    units: Mapping[str, str] = NO_UNITS,
    needed: Container[str] = (),
) -> Selected:
    """The signals of a file, or those given under its name, under the names of the case and in SI units.

    Args:
        torque_units: (n,) N.m or N of each joint, where known; units: name of a signal -> its unit, if it is not SI.
        needed: names of signals that are asked for beside those of joints and those that the case names; of others
            a column in which something is no number is left out.
    """
    table, time = table_and_time(source, folder, signals)
    command = isinstance(source, TorqueFile) and source.quantity == "command"
    found = selected(
        table, time=time, columns=source.columns, torque_units=torque_units, is_command=command, units=units,
        of_motors=source.motors is not None, others=lambda name: is_of_joint(name) or name in needed,
    )  # fmt: skip
    if source.motors is not None:
        of_joints = on_joints(found.signals, source.motors, torque_units, where=source.file)
        found = replace(found, signals=of_joints)
    return replace(found, told=found_in(found.told, source.file))


def read_samples(
    source: SignalFile,
    folder: Path,
    columns: Mapping[str, Column],
    signals: Mapping[str, Trajectory] = NONE_GIVEN,
    *,
    torque_units: tuple[str, ...] = (),
    units: Mapping[str, str] = NO_UNITS,
) -> dict[str, Selected]:
    """Each of these signals of a file at its own instants: a cell without a number is no sample.

    Args:
        columns: name of a signal -> its column; the others as of :func:`read_signals`.
    """
    table, time = table_and_time(source, folder, signals)
    found = dict[str, Selected]()
    for name, column in columns.items():
        one = selected(
            table, time=time, columns={name: column}, torque_units=torque_units, units=units, others=False, sparse=True
        )
        found[name] = replace(one, told=found_in(one.told, source.file))
    return found


def read_stamps(
    source: DataFile, folder: Path, signals: Mapping[str, Trajectory] = NONE_GIVEN
) -> tuple[Array, tuple[Diagnostic, ...]]:
    """(N,) instants of the rows of a file, or of the signals given under its name, in s, and what was found in it."""
    table, time = table_and_time(source, folder, signals)
    clock = clock_column(table, time, ())
    rows = table.columns[clock] if clock is not None else next(iter(table.columns.values()))
    stamps, told = instants(table, time, clock, rows.size)
    return stamps[np.isfinite(stamps)] if time.polled else stamps, found_in(told, source.file)


def found_in(told: Iterable[Diagnostic], file: str) -> tuple[Diagnostic, ...]:
    """Diagnostics of a file, under the name that the case gives it."""
    return tuple(replace(diagnostic, place=file) for diagnostic in told)


def table_and_time(
    source: DataFile, folder: Path, signals: Mapping[str, Trajectory] = NONE_GIVEN
) -> tuple[SignalTable, TimeColumn]:
    """The columns of a file, or of the signals given under its name, and where their instants stand."""
    given = signals.get(source.file)
    if given is not None:
        return _in_memory(given, source), TimeColumn(name=TIME_IN_MEMORY)
    return read_table(resolve(source, folder), layout=source.csv), source.time or TimeColumn()


def _in_memory(given: Trajectory, source: DataFile) -> SignalTable:
    columns = {name: given.values[:, i] for i, name in enumerate(given.names)}
    return SignalTable({TIME_IN_MEMORY: given.time, **columns}, source=given.source or source.file)
