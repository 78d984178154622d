"""The master: wiring, order and time of the loop, and what is recorded."""

from fmu_didim.master.interpreted import Observer
from fmu_didim.master.kept import KeptRecordings, response_key
from fmu_didim.master.pool import InstancePool
from fmu_didim.master.recording import Recording
from fmu_didim.master.sampling import Indices, SampleOperator, decimated_times, grid_places, sample_operator
from fmu_didim.master.simulation import simulate
from fmu_didim.master.splice import logged_torque, splice, splice_effect, splice_output
from fmu_didim.master.system import Connection, System, closed_loop

__all__ = [
    "Connection",
    "Indices",
    "InstancePool",
    "KeptRecordings",
    "Observer",
    "Recording",
    "SampleOperator",
    "System",
    "closed_loop",
    "decimated_times",
    "grid_places",
    "logged_torque",
    "response_key",
    "sample_operator",
    "simulate",
    "splice",
    "splice_effect",
    "splice_output",
]
