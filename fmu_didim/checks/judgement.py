"""The judgement of an answer, the same for all verbs: whether it may be used, and the reasons if not."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from pydantic import Field

from fmu_didim.base.diagnostics import PROBLEM, REMARK, Diagnostic, by_weight
from fmu_didim.base.documents import Number, Saved

Verdict = Literal["valid", "doubtful", "not_settled", "refused"]


class DiagnosticResult(Saved):
    """A diagnostic as it is saved.

    Attributes:
        unit: FMI unit string of value and bound.
    """

    code: str = Field(description="stable name of its kind")
    place: str = Field(description="experiment, joint, parameter or file; empty where it is about all of them")
    text: str = Field(description="a sentence with the figures")
    value: Number = Field(description="the figure found, in the unit; null without one")
    bound: Number = Field(description="the figure it is compared with")
    unit: str
    next_step: str = Field(description="what to do about it")


@dataclass(frozen=True)
class Judgement:
    """Whether an answer may be used.

    Attributes:
        verdict: ``valid``; ``doubtful``, usable with the reasons in mind; ``not_settled``; ``refused``.
        reasons: why it is not valid, the most important first; remarks: further diagnostics.
    """

    verdict: Verdict
    reasons: tuple[Diagnostic, ...] = ()
    remarks: tuple[Diagnostic, ...] = ()

    def saved(self, case: str = "") -> list[DiagnosticResult]:
        """The reasons as they are saved; ``case``: its file, for the commands that they name."""
        return [diagnostic_result(reason, case) for reason in self.reasons]


def judgement(found: Iterable[Diagnostic], *, settled: bool = True) -> Judgement:
    """The judgement of an answer by its diagnostics; ``settled``: whether the iterations came to an end."""
    ordered = by_weight(found)
    reasons = tuple(d for d in ordered if d.code.severity is not REMARK)
    verdict: Verdict = "valid"
    if any(d.code.severity is PROBLEM for d in reasons):
        verdict = "refused"
    elif not settled:
        verdict = "not_settled"
    elif reasons:
        verdict = "doubtful"
    return Judgement(verdict, reasons, tuple(d for d in ordered if d.code.severity is REMARK))


CASE = "CASE.yaml"
"""Stands for the file of the case in the commands that diagnostics name."""


def diagnostic_result(found: Diagnostic, case: str = "") -> DiagnosticResult:
    """A diagnostic as it is saved; ``case``: file of the case, for the commands that it names."""
    return DiagnosticResult(
        code=found.code.name, place=found.place, text=found.text, value=found.value, bound=found.bound,
        unit=found.unit, next_step=found.advice.replace(CASE, case or CASE),
    )  # fmt: skip
