"""One simulation of the TX40 at 5 kHz against the bare evaluations of its direct model in C that RK4 would take."""

from __future__ import annotations

import ctypes
import tempfile
from pathlib import Path

import numpy as np

from fmu_didim.case import load_case
from fmu_didim.cosim import simulate
from fmu_didim.estimators import Estimator
from fmu_didim.model.loop_model import LoopModel
from tests.tools.benchmarks import tx40
from tests.tools.benchmarks.c_program import doubles
from tests.tools.benchmarks.figure import Figure, Settings, interleaved
from tests.tools.benchmarks.pinocchio_loop import PinocchioLoop

LOG_HZ = 100


def model(duration_s: float, *, rate_hz: int = tx40.RATE_HZ, **estimator: object) -> tuple[LoopModel, Estimator]:
    """The loop with torque at 100 Hz from the C program, and its estimator; the control runs at ``rate_hz``."""
    motion = tx40.excitation(duration_s=duration_s)
    ticks = np.arange(0, round(duration_s * rate_hz), rate_hz // LOG_HZ)
    controller = tx40.CONTROLLERS[rate_hz]
    substeps = tx40.SUBSTEPS * (tx40.RATE_HZ // rate_hz) ** 2  # friction needs steps far shorter than those of a loop
    torque = tx40.program(motion, controller=controller, substeps=substeps).runner(ticks)()[:, :6]
    noise = 0.05 * np.random.default_rng(1).normal(size=torque.shape)
    with tempfile.TemporaryDirectory() as name:
        case = load_case(
            tx40.write_case(Path(name), motion, ticks / rate_hz, torque + noise, controller=controller, **estimator),
        )
    assert case.model is not None
    return case.model, case.estimator


def run(settings: Settings) -> list[Figure]:
    """10 s at 5 kHz: one and two linearly implicit steps a tick, against four evaluations a tick, one step of RK4."""
    duration_s = settings.size(10, 1)
    motion = tx40.excitation(duration_s=duration_s)
    loop = tx40.program(motion)
    here, _ = model(duration_s)
    reference, ticks = here.experiments[here.first].reference, here.simulation(here.start).operator.ticks
    count = int(ticks[-1]) + 1
    every = loop.runner(np.arange(count))
    record = every()
    torque, states = np.ascontiguousarray(record[:, :6]), np.ascontiguousarray(record[:, 6:18])
    p, each = loop.plant.parameter_values, 4
    evaluate = loop.library().evaluate
    evaluate.restype = ctypes.c_double
    arguments = (ctypes.c_longlong(count), ctypes.c_int(each), doubles(states), doubles(torque), doubles(p))
    systems = {n: here.with_loop(substeps=n).system(here.start) for n in (1, 2)}
    torques = {n: here.with_loop(substeps=n).torque(here.start) for n in (1, 2, 32)}
    size = np.sqrt(np.mean(torques[32] ** 2, axis=0))
    errors = {n: float(np.max(np.sqrt(np.mean((torques[n] - torques[32]) ** 2, axis=0)) / size)) for n in (1, 2)}
    times = interleaved(
        {
            "one": lambda: simulate(systems[1], reference, ticks=ticks),
            "two": lambda: simulate(systems[2], reference, ticks=ticks),
            "evaluations": lambda: evaluate(*arguments),
            "program": loop.runner(ticks),
        },
        repeats=settings.repeats,
    )
    raw = {f"{name}_ms": 1e3 * times.median(name) for name in ("one", "two", "evaluations", "program")}
    raw |= {"error_of_one": errors[1], "error_of_two": errors[2]}
    raw["us_per_evaluation"] = 1e6 * times.median("evaluations") / (count * each)
    note = (
        f"{count} ticks of {each} evaluations, {ticks.size} recorded; program: RK4 with {loop.substeps} steps, all in C"
    )
    return [
        Figure(
            f"TX40 simulation, 5 kHz, 10 s, {words} a tick / four evaluations of its direct model in C",
            times.ratio(name, "evaluations"), goal, "at most", raw, f"error {error:.1e} of the torque; {note}",
        )
        for name, words, goal, error in (("one", "one step", 0.6, errors[1]), ("two", "two steps", None, errors[2]))
    ]  # fmt: skip


def pinocchio() -> PinocchioLoop:
    """The same loop in Python with Pinocchio."""
    block = tx40.read_controller(tx40.CONTROLLER)
    values = {v.name: v.start for v in block.parameters}
    gains = [[values[f"{name}{j}"] for j in range(1, 7)] for name in ("Kp", "Kd")]
    return PinocchioLoop(tx40.description(), (*gains, tx40.DRIVE_GAINS), 1 / tx40.RATE_HZ, tx40.SUBSTEPS)
