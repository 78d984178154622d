"""The master: wiring, order and time of the loop, and what is recorded."""

from fmu_didim.master.sampling import SampleOperator, decimated_times, sample_operator
from fmu_didim.master.simulation import Observer, Recording, simulate
from fmu_didim.master.system import Connection, System, closed_loop

__all__ = [
    "Connection",
    "Observer",
    "Recording",
    "SampleOperator",
    "System",
    "closed_loop",
    "decimated_times",
    "sample_operator",
    "simulate",
]
