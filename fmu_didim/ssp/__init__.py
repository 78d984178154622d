"""System Structure and Parameterization 1.0: a system of FMUs as an archive that other tools read, and back."""

from fmu_didim.ssp.read import read_ssp
from fmu_didim.ssp.values import ssv_text
from fmu_didim.ssp.write import write_ssp

__all__ = ["read_ssp", "ssv_text", "write_ssp"]
