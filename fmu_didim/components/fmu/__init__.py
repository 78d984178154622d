"""FMUs in the loop: FMI 2.0 and 3.0 for co-simulation and model exchange, FMI 1.0 for co-simulation.

``component = load_fmu(path)`` is all most callers need; ``probe_fmu(component)`` reports how an FMU behaves.
"""

from fmu_didim.components.fmu.component import FmuComponent
from fmu_didim.components.fmu.inspection.info import info_lines
from fmu_didim.components.fmu.inspection.probe import FmuProbe, probe_fmu
from fmu_didim.components.fmu.load import load_fmu
from fmu_didim.components.fmu.reading import read_description

__all__ = ["FmuComponent", "FmuProbe", "info_lines", "load_fmu", "probe_fmu", "read_description"]
