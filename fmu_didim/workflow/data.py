"""The data and the plant of a case, checked before any work by all verbs that fit to them."""

from __future__ import annotations

import string
from collections.abc import Callable
from functools import cached_property, partial
from typing import TypeVar

from fmu_didim.base.diagnostics import DiagnosedError, Diagnostic, by_weight, refuse_problems
from fmu_didim.case import Case
from fmu_didim.case.sources import SignalFile
from fmu_didim.checks.data.checks import data_diagnostics, without_outliers
from fmu_didim.checks.outputs.data import model_data_diagnostics
from fmu_didim.checks.outputs.words import of_a_model
from fmu_didim.checks.plant.consistency import Consistency, check_consistency, plant_diagnostics
from fmu_didim.checks.plant.gear_ratios import Brought, brought_by, gear_ratio_diagnostics
from fmu_didim.checks.plant.influence import check_parameter_influence
from fmu_didim.checks.plant.reading import reading_diagnostics
from fmu_didim.checks.plant.start import start_diagnostics
from fmu_didim.dynamics.effects import Motor
from fmu_didim.dynamics.robot import RobotModel
from fmu_didim.estimators import Progress
from fmu_didim.fit.iteration import Iteration
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.model.workers import Beside

_Result = TypeVar("_Result")


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
    of_data = data_diagnostics(model or case.model, without_torque=without, causes=causes)
    return by_weight([*of_data, *of_reading, *_of_motors(case)])


def stated_motors(case: Case) -> dict[int, Motor]:
    """Joint, from 1 -> its motor, where the robot description of a case states one."""
    robot = getattr(case.parameters, "model", None)
    joints = robot.description.joints if isinstance(robot, RobotModel) else ()
    return {j: joint.motor for j, joint in enumerate(joints, start=1) if joint.motor is not None}


def _of_motors(case: Case) -> list[Diagnostic]:
    """Whether the motors of the description are those by which the logs are brought to the joints."""
    stated = {j: motor.gear_ratio for j, motor in stated_motors(case).items()}
    files = (s for r in case.document.runs.values() for s in (r.reference, r.torque, r.positions)) if stated else ()
    brought = list[Brought]()
    for source in files:
        if not isinstance(source, SignalFile):
            continue
        if source.motors is not None:
            brought += brought_by(f"motors: of {source.file}", source.motors)
        for signal, column in source.columns.items():
            number = signal.lstrip(string.ascii_letters)
            if column.gear_ratio is not None and number.isdecimal():
                brought.append(Brought(f"gear_ratio: of {signal} in {source.file}", int(number), column.gear_ratio))
    return gear_ratio_diagnostics(stated, brought)


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


class DataBeside:
    """The checks of the data of a case, beside its estimation where a copy of this process can make them.

    What comes of it is as if they had been made before: no iteration is told until the data are found to be right;
    where they are not, the estimation ends with its next iteration, and whatever it came to is left.

    Args:
        part: of the model of the case, with the stretches of long logs that are judged; None: all samples.
        progress: is called with each iteration.
    """

    def __init__(self, case: Case, part: LoopModel | None, progress: Progress) -> None:
        self._model, self._progress, self._held = case.model, progress, list[Iteration]()
        self._beside = Beside(partial(case_diagnostics, case, part), 1 if part is not None else _workers(case))

    @cached_property
    def _cleaned(self) -> tuple[LoopModel, list[Diagnostic]]:
        return without_outliers(self._model, refuse_problems(self._beside.result()))

    @property
    def model(self) -> LoopModel:
        """The model that is fitted: without the outliers that the case leaves out, for which the checks are waited."""
        return self._cleaned[0] if self._beside.is_done else self._model

    def found(self) -> list[Diagnostic]:
        """What is found, the most important first; raises DiagnosedError where a problem is."""
        return self._cleaned[1]

    def ahead(self, work: Callable[[], _Result]) -> _Result:
        """What comes of work that does not wait for the checks; a problem of the data comes before all that it
        raises."""
        try:
            return work()
        except Exception:
            self.found()
            raise

    def progress(self, iteration: Iteration) -> None:
        """Tell an iteration once the data are known to be right; raises DiagnosedError where they are not."""
        self._held.append(iteration)
        if self._beside.is_done:
            self.tell()

    def tell(self) -> None:
        """Tell the iterations that were held back; raises DiagnosedError where the data are not right."""
        self.found()
        held, self._held = self._held, []
        for iteration in held:
            self._progress(iteration)


def _workers(case: Case) -> int:
    """How many processes may look at a case at once: one where the estimation needs to know what is found, or makes
    processes of its own."""
    model = case.model
    if case.document.search is not None or any(e.leaves_out_outliers for e in model.experiments.values()):
        return 1
    return model.workers_from_start
