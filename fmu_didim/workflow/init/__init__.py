"""The verb ``init``: a commented case, with robot and controller, from the files that a user has."""

from fmu_didim.workflow.init.write import Started, start_case

__all__ = ["Started", "start_case"]
