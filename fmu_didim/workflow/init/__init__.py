"""The verb ``init``: a commented case, with robot and controller, from the files that a user has."""

from fmu_didim.workflow.init.write import start_case

__all__ = ["start_case"]
