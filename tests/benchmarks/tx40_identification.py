"""The TX40 identified as a whole, against the same work in Python with Pinocchio."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass

import numpy as np

from fmu_didim.signals import Trajectory
from tests.benchmarks import pinocchio_loop, tx40
from tests.benchmarks.counting import afresh, simulated
from tests.benchmarks.figure import Figure, Settings
from tests.benchmarks.pinocchio_loop import PinocchioLoop
from tests.benchmarks.tx40_simulation import model, pinocchio

GOAL = 400
"""How many times faster than Pinocchio's loop with differences."""
SECONDS = {5000: 4.0, 1000: 3.0}
"""Rate of the control in Hz -> within how many seconds an identification is wanted, on two cores."""
BIRDY_S = 1.0
"""What BIRDy's authors publish for one identification, about 1 s."""


def _alone(settings: Settings) -> list[Figure]:
    """Seconds of an identification as users start it."""
    figures = []
    for rate_hz, goal in SECONDS.items():
        here, estimator = model(settings.size(10, 4), rate_hz=rate_hz)
        rounds = []
        for again in range(1 + settings.size(3, 1, settings.repeats)):
            begin = time.perf_counter()
            estimator.estimate(afresh(here))
            rounds += [time.perf_counter() - begin] if again else []  # the first one compiles
        seconds = statistics.median(rounds)
        title = f"TX40 identification, warm, control at {rate_hz / 1000:g} kHz, seconds"
        figures.append(Figure(title, seconds, goal, "at most", {"best_s": min(rounds), "longest_s": max(rounds)}))
    return figures


def run(settings: Settings) -> list[Figure]:
    """Of 52 base parameters in seconds, and against the same work with Pinocchio."""
    return [*_alone(settings), *_against_pinocchio(settings)]


def _against_pinocchio(settings: Settings) -> list[Figure]:
    """52 base parameters from torque at 100 Hz with 0.05 N.m of noise; with the efficient finish and without."""
    if pinocchio_loop.pinocchio is None:
        title, note = "Pinocchio in Python / TX40 identification", "absent: pinocchio (package pin) cannot be loaded"
        return [Figure(title, None, GOAL, "at least", {}, note)]
    duration_s = settings.size(10, 4)  # less does not tell 52 parameters
    loop, figures = pinocchio(), []
    reference = tx40.excitation(duration_s=duration_s).trajectory(tx40.RATE_HZ)
    ticks, part = reference.time.size - 1, settings.size(2_000, 200)
    kinds: tuple[tuple[str, bool, dict[str, str]], ...] = (
        ("with the finish", True, {}),
        ("with the finish, from the reference", True, {"start": "reference"}),
        ("DIDIM alone, from the reference", False, {"start": "reference"}),
    )
    for label, finish, start in kinds:
        here, estimator = model(duration_s, finish=finish, **start)
        estimate, runs = simulated(here, estimator)  # warm, and counted
        samples, rounds = here.measured.shape[0], []
        before = _costs(loop, reference, part, min(samples, part))
        for _ in range(settings.size(1, 1, settings.repeats)):
            begin = time.perf_counter()
            estimator.estimate(afresh(here))
            rounds.append(time.perf_counter() - begin)
        ours = statistics.median(rounds)
        costs = before.mean_with(_costs(loop, reference, part, min(samples, part)))
        count = here.parameters.count
        solutions = len(estimate.iterations) * (samples * costs.row + _solution_s(samples))
        plain = ticks * sum(costs.tick(n) for n in runs.plain)
        differences = ticks * count * sum(costs.tick(n) for n in runs.varied)
        variations = ticks * sum(costs.varied_tick(n) for n in runs.varied)
        raw = {
            "ours_s": ours, "by_differences_s": plain + differences + solutions,
            "by_derivatives_s": plain + variations + solutions, "birdy_published_s": BIRDY_S,
            "simulations": float(len(runs.plain)), "with_derivatives": float(len(runs.varied)),
            "iterations": float(len(estimate.iterations)), "us_per_evaluation": 1e6 * costs.evaluation,
            "us_per_derivative": 1e6 * costs.variation, "us_per_row": 1e6 * costs.row,
        }  # fmt: skip
        note = f"substeps {runs.plain}, with derivatives {runs.varied}; {part} ticks of {ticks} measured and scaled"
        figures += [
            Figure(
                f"Pinocchio in Python, sensitivities by differences / TX40 identification, {label}",
                raw["by_differences_s"] / ours, GOAL if finish else None, "at least", raw, note,
            ),
            Figure(
                f"Pinocchio in Python with its derivatives / TX40 identification, {label}",
                raw["by_derivatives_s"] / ours, None, "at least", raw,
            ),
        ]  # fmt: skip
    return figures


@dataclass(frozen=True)
class _Costs:
    """Seconds of Pinocchio's side.

    Attributes:
        evaluation: of the direct model in the loop, the loop's own work included; variation: of its derivatives by all
            parameters; row: of the regressor at one sample.
    """

    evaluation: float
    variation: float
    row: float

    def mean_with(self, other: _Costs) -> _Costs:
        """The middle of two measurements, one before and one after ours, as the machine's speed drifts."""
        return _Costs(
            (self.evaluation + other.evaluation) / 2, (self.variation + other.variation) / 2, (self.row + other.row) / 2
        )

    def tick(self, substeps: int) -> float:
        """One tick by RK4, and the acceleration that is recorded."""
        return self.evaluation * (4 * substeps + 1)

    def varied_tick(self, substeps: int) -> float:
        """The same with the derivatives."""
        return self.tick(substeps) + self.variation * 4 * substeps


def _costs(loop: PinocchioLoop, reference: Trajectory, ticks: int, rows: int) -> _Costs:
    """Medians of three."""
    steps, columns, variations = [], [], []
    chosen, x, u = np.arange(52), np.zeros((12, 52)), np.zeros((6, 52))
    for _ in range(3):
        begin = time.perf_counter()
        torque, motion = loop.run(reference, ticks)
        steps.append((time.perf_counter() - begin) / (ticks * (4 * loop.substeps + 1)))
        begin = time.perf_counter()
        for k in range(rows):
            loop.regressor(motion[k, :6], motion[k, 6:12], motion[k, 12:])
        columns.append((time.perf_counter() - begin) / rows)
        begin = time.perf_counter()
        for k in range(rows):
            loop.variation(motion[k, :6], motion[k, 6:12], torque[k], x, u, chosen)
        variations.append((time.perf_counter() - begin) / rows)
    return _Costs(statistics.median(steps), statistics.median(variations), statistics.median(columns))


def _solution_s(samples: int) -> float:
    """Seconds of one least squares solution of that size."""
    matrix = np.random.default_rng(0).normal(size=(6 * samples, 52))
    begin = time.perf_counter()
    np.linalg.lstsq(matrix, matrix[:, 0], rcond=None)
    return time.perf_counter() - begin
