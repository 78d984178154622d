"""Reports of saved results for the terminal, notebooks and a self-contained HTML page; nothing is recomputed."""

from fmu_didim.report.identification.sections import result_page, result_table, write_report

__all__ = ["result_page", "result_table", "write_report"]
