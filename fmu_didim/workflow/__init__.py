"""The verbs of the Python API, one module each, and what they return."""

from fmu_didim.workflow.check import Checked, check
from fmu_didim.workflow.compare import Compared, compare
from fmu_didim.workflow.discover import discover
from fmu_didim.workflow.excitation.excite import excite
from fmu_didim.workflow.excitation.excited import Excited
from fmu_didim.workflow.export import export_ssp
from fmu_didim.workflow.identify import identify
from fmu_didim.workflow.naming.named import NamedController
from fmu_didim.workflow.naming.verb import name_controller
from fmu_didim.workflow.output.discovered import Discovered
from fmu_didim.workflow.output.result import Result
from fmu_didim.workflow.simulate import simulate
from fmu_didim.workflow.watch import Watched, watch

__all__ = [
    "Checked", "Compared", "Discovered", "Excited", "NamedController", "Result", "Watched", "check", "compare",
    "discover", "excite", "export_ssp", "identify", "name_controller", "simulate", "watch",
]  # fmt: skip
