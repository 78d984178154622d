"""The data and the plant of a case, checked before any work by all verbs that fit to them."""

from __future__ import annotations

from fmu_didim.base.diagnostics import DiagnosedError, Diagnostic, by_weight
from fmu_didim.case import Case
from fmu_didim.checks.data.checks import data_diagnostics
from fmu_didim.checks.outputs.data import model_data_diagnostics
from fmu_didim.checks.outputs.words import of_a_model
from fmu_didim.checks.plant.consistency import Consistency, check_consistency, plant_diagnostics
from fmu_didim.checks.plant.influence import check_parameter_influence
from fmu_didim.checks.plant.reading import reading_diagnostics
from fmu_didim.checks.plant.start import start_diagnostics
from fmu_didim.model.loop_model import LoopModel


def case_diagnostics(case: Case, model: LoopModel | None = None, *, causes: bool = True) -> list[Diagnostic]:
    """Problems and doubts about the data of a case, the most important first.

    Args:
        model: of the case, with a part of its logs; with all of them by default.
        causes: see :func:`~fmu_didim.checks.data.checks.data_diagnostics`.
    """
    without = [label for label, run in case.document.runs.items() if run.torque is None]
    stated = [name for name, source in case.document.parts.items() if source.outputs_after_step is not None]
    of_reading = reading_diagnostics(case.model.loop.systems[case.model.first], stated)
    if case.data is not None:
        return by_weight(of_a_model([*model_data_diagnostics(case.model), *of_reading]))
    return by_weight([*data_diagnostics(model or case.model, without_torque=without, causes=causes), *of_reading])


def check_plant(case: Case, model: LoopModel) -> tuple[Consistency | None, list[Diagnostic]]:
    """How a plant with a source of its own compares with the robot description, and what is wrong with it.

    Nothing where the plant is built from the description.
    """
    if case.document.plant_source is None and case.base is None:
        return None, []
    if case.data is not None:
        return None, of_a_model(_of_influence(model))
    consistency = check_consistency(model) if model.parameters.has_regressor else None
    found = [*plant_diagnostics(consistency), *_of_influence(model)]
    return consistency, [*found, *start_diagnostics(model)]


def _of_influence(model: LoopModel) -> list[Diagnostic]:
    """Parameters that do nothing."""
    try:
        check_parameter_influence(model)
    except DiagnosedError as error:
        return error.found
    return []
