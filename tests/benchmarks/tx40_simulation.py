"""One simulation of the TX40 at 5 kHz against the bare evaluations of its direct model in C."""

from __future__ import annotations

import ctypes
import tempfile
from pathlib import Path

import numpy as np
from fmu_didim.prediction.problem import Problem

from fmu_didim.case import load_case
from fmu_didim.estimators import Estimator
from fmu_didim.master import simulate
from tests.benchmarks import tx40
from tests.benchmarks.c_program import doubles
from tests.benchmarks.figure import Figure, Settings, interleaved
from tests.benchmarks.pinocchio_loop import PinocchioLoop

LOG_HZ = 100


def problem(duration_s: float, **estimator: object) -> tuple[Problem, Estimator]:
    """The identification problem with torque at 100 Hz from the C program, and its estimator."""
    motion = tx40.excitation(duration_s=duration_s)
    ticks = np.arange(0, round(duration_s * tx40.RATE_HZ), tx40.RATE_HZ // LOG_HZ)
    torque = tx40.program(motion).runner(ticks)()[:, :6]
    noise = 0.05 * np.random.default_rng(1).normal(size=torque.shape)
    with tempfile.TemporaryDirectory() as name:
        case = load_case(
            tx40.write_case(Path(name), motion, ticks / tx40.RATE_HZ, torque + noise, **estimator),
        )
    assert case.problem is not None
    return case.problem, case.estimator


def run(settings: Settings) -> list[Figure]:
    """10 s at 5 kHz: RK4 with four substeps, and one output a tick."""
    duration_s = settings.size(10, 1)
    motion = tx40.excitation(duration_s=duration_s)
    loop = tx40.program(motion)
    here, _ = problem(duration_s)
    theta, ticks = here.parameters.nominal(), here.experiment.operator.ticks
    count = int(ticks[-1]) + 1
    every = loop.runner(np.arange(count))
    record = every()
    torque, states = np.ascontiguousarray(record[:, :6]), np.ascontiguousarray(record[:, 6:18])
    p, each = loop.plant.parameter_values, 4 * loop.substeps + 1
    evaluate = loop.library().evaluate
    evaluate.restype = ctypes.c_double
    arguments = (ctypes.c_longlong(count), ctypes.c_int(each), doubles(states), doubles(torque), doubles(p))
    whole = loop.runner(ticks)
    times = interleaved(
        {
            "ours": lambda: simulate(here.system_with(theta), here.experiment.reference, ticks=ticks),
            "evaluations": lambda: evaluate(*arguments),
            "program": whole,
        },
        repeats=settings.repeats,
    )
    raw = {f"{name}_ms": 1e3 * times.median(name) for name in ("ours", "evaluations", "program")}
    raw["us_per_evaluation"] = 1e6 * times.median("evaluations") / (count * each)
    return [
        Figure(
            "TX40 simulation, 5 kHz, 10 s / direct model alone in C", times.ratio("ours", "evaluations"), 1.5,
            "at most", raw, f"{count} ticks of {each} evaluations, {ticks.size} recorded; program: all in C",
        )
    ]  # fmt: skip


def pinocchio() -> PinocchioLoop:
    """The same loop in Python with Pinocchio."""
    block = tx40.read_controller(tx40.CONTROLLER)
    values = {v.name: v.start for v in block.parameters}
    gains = [[values[f"{name}{j}"] for j in range(1, 7)] for name in ("Kp", "Kd")]
    return PinocchioLoop(tx40.description(), (*gains, tx40.DRIVE_GAINS), 1 / tx40.RATE_HZ, tx40.SUBSTEPS)
