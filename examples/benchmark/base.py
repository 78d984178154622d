"""Where the methods beside ours begin: the base model fitted in the closed loop, its residual and its motion.

They get this from the project: a residual along the reference, without a loop, would hold the tracking error.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import yaml

from fmu_didim.case import load_case
from fmu_didim.data.signals import Array
from fmu_didim.discovery.augmentation.builder import LoopModelBuilder
from fmu_didim.discovery.base_model import prepare
from fmu_didim.discovery.run import FIRST_S
from fmu_didim.dynamics.robot import RobotDescription, RobotModel
from fmu_didim.fit.fit import Fit
from fmu_didim.model.motion import Motion, simulated_motion
from fmu_didim.workflow.discover import described_plant

STRONG = 10.0
"""[1] BIC difference from which something is there, and within which two forms are not told apart: "very strong" of
Kass and Raftery, J. Am. Stat. Assoc. 90 (1995), as in our discovery."""


@dataclass(frozen=True)
class Base:
    """The base model at its fit.

    Attributes:
        fit: to the training log, without its first quarter of a second; builder: of models with further effects.
        robot: the description. motion, held_out: the simulated motion at the samples of both logs.
        held_out_residual: (N, n). period_s: after which the motion of the training log repeats.
    """

    fit: Fit
    builder: LoopModelBuilder
    robot: RobotDescription
    motion: Motion
    held_out: Motion
    held_out_residual: Array
    period_s: float

    @staticmethod
    def of(path: Path) -> Base:
        """The base model of a case file."""
        case = load_case(path)
        model, robot = case.model, described_plant(case)
        assert robot is not None
        for label, experiment in model.experiments.items():
            model = model.with_experiment(label, experiment.after(FIRST_S))
        prepared = prepare(model)
        fit = prepared.fit

        def motion(label: str) -> Motion:
            found = simulated_motion(fit.model.simulation(fit.values, label), RobotModel(robot))
            assert found is not None
            return found.at(np.searchsorted(found.time, fit.model.experiments[label].time - found.step / 2))

        builder = LoopModelBuilder(fit.model, robot, start=prepared.start)
        rest = fit.model.residual(fit.values, "validation")
        period = yaml.safe_load(path.read_text(encoding="utf-8"))["train"]["reference"]["period_s"]
        return Base(fit, builder, robot, motion("estimation"), motion("validation"), rest, float(period))

    @cached_property
    def weight(self) -> Array:
        """(n,) 1 over the RMS residual of each joint."""
        return np.asarray(1 / np.sqrt(np.mean(self.fit.residual**2, axis=0)))

    def stacked(self, columns: Array) -> Array:
        """(N n, m) of (N, n, m), each joint weighted."""
        return (columns * self.weight[None, :, None]).reshape(-1, columns.shape[2])

    @cached_property
    def target(self) -> Array:
        """(N n,) weighted residual."""
        return (self.fit.residual * self.weight).reshape(-1)

    @cached_property
    def basis(self) -> Array:
        """(N n, p) orthonormal, of what the base parameters change."""
        return np.asarray(np.linalg.qr(self.stacked(self.fit.jacobian) * self._unit)[0])

    @cached_property
    def _unit(self) -> Array:
        return 1 / np.linalg.norm(self.stacked(self.fit.jacobian), axis=0)

    def on_joint(self, joint: int, columns: Array) -> Array:
        """(N n, m) of columns (N, m) that act on one joint, from 0."""
        whole = np.zeros((*self.fit.residual.shape, columns.shape[1]))
        whole[:, joint] = columns
        return self.stacked(whole)

    def bic(self, columns: Array) -> float:
        """N ln(RSS / N) + k ln N of base parameters and these columns (N n, m), as if the noise were white."""
        rows = len(self.target)
        return float(rows * np.log(self.left(columns) / rows) + columns.shape[1] * np.log(rows))

    def left(self, columns: Array) -> float:
        """Sum of squares that base parameters and these columns leave."""
        rest = self.target - self.basis @ (self.basis.T @ self.target)
        if columns.shape[1]:
            own = columns - self.basis @ (self.basis.T @ columns)
            size = np.linalg.norm(own, axis=0)
            own = own[:, size > 0] / size[size > 0]
            rest = rest - own @ np.linalg.lstsq(own, rest, rcond=1e-10)[0]
        return float(rest @ rest)

    def parameters(self, columns: Array) -> dict[str, tuple[float, float]]:
        """Value and standard deviation of the base parameters by least squares with these columns, once, as if the
        noise were white."""
        table = np.column_stack([self.stacked(self.fit.jacobian), columns])
        size = np.linalg.norm(table, axis=0)
        table = table / np.where(size > 0, size, 1)
        inverse = np.linalg.pinv(table.T @ table, rcond=1e-12)
        found = inverse @ (table.T @ self.target)
        rest = self.target - table @ found
        std = np.sqrt(np.diag(inverse) * (rest @ rest) / (len(rest) - table.shape[1])) / size
        names = self.fit.model.names
        moved = self.fit.values + (found / size)[: len(names)]
        return {name: (float(v), float(s)) for name, v, s in zip(names, moved, std, strict=False)}


def forward(base: Base, offered: dict[str, list[Array]], most: int = 5) -> list[tuple[str, Array, tuple[str, ...]]]:
    """Forward selection by BIC: name, columns, and the names within ``STRONG`` of it, step by step.

    Args:
        offered: name -> its columns (N n, m), one table for each of its shapes. most: steps, as our discovery's.
    """
    taken: list[tuple[str, Array, tuple[str, ...]]] = []
    columns = np.empty((len(base.target), 0))
    before = base.bic(columns)
    while len(taken) < most:
        q, rest = _left_of(base, columns)
        known = {name for name, _, _ in taken}
        best = {n: _best(q, rest, tables, columns.shape[1]) for n, tables in offered.items() if n not in known}
        if not best:
            break
        name = min(best, key=lambda n: best[n][0])
        bic, table = best[name]
        if bic > before - STRONG:
            break
        near = tuple(n for n, (other, _) in best.items() if n != name and other < bic + STRONG)
        taken.append((name, table, near))
        columns, before = np.column_stack([columns, table]), bic
    return taken


def _left_of(base: Base, columns: Array) -> tuple[Array, Array]:
    """Orthonormal basis of base and columns, and what they leave of the target."""
    own = columns - base.basis @ (base.basis.T @ columns)
    q = base.basis if not own.shape[1] else np.column_stack([base.basis, np.linalg.qr(own)[0]])
    return q, base.target - q @ (q.T @ base.target)


SURVIVES = 1e-3
"""[1] Least part of a column that must be left beside what is there already, so that its BIC is not one of rounding."""


def _best(q: Array, rest: Array, tables: list[Array], count: int) -> tuple[float, Array]:
    """The least BIC of the shapes of a candidate beside ``count`` columns that are taken, and its columns."""
    rows, found = len(rest), (np.inf, tables[0])
    for table in tables:
        own = table - q @ (q.T @ table)
        kept = np.linalg.norm(own, axis=0) > SURVIVES * np.linalg.norm(table, axis=0)
        if not kept.all():
            continue
        basis = np.linalg.qr(own / np.linalg.norm(own, axis=0))[0]
        left = float(rest @ rest - np.sum((basis.T @ rest) ** 2))
        bic = rows * np.log(max(left, 1e-300) / rows) + (count + table.shape[1]) * np.log(rows)
        if bic < found[0]:
            found = (bic, table)
    return found
