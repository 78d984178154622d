"""The TX40 identified as a whole, against the same work in Python with Pinocchio."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass

import numpy as np

from fmu_didim.data.signals import Trajectory
from tests.tools.benchmarks import pinocchio_loop, tx40
from tests.tools.benchmarks.counting import Simulated, afresh, simulated
from tests.tools.benchmarks.figure import Figure, Settings
from tests.tools.benchmarks.pinocchio_loop import PinocchioLoop
from tests.tools.benchmarks.tx40_simulation import LOG_HZ, model, pinocchio

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
    finer = _steps_of_rk4(duration_s)
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
        rest = len(estimate.iterations) * (samples * costs.row + _solution_s(samples))
        step_for_step, by_differences = (
            rest + costs.by_differences(runs, n, ticks, here.parameters.count) for n in (1, finer)
        )
        by_derivatives = rest + costs.by_derivatives(runs, finer, ticks)
        raw = {
            "ours_s": ours, "by_differences_s": by_differences, "step_for_step_s": step_for_step,
            "by_derivatives_s": by_derivatives, "birdy_published_s": BIRDY_S, "rk4_steps_for_one": float(finer),
            "simulations": float(len(runs.plain)), "with_derivatives": float(len(runs.varied)),
            "iterations": float(len(estimate.iterations)), "us_per_evaluation": 1e6 * costs.evaluation,
            "us_per_derivative": 1e6 * costs.variation, "us_per_row": 1e6 * costs.row,
        }  # fmt: skip
        title = f"TX40 identification, {label}"
        note = f"substeps {runs.plain}, with derivatives {runs.varied}; {part} ticks of {ticks} measured and scaled"
        figures += [
            Figure(f"Pinocchio in Python, {words} / {title}", theirs / ours, goal, "at least", raw, note)
            for words, theirs, goal in (
                ("sensitivities by differences", by_differences, GOAL if finish else None),
                ("the same with as many steps as ours, less accurate", step_for_step, None),
                ("with its derivatives", by_derivatives, None),
            )
        ]  # fmt: skip
    return figures


def _steps_of_rk4(duration_s: float) -> int:
    """The fewest steps of RK4 a tick whose torque is as accurate as one of ours: the same work for Pinocchio's loop."""
    motion = tx40.excitation(duration_s=duration_s)
    ticks = np.arange(0, round(duration_s * tx40.RATE_HZ), tx40.RATE_HZ // LOG_HZ)
    here, _ = model(duration_s)
    one, exact = (here.with_loop(substeps=n).torque(here.start) for n in (1, 32))
    count = 1
    while True:
        theirs = tx40.program(motion, substeps=count).runner(ticks)()[:, :6]
        if np.sqrt(np.mean((theirs - exact) ** 2)) <= np.sqrt(np.mean((one - exact) ** 2)):
            return count
        count += 1


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

    def by_differences(self, runs: Simulated, finer: int, ticks: int, parameters: int) -> float:
        """Seconds of the simulations, with so many steps of RK4 for one of ours; a further one for each parameter where
        there are derivatives."""
        return ticks * (
            sum(self._tick(finer * n) for n in runs.plain)
            + parameters * sum(self._tick(finer * n) for n in runs.varied)
        )

    def by_derivatives(self, runs: Simulated, finer: int, ticks: int) -> float:
        """The same with Pinocchio's derivatives."""
        return ticks * sum(
            (
                *(self._tick(finer * n) for n in (*runs.plain, *runs.varied)),
                *(4 * finer * n * self.variation for n in runs.varied),
            )
        )

    def _tick(self, steps: int) -> float:
        """Steps of RK4, and the acceleration that is recorded."""
        return self.evaluation * (4 * steps + 1)


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
