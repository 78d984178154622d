"""A warm identification of the SCARA from torque at 10 Hz, without the report."""

from __future__ import annotations

from tests.tools.benchmarks import scara
from tests.tools.benchmarks.counting import afresh, simulated
from tests.tools.benchmarks.figure import Figure, Settings, interleaved


def run(settings: Settings) -> list[Figure]:
    """Ours against its iterations, and against its simulations, each at the cost of the C program."""
    model, estimator = scara.model(), scara.case().estimator
    estimate, runs = simulated(model, estimator)
    count = len(runs.plain) + len(runs.varied)
    program = scara.program(model.start).runner(model.simulation(model.start).operator.ticks)
    times = interleaved({"ours": lambda: estimator.estimate(afresh(model)), "c": program}, repeats=2 * settings.repeats)
    iterations = len(estimate.iterations)
    raw = {
        "ours_ms": 1e3 * times.median("ours"), "c_program_ms": 1e3 * times.median("c"),
        "iterations": float(iterations), "simulations": float(len(runs.plain)),
        "with_derivatives": float(len(runs.varied)),
    }  # fmt: skip
    ratio = times.ratio("ours", "c")
    return [
        Figure(
            "SCARA identification, 10 Hz / (iterations x C program)", ratio / iterations, 2.0, "at most", raw,
            f"{iterations} iterations take {len(runs.plain)} simulations, and {len(runs.varied)} with the derivatives",
        ),
        Figure("SCARA identification, 10 Hz / (simulations x C program)", ratio / count, None, "at most", raw),
    ]  # fmt: skip
