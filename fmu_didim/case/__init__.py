"""Cases: YAML files that say what to identify from which data."""

from fmu_didim.case.build import Case, load_case
from fmu_didim.case.document import CaseDocument, read_case

__all__ = ["Case", "CaseDocument", "load_case", "read_case"]
