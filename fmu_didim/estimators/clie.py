"""CLIE: closed-loop input error.

    theta = argmin | W^(1/2) (y - tau_s(theta)) |^2

by Gauss-Newton with the true sensitivity of the simulated torque. It needs no inverse model, so the parameters may
enter the loop, an FMU say, in any way. Source: Gautier, Janot, Vandanjon, IEEE TCST 21(2), 2013, where it is compared
with DIDIM.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, repeat
from typing import Any

import numpy as np

from fmu_didim.base.documents import Count, Positive
from fmu_didim.base.errors import SimulationError
from fmu_didim.estimators.base import Estimator, Progress, no_progress
from fmu_didim.estimators.finish import Minimum, finish_by_colour, torque_estimate
from fmu_didim.estimators.initial_states import free_starts, start_advice, with_starts
from fmu_didim.estimators.joint import joint_minimum, motion_minimum
from fmu_didim.estimators.local_minima import nearer_to_prior
from fmu_didim.estimators.reweighted import with_error_models
from fmu_didim.estimators.starts.start import simulatable, start_values, with_free_delay
from fmu_didim.fit.estimate import Estimate, RefusedError, Stage
from fmu_didim.fit.fit import point
from fmu_didim.fit.iteration import Iteration
from fmu_didim.fit.noise.weighting import NoiseOfResidual
from fmu_didim.fit.solver.accuracy import with_fitting_substeps
from fmu_didim.fit.solver.admissible import mass_matrix_problem, physical_problem, tracking_problem
from fmu_didim.fit.solver.minimum_check import unproven
from fmu_didim.fit.solver.numerical_noise import smoother_advice
from fmu_didim.model.loop_model import LoopModel

ADVICE = (
    "Start nearer to the truth (start: {name: value}), check the sign, unit and clock of the torque, the controller, "
    "and the delay of the loop."
)

ADVICE_OF_OUTPUTS = (
    "Start nearer to the truth (identify: {name: {start: ...}}), give limits (minimum, maximum), and check units and "
    "clock of the inputs and of what was measured."
)


OF_OUTPUTS = "output_error"
"""What the same least squares are called where the outputs of a model without controller are fitted."""


ROUGH = (
    "The slopes are not those of the model, as where an FMU's own solver makes its outputs rough.",
    "Or start nearer to the truth (identify: {name: {start: ...}}).",
)
"""Of a fit of outputs that has settled, maybe not at a minimum; between them stands what makes outputs smoother."""


@dataclass(frozen=True)
class Clie(Estimator):
    """The estimator ``clie``.

    Attributes:
        start: ``description`` (the values of the plant), ``reference`` (robots only) or values by name.
        tolerance: no parameter moves by more than this fraction of its size or of its standard deviation.
        maximum_iterations: Gauss-Newton steps.
        estimate_delay: whether the delay of the loop is estimated too.
    """

    name = "clie"
    needs_positions = False

    start: Any = "description"
    tolerance: Positive = 1e-6
    maximum_iterations: Count = 40
    estimate_delay: bool = False

    @property
    def fits_channels(self) -> bool:
        """It fits what was measured beside the torque together with it."""
        return True

    @property
    def takes_prior(self) -> bool:
        """It does."""
        return True

    def finds_minima(self, model: LoopModel) -> bool:
        """It does."""
        return True

    def estimate(self, model: LoopModel, *, progress: Progress = no_progress) -> Estimate:
        model = with_free_delay(model) if self.estimate_delay else model
        further = replace(self, start="description", estimate_delay=False)
        ways = chain([self], repeat(further))
        return with_error_models(model, lambda at: next(ways)._fitted(at, progress), self._concluded)

    def _fitted(self, model: LoopModel, progress: Progress) -> Minimum:
        """The minimum with the scales of error models held; raises RefusedError where it is not that of a machine."""
        values, _ = simulatable(model, model.free_parameters.limited(start_values(model, self.start)))
        reason = mass_matrix_problem(model, values)
        if reason:
            raise RefusedError("The start cannot be simulated.", iterations=[], got=reason, next_step=_advice(model))
        model = with_fitting_substeps(model, values)
        if model.experiments.channels and (model.loop.torque_is_given or not model.loop.shows_torque):
            return self._of_motion(model.with_values(values), progress)
        try:
            alone = model.torque_alone
            start = point(alone.with_values(values), NoiseOfResidual(alone))
        except SimulationError as error:
            raise RefusedError(
                "The start cannot be simulated.", iterations=[Iteration(self.name, 1, values, np.nan, note=error.what)],
                got=str(error), next_step=_advice(model),
            ) from error  # fmt: skip
        finish = partial(
            finish_by_colour, tolerance=self.tolerance, progress=progress, stage=self._stage(model),
            maximum_iterations=self.maximum_iterations,
        )  # fmt: skip
        joint = partial(joint_minimum, experiments=model.experiments, tolerance=self.tolerance, progress=progress)
        return self._of_machine(
            with_starts(start, free_starts(start), lambda at: joint(nearer_to_prior(finish(at), finish)))
        )

    def _stage(self, model: LoopModel) -> str:
        """What the iterations are called."""
        return self.name if model.loop.shows_torque else OF_OUTPUTS

    def _of_motion(self, model: LoopModel, progress: Progress) -> Minimum:
        """All outputs at once: in an open loop, whose torque is given, and of any model, whose outputs may show the
        values only together."""
        try:
            minimum = motion_minimum(
                model, tolerance=self.tolerance, progress=progress, maximum=self.maximum_iterations,
                stage="joint" if model.loop.shows_torque else OF_OUTPUTS,
            )  # fmt: skip
        except SimulationError as error:
            raise RefusedError(
                "The start cannot be simulated.", iterations=[], got=str(error), next_step=_advice(model)
            ) from error  # fmt: skip
        return self._of_machine(minimum)

    def _of_machine(self, minimum: Minimum) -> Minimum:
        """A minimum; raises RefusedError where it is not that of a machine."""
        fit, known = minimum.fit, minimum.known
        model = fit.model
        if not model.loop.shows_torque:  # what may be, and what at a limit, says the judgement of any model
            return minimum
        reason = physical_problem(model, fit.values, known.deviation)
        reason = reason or tracking_problem(model.measured, fit.torque)
        if reason:
            raise RefusedError(
                "The identified model is not physical.", iterations=minimum.iterations, got=reason,
                next_step=_advice(model), values=fit.values, deviation=known.deviation,
            )  # fmt: skip
        return minimum

    def _concluded(self, minimum: Minimum) -> Estimate:
        """The estimate at a minimum."""
        fit, model = minimum.fit, minimum.fit.model
        if model.loop.shows_torque:
            return self._estimate(minimum, self.name, settled=fit.settled)
        doubt = unproven(fit) if fit.settled else None
        found = self._estimate(minimum, OF_OUTPUTS, settled=fit.settled and doubt is None)
        if doubt is None:
            return found
        what, start = ROUGH
        words = (f"{doubt.text[:1].upper()}{doubt.text[1:]}.", what, smoother_advice(model), start)
        return replace(found, advice=" ".join(part for part in words if part))

    def _estimate(self, minimum: Minimum, name: str, *, settled: bool) -> Estimate:
        return torque_estimate(
            minimum, estimator=name, settled=settled, iterations=minimum.iterations,
            stages={name: Stage(minimum.fit.values, minimum.known.deviation)},
        )  # fmt: skip


def _advice(model: LoopModel) -> str:
    """What to do where there is no answer."""
    return start_advice(model) + (ADVICE if model.loop.shows_torque else ADVICE_OF_OUTPUTS)
