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

from fmu_didim.case import Case, load_case
from fmu_didim.case.runs.experiment import read_experiment
from fmu_didim.checks.validation import validate_on
from fmu_didim.cosim import decimated_times, sample_operator
from fmu_didim.estimators import Didim
from fmu_didim.fit.estimate import Estimate
from fmu_didim.model.loop_model import LoopModel

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


def full_rate(case: Case) -> LoopModel:
    """The model with the whole log of the estimation set; validation data come as they are."""
    model, source = case.model, case.document.runs["estimation"]
    assert model is not None and source.torque is not None
    torque = source.torque.model_copy(update={"rate_hz": None, "phase_s": 0.0})
    train = source.model_copy(update={"torque": torque})
    experiment = read_experiment(
        train, case.folder, step=case.step_size, drive_gains=case.document.loop.drive_gains,
        torque_units=model.parameters.torque_units, label="estimation",
    )  # fmt: skip
    return model.with_experiment("estimation", experiment)


def thinned(model: LoopModel, rate_hz: float, phase_s: float) -> LoopModel:
    """Point samples of the log at phase + i / rate."""
    experiment, step = model.experiments["estimation"], model.loop.systems["estimation"].step_size
    start = float(experiment.reference.time[0])
    times = decimated_times(experiment.time, rate_hz, phase_s)
    operator = sample_operator(times, start=start, step=step, tick_count=experiment.reference.time.size)
    first = round((experiment.time[0] - start) / step)
    torque = experiment.torque[operator.ticks - first]
    return model.with_experiment("estimation", replace(experiment, time=times, torque=torque, operator=operator))


def errors(model: LoopModel, estimate: Estimate) -> tuple[float, float]:
    """Force error in % on the estimation and on the validation set."""
    direct, cross = (validate_on(model, estimate.base_value, label) for label in ("estimation", "validation"))
    return direct.total_percent, cross.total_percent


def rows(model: LoopModel) -> list[Row]:
    """Every rate from every start."""
    found = []
    for rate in RATES_HZ:
        low = thinned(model, rate, 0.0 if rate == 1000 else 0.5 / rate)
        estimates = [Didim(start={"M": mass}).estimate(low) for mass in STARTS]
        most = max(e.iteration_count for e in estimates)
        found.append(Row(rate, most, estimates[0], *errors(model, estimates[0])))
    return found


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--phases", type=int, default=10, help="phases a rate, for the second table")
    options = parser.parse_args()
    model = full_rate(load_case(HERE / "identify.yaml"))
    head = f"{'Hz':>5}{'it.':>4}{'M, kg':>10}{'Fv':>9}{'Fc':>9}{'offset':>9}{'est. %':>8}{'val. %':>8}"
    print(f"{head}   off the published, %")
    for row in rows(model):
        values = row.estimate.value
        off = "  ".join(f"{100 * (v / p - 1):+.2f}" for v, p in zip(values, PUBLISHED, strict=True))
        print(
            f"{row.rate_hz:5g}{row.iterations:4}{values[0]:10.3f}{values[1]:9.2f}{values[2]:9.3f}{values[3]:9.3f}"
            f"{row.estimation:8.3f}{row.validation:8.3f}   {off}"
        )
    print("\nOver the phases of the sampling: mean and standard deviation of each value; sigma that a log claims")
    for rate in RATES_HZ[1:]:
        count = min(options.phases, round(1000 / rate))
        runs = [Didim().estimate(thinned(model, rate, k / count / rate)) for k in range(count)]
        values = np.array([e.value for e in runs])
        claimed = np.mean([e.standard_deviation for e in runs], axis=0)
        cells = "".join(
            f"{m:11.3f} ± {s:.3f} ({c:.3f})"
            for m, s, c in zip(values.mean(0), values.std(0, ddof=1), claimed, strict=True)
        )
        print(f"{rate:5g}{cells}")


if __name__ == "__main__":
    main()
