"""The closed loop of the SCARA: two FMUs in our master against one C program."""

from __future__ import annotations

import numpy as np

from fmu_didim.cosim import Recording, simulate
from fmu_didim.model.loop_model import LoopModel
from tests.tools.benchmarks import scara
from tests.tools.benchmarks.figure import Figure, Settings, interleaved


def ours(model: LoopModel, values: np.ndarray, ticks: np.ndarray) -> Recording:
    """One simulation as an identification makes it: by instances that have run before, from other values."""
    return simulate(model.system(values), model.experiments[model.first].reference, ticks=ticks, pool=model.pool)


def run(settings: Settings) -> list[Figure]:
    """10 s at 200 Hz, every tick recorded, from parameters to recording."""
    model = scara.model()
    ticks = np.arange(settings.size(model.experiments[model.first].reference.time.size, 200), dtype=np.int64)
    program = scara.program(model.start).runner(ticks)
    times = interleaved(
        {"ours": lambda: ours(model, model.start, ticks), "c": program}, repeats=settings.size(4, 1) * settings.repeats
    )
    return [
        Figure(
            "SCARA loop, 200 Hz, 10 s / one C program", times.ratio("ours", "c"), 1.3, "at most",
            {"ours_ms": 1e3 * times.median("ours"), "c_program_ms": 1e3 * times.median("c")},
            f"{ticks.size} ticks, every one recorded; ours with the change of the parameters, as in an identification",
        )
    ]  # fmt: skip
