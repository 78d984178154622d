"""FMUs in the loop: FMI 2.0 and 3.0, co-simulation and model exchange.

``component = load_fmu(path)`` is all most callers need; ``probe_fmu(component)`` tells how an FMU behaves.
"""

from fmu_didim.components.fmu.component import RESET_STRATEGY, SUBSTEPS, FmuComponent, load_fmu
from fmu_didim.components.fmu.description import FmuDescription, FmuVariable, Interface, read_description
from fmu_didim.components.fmu.probe import FmuProbe, probe_fmu

__all__ = [
    "RESET_STRATEGY",
    "SUBSTEPS",
    "FmuComponent",
    "FmuDescription",
    "FmuProbe",
    "FmuVariable",
    "Interface",
    "load_fmu",
    "probe_fmu",
    "read_description",
]
