"""The TX40 identified as a whole, against the same work in Python with Pinocchio."""

from __future__ import annotations

import statistics
import time

import numpy as np

from fmu_didim.signals import Trajectory
from tests.benchmarks import tx40
from tests.benchmarks.figure import Figure, Settings
from tests.benchmarks.pinocchio_loop import PinocchioLoop
from tests.benchmarks.scara_identification import simulations
from tests.benchmarks.tx40_simulation import pinocchio, problem

BIRDY_S = 1.0
"""What BIRDy's authors publish for one identification, about 1 s."""


def run(settings: Settings) -> list[Figure]:
    """52 base parameters from torque at 100 Hz with 0.05 N.m of noise; with the efficient finish and without."""
    duration_s = settings.size(10, 1)
    figures = []
    for label, finish in (("with the finish", True), ("DIDIM alone", False)):
        here, estimator = problem(duration_s, finish=finish, start="reference")
        estimate, count = simulations(here, estimator)  # warm, and counted
        rounds = []
        for _ in range(settings.size(1, 1, settings.repeats)):
            begin = time.perf_counter()
            estimator.estimate(here)
            rounds.append(time.perf_counter() - begin)
        ours = statistics.median(rounds)
        reference = tx40.excitation(duration_s=duration_s).trajectory(tx40.RATE_HZ)
        ticks, samples = reference.time.size - 1, here.experiment.time.size
        part = settings.size(2_000, 200)
        loop, solutions = pinocchio(), len(estimate.iterations)
        step, row = _costs(loop, reference, part, min(samples, part))
        theirs = count * ticks * step + solutions * (samples * row + _solution_s(samples))
        raw = {
            "ours_s": ours, "pinocchio_s": theirs, "birdy_published_s": BIRDY_S, "simulations": float(count),
            "iterations": float(solutions), "pinocchio_us_per_tick": 1e6 * step, "pinocchio_us_per_row": 1e6 * row,
        }  # fmt: skip
        figures.append(
            Figure(
                f"Pinocchio in Python / TX40 identification, {label}", theirs / ours, 50 if finish else None,
                "at least", raw, f"{count} simulations of {ticks} ticks; Pinocchio: {part} ticks measured and scaled",
            )
        )  # fmt: skip
    return figures


def _costs(loop: PinocchioLoop, reference: Trajectory, ticks: int, rows: int) -> tuple[float, float]:
    """Seconds of one tick of the loop and of one row of the regressor, medians of three."""
    steps, columns = [], []
    for _ in range(3):
        begin = time.perf_counter()
        _, motion = loop.run(reference, ticks)
        steps.append((time.perf_counter() - begin) / ticks)
        begin = time.perf_counter()
        for k in range(rows):
            loop.regressor(motion[k, :6], motion[k, 6:12], motion[k, 12:])
        columns.append((time.perf_counter() - begin) / rows)
    return statistics.median(steps), statistics.median(columns)


def _solution_s(samples: int) -> float:
    """Seconds of one least squares problem of that size."""
    matrix = np.random.default_rng(0).normal(size=(6 * samples, 52))
    begin = time.perf_counter()
    np.linalg.lstsq(matrix, matrix[:, 0], rcond=None)
    return time.perf_counter() - begin
