"""The verbs of the Python API, one module each: identify, discover, simulate, export, and the files they write."""

from fmu_didim.workflow.discover import discover
from fmu_didim.workflow.export import export_ssp
from fmu_didim.workflow.identify import ROBOT_FILE, Outcome, identify
from fmu_didim.workflow.simulate import simulate_case

__all__ = ["ROBOT_FILE", "Outcome", "discover", "export_ssp", "identify", "simulate_case"]
