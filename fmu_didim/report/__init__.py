"""Saved results for people: a text for the terminal and one self-contained HTML page. Nothing is recomputed."""

from fmu_didim.report.identification.page import write_report
from fmu_didim.report.identification.table import result_table

__all__ = ["result_table", "write_report"]
