"""DIDIM: direct and inverse dynamic identification models (Gautier, Janot, Vandanjon).

Each iteration simulates the closed loop with the direct model at chi_k, samples torque and regressor as
the log did, and solves one linear least squares problem (eqs. 18 to 20 of the paper):

    chi_{k+1} = argmin | Y - W_s(chi_k) chi |

The regressor of the simulated motion stands for the derivative of the simulated torque. The efficient
finish (:mod:`fmu_didim.identification.conclude`) then replaces it by the true sensitivity, and frees what is no base
parameter: gains of the controller, the delay, the clock of the log.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmu_didim.errors import InputError, SimulationError
from fmu_didim.estimators.base import Estimator, Progress, no_progress
from fmu_didim.identification.conclude import Minimum, efficient_finish, integration_error, torque_estimate
from fmu_didim.identification.estimate import Estimate, RefusedError, Stage
from fmu_didim.identification.start import Start, start_values, with_free_delay
from fmu_didim.prediction.accuracy import with_fitting_substeps
from fmu_didim.prediction.fit import Fit, point
from fmu_didim.prediction.fit_uncertainty import fit_uncertainty
from fmu_didim.prediction.guard import mass_matrix_problem, physical_problem, tracking_problem
from fmu_didim.prediction.iteration import Iteration
from fmu_didim.prediction.loop_model import LoopModel
from fmu_didim.prediction.prediction import Prediction, predict
from fmu_didim.prediction.probing import RegressorProbe
from fmu_didim.prediction.reference_start import from_reference
from fmu_didim.prediction.uncertainty import Uncertainty
from fmu_didim.prediction.weighting import NoiseOfResidual, weighted_solution, whitened
from fmu_didim.signals import Array
from fmu_didim.statistics import covariance_efficient, covariance_paper, relative_error_percent

MAXIMUM_HALVINGS = 6
GROWTH = 1.5
"""A step after which the error is this many times larger is halved."""
ERROR_FLOOR = 1e-3
"""A change of the relative torque error below 0.001 % of the torque counts as none (data without noise)."""
USELESS_ERROR = 50.0
"""A start whose torque error in percent exceeds this, and whose first step does not bring it below, is
given up for the reference trajectory instead of being halved towards."""
ADVICE = (
    "Start from the reference trajectory (start: reference), check the sign, unit and clock of the torque, "
    "the gains and the rate of the controller, and the delay of the loop."
)


@dataclass(frozen=True)
class Didim(Estimator):
    """The estimator ``didim``.

    Attributes:
        start: ``reference``, ``description`` or values by name.
        tolerance: the iterations stop when |eps| and the parameters, in units of torque, both change by
            less than this part.
        maximum_iterations: of the DIDIM stage.
        finish: whether the efficient finish follows.
        finish_tolerance: relative change of the parameters at which it stops.
        estimate_delay: whether the delay of the loop is estimated in the finish.
    """

    name = "didim"
    needs_positions = False

    start: Any = "reference"
    tolerance: float = 0.025
    maximum_iterations: int = 20
    finish: bool = True
    finish_tolerance: float = 1e-6
    estimate_delay: bool = False

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
        history: list[Iteration] = []
        try:
            return self._from(model, self.start, history, progress)
        except _NonPhysicalError as caught:
            if self.start == "reference" or not parameters.has_regressor:
                raise RefusedError(
                    "The identified model is not physical.", iterations=history, got=caught.reason, next_step=ADVICE
                ) from None
            note = f"{caught.reason}; restarted from the reference trajectory"
            self._record(history, progress, Iteration("didim", len(history) + 1, caught.theta, np.nan, note=note))
        try:
            return self._from(model, "reference", history, progress)
        except _NonPhysicalError as caught:
            raise RefusedError(
                "The identified model is not physical, from the given start and from the reference trajectory.",
                iterations=history,
                got=caught.reason,
                next_step=ADVICE,
            ) from None

    def _check_linearity(self, model: LoopModel) -> None:
        values, label = start_values(model, self.start), model.first
        count = model.operator(values, label).ticks.size
        probe = RegressorProbe(model.plant_name, model.parameters, model.theta(values, label), count)
        with suppress(SimulationError):  # the guard of the first iteration says more
            model.record(values, label, observe=probe.check_linearity())
        probe.raise_if_nonlinear()

    def _record(self, history: list[Iteration], progress: Progress, iteration: Iteration) -> None:
        history.append(iteration)
        progress(iteration)

    def _from(self, model: LoopModel, start: Start, history: list[Iteration], progress: Progress) -> Estimate:
        model, theta, settled = self._iterate(model, start, history, progress)
        reason = mass_matrix_problem(model, theta)
        if reason:
            raise _NonPhysicalError(theta, reason)
        try:
            prediction = predict(model, theta)
        except SimulationError as error:
            raise _NonPhysicalError(theta, error.what) from error
        return self._conclude(model, theta, prediction, settled, history, progress)

    def _iterate(
        self, model: LoopModel, start: Start, history: list[Iteration], progress: Progress
    ) -> tuple[LoopModel, Array, bool]:
        """The DIDIM iterations: the model with the steps that were chosen for them, the last solution, and whether the
        stop criteria were met."""
        theta = model.limited(start_values(model, start))
        as_found, has_steps = model, False
        # Without an inverse model there is no regressor of the reference to restart from.
        restarted = start == "reference" or not model.parameters.has_regressor
        good: tuple[Array, float] | None = None
        halvings = 0
        while len(history) < self.maximum_iterations:
            number = len(history) + 1
            if not has_steps and not mass_matrix_problem(as_found, theta):
                model, has_steps = with_fitting_substeps(as_found, theta), True
            prediction, failure = _try(model, theta)
            error = np.nan
            if prediction is not None:
                error = relative_error_percent(model.measured, prediction.torque)[0]
                if good is not None and error > GROWTH * good[1]:
                    failure = f"the error grew to {error:.3g} %"
            is_useless = good is not None and good[1] > USELESS_ERROR and not restarted
            if is_useless and not failure and error > USELESS_ERROR:
                failure = f"the torque error is still {error:.0f} % after a step"
            if failure and good is not None and not is_useless and halvings < MAXIMUM_HALVINGS:
                halvings += 1
                self._record(
                    history, progress, Iteration("didim", number, theta, error, note=f"{failure}; step halved")
                )
                theta = 0.5 * (theta + good[0])
                continue
            if failure:
                if restarted:
                    self._record(history, progress, Iteration("didim", number, theta, error, note=failure))
                    raise _NonPhysicalError(theta, failure)
                restarted, good, halvings, has_steps = True, None, 0, False
                note = f"{failure}; restarted from the reference trajectory"
                self._record(history, progress, Iteration("didim", number, theta, error, note=note))
                theta = from_reference(model)
                continue
            assert prediction is not None
            following, change, condition = self._solve(model, theta, prediction)
            self._record(history, progress, Iteration("didim", number, theta, float(error), change, condition))
            settled = (
                good is not None
                and abs(error - good[1]) <= max(self.tolerance * good[1], ERROR_FLOOR)
                and change <= self.tolerance
            )
            good, theta, halvings = (theta, float(error)), following, 0
            if settled:
                return model, theta, True
        return model, theta, False

    def _solve(self, model: LoopModel, theta: Array, prediction: Prediction) -> tuple[Array, float, float]:
        """Next values, relative change of the torque that they explain, condition number.

        What is no base parameter stays where it is: it is no matter of the regressor.
        """
        regressor, known = _inverse(prediction)
        count = model.linear_count
        solution, deviation = weighted_solution(model, regressor, model.measured - known, model.names[:count])
        following = np.concatenate([solution.solution, theta[count:]])
        scaled = whitened(regressor, deviation)
        moved = np.linalg.norm(scaled @ (following - theta)[:count])
        size = np.linalg.norm(scaled @ solution.solution)
        return following, float(moved / size), solution.condition_number

    def _conclude(
        self,
        model: LoopModel,
        theta: Array,
        prediction: Prediction,
        settled: bool,
        history: list[Iteration],
        progress: Progress,
    ) -> Estimate:
        """Statistics, the efficient finish, the check of what is physical."""
        fit = point(model.with_values(theta), NoiseOfResidual(model), prediction)
        known = fit_uncertainty(fit, _inverse(prediction)[0])
        stages = {"didim": self._stage(fit, known)}
        if self.finish or fit.values.size > model.linear_count:
            minimum = efficient_finish(fit, tolerance=self.finish_tolerance, progress=progress)
            history.extend(minimum.iterations)
            fit, settled = minimum.fit, minimum.fit.settled  # at a minimum, however it was reached
            known = fit_uncertainty(fit)
            stages["finish"] = Stage(fit.values, known.deviation)
        else:
            minimum = Minimum(fit, integration_error(fit))
        reason = physical_problem(model, fit.values, known.deviation) or tracking_problem(model.measured, fit.torque)
        if reason:
            raise _NonPhysicalError(fit.values, reason)
        return torque_estimate(minimum, known, estimator=self.name, settled=settled, iterations=history, stages=stages)

    def _stage(self, fit: Fit, known: Uncertainty) -> Stage:
        """DIDIM's own answer with its standard deviation; beside it, for white noise, the paper's and the bound."""
        assert fit.prediction is not None
        count = fit.model.linear_count
        w = whitened(_inverse(fit.prediction)[0], fit.deviation)
        s = whitened(fit.jacobian[:, :, :count], fit.deviation)
        return Stage(
            fit.values[:count],
            known.deviation,
            {
                "paper": np.sqrt(np.diag(covariance_paper(w))),
                "cramer_rao": np.sqrt(np.diag(covariance_efficient(s))),
            },
        )


class _NonPhysicalError(Exception):
    """Inside this module: an answer that must not be returned."""

    def __init__(self, theta: Array, reason: str) -> None:
        self.theta, self.reason = theta, reason
        super().__init__(reason)


def _try(model: LoopModel, theta: Array) -> tuple[Prediction | None, str]:
    """The prediction at theta, or why there is none."""
    reason = mass_matrix_problem(model, theta)
    if reason:
        return None, reason
    try:
        return predict(model, theta), ""
    except SimulationError as error:
        return None, error.what


def _inverse(prediction: Prediction) -> tuple[Array, Array]:
    """Regressor and known torque; that there is an inverse model was checked before the first iteration."""
    assert prediction.regressor is not None
    assert prediction.known is not None
    return prediction.regressor, prediction.known
