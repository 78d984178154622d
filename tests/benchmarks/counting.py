"""What an identification simulates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

from fmu_didim.prediction.problem import Problem

from fmu_didim.estimators import Estimator
from fmu_didim.identification.estimate import Estimate
from fmu_didim.master import Recording, System
from fmu_didim.prediction import plant_sensitivity as sensitivity_module
from fmu_didim.prediction import problem as problem_module


@dataclass(frozen=True)
class Simulated:
    """The runs of the loop.

    Attributes:
        plain, varied: substeps of the plant in each run without and with derivatives, 0 where they are chosen.
    """

    plain: tuple[int, ...]
    varied: tuple[int, ...]


def simulated(problem: Problem, estimator: Estimator) -> tuple[Estimate, Simulated]:
    """An estimate, and the runs that it took."""
    counts: dict[bool, list[int]] = {False: [], True: []}

    def counted(original: Any, varied: bool) -> Any:
        def simulate(system: System, *arguments: Any, **options: Any) -> Recording:
            counts[varied].append(system.components[problem.plant].stated_substeps or 0)
            return original(system, *arguments, **options)

        return simulate

    with (
        patch.object(problem_module, "simulate", counted(problem_module.simulate, False)),
        patch.object(sensitivity_module, "simulate", counted(sensitivity_module.simulate, True)),
    ):
        estimate = estimator.estimate(problem)
    return estimate, Simulated(tuple(counts[False]), tuple(counts[True]))
