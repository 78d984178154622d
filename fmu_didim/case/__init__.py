"""Cases: YAML files that say what to identify from which data."""

from fmu_didim.case.arrays import Inputs, Log, Measured, Reference
from fmu_didim.case.build import Case, case_of, load_case
from fmu_didim.case.changes import CaseObjects, CaseParts, with_objects
from fmu_didim.case.document import CaseDocument, read_case

__all__ = [
    "Case",
    "CaseDocument",
    "CaseObjects",
    "CaseParts",
    "Inputs",
    "Log",
    "Measured",
    "Reference",
    "case_of",
    "load_case",
    "read_case",
    "with_objects",
]
