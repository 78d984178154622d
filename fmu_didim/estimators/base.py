"""The interface of an estimator. A new one is one file with one frozen dataclass, and a row in ``ESTIMATORS``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from fmu_didim.base.errors import InputError
from fmu_didim.data.signals import Trajectory
from fmu_didim.fit.estimate import Estimate
from fmu_didim.fit.iteration import Iteration
from fmu_didim.model.loop_model import LoopModel

Progress = Callable[[Iteration], None]


def no_progress(iteration: Iteration) -> None:
    """Ignore an iteration."""


class Estimator(ABC):
    """From a loop model to an estimate; a frozen dataclass, whose fields are its options in a case.

    Attributes:
        name: the name in a case file.
        needs_positions: whether measured positions are required.
        probes: whether it has the regressor measured on the running plant where the plant has none.
    """

    name: str
    needs_positions: bool = False
    probes: bool = False

    @property
    def fits_channels(self) -> bool:
        """Whether it fits what was measured beside the torque together with it."""
        return False

    @property
    def fits_outputs(self) -> bool:
        """Whether it fits outputs of any model, which has neither a controller nor a torque."""
        return False

    @property
    def takes_prior(self) -> bool:
        """Whether it counts what is known of the robot before (:mod:`fmu_didim.dynamics.prior`) beside the data."""
        return False

    def finds_minima(self, model: LoopModel) -> bool:
        """Whether its answer is a minimum of the misfit of all outputs of a model: those from several starts may then
        be compared, and the misfit around it profiled."""
        return False

    @abstractmethod
    def estimate(self, model: LoopModel, *, progress: Progress = no_progress) -> Estimate:
        """Estimate the free parameters from the experiments for the estimation; ``progress`` gets each iteration.

        Raises:
            RefusedError: no physical answer was found; InputError: data are missing.
        """

    def positions(self, model: LoopModel, label: str) -> Trajectory:
        """The measured positions of an experiment; raises InputError if there are none."""
        found = model.experiments[label].positions
        if found is None:
            raise InputError(
                f"The estimator {self.name} needs measured positions.", where=label,
                next_step="Add positions: {file: ...}, or use didim, which needs none.",
            )  # fmt: skip
        return found

    def base_alone(self, model: LoopModel) -> None:
        """Refuse free parameters beside the base parameters; for estimators that do not simulate the torque."""
        further = model.names[model.linear_count :]
        if further:
            raise InputError(
                f"The estimator {self.name} identifies base parameters only.", where="identify",
                got=", ".join(further), next_step="Use didim or clie for them.",
            )  # fmt: skip

    def describe(self) -> dict[str, Any]:
        """Name and options, for the provenance."""
        return {"name": self.name, **{k: v for k, v in vars(self).items() if not k.startswith("_")}}
