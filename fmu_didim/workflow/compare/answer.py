"""A result, and its log with its loop, as they are compared with others."""

from __future__ import annotations

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.discovery.change.answers import Answer
from fmu_didim.discovery.change.log_fit import LogFit
from fmu_didim.dynamics.effects import EFFECTS
from fmu_didim.dynamics.robot import RobotDescription
from fmu_didim.model.loop_model import LoopModel
from fmu_didim.workflow.output.result import Result


def answer_of(result: Result, source: str, place: str) -> Answer:
    """A result with the robot that it describes; source: where it was read; place: ``before``, ``after`` or a log."""
    try:
        robot = result.robot
    except FmuDidimError:  # an effect that is not there any more: values can still be compared
        robot = None
    return Answer(place, source, result.document, result.validations, robot)


def log_of(model: LoopModel, robot: RobotDescription | None) -> LogFit:
    """A log with its loop, from a model with identified values; robot: from which its plant was built."""
    return LogFit.of(model, robot, EFFECTS)


def why_no_effects(model: LoopModel) -> str:
    """Why a log tells nothing of effects; empty where it does."""
    why = ""
    if not model.loop.shows_torque or model.loop.torque_is_given:
        why = "no torque is measured in a closed loop"
    elif model.experiments.low_pass is not None:
        why = "the case has a low_pass"
    elif model.prior is not None:
        why = "the case has a prior"
    elif any(p.experiment is not None and not p.is_start for p in model.free_parameters):
        why = "single experiments have values of their own"
    elif any(experiment.is_unsigned for experiment in model.experiments.values()):
        why = "the log has no signs"
    return why
