"""The data of a case, looked at before any work, by all verbs that fit to them."""

from __future__ import annotations

from fmu_didim.base.diagnostics import Diagnostic
from fmu_didim.case import Case
from fmu_didim.checks.data.checks import data_diagnostics


def case_diagnostics(case: Case, *, causes: bool = True) -> list[Diagnostic]:
    """What is wrong or doubtful with the data of a case, the most important first.

    Args:
        causes: see :func:`~fmu_didim.checks.data.checks.data_diagnostics`.
    """
    without = [label for label, run in case.document.runs.items() if run.torque is None]
    return data_diagnostics(case.model, without_torque=without, causes=causes)
