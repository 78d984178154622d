"""The result of an estimator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from fmu_didim.base.errors import FmuDidimError, IdentificationError
from fmu_didim.data.signals import Array
from fmu_didim.fit.exploration.all_samples import AllSamples
from fmu_didim.fit.exploration.choices import Choices
from fmu_didim.fit.exploration.essential import Essential
from fmu_didim.fit.exploration.minima import SearchOutcome
from fmu_didim.fit.exploration.profile import Profile
from fmu_didim.fit.fit import Fit
from fmu_didim.fit.iteration import Iteration
from fmu_didim.fit.prior_fit import PriorFit
from fmu_didim.fit.solver.numerical_noise import Roughness
from fmu_didim.fit.statistics import bounded_interval, confidence_interval, correlation, relative_deviation_percent
from fmu_didim.fit.uncertainty import Colour
from fmu_didim.model.integration import Integration
from fmu_didim.model.loop_model import LoopModel


class Status(Enum):
    """How an estimation ended; the value is advice to the user."""

    CONVERGED = "Converged."
    MAXIMUM_ITERATIONS = (
        "The iterations did not settle: the values are those of the last one. Increase maximum_iterations, "
        "start from the reference trajectory, or check the model of the controller and the delay of the loop."
    )
    REFUSED = "No values are given: see the reason."


@dataclass(frozen=True)
class Stage:
    """Values and standard deviations at the end of a stage, (b,) each.

    ``formulas`` holds standard deviations by other formulas, for comparison.
    """

    value: Array
    standard_deviation: Array
    formulas: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class ChannelNoise:
    """What a channel that was fitted beside the torque leaves.

    Attributes:
        name, unit: of the channel; samples: how many.
        deviation: of its noise, as it was stated or as the residual shows; is_stated: whether it was stated.
        rms: root mean square of the residual; lag_one: correlation of its neighbouring samples.
        inflation: of standard deviations that come from the channel, over those of white noise.
    """

    name: str
    unit: str
    samples: int
    deviation: float
    is_stated: bool
    rms: float
    lag_one: float
    inflation: float


@dataclass(frozen=True)
class JointFit:
    """The torque and further channels fitted together, beside the torque alone, where that says anything.

    Attributes:
        channels: what was fitted beside the torque.
        alone: (p,) values that the torque alone gives, with standard deviations ``alone_deviation`` (p,); None in an
            open loop, where the torque is given.
        apart: (p,) joint minus these values, in standard deviations of that difference.
        p_value: probability of differences as large by noise alone, by chi-square over all parameters.
    """

    channels: tuple[ChannelNoise, ...]
    alone: Array | None
    alone_deviation: Array
    apart: Array
    p_value: float


@dataclass(frozen=True)
class Estimate:
    """Identified parameters and all that is needed to judge them.

    Attributes:
        estimator: its name.
        model: the loop with the identified values, integrated by the rule; what an estimator has freed, such as
            ``delay``, comes last.
        covariance: (p, p) of the values.
        freedom: degrees of freedom of the residual.
        time: (N,); measured, simulated: (N, n) torque at the samples of all fitted experiments (filtered if asked for).
        noise: (n,) standard deviation of the torque residual of each joint.
        condition_number: of the scaled regressor.
        status: how it ended; iterations: its history; stages: intermediate results by name.
        integration_error: relative difference of the torque when the plant's substeps are doubled; integration_shift:
            (p,) by how many standard deviations the values would move then; NaN where it cannot be tried.
        integration: method and substeps of the plant, where they are known.
        colours: the noise that the residual shows, by rate and joint; known_noise: (n,) standard deviation of the
            torque log that the case states, or periods that repeat show; None where it is not known.
        noise_is_stated: whether it is the case that states it.
        fit: the point of the closed loop that it is, with the torque alone; None where the residual is not that of a
            simulated torque.
        roughness: of the sensitivities of a foreign plant; None where they are exact.
        accuracy: (m,) root mean square of the error of each simulated output of a model.
        rivals: parameter and its value at other minima that fit the data almost as well.
        joint: beside the torque alone, where further channels were fitted with it; None otherwise.
        prior: what of the values comes from a prior; None without one.
        unlimited: (p,) values that the data alone ask for, where no machine has them; None where one does.
        minimum: the same with all outputs.
        choices: what other choices of a virtual controller do to the values, which the covariance contains; None where
            the controller is that of the machine.
        profiles: of the parameters for which they were asked.
        essential: the reduced model, where it was asked for.
        search: what a search for other minima has found; None where there was one start.
        all_samples: what those of long logs say of which a part was judged: ``fit`` and ``minimum`` are then of that
            part, all else of all samples; None where they are of all.
        remarks: what the user should know; advice: what to do, if more is known than the status.
        provenance: versions, options, hashes, loop.
    """

    estimator: str
    model: LoopModel
    covariance: Array
    freedom: float
    time: Array
    measured: Array
    simulated: Array
    noise: Array
    condition_number: float
    status: Status
    iterations: tuple[Iteration, ...]
    stages: Mapping[str, Stage]
    integration_error: float = float("nan")
    integration_shift: Array = field(default_factory=lambda: np.full(1, np.nan))
    integration: Integration | None = None
    colours: tuple[Colour, ...] = ()
    known_noise: Array | None = None
    noise_is_stated: bool = True
    fit: Fit | None = None
    roughness: Roughness | None = None
    accuracy: Array = field(default_factory=lambda: np.zeros(1))
    rivals: tuple[tuple[str, float], ...] = ()
    joint: JointFit | None = None
    prior: PriorFit | None = None
    unlimited: Array | None = None
    minimum: Fit | None = None
    choices: Choices | None = None
    profiles: tuple[Profile, ...] = ()
    essential: Essential | None = None
    search: SearchOutcome | None = None
    all_samples: AllSamples | None = None
    remarks: tuple[str, ...] = ()
    advice: str = ""
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def fitted_model(self) -> LoopModel:
        """The model integrated as it was fitted: twice the substeps move the values by ``integration_shift`` alone."""
        if self.fit is None or self.fit.model.loop.substeps is None:
            return self.model
        loop = self.fit.model.loop
        return self.model.with_loop(substeps=loop.substeps, substep_factor=loop.substep_factor)

    @property
    def validated_model(self) -> LoopModel:
        """The model integrated twice as finely as it was fitted: a held-out motion may ask for more than the fitted
        ones, and the rule, which looks at no data, for many times more than either."""
        fitted = self.fitted_model
        return self.model if fitted.loop.substeps is None else fitted.twice_as_fine() or self.model

    @property
    def names(self) -> tuple[str, ...]:
        """(p,) of the parameters."""
        return self.model.names

    @property
    def units(self) -> tuple[str, ...]:
        """(p,) FMI unit strings."""
        return self.model.free_parameters.units

    @property
    def value(self) -> Array:
        """(p,) identified values."""
        return self.model.start

    @property
    def standard_deviation(self) -> Array:
        """(p,) of the values."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def residual(self) -> Array:
        """(N, n) measured minus simulated torque."""
        return self.measured - self.simulated

    @property
    def base_value(self) -> Array:
        """(b,) base parameters that all experiments share, without those of the loop."""
        return self.value[: self.model.parameters.count]

    @property
    def relative_deviation_percent(self) -> Array:
        """100 sigma / |value|, (p,)."""
        return relative_deviation_percent(self.value, self.standard_deviation)

    def interval(self, level: float = 0.95) -> Array:
        """(p, 2) confidence intervals; of friction that is held at zero from there on."""
        found = confidence_interval(self.value, self.standard_deviation, self.freedom, level)
        for i in self.held_at_zero:
            assert self.unlimited is not None
            high = bounded_interval(self.unlimited[i], self.standard_deviation[i], self.freedom, 0.0, level)
            found[i] = 0.0, high
        return found

    @property
    def held_at_zero(self) -> tuple[int, ...]:
        """Places of the parameters that are zero because the data alone have them below."""
        if self.unlimited is None:
            return ()
        return tuple(int(i) for i in np.flatnonzero((self.value == 0) & (self.unlimited < 0)))

    def correlations(self, threshold: float = 0.9) -> list[tuple[str, str, float]]:
        """Pairs of parameters whose correlation exceeds the threshold, largest first."""
        matrix = correlation(self.covariance)
        rows, columns = np.triu_indices(len(self.names), k=1)
        pairs = [
            (self.names[i], self.names[j], float(matrix[i, j]))
            for i, j in zip(rows, columns, strict=True)
            if abs(matrix[i, j]) > threshold
        ]
        return sorted(pairs, key=lambda pair: -abs(pair[2]))

    @property
    def iteration_count(self) -> int:
        """Iterations of the main stage (the efficient finish is counted apart)."""
        return sum(1 for it in self.iterations if it.stage != "finish")


class RefusedError(IdentificationError):
    """No answer can be given.

    Attributes:
        iterations: made so far; values: (p,) where they led, without regard to what is physical, None where to nothing;
            deviation: (p,) their standard deviations, where they are a minimum.
    """

    def __init__(
        self,
        what: str,
        *,
        iterations: Sequence[Iteration],
        next_step: str,
        got: object = None,
        values: Array | None = None,
        deviation: Array | None = None,
        where: str = "",
    ) -> None:
        self.iterations = tuple(iterations)
        self.values, self.deviation = values, deviation
        super().__init__(what, where=where, got=got, next_step=next_step)

    def because_of(self, failure: FmuDidimError | None) -> RefusedError:
        """This refusal, headed by the first failure of a component in its runs, where it led to no minimum."""
        if failure is None or self.deviation is not None or failure.what == self.what:
            return self
        told = (failure.got, f"so that there is no answer: {self.what}", self.got)
        look, values = failure.next_step, f"If the values that it was given are to blame: {self.next_step}"
        return RefusedError(
            failure.what, iterations=self.iterations, got="; ".join(str(part) for part in told if part),
            next_step=f"{look} {values}", values=self.values, where=failure.where,
        )  # fmt: skip
