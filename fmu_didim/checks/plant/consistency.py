"""Whether a plant of its own agrees with the robot description: torque and regressor, point by point.

Where a case gives a robot description and a plant beside it (an FMU of another tool), the regressor comes from the
description and the motion from the plant. Both must obey the same equation at each instant of any motion,

    tau = W(q, dq, ddq) theta + known.

It is tested along the first part of the reference with the values of the description: the torque against the
right-hand side, and each column of W against the one measured on the running plant.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from fmu_didim.base.diagnostics import CATALOGUE, DOUBT, Diagnostic
from fmu_didim.base.documents import Number, Saved
from fmu_didim.base.errors import SimulationError
from fmu_didim.checks.mismatch import unlike_torque
from fmu_didim.checks.plant.idle import CHANGE
from fmu_didim.cosim import Observer
from fmu_didim.data.signals import Array
from fmu_didim.estimators.starts.reference_start import from_reference
from fmu_didim.fit.noise.noise import TINY
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.model.loop_model import LoopModel, Simulation
from fmu_didim.model.numerical_regressor import RegressorProbe
from fmu_didim.model.prediction import drive_torque

POINTS = 20
"""[instants] Compared, spread over the simulation."""
LENGTHS = (2000, 200, 20, 10)
"""[ticks] Of the reference that are simulated; fewer where the loop does not run for so long."""
TORQUE_TOLERANCE = 1e-3
"""[1] Relative difference of the torque from which plant and description are different."""
COLUMN_TOLERANCE = 1e-2
"""[1] The same of a column of the regressor."""
DIFFERENCE_TOLERANCE = 5e-2
"""[1] The same of both where accelerations are differences of velocities."""
QUIET_JOINT = 1e-3
"""[1] Of the torque of all joints: the least size with which the difference of a joint is compared."""
UNEXCITED = 1e-12
"""[SI] A column that is nowhere larger is not excited by the motion."""
SILENT_COLUMN = 1e-6
"""[1] Fraction of a column below which that of the plant is the error of differences."""

PLANT_DIFFERS = CATALOGUE(
    "plant-differs", DOUBT, rank=33,
    meaning="The plant that was simulated does not obey the equations of the robot description, from which the "
    "regressor comes.",
    next_step="Correct the description or the plant; fmu-didim check CASE.yaml compares them.",
)  # fmt: skip


class ColumnResult(Saved):
    """A column of the regressor, of the plant against that of the robot description."""

    difference: float = Field(description="relative")
    cosine: Number = Field(description="of the angle between the two; null if the parameter has no effect")
    size: float = Field(description="norm in the plant over norm by the description")
    joint: int = Field(description="where they differ most")

    def text(self, name: str) -> str:
        """The difference in words."""
        if self.size == 0:
            return f"{name}: it has no effect in the plant"
        return (
            f"{name}: the column differs most at joint {self.joint} (cosine {self.cosine:.3g}, "
            f"{self.size:.3g} times as large in the plant)"
        )


@dataclass(frozen=True)
class Consistency:
    """The result of the comparison.

    Attributes:
        points: instants compared; torque: (n,) RMS difference of each joint, relative to the RMS of all its torque.
        columns: by name of the parameter, as far as the motion excites them.
        method: how the plant's columns were found: ``probed``, or ``simulated again`` where a parameter cannot be
            changed in a run; empty if they were not.
        by_differences: whether accelerations are differences of velocities.
        causes: that would explain a difference of the torque; failure: why nothing was compared, or empty.
    """

    points: int = 0
    torque: tuple[float, ...] = ()
    columns: dict[str, ColumnResult] | None = None
    method: str = ""
    by_differences: bool = False
    causes: tuple[str, ...] = ()
    failure: str = ""

    @property
    def worst(self) -> float:
        """Largest of all relative differences; NaN if nothing was compared."""
        found = [*self.torque, *(c.difference for c in (self.columns or {}).values())]
        return max(found) if found else float("nan")

    def warnings(self) -> list[str]:
        """The differences, a line each; empty if plant and description agree."""
        if self.failure:
            return [f"The plant could not be compared with the robot description: {self.failure}"]
        torque_limit = DIFFERENCE_TOLERANCE if self.by_differences else TORQUE_TOLERANCE
        column_limit = DIFFERENCE_TOLERANCE if self.by_differences else COLUMN_TOLERANCE
        found = [c.text(name) for name, c in (self.columns or {}).items() if c.difference > column_limit]
        unlike = [f"{100 * d:.2g} % at joint {j}" for j, d in enumerate(self.torque, start=1) if d > torque_limit]
        if unlike:
            found.append(f"torque: differs by {', '.join(unlike)}")
        return found + list(self.causes)


def check_consistency(model: LoopModel) -> Consistency:
    """Compare the plant of a model with the robot description that gives its regressor.

    Two simulations of at most 2 000 ticks; one more a parameter if the plant's parameters cannot be changed in a run.
    """
    model = model.on(model.first).with_free(model.free_parameters.shared_base)
    offered = {v.name for v in model.loop.plant.outputs}
    absent = [name for name in model.parameters.observed if name not in offered]
    if absent:
        return Consistency(failure=f"its torque also depends on {', '.join(absent)}, which the plant does not give.")
    runs = _longest_run(model)
    if runs is None:
        return Consistency(failure="neither the values of the description nor those of the reference can be simulated.")
    run, count = runs
    theta = run.theta
    ticks = np.unique(np.linspace(1, count - 2, POINTS).astype(np.int64))
    columns: Array | None = None
    method, by_differences = "", not model.loop.gives_acceleration
    try:
        probe = RegressorProbe(model.loop.plant_name, model.parameters, theta, ticks.size)
        if by_differences:
            points = _points(run, ticks)
        else:
            try:
                points = _points(run, ticks, observe=probe)
                columns, method = probe.columns, "probed"
            except SimulationError:  # parameters that are fixed in a run, or no feed-through
                points = _points(run, ticks)
        acts = points[1].any(axis=(0, 1))  # by the description
        if columns is None or not np.isfinite(columns).all() or (acts & ~columns.any(axis=(0, 1))).any():
            columns, method = _simulated_columns(run, ticks, points), "simulated again"
    except SimulationError as error:
        return Consistency(failure=error.what)
    torque, regressor, known, motion, observed = points
    residual = torque - regressor @ theta - known
    size = np.sqrt((torque**2).mean(axis=0))
    whole = float(np.sqrt((torque**2).mean()))
    # A joint that hardly needs torque is measured by that of all.
    relative = np.sqrt((residual**2).mean(axis=0)) / np.maximum(size, QUIET_JOINT * whole)
    compared = _compared(model.parameters.names, columns, regressor)
    found = Consistency(ticks.size, tuple(float(v) for v in relative), compared, method, by_differences)
    if by_differences or not any("torque:" in line for line in found.warnings()):
        return found
    return replace(found, causes=tuple(unlike_torque(model.parameters, theta, motion, observed, residual)))


Points = tuple[Array, Array, Array, tuple[Array, Array, Array], Array]
"""Torque (K, n), regressor (K, n, p), known torque (K, n), motion, and further signals (K, no) of the regressor."""


def _longest_run(model: LoopModel) -> tuple[Simulation, int] | None:
    """The longest run and its ticks, with the values of the description or, failing those, of the reference."""
    total = model.experiments[model.first].reference.time.size
    for count in sorted({min(total, length) for length in LENGTHS}, reverse=True):
        for choose in (lambda m: m.start, from_reference):
            theta: Array = choose(model)
            if mass_matrix_problem(model, theta):
                continue
            run = model.simulation(theta)
            try:
                run.record(ticks=np.arange(count - 1, count))
            except SimulationError:
                continue
            return run, count
    return None


def _points(run: Simulation, ticks: NDArray[np.int64], observe: Observer | None = None) -> Points:
    model = run.model
    if model.loop.gives_acceleration:
        recording = run.record(ticks=ticks, observe=observe)
        motion = [recording.table(model.loop.joint_signals(name)) for name in ("q", "dq", "ddq")]
        torque, rows = drive_torque(model, recording), np.arange(ticks.size)
    else:
        # While a torque is held, the mean acceleration of the period belongs to its middle.
        both = np.unique(np.concatenate([ticks, ticks + 1]))
        recording = run.record(ticks=both)
        rows = here = np.searchsorted(both, ticks)
        after = np.searchsorted(both, ticks + 1)
        q, dq = (recording.table(model.loop.joint_signals(name)) for name in ("q", "dq"))
        acceleration = (dq[after] - dq[here]) / recording.elapsed(here, after)
        motion = [(q[here] + q[after]) / 2, (dq[here] + dq[after]) / 2, acceleration]
        torque = drive_torque(model, recording)[here]
    names = [f"{model.loop.plant_name}.{name}" for name in model.parameters.observed]
    observed = recording.table(names)[rows] if names else np.zeros((ticks.size, 0))
    regressor, known = model.parameters.regressor(*motion, observed=observed)
    return torque, regressor, known, (motion[0], motion[1], motion[2]), observed


def _simulated_columns(run: Simulation, ticks: NDArray[np.int64], points: Points) -> Array:
    """The plant's columns from a simulation with each parameter changed.

    With r = tau - W theta - known on each simulation, the plant's column is W_i + dr / dtheta_i: exact where plant and
    description agree or the parameter has no effect, and to first order in the change of the motion otherwise.
    """
    torque, regressor, known, *_ = points
    theta = run.values
    before = torque - regressor @ theta - known
    size = np.linalg.norm(torque) / np.maximum(np.linalg.norm(regressor, axis=(0, 1)), TINY)
    columns = np.empty_like(regressor)
    for i in range(theta.size):
        step = CHANGE * (abs(theta[i]) or min(float(size[i]), 1.0))
        other = run.moved(i, theta[i] + step)
        moved_torque, moved, moved_known, *_ = _points(other, ticks)
        after = moved_torque - moved @ other.values - moved_known
        columns[:, :, i] = regressor[:, :, i] + (after - before) / step
    return columns


def _compared(names: tuple[str, ...], plant: Array, analytic: Array) -> dict[str, ColumnResult]:
    scale = np.abs(analytic).max(axis=(0, 1))
    found = {}
    for i, name in enumerate(names):
        if scale[i] <= UNEXCITED:
            continue
        ours, theirs = analytic[:, :, i], plant[:, :, i]
        norm, other = float(np.linalg.norm(ours)), float(np.linalg.norm(theirs))
        cosine = float((ours * theirs).sum() / (norm * other)) if other else float("nan")
        joint = int(np.argmax(np.linalg.norm(theirs - ours, axis=0))) + 1
        size = 0.0 if other <= SILENT_COLUMN * norm else other / norm
        difference = float(np.linalg.norm(theirs - ours)) / norm
        found[name] = ColumnResult(difference=difference, cosine=cosine, size=size, joint=joint)
    return found


def plant_diagnostics(consistency: Consistency | None) -> list[Diagnostic]:
    """The differences between a plant of its own and the robot description."""
    warnings = [] if consistency is None else consistency.warnings()
    return [Diagnostic(PLANT_DIFFERS, text, "plant") for text in warnings]
