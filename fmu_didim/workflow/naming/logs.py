"""What the laws are fitted to: reference, measured positions and torque of each run of a case, at the control ticks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fmu_didim.base.documents import validate
from fmu_didim.base.errors import InputError
from fmu_didim.case import Case, load_case
from fmu_didim.case.build import contents_of
from fmu_didim.case.document import CaseDocument, read_case
from fmu_didim.case.files import read_signals
from fmu_didim.case.runs.instants import read_motion
from fmu_didim.case.runs.torque_log import TorqueLog, read_torque_log
from fmu_didim.case.sources import ExperimentSource, SignalFile
from fmu_didim.controllers.pd import PD
from fmu_didim.data.signals import Trajectory, Variable
from fmu_didim.dynamics.robot import read_robot
from fmu_didim.workflow.naming.catalogue import JointSignals

EDGE = 10
"""[ticks] At both ends of the positions that are not compared: a spline has its ends there, and filters begin."""
FEWEST = 60
"""[samples] Of the torque that a run must have."""
ON_TICK = 0.05
"""[control periods] By how much a sample may be off a tick and still belong to it."""


@dataclass(frozen=True)
class Logs:
    """The runs of a case for its laws.

    Attributes:
        case: with a controller that can run, whatever the case says of its own.
        joints: (n,) joints, each with its runs; none where there are no positions.
        step: control period, s; rate_is_known: whether the case says so; every_tick: whether positions were measured
            at each tick, so that they show what the controller saw.
        labels: of the runs; kinds: type of each joint; unit: of the command.
        torque_hz, positions_hz: rates of the logs; no positions: 0. is_unknown: whether the case guesses no controller.
        is_rebuilt: whether jittered stamps of a log were put right.
    """

    case: Case
    joints: tuple[tuple[JointSignals, ...], ...]
    step: float
    rate_is_known: bool
    every_tick: bool
    labels: tuple[str, ...]
    kinds: tuple[str, ...]
    torque_hz: float
    positions_hz: float
    is_unknown: bool
    is_rebuilt: bool = False


def logs_of(case: Case | Path | str | Mapping[str, Any]) -> Logs:
    """Read the runs of a case that are fitted.

    Raises:
        InputError: the case is wrong, or its logs cannot be used.
    """
    document, folder = _document(case)
    if document.robot is None or document.controller is None:
        raise InputError(
            "Only the controller of a robot can be named.", where="case", got="no robot: or no controller:",
            next_step="Give robot: (a description) and controller: {kind: tracking}.",
        )  # fmt: skip
    step, known = _step(case, document, folder)
    ready = _ready(case, document, folder, step)
    n, units = ready.parameters.joint_count, ready.parameters.torque_units
    labels = tuple(label for label, run in document.runs.items() if run.role == "estimation")
    needed = frozenset(f"{d}q{j}" for d in ("", "d", "dd") for j in range(1, n + 1))
    runs, torque_hz, positions_hz, on_ticks = [], [], [], []
    for label in labels:
        run = ready.document.runs[label]
        if run.reference is None:
            raise InputError(
                "The law of a controller is named from what it was asked to do, and this run has no reference.",
                where=label, next_step="Add reference: {file: ...} with the set points of the controller.",
            )  # fmt: skip
        motion = read_motion(
            run, folder, step=step, torque_units=units, needed=needed, signals=ready.signals
        ).signals  # fmt: skip
        log = read_torque_log(
            run, folder, motion, step=step, drive_gains=document.loop.drive_gains, torque_units=units, label=label,
            signals=ready.signals,
        )  # fmt: skip
        torque_hz.append((log.times.size - 1) / float(np.ptp(log.times)))
        if torque_hz[-1] * step > 1 + ON_TICK:
            raise InputError(
                "The torque was logged faster than the controller is said to run, so that the control rate is wrong.",
                where="loop.rate_hz", got=f"control at {1 / step:.6g} Hz, torque at {torque_hz[-1]:.6g} Hz",
                next_step="State the rate of the controller, or take every so many rows of the log (torque: {rate_hz: "
                "...}).",
            )  # fmt: skip
        positions = _positions(run, folder, ready, units)
        if positions is None:
            continue
        positions_hz.append((positions.time.size - 1) / float(np.ptp(positions.time)))
        runs.append(_joint_signals(motion, positions, log, step, label))
        on_ticks.append(positions_hz[-1] * step > 1 - 1e-3)
    if len(runs) < len(labels):
        runs = []
    joints = tuple(tuple(run[j] for run in runs) for j in range(n)) if runs else ()
    assert ready.robot is not None  # the document names it
    kinds = tuple(joint.type for joint in ready.robot.joints)
    return Logs(
        ready, joints, step, known, bool(runs) and all(on_ticks), labels, kinds, min(torque_hz),
        min(positions_hz, default=0.0), document.controller.is_tracking,
        any(_is_rebuilt(document.runs[label]) for label in labels),
    )  # fmt: skip


def _is_rebuilt(run: ExperimentSource) -> bool:
    files = (run.torque, run.positions, *run.measured_files)
    return any(file is not None and file.time is not None and file.time.is_rebuilt for file in files)


def _document(case: Case | Path | str | Mapping[str, Any]) -> tuple[CaseDocument, Path]:
    if isinstance(case, Case):
        return case.document, case.folder
    if isinstance(case, Mapping):
        return validate(CaseDocument, dict(case), where="case"), Path()
    return read_case(case), Path(case).parent


def _step(case: Any, document: CaseDocument, folder: Path) -> tuple[float, bool]:
    """Control period in s, and whether it is known: of the loop, of a controller that the case guesses, or of the
    log."""
    assert document.controller is not None
    if document.loop.rate_hz is not None:
        return 1 / document.loop.rate_hz, True
    if not document.controller.is_tracking:
        ready = case if isinstance(case, Case) else load_case(case, require_torque=False)
        return ready.step_size, True
    run = next(run for run in document.runs.values() if run.role == "estimation")
    signals = case.signals if isinstance(case, Case) else {}
    if run.torque is None:
        raise InputError("The torque log is missing.", where="train", next_step="Add torque: {file: ...} to it.")
    log = read_signals(run.torque, folder, signals, torque_units=()).signals
    return float(np.median(np.diff(log.time))), False


def _ready(case: Any, document: CaseDocument, folder: Path, step: float) -> Case:
    """The case with a controller that runs, so that it can be loaded whatever the rate of its positions."""
    assert document.controller is not None and document.robot is not None
    if not document.controller.is_tracking:
        return case if isinstance(case, Case) else load_case(case, require_torque=False)
    robot = case.robot if isinstance(case, Case) else read_robot(folder / document.robot)
    assert robot is not None  # the document names it
    ones = (1.0,) * len(robot.joints)
    kinds = tuple(joint.type for joint in robot.joints)
    law = PD(law="pd", name="unknown", joints=kinds, rate_hz=1 / step, Kp=ones, Kd=ones)
    loop = {"rate_hz": 1 / step}
    if isinstance(case, Case):
        return case.with_(controller=law.block(), loop=loop)
    content = contents_of(document)
    content = {**content, "controller": law.block(), "loop": {**content.get("loop", {}), **loop}}
    return load_case(content, folder=folder, require_torque=False)


def _positions(run: ExperimentSource, folder: Path, case: Case, units: tuple[str, ...]) -> Trajectory | None:
    """The measured positions of a run, under ``positions:`` or ``measured:``; None where they are not all there."""
    names = [f"q{j}" for j in range(1, len(units) + 1)]
    files: list[SignalFile] = [file for file in (run.positions, *run.measured_files) if file is not None]
    for file in files:
        found = read_signals(file, folder, case.signals, torque_units=units).signals
        if set(names) <= set(found.names):
            return replace(found, values=found.select(names), variables=tuple(map(Variable, names)))
    return None


def _joint_signals(
    motion: Trajectory, positions: Trajectory, log: TorqueLog, step: float, label: str
) -> list[JointSignals]:
    """Of each joint of a run."""
    from scipy.interpolate import CubicSpline  # few cases need it

    ticks, start = motion.time, float(motion.time[0])
    inside = (ticks >= positions.time[0] - ON_TICK * step) & (ticks <= positions.time[-1] + ON_TICK * step)
    first = int(np.flatnonzero(inside)[0])
    time = ticks[inside]
    spline = CubicSpline(positions.time, positions.values)
    rows = np.floor((log.times - start) / step + ON_TICK).astype(np.int64) - first
    kept = (rows >= EDGE) & (rows < time.size - EDGE)
    rows, torque = rows[kept], log.torque[kept]
    if rows.size < FEWEST or np.ptp(np.diff(rows)) > 0:
        raise InputError(
            "The law is named from torque at even instants along the positions.", where=label,
            got=f"{rows.size} samples" + (", at uneven instants" if rows.size >= FEWEST else ""),
            valid=f"{FEWEST} or more, evenly spaced",
            next_step="Give a longer log, or one without gaps (from_s, to_s).",
        )  # fmt: skip
    count = _smooth_number(rows.size)
    table = [motion.select([f"{d}q{j + 1}" for j in range(log.torque.shape[1])])[inside] for d in ("", "d", "dd")]
    q, dq = spline(time), spline(time, 1)
    return [
        JointSignals(
            table[0][:, j], table[1][:, j], table[2][:, j], q[:, j], dq[:, j], step, rows[:count], torque[:count, j]
        )
        for j in range(log.torque.shape[1])
    ]


def _smooth_number(count: int) -> int:
    """The largest number up to this one with no factor but 2, 3 and 5, of which Fourier transforms are fast."""
    for number in range(count, 0, -1):
        left = number
        for factor in (2, 3, 5):
            while left % factor == 0:
                left //= factor
        if left == 1:
            return number
    return count
