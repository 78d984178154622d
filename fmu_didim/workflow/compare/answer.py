"""A result as it is compared with others."""

from __future__ import annotations

from fmu_didim.base.errors import FmuDidimError
from fmu_didim.discovery.change.answers import Answer
from fmu_didim.workflow.output.result import Result


def answer_of(result: Result, source: str, place: str) -> Answer:
    """A result with the robot that it describes; source: where it was read; place: ``before``, ``after`` or a log."""
    try:
        robot = result.robot
    except FmuDidimError:  # an effect that is not there any more: values can still be compared
        robot = None
    return Answer(place, source, result.document, result.validations, robot)
