"""DIDIM: direct and inverse dynamic identification models (Gautier, Janot, Vandanjon).

Each iteration simulates the closed loop with the direct model at chi_k, samples torque and regressor as
the log did, and solves one linear least squares problem (eqs. 18 to 20 of the paper):

    chi_{k+1} = argmin | Y - W_s(chi_k) chi |

The regressor of the simulated motion stands for the derivative of the simulated torque. The efficient
finish (:mod:`fmu_didim.estimators.finish`) then replaces it by the true sensitivity, and frees what is no base
parameter: gains of the controller, the delay, the clock of the log.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from fmu_didim.base.distributions import chi2_sf
from fmu_didim.base.documents import Count, Positive
from fmu_didim.base.errors import FixedParameterError, IdentificationError, InputError, SimulationError
from fmu_didim.data.signals import Array
from fmu_didim.estimators.base import Estimator, Progress, no_progress
from fmu_didim.estimators.descent import Descent
from fmu_didim.estimators.finish import Minimum, finish_by_colour, integration_error, torque_estimate
from fmu_didim.estimators.initial_states import free_starts, start_advice, with_likely_starts, with_starts
from fmu_didim.estimators.joint import joint_minimum
from fmu_didim.estimators.local_minima import lowest, nearer_to_prior
from fmu_didim.estimators.starts.start import (
    Start,
    simulatable,
    start_sequence,
    start_text,
    start_values,
    with_free_delay,
)
from fmu_didim.fit.estimate import Estimate, RefusedError, Stage, Status
from fmu_didim.fit.fit import Fit, point
from fmu_didim.fit.fit_uncertainty import fit_uncertainty
from fmu_didim.fit.iteration import History, Iteration
from fmu_didim.fit.linear_problem import LinearProblem
from fmu_didim.fit.noise.weighting import NoiseOfResidual, weighted_solution, whitened
from fmu_didim.fit.region import Region
from fmu_didim.fit.solver.accuracy import with_fitting_substeps
from fmu_didim.fit.solver.admissible import mass_matrix_problem, physical_problem, tracking_problem
from fmu_didim.fit.statistics import covariance_white, relative_error_percent
from fmu_didim.fit.uncertainty import Uncertainty
from fmu_didim.model.free_parameter import FreeParameter
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.numerical_regressor import RegressorProbe
from fmu_didim.model.prediction import Prediction, predict

RISES = 2
"""[iterations] After this many in a row that do not lower the error, the best one goes on to the finish."""
SAME_MINIMUM = 2
"""[starts] After this many starts that end in physically impossible minima, the others would end there, too."""

Joint = Callable[[Minimum], Minimum]
"""From the minimum of the torque error to that of all outputs."""
BEST = "the best point goes on to the finish"
NO_FINISH = "the finish could not be simulated"
ASTRAY = "neither the iterations nor the finish settled"
IMPOSSIBLE = "the iterations did not settle, and at the minimum that follows the data ask for what no machine has"
REFUTED = 0.001
"""[1] Probability, by chance, of values as far beyond one limit of machines, below which a minimum that the iterations
have not led to gives way to another start; beyond several limits it is larger, which costs time alone."""
ADVICE = (
    "Run fmu-didim check, and check the sign, unit and clock of the torque, "
    "the gains and the rate of the controller, and the delay of the loop."
)
WITHOUT_SIMULATION = (
    "The log has positions: estimator: {kind: idim_ls} takes the measured motion and simulates nothing, and shows how "
    "far from a machine the data alone are."
)


@dataclass(frozen=True)
class Didim(Estimator):
    """The estimator ``didim``.

    Attributes:
        start: ``torque``, ``reference``, ``nominal``, ``description`` or values by name; where it fails, the others in
            this order.
        tolerance: the iterations stop when |eps| and the parameters, in units of torque, both change by
            less than this part.
        maximum_iterations: of the DIDIM stage.
        finish: whether the efficient finish follows.
        finish_tolerance: relative change of the parameters at which it stops; by default when the next step would be
            below a hundredth of a standard deviation.
        estimate_delay: whether the delay of the loop is estimated in the finish.
    """

    name = "didim"
    needs_positions = False
    probes = True

    start: Any = "torque"
    tolerance: Positive = 0.025
    maximum_iterations: Count = 20
    finish: bool = True
    finish_tolerance: Positive | None = None
    estimate_delay: bool = False

    @property
    def fits_channels(self) -> bool:
        """Whether there is a finish, which fits what was measured beside the torque together with it."""
        return self.finish

    @property
    def takes_prior(self) -> bool:
        """With its finish, whose covariance counts it."""
        return self.finish

    def finds_minima(self, model: LoopModel) -> bool:
        """With its finish."""
        return self.finish

    def estimate(self, model: LoopModel, *, progress: Progress = no_progress) -> Estimate:
        model = with_free_delay(model) if self.estimate_delay else model
        parameters = model.parameters
        if parameters.is_probed:
            self._check_linearity(model)
        elif not parameters.has_regressor:
            raise InputError(
                "didim needs a regressor: a robot description, or a plant from which it is probed.",
                where="estimator",
                next_step="Use the estimator clie, which needs none, or give robot: in the case.",
            )
        history = History(progress)
        joint: Joint = partial(
            joint_minimum, experiments=model.experiments, tolerance=self.finish_tolerance, progress=progress
        )
        model = model.torque_alone
        failures: list[str] = []
        lost: list[IdentificationError] = []
        last: _NonPhysicalError | None = None
        unsettled: Estimate | None = None
        settled, looked, starts = 0, False, start_sequence(model, self.start)
        for start, further in zip(starts, (*starts[1:], None), strict=True):
            then = "" if further is None else f"; restarted from {start_text(further)}"
            try:
                estimate = self._from(model, start, then, joint, history)
            except _NonPhysicalError as caught:
                if not looked and isinstance(start, str):  # values of one's own may be impossible by themselves
                    model, looked = with_likely_starts(model), True
                last = caught if caught.settled or last is None or not last.settled else last
                failures.append(f"from {start_text(start)}: {caught.reason}")
                settled += caught.settled
                if settled == SAME_MINIMUM:
                    break
                history.restart()
                continue
            except IdentificationError as caught:  # rank that is lost at one start is no property of the data
                lost.append(caught)
                failures.append(f"from {start_text(start)}: {caught.what} ({caught.got})")
                history.restart()
                continue
            told = (f"Started from {start_text(start)}; not {'; not '.join(failures)}.",) if failures else ()
            estimate = replace(estimate, remarks=(*told, *estimate.remarks))
            if unsettled is None and further is not None and (reason := _astray(estimate)):
                unsettled = estimate
                failures.append(f"from {start_text(start)}: {reason}")
                history.restart()
                continue
            return estimate if unsettled is None or _error(estimate) < _error(unsettled) else unsettled
        if unsettled is not None:
            return unsettled
        if len(lost) == len(failures):
            raise lost[0]
        raise RefusedError(
            "The identified model is not physical.", iterations=history.iterations, got="; ".join(failures),
            next_step=start_advice(model) + _advice(model),
            values=last.theta if last else None, deviation=last.deviation if last else None,
        )  # fmt: skip

    def _check_linearity(self, model: LoopModel) -> None:
        run = model.simulation(start_values(model, self.start))
        probe = RegressorProbe(model.loop.plant_name, model.parameters, run.theta, run.operator.ticks.size)
        try:
            run.record(observe=probe.check_linearity())
        except FixedParameterError as error:
            raise InputError(
                "didim changes the parameters of a plant while it runs, and those of this one are fixed then.",
                where="identify", got=error.got,
                next_step="Use the estimator clie, give robot: in the case, or export the plant with tunable ones.",
            ) from error  # fmt: skip
        except SimulationError:
            pass  # the guard of the first iteration says more
        probe.raise_if_nonlinear()

    def _from(self, model: LoopModel, start: Start, then: str, joint: Joint, history: History) -> Estimate:
        """The estimate from a start; ``then`` says what follows if it gives no estimate."""
        try:
            found, theta, settled = self._iterate(model, start, then, history)
            fit = _point(found, theta)
            starts = free_starts(fit)
            if (starts or not settled) and (likely := with_likely_starts(found)) is not found:
                # The transient of a start off the reference has bent what came so far, or has kept it from settling
                # where a loop hardly holds, whose sensitivities tell nothing of the start.
                with suppress(IdentificationError, _NonPhysicalError):
                    return self._from_likely(likely, then, joint, history)
            return self._conclude(fit, starts, joint, settled, history)
        except _NonPhysicalError as caught:
            note = f"{caught.reason}{then}"
            history.add(Iteration(self.name, history.count + 1, caught.theta, caught.error, note=note))
            raise

    def _from_likely(self, model: LoopModel, then: str, joint: Joint, history: History) -> Estimate:
        """The estimate with the starts that are likely."""
        found, theta, settled = self._iterate(model, "reference", then, history)
        fit = _point(found, theta)
        return self._conclude(fit, free_starts(fit), joint, settled, history)

    def _iterate(self, model: LoopModel, start: Start, then: str, history: History) -> tuple[LoopModel, Array, bool]:
        """The DIDIM iterations: the model with the steps that were chosen for them, the last solution, or the best one
        where they do not settle, and whether they did; raises _NonPhysicalError where nothing can be simulated."""
        try:
            theta = model.free_parameters.limited(start_values(model, start))
        except SimulationError as failed:
            raise _NonPhysicalError(model.start, f"{failed.what} {failed.got or ''}".strip()) from failed
        theta, impossible = simulatable(model, theta)
        if impossible and _try(model, theta)[1]:
            raise _NonPhysicalError(theta, f"{impossible}, and from the nearest possible values the loop fails")
        model = with_fitting_substeps(model, theta)
        descent, region = Descent(is_last=not then), Region.of(model).of_base(model.linear_count)
        while descent.count < self.maximum_iterations:
            number = history.count + 1
            prediction, failure = _try(model, theta)
            error = np.nan if prediction is None else relative_error_percent(model.measured, prediction.torque)[0]
            step = descent.judged(theta, float(error), failure)
            if step == "failed":
                raise _NonPhysicalError(theta, descent.failure, error=float(error))
            if step in ("halved", "over"):
                note = f"{descent.failure}; {'step halved' if step == 'halved' else BEST}"
                history.add(Iteration(self.name, number, theta, error, note=note))
                if step == "over":
                    break
                theta = 0.5 * (theta + descent.best[0])
                continue
            assert prediction is not None
            following, change, condition = self._solve(model, theta, prediction, region)
            is_over = self.finish and descent.rises >= RISES
            note = f"the error falls no more; {BEST}" if is_over else ""
            if impossible:
                note, impossible = f"the nearest values that can be simulated: {impossible}", ""
            history.add(Iteration(self.name, number, theta, float(error), change, condition, note))
            if descent.steady(float(error), self.tolerance) and change <= self.tolerance:
                return model, following, True
            if is_over:
                break
            theta = following
        return model, descent.best[0], False

    def _solve(
        self, model: LoopModel, theta: Array, prediction: Prediction, region: Region
    ) -> tuple[Array, float, float]:
        """Next values, relative change of the explained torque, condition number.

        Other parameters than base parameters stay as they are.
        """
        regressor, known = _inverse(prediction)
        count = model.linear_count
        solution, deviation = weighted_solution(model, regressor, model.measured - known)
        scaled, right = whitened(regressor, deviation), whitened(model.measured - known, deviation)
        prior = None if model.prior is None else (model.prior.padded(count), model.prior.target)
        equations = LinearProblem.of(scaled[:, None, :], right[:, None], prior=prior)
        found = equations.step(np.zeros(count), region, 0.0)[0]
        following = np.concatenate([found, theta[count:]])
        moved = np.linalg.norm(scaled @ (following - theta)[:count])
        size = np.linalg.norm(scaled @ found)
        return following, float(moved / size), solution.condition_number

    def _conclude(
        self, fit: Fit, starts: Sequence[FreeParameter], joint: Joint, settled: bool, history: History
    ) -> Estimate:
        """Statistics, efficient finish, physical check."""
        assert fit.prediction is not None
        known = fit_uncertainty(fit, _inverse(fit.prediction)[0])
        stages = {self.name: self._stage(fit, known)}
        if self.finish or fit.values.size > fit.model.linear_count:
            finish = partial(finish_by_colour, tolerance=self.finish_tolerance, progress=history.progress)
            try:
                minimum = with_starts(
                    fit, starts, lambda at: joint(lowest(nearer_to_prior(finish(at), finish), finish))
                )  # fmt: skip
            except SimulationError as failed:
                reason = f"{NO_FINISH}: {failed.what} {failed.got or ''}".strip()
                raise _NonPhysicalError(fit.values, reason, deviation=known.deviation) from failed
            history.iterations.extend(minimum.iterations)
            fit, settled = minimum.fit, minimum.fit.settled  # at a minimum, however it was reached
            known = minimum.known
            stages["finish"] = Stage(fit.values, known.deviation)
        else:
            minimum = Minimum(fit, integration_error(fit), known)
        model = fit.model
        reason = physical_problem(model, fit.values, known.deviation) or tracking_problem(model.measured, fit.torque)
        if reason:
            raise _NonPhysicalError(fit.values, reason, settled=settled, deviation=known.deviation)
        return torque_estimate(
            minimum, estimator=self.name, settled=settled, iterations=history.iterations, stages=stages
        )

    def _stage(self, fit: Fit, known: Uncertainty) -> Stage:
        """DIDIM's own answer with its standard deviation; beside it, for white noise, the paper's and the bound."""
        assert fit.prediction is not None
        count = fit.model.linear_count
        tables = (_inverse(fit.prediction)[0], fit.jacobian[:, :, :count])
        w, s = (fit.model.beside_prior(whitened(table, fit.deviation)) for table in tables)
        formulas = {"paper": covariance_white(w), "cramer_rao": covariance_white(s)}
        deviations = {name: np.sqrt(np.diag(covariance)) for name, covariance in formulas.items()}
        return Stage(fit.values[:count], known.deviation, deviations)


@dataclass(eq=False)
class _NonPhysicalError(Exception):
    """An answer that must not be returned; ``settled`` if it is a minimum. Internal to this module."""

    theta: Array
    reason: str
    settled: bool = False
    error: float = np.nan
    deviation: Array | None = None


def _astray(estimate: Estimate) -> str:
    """Why another start may do better than one from which the iterations have not settled; empty where none may."""
    stages = [iteration for iteration in estimate.iterations if iteration.stage == Didim.name]
    if BEST not in stages[-1].note:
        return ""
    if estimate.status is not Status.CONVERGED:
        return ASTRAY
    if estimate.unlimited is None:
        return ""
    moved = estimate.value - estimate.unlimited
    distance = float(moved @ np.linalg.lstsq(estimate.covariance, moved, rcond=None)[0])
    return IMPOSSIBLE if chi2_sf(distance, 1) < REFUTED else ""


def _error(estimate: Estimate) -> float:
    """Torque error, %."""
    return float(relative_error_percent(estimate.measured, estimate.simulated)[0])


def _try(model: LoopModel, theta: Array) -> tuple[Prediction | None, str]:
    """The prediction at theta, or why it failed."""
    reason = mass_matrix_problem(model, theta)
    if reason:
        return None, reason
    try:
        return predict(model, theta), ""
    except SimulationError as error:
        return None, f"{error.what} {error.got or ''}".strip()


def _point(model: LoopModel, theta: Array) -> Fit:
    """The closed loop at the end of the iterations; raises _NonPhysicalError where it cannot be simulated."""
    prediction, failure = _try(model, theta)
    if prediction is None:
        raise _NonPhysicalError(theta, failure)
    return point(model.with_values(theta), NoiseOfResidual(model), prediction)


def _inverse(prediction: Prediction) -> tuple[Array, Array]:
    """Regressor and known torque; that there is an inverse model was checked before the first iteration."""
    assert prediction.regressor is not None
    assert prediction.known is not None
    return prediction.regressor, prediction.known


def _advice(model: LoopModel) -> str:
    """What to do where no answer is physical: where the logs show the motion, too, it need not be simulated."""
    seen = all(model.experiments[label].positions is not None for label in model.estimation_labels)
    return f"{ADVICE} {WITHOUT_SIMULATION}" if seen else ADVICE
