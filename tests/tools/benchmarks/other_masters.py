"""The cheap FMUs in other masters, where those are installed: seconds for a number of steps in one batch.

Each steps in its own order and records nothing, which favours it.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from fmu_didim.components import load_fmu
from tests.tools.benchmarks.cheap_fmus import STEP_S, files

Batch = Callable[[int], float]


def libcosim() -> Batch | str:
    """Steps of libcosim by libcosimpy, or why there are none."""
    try:
        from libcosimpy.CosimExecution import CosimExecution
        from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
        from libcosimpy.CosimSlave import CosimLocalSlave
    except (ImportError, OSError) as error:
        return f"absent: libcosimpy cannot be loaded ({error})"
    log_output_level(CosimLogLevel.ERROR)
    execution = CosimExecution.from_step_size(round(STEP_S * 1e9))
    a, b = (
        execution.add_local_slave(CosimLocalSlave(str(path), name)) for path, name in zip(files(), "ab", strict=True)
    )
    one, two = (load_fmu(path) for path in files())
    execution.connect_real_variables(b, two.output_references[0], a, one.input_references[1])
    execution.connect_real_variables(a, one.output_references[0], b, two.input_references[0])

    def steps(count: int) -> float:
        begin = time.perf_counter()
        if not execution.step(step_count=count):
            raise RuntimeError("libcosim refused a step")
        return time.perf_counter() - begin

    return steps


def ecos() -> Batch | str:
    """Steps of ecos by ecospy, or why there are none."""
    try:
        from ecospy import EcosSimulation, EcosSimulationStructure
    except (ImportError, OSError) as error:
        return f"absent: ecospy cannot be loaded ({error})"
    structure = EcosSimulationStructure()
    for path, name in zip(files(), "ab", strict=True):
        structure.add_model(name, str(path))
    structure.make_real_connection("b::y", "a::v")
    structure.make_real_connection("a::y", "b::u")
    simulation = EcosSimulation(structure=structure, step_size=STEP_S)
    simulation.init()

    def steps(count: int) -> float:
        begin = time.perf_counter()
        simulation.step(count)
        return time.perf_counter() - begin

    return steps
