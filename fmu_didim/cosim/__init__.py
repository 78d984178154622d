"""The master: wiring, order and time of the loop, and its recording."""

from fmu_didim.cosim.execution.instance_pool import InstancePool
from fmu_didim.cosim.execution.running import Observer
from fmu_didim.cosim.insertion import (
    check_period,
    insert_after_output,
    insert_before_input,
    insert_effect,
    logged_torque,
    measured_output,
)
from fmu_didim.cosim.instants import Instants, period_change
from fmu_didim.cosim.recording import Columns, Recording
from fmu_didim.cosim.recording_cache import KeptRecordings, response_key
from fmu_didim.cosim.sampling import Indices, SampleOperator, decimated_times, grid_places, sample_operator
from fmu_didim.cosim.simulation import simulate
from fmu_didim.cosim.system import Connection, System, closed_loop

__all__ = [
    "Columns",
    "Connection",
    "Indices",
    "InstancePool",
    "Instants",
    "KeptRecordings",
    "Observer",
    "Recording",
    "SampleOperator",
    "System",
    "check_period",
    "closed_loop",
    "decimated_times",
    "grid_places",
    "insert_after_output",
    "insert_before_input",
    "insert_effect",
    "logged_torque",
    "measured_output",
    "period_change",
    "response_key",
    "sample_operator",
    "simulate",
]
