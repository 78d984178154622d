"""EMPS at torque rates from 1 kHz to 4 Hz, from starts M = 20 ... 500 kg without friction.

Point samples in the middle of each period, then the spread over the other phases that a logger could have.
The force errors are those of the closed-loop simulation at 1 kHz.

    python examples/emps/torque_rates.py [--phases 10]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from fmu_didim.prediction.problem import Problem

from fmu_didim.case import Case, load_case
from fmu_didim.case.data import read_experiment
from fmu_didim.diagnosis.validation import validate
from fmu_didim.estimators import Didim
from fmu_didim.identification.estimate import Estimate
from fmu_didim.master import decimated_times, sample_operator

HERE = Path(__file__).parent
RATES_HZ = (1000.0, 100.0, 10.0, 4.0)
STARTS = (20.0, 60.0, 120.0, 250.0, 500.0)
PUBLISHED = np.array([95.1089, 203.5034, 20.3935, -3.1648])
"""M, Fv, Fc, offset by IDIM-LS: Janot, Gautier, Brunot, Data set and reference models of EMPS, 2019."""


@dataclass(frozen=True)
class Row:
    """One rate: the most iterations over the starts, the estimate, force errors in %."""

    rate_hz: float
    iterations: int
    estimate: Estimate
    estimation: float
    validation: float


def full_rate(case: Case) -> Problem:
    """The problem with the whole log of the estimation set; validation data come as they are."""
    source = case.document.train
    assert source.torque is not None
    torque = source.torque.model_copy(update={"rate_hz": None, "phase_s": 0.0})
    train = source.model_copy(update={"torque": torque})
    assert case.problem is not None
    experiment = read_experiment(
        train, case.folder, step=case.problem.system.step_size, drive_gains=case.document.loop.drive_gains,
        joint_count=1, label="train",
    )  # fmt: skip
    return case.problem.on(experiment)


def thinned(problem: Problem, rate_hz: float, phase_s: float) -> Problem:
    """Point samples of the log at phase + i / rate."""
    experiment, step = problem.experiment, problem.system.step_size
    start = float(experiment.reference.time[0])
    times = decimated_times(experiment.time, rate_hz, phase_s)
    operator = sample_operator(times, start=start, step=step, tick_count=experiment.reference.time.size)
    first = round((experiment.time[0] - start) / step)
    return problem.on(
        replace(experiment, time=times, torque=experiment.torque[operator.ticks - first], operator=operator)
    )


def errors(case: Case, problem: Problem, estimate: Estimate) -> tuple[float, float]:
    """Force error in % on the estimation and on the validation set."""
    assert case.validation is not None
    direct = validate(problem, estimate.base_value, problem.experiment, label="train")
    there = replace(problem, system=case.system(case.validation.reference))
    return direct.total_percent, validate(there, estimate.base_value, case.validation, label="validation").total_percent


def rows(case: Case, problem: Problem) -> list[Row]:
    """Every rate from every start."""
    found = []
    for rate in RATES_HZ:
        low = thinned(problem, rate, 0.0 if rate == 1000 else 0.5 / rate)
        estimates = [Didim(start={"M": mass}).estimate(low) for mass in STARTS]
        most = max(e.iteration_count for e in estimates)
        found.append(Row(rate, most, estimates[0], *errors(case, problem, estimates[0])))
    return found


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--phases", type=int, default=10, help="phases a rate, for the second table")
    options = parser.parse_args()
    case = load_case(HERE / "identify.yaml")
    problem = full_rate(case)
    head = f"{'Hz':>5}{'it.':>4}{'M, kg':>10}{'Fv':>9}{'Fc':>9}{'offset':>9}{'est. %':>8}{'val. %':>8}"
    print(f"{head}   off the published, %")
    for row in rows(case, problem):
        values = row.estimate.value
        off = "  ".join(f"{100 * (v / p - 1):+.2f}" for v, p in zip(values, PUBLISHED, strict=True))
        print(
            f"{row.rate_hz:5g}{row.iterations:4}{values[0]:10.3f}{values[1]:9.2f}{values[2]:9.3f}{values[3]:9.3f}"
            f"{row.estimation:8.3f}{row.validation:8.3f}   {off}"
        )
    print("\nOver the phases of the sampling: mean and standard deviation of each value; sigma that a log claims")
    for rate in RATES_HZ[1:]:
        count = min(options.phases, round(1000 / rate))
        runs = [Didim().estimate(thinned(problem, rate, k / count / rate)) for k in range(count)]
        values = np.array([e.value for e in runs])
        claimed = np.mean([e.standard_deviation for e in runs], axis=0)
        cells = "".join(
            f"{m:11.3f} ± {s:.3f} ({c:.3f})"
            for m, s, c in zip(values.mean(0), values.std(0, ddof=1), claimed, strict=True)
        )
        print(f"{rate:5g}{cells}")


if __name__ == "__main__":
    main()
