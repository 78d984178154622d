"""A warm identification of the SCARA from torque at 10 Hz, without the report."""

from __future__ import annotations

from unittest.mock import patch

from fmu_didim.estimators import Estimator
from fmu_didim.identification import problem as problem_module
from fmu_didim.identification.estimate import Estimate
from fmu_didim.identification.problem import Problem
from tests.benchmarks import scara
from tests.benchmarks.figure import Figure, Settings, interleaved


def simulations(problem: Problem, estimator: Estimator) -> tuple[Estimate, int]:
    """An estimate, and how many simulations of the loop it took."""
    with patch.object(problem_module, "simulate", wraps=problem_module.simulate) as counted:
        estimate = estimator.estimate(problem)
    return estimate, counted.call_count


def run(settings: Settings) -> list[Figure]:
    """Ours against its iterations, and against its simulations, each at the cost of the C program."""
    problem, estimator = scara.problem(), scara.case().estimator
    estimate, count = simulations(problem, estimator)
    program = scara.program(problem.parameters.nominal()).runner(problem.experiment.operator.ticks)
    times = interleaved({"ours": lambda: estimator.estimate(problem), "c": program}, repeats=2 * settings.repeats)
    iterations = len(estimate.iterations)
    raw = {
        "ours_ms": 1e3 * times.median("ours"), "c_program_ms": 1e3 * times.median("c"),
        "iterations": float(iterations), "simulations": float(count),
    }  # fmt: skip
    ratio = times.ratio("ours", "c")
    return [
        Figure(
            "SCARA identification, 10 Hz / (iterations x C program)", ratio / iterations, 3, "at most", raw,
            f"{iterations} iterations take {count} simulations: the sensitivity needs one a parameter",
        ),
        Figure("SCARA identification, 10 Hz / (simulations x C program)", ratio / count, None, "at most", raw),
    ]  # fmt: skip
