"""The doubts of a case that its user has checked."""

from __future__ import annotations

from collections.abc import Mapping

from fmu_didim.base.diagnostics import DOUBT
from fmu_didim.base.errors import InputError, UnknownNameError
from fmu_didim.case import Case


def acknowledged(case: Case) -> Mapping[str, str]:
    """Code -> sentence of the doubts that the user of a case has checked.

    Raises:
        UnknownNameError: there is no such code; InputError: it is no doubt, or the sentence is empty.
    """
    given = case.document.acknowledged
    if not given:
        return {}
    from fmu_didim.workflow.reference.codes import all_codes

    codes = {code.name: code for code in all_codes()}
    doubts = [name for name, code in codes.items() if code.severity is DOUBT]
    for name, sentence in given.items():
        if name not in codes:
            raise UnknownNameError("doubt", name, doubts, where=f"acknowledged.{name}")
        if name not in doubts:
            raise InputError(
                "Only a doubt can be acknowledged.", where=f"acknowledged.{name}",
                got=f"{name} is a {codes[name].severity.value}",
                next_step=codes[name].next_step or "Take it out: it does not affect the verdict.",
            )  # fmt: skip
        if not sentence.strip():
            raise InputError(
                "An acknowledged doubt needs a sentence.", where=f"acknowledged.{name}", got=repr(sentence),
                next_step="Say what was checked, and how: it stands in the result and in the report.",
            )  # fmt: skip
    return given
