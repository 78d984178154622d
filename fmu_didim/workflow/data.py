"""The data of a case, looked at before any work, by all verbs that fit to them."""

from __future__ import annotations

from fmu_didim.case import Case
from fmu_didim.diagnosis.data.checks import data_diagnostics
from fmu_didim.diagnostics import Diagnostic
from fmu_didim.prediction.loop_model import LoopModel


def case_diagnostics(case: Case, model: LoopModel) -> list[Diagnostic]:
    """What is wrong or doubtful with the data of a case, the weightiest first.

    Args:
        model: the loop of the case, with all that is free in it.
    """
    runs = case.document.runs
    return data_diagnostics(model, without_torque=[label for label, run in runs.items() if run.torque is None])
