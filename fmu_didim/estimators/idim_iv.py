"""IDIM-IV: the inverse dynamic model on measured motion, with simulated motion as instruments.

    chi_{k+1} = (Z_k' W)^-1 Z_k' Y,      W of the measured positions, Z_k of the closed loop simulated at chi_k

Least squares on measured motion (:mod:`fmu_didim.estimators.idim_ls`) is biased: W holds the noise of the positions,
twice differentiated, and is correlated with what it leaves. The simulated motion knows the reference, the controller
and chi_k, but no noise. The answer stays right where the controller is not quite the real one, as long as both motions
are alike. Only noise of the positions is made up for, no delay that the case does not state.

Source: Janot, Vandanjon, Gautier, A generic instrumental variable approach for industrial robot identification, IEEE
TCST 22(1), 2014. The strength of instruments: Cragg, Donald, Econometric Theory 9(2), 1993.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmu_didim.base.documents import Count, Positive
from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.estimators.base import Progress, no_progress
from fmu_didim.estimators.idim_ls import IdimLs
from fmu_didim.estimators.starts.start import simulatable
from fmu_didim.fit.estimate import Estimate, RefusedError, Stage, Status
from fmu_didim.fit.iteration import History, Iteration
from fmu_didim.fit.noise.weighting import weighted_solution, whitened
from fmu_didim.fit.statistics import influence_efficient, influence_of_instruments
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.prediction import predict

WEAK = 10.0
"""[1] Least F statistic of the instruments, by the rule of thumb of Staiger and Stock, Econometrica 65(3), 1997: below,
the answer is drawn to that of least squares, and its intervals are too short."""
EXACT = 1e-15
"""[1] Least share of the noise in the measured motion: less is rounding."""
UNLIKE = "Check the controller, its rate, the reference and the clock of the positions; idim_ls takes the last alone."


@dataclass(frozen=True)
class IdimIv(IdimLs):
    """The estimator ``idim_iv``.

    Attributes:
        maximum_iterations: each simulates the closed loop once.
        settled: they end where no value moves by more than this many standard deviations.
    """

    name = "idim_iv"

    maximum_iterations: Count = 10
    settled: Positive = 0.03

    def estimate(self, model: LoopModel, *, progress: Progress = no_progress) -> Estimate:
        rows, history = self.rows(model), History(progress)
        first, deviation = weighted_solution(model, rows.columns, rows.target)
        columns, target = whitened(rows.columns, deviation), whitened(rows.target, deviation)
        found = self.solved(model, rows, first.solution, influence_efficient(columns), deviation)
        stages, status = {IdimLs.name: Stage(found.value, found.known.deviation)}, Status.MAXIMUM_ITERATIONS
        while status is not Status.CONVERGED and history.count < self.maximum_iterations:
            instruments, note = self._instruments(model, found.value, history)
            flat = whitened(instruments, deviation)
            if (strength := cragg_donald(flat, columns)) < WEAK:
                raise RefusedError(
                    "The simulated motion is hardly correlated with the measured one.", iterations=history.iterations,
                    got=f"F statistic of the instruments {strength:.2g}, {WEAK:g} or more is needed", next_step=UNLIKE,
                )  # fmt: skip
            influence = influence_of_instruments(flat, columns)
            last, found = found, self.solved(model, rows, influence.T @ target, influence, deviation)
            change = float(np.linalg.norm(columns @ (found.value - last.value)) / np.linalg.norm(columns @ found.value))
            condition = first.condition_number
            history.add(Iteration(self.name, history.count + 1, found.value, found.error, change, condition, note))
            if np.all(np.abs(found.value - last.value) <= self.settled * found.known.deviation):
                status = Status.CONVERGED
        stages[self.name] = Stage(found.value, found.known.deviation)
        return self.concluded(model, rows, found, history.iterations, stages, status)

    def _instruments(self, model: LoopModel, value: Array, history: History) -> tuple[Array, str]:
        """(M, n, b) rows of the motion simulated at values (b,), or at the nearest that can be, which is then said."""
        near, impossible = simulatable(model, value)
        try:
            prediction = predict(model, near)
        except SimulationError as failed:
            raise RefusedError(
                "The motion that idim_iv takes its instruments from cannot be simulated.",
                iterations=history.iterations, got=f"{failed.what} {failed.got or ''}".strip(), values=value,
                next_step="Check the controller, its rate and the reference: fmu-didim check. idim_ls needs no "
                "simulation.",
            ) from failed  # fmt: skip
        assert prediction.columns is not None  # base parameters alone are free
        logs = zip(model.estimation_labels, prediction.columns, strict=True)
        kept = [self.decimated(table()[0][self.inner(model.experiments[label].time)]) for label, table in logs]
        note = f"simulated at the nearest values that can be: {impossible}" if impossible else ""
        return np.concatenate(kept), note


def cragg_donald(instruments: Array, columns: Array) -> float:
    """F statistic of the weakest direction of instruments (r, p) for columns (r, p): with c the least canonical
    correlation of both, c^2 / (1 - c^2) (r - p) / p."""
    r, p = columns.shape
    between = np.linalg.qr(instruments)[0].T @ np.linalg.qr(columns)[0]
    share = min(float(np.linalg.svd(between, compute_uv=False)[-1]) ** 2, 1.0)
    return float(share / max(1.0 - share, EXACT) * (r - p) / p)
