"""What an estimator is. A new one is one file with one final class, and a row in ``ESTIMATORS``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from fmu_didim.errors import InputError
from fmu_didim.identification.estimate import Estimate
from fmu_didim.prediction.iteration import Iteration
from fmu_didim.prediction.problem import Problem
from fmu_didim.signals import Trajectory

Progress = Callable[[Iteration], None]


def no_progress(iteration: Iteration) -> None:
    """Tell nobody."""


class Estimator(ABC):
    """From a problem to an estimate.

    Attributes:
        name: the name in a case file.
        needs_positions: whether measured positions are required.
    """

    name: str
    needs_positions: bool = False

    @abstractmethod
    def estimate(self, problem: Problem, *, progress: Progress = no_progress) -> Estimate:
        """Estimate the base parameters; ``progress`` is told of each iteration.

        Raises:
            RefusedError: no physical answer was found; InputError: data are missing.
        """

    def positions(self, problem: Problem) -> Trajectory:
        """The measured positions; raises InputError if there are none."""
        found = problem.experiment.positions
        if found is None:
            raise InputError(
                f"The estimator {self.name} needs measured positions.", where="train",
                next_step="Add positions: {file: ...}, or use didim, which needs none.",
            )  # fmt: skip
        return found

    def describe(self) -> dict[str, Any]:
        """Name and options, for the provenance."""
        return {"name": self.name, **{k: v for k, v in vars(self).items() if not k.startswith("_")}}
