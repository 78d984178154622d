"""Saved results for people: a text for the terminal and one self-contained HTML page. Nothing is recomputed."""

from fmu_didim.report.identification.sections import result_table, write_report

__all__ = ["result_table", "write_report"]
