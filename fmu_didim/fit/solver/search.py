"""Line search of a step: the least damped trial that lowers the cost."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fmu_didim.base.distributions import chi2_isf
from fmu_didim.base.errors import SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.fit.derivatives.differences import Steps, jitter_in
from fmu_didim.fit.fit import prior_squares, sum_of_squares
from fmu_didim.fit.region import Region
from fmu_didim.fit.solver.admissible import mass_matrix_problem
from fmu_didim.fit.solver.linear_step import LinearStep, State
from fmu_didim.fit.uncertainty import EXCESS
from fmu_didim.model.loop_model import LoopModel

DAMPINGS = (0.0, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0)
"""[1] Tried one after the other, for columns of the Jacobian of length one."""
KEPT_PROMISE = (0.5, 1.5)
"""[1] Gain of a step over what the linear model promised: outside, its slopes are stale."""
DRAWN_BY_JITTER = 5.0
"""[standard deviations] Of the difference of two costs, by which jitter may make a step miss its promise: a cost that
is too low by three of its own and one that is too high by as much are 4.2 apart."""
EQUAL = 1e-9
"""[1] Costs that differ by a smaller fraction are the same: at the minimum, rounding decides whether the cost
grows."""

HALVINGS = 10
"""[1] Of a step of a model without loop that cannot be simulated: to a thousandth. Damping, which comes then, turns the
step; it moves far less than half the way to the edge."""
SHORTEST = 0.1
"""[1] Of a step, from which on a parabola says how far to go: the misfit of a model that explodes at its end, as one
with a resistance below zero does, would leave nothing of it."""
NO_STEP = "no step lowers the error"
"""The note of an iteration after which the steps have ended,"""
BEYOND_EDGE = f"{NO_STEP}: where the data lead, "
"""and its begin where that is because what the whole step led to cannot be simulated."""
FAILED = "the simulation failed at "
"""How the note of an iteration says that a step led to values with which a model cannot be simulated."""


def failed_at(model: LoopModel, values: Array, error: SimulationError) -> str:
    """What an error says of a trial; of a model without loop, at which values, and what its FMU said."""
    if model.loop.shows_torque:
        return error.what
    at = ", ".join(f"{name} = {value:.4g}" for name, value in zip(model.names, values, strict=True))
    said = f" ({error.got})" if error.got else ""
    return f"{FAILED}{at}: {error.what.rstrip('.')}{said}"


@dataclass(frozen=True)
class Trial:
    """Result of a step.

    Attributes:
        values: (p,); outputs: (M, m) there; None where no step lowers the cost.
        cost: there; promised: how much the step should have lowered it; tried: simulations.
        at_edge: whether a less damped step could not be simulated; note: what was done to the step.
    """

    values: Array
    outputs: Array | None
    cost: float
    promised: float
    tried: int
    at_edge: bool
    note: str = ""


@dataclass(frozen=True)
class Search:
    """The search along a step.

    Attributes:
        model: the loop; region: where its values may be.
        settles: whether the fit is to settle, not only to come near a minimum.
        check_all: whether a step must leave all experiments simulable, not only those that are fitted.
        differences: of the sensitivity, which know the jitter of the torque.
    """

    model: LoopModel
    region: Region
    settles: bool
    check_all: bool
    differences: Steps

    def trial(self, at: State, step: LinearStep) -> Trial:
        """The least damped step that lowers the cost; the next more damped one where less damping is not feasible,
        because at the edge of what can be simulated a loop hardly damps itself any more."""
        model, settles = self.model, self.settles
        measured, others = model.measured_outputs, model.experiments.validation_labels if self.check_all else ()
        tried, edge, best, note, beyond = 0, False, None, "", ""
        for damping in DAMPINGS:
            change, promised = step.change, step.promised  # of the undamped one, which may have been a cone program
            if damping > 0:
                change, promised = step.equations.step(at.values, self.region, damping)
            trial = np.clip(at.values + change, self.region.low, self.region.high)
            reason = mass_matrix_problem(model, trial)
            if reason:
                edge, note = True, f"step damped: {reason}"
                continue
            tried += 1
            try:
                outputs = model.outputs(trial)
                reached = sum_of_squares(measured - outputs, step.deviation) + prior_squares(model.prior, trial)
                kept = damping == 0 and self.keeps_promise(at, step, reached)
                if kept or reached < step.cost:
                    for label in others:  # only whether it runs
                        model.torque(trial, label)
            except SimulationError as error:
                edge, note = True, f"step damped: {failed_at(model, trial, error)}"
                beyond = beyond or failed_at(model, trial, error)
                if damping == 0 and not model.loop.shows_torque:
                    halved = self._halved(at, step, trial, promised, note.replace("damped", "shortened"), tried)
                    tried = halved.tried
                    if halved.outputs is not None:
                        return halved
                continue
            if kept:
                return Trial(trial, outputs, reached, promised, tried, edge)
            if damping == 0 and settles:
                found = self._shortened(at, step, Trial(trial, outputs, reached, promised, tried, edge))
                tried = found.tried
                if found.note:
                    return found
                if reached > step.cost * (1 + EQUAL) and not at.fresh and at.updates > 0:
                    break  # damping would not make up for old slopes
            if reached <= step.cost * (1 + (EQUAL if settles else 0.0)) and (reached < step.cost or settles):
                found = Trial(trial, outputs, reached, promised, tried, edge, note)
                if best is not None or not edge:
                    return found
                best = found
            else:
                note = "step damped: the error grew"
        ended = f"{BEYOND_EDGE}{beyond}" if beyond and model.loop.shows_torque else NO_STEP
        return best or Trial(at.values, None, step.cost, 0.0, tried, edge, ended)

    def _halved(self, at: State, step: LinearStep, end: Array, promised: float, note: str, tried: int) -> Trial:
        """The longest of halves, quarters, ... of a step that can be simulated and lowers the cost."""
        part = 1.0
        for _ in range(HALVINGS):
            part /= 2
            trial = at.values + part * (end - at.values)
            tried += 1
            try:
                outputs = self.model.outputs(trial)
            except SimulationError:
                continue
            reached = sum_of_squares(self.model.measured_outputs - outputs, step.deviation)
            reached += prior_squares(self.model.prior, trial)
            if reached < step.cost:
                return Trial(trial, outputs, reached, part * (2 - part) * promised, tried, True, note)
        return Trial(at.values, None, step.cost, 0.0, tried, True)

    def keeps_promise(self, at: State, step: LinearStep, reached: float) -> bool:
        """Whether a full step with fresh slopes has reached the cost that it promised, within the jitter of the torque.

        What it misses must be less than noise moves the minimum by, so that no jitter excuses a step that is wrong.
        """
        if not self.settles or not at.fresh:
            return False
        blur = step.blur(jitter_in(self.differences, step.deviation))
        hidden = min(DRAWN_BY_JITTER * blur, float(chi2_isf(EXCESS, step.change.size)))
        return reached <= step.cost - step.promised + hidden

    def _shortened(self, at: State, step: LinearStep, found: Trial) -> Trial:
        """The least cost along a step that went too far, by the parabola through its slope, its beginning and its end.

        Where the residual is large, its second derivatives matter: then all steps go too far by the same factor.
        """
        gained = step.cost - found.cost
        if gained >= KEPT_PROMISE[0] * found.promised or found.promised <= EQUAL * step.cost:
            return found
        part = found.promised / (2 * found.promised - gained)
        if part < SHORTEST and not self.model.loop.shows_torque:  # beyond where no parabola is near the misfit
            halved = self._halved(at, step, found.values, found.promised, "step shortened", found.tried)
            return found if halved.outputs is None else replace(halved, at_edge=found.at_edge)
        trial = at.values + part * (found.values - at.values)
        if mass_matrix_problem(self.model, trial):
            return found
        tried = found.tried + 1
        try:
            outputs = self.model.outputs(trial)
        except SimulationError:
            return replace(found, tried=tried)
        reached = sum_of_squares(self.model.measured_outputs - outputs, step.deviation)
        reached += prior_squares(self.model.prior, trial)
        if reached >= min(found.cost, step.cost):
            return replace(found, tried=tried)
        return replace(found, values=trial, outputs=outputs, cost=reached, tried=tried, note="step shortened")
